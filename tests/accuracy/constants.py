"""What the daemon's constants do: `make constants` writes docs/maintainers/constants.md.

Each one is halved and doubled in a copy of the sources. Of those that decide how accurate an
estimate is, the daemon of that copy is measured on simulated scenes; of those that decide about
sequences of frames, the unit tests say which of them notice.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import page
import report
from lightprobe.evaluate import evaluation, metrics, offline
from lightprobe.evaluate.evaluation import Input
from lightprobe.sim import scenes

ROOT = Path(__file__).resolve().parents[2]
COPIES = ROOT / "build/constants"
PAGE = ROOT / "docs/maintainers/constants.md"
COPIED = ("Makefile", "daemon", "proto", "packaging", "tests", "host_py", "firmware", "hw",
          "docs/docs.mk", "clients/clients.mk",
          "build/gen", "build/release", "build/stamps")  # fmt: skip


@dataclass(frozen=True)
class Constant:
    """A number in the sources, and what is tried in its place."""

    path: str
    name: str
    tried: tuple[float, ...] = ()  # none: half and double

    @property
    def title(self) -> str:
        """Name and place."""
        return f"`{self.name.lstrip('.')}`, {self.path}"

    @property
    def pattern(self) -> re.Pattern[str]:
        """The number, between what stands before and after it."""
        name = re.escape(self.name)
        return re.compile(rf"(#define {name}\s+\(?|{name} = )([-\d.e]+)(F?)")

    def find(self, text: str) -> str:
        """Its value as it is written; SystemExit when it is not there once."""
        found = self.pattern.findall(text)
        if len(found) != 1:
            raise SystemExit(f"constants: {self.path}: {self.name} stands there {len(found)} times")
        return str(found[0][1])

    def replace(self, text: str, value: str) -> str:
        """The text with another value."""
        return self.pattern.sub(rf"\g<1>{value}\g<3>", text)

    def others(self, present: str) -> Iterator[str]:
        """What to try, written as the present value is."""
        whole = re.fullmatch(r"-?\d+", present)
        for value in self.tried or (float(present) / 2, float(present) * 2):
            yield str(round(value)) if whole else repr(float(value))


#: Measured on scenes.
ACCURACY = (
    Constant("light/find/detection.c", ".floor_ratio"),
    Constant("light/find/detection.c", ".area_sr"),
    Constant("light/find/detection.h", "LP_PEAK_STANDS_OUT", (1.2, 3.2)),
    Constant("light/find/detection.c", ".core_ratio"),
    Constant("light/find/detection.c", ".min_strength"),
    Constant("light/find/detection.c", ".min_contrast", (1.2, 4.0)),
    Constant("light/find/lamps.c", "RIM_FACTOR"),
    Constant("light/find/lamps.c", "RING_CELLS"),
    Constant("light/find/lamps.c", "MAX_RING_CELLS"),
    Constant("vision/lamp/refine.c", "CAMERA_SIGMA"),
    Constant("vision/lamp/refine.c", "CORE_SHARE"),
    Constant("vision/lamp/refine.c", "DECODED_SHARE"),
    Constant("vision/lamp/refine.c", "LEAST_SIGMA_PX"),
    Constant("vision/lamp/refine.c", "MOST_SPACING"),
    Constant("vision/lamp/refine.c", "MOST_THINNED"),
    Constant("vision/camera/response.c", "CURVATURE_CODES"),
    Constant("vision/camera/response.c", "FADE_FROM", (180.0, 235.0)),
    Constant("vision/camera/response.c", "FADE_TO", (230.0, 254.0)),
    Constant("vision/picture/tile.cpp", "kLeastVariance"),
)


#: Tested with sequences of frames, by these unit tests.
SEQUENCES = {
    "bracket pipeline": [
        Constant("estimate/exposures/bracket.c", name)
        for name in (
            "MOST_DELAY_FRAMES", "MOST_MISSES", "RETRY_FRAMES",
            "TRUSTED_CHANGES", "MOST_STRANGE", "FIT_CODES", "CLEARLY", "LEAST_CODES",
            "REPLAN_STOPS", "FIRST_US",
        )
    ] + [
        Constant("estimate/exposures/bracket_plan.c", name)
        for name in (
            "MEDIAN_AT", "PEAK_HIGH", "STOPS_ALONE", "STOPS_APART", "LEAST_US", "MOST_US",
        )
    ] + [
        Constant("estimate/exposures/bracket_plan.h", "LP_BRACKET_PEAK_LOW"),
    ],
    "imager bracket pipeline": [
        Constant("vision/doubt/match.c", "STEP"),
        Constant("vision/doubt/match.c", "LEAST_LINEAR"),
        Constant("vision/eye.c", "SAME_EXPOSURE", (1.1, 2.8)),
        Constant("vision/eye.c", "BRACKETS_REMEMBERED"),
    ],
    "tracker": [Constant("light/send/tracker.c", "LEAST_SHARE")],
    "lamp_memory pipeline": [
        Constant("estimate/lamp_stage.c", "BEFORE_S"),
        Constant("light/lamps/lamp_memory.c", "CAME_SHARE"),
        Constant("light/lamps/lamp_memory.c", "STAYS_APART", (0.6, 1.0)),
    ],
    "existence lamp_memory holding": [
        Constant("light/lamps/existence.c", name)
        for name in (
            "CERTAIN", "LAMPS_PER_S", "FIRST_S", "MISSED_PER_S", "PRIOR_PER_S",
            "PRIOR_STAY_S", "PRIOR_S", "CLUTTER_S",
        )
    ],
    "listing": [Constant("light/send/listing.c", "COST_OF_CHANGE_S")],
    "model": [Constant("light/send/model.h", "LP_SHADOW_SHARE")],
    "pipeline": [
        Constant("estimate/pipeline_estimate.c", "DARK_CODE"),
        Constant("estimate/pipeline_state.h", "LP_LEAST_CLIPPED_FRACTION"),
    ],
    "governor": [
        Constant("app/run/governor.c", "MOST_LATE"),
        Constant("app/run/governor.c", "SPARE"),
        Constant("app/run/governor.c", "FIRST_PATIENCE"),
        Constant("app/run/governor.c", "MOST_PATIENCE"),
    ],
}  # fmt: skip


class Tree:
    """A copy of the sources to change, with what is built already."""

    def __init__(self, name: str) -> None:
        """Copy it."""
        self.root = COPIES / name
        shutil.rmtree(self.root, ignore_errors=True)
        self.root.mkdir(parents=True)
        for path in COPIED:
            (self.root / path).parent.mkdir(parents=True, exist_ok=True)
            subprocess.run(["cp", "-a", ROOT / path, self.root / path], check=True)
        (self.root / "build/venv").symlink_to(ROOT / "build/venv")

    def build(self, *targets: str) -> None:
        """Raises CalledProcessError."""
        make = [
            "make",
            "-s",
            "-C",
            str(self.root),
            f"-j{os.cpu_count()}",
            "VARIANT=release",
        ]
        subprocess.run([*make, *targets], check=True, stdout=subprocess.DEVNULL)

    def changed(self, constant: Constant) -> Iterator[tuple[str, str]]:
        """Put other values in the constant's place, one after the other: (present, tried)."""
        path = self.root / "daemon" / constant.path
        original = path.read_text()
        present = constant.find(original)
        try:
            for value in constant.others(present):
                path.write_text(constant.replace(original, value))
                yield present, value
        finally:
            path.write_text(original)


@dataclass(frozen=True)
class Shot:
    """Frames of one scene in a folder, and the truth."""

    folder: Path
    exposures_us: list[float]
    truth: metrics.Reference


def shoot(name: str, how: str, folder: Path) -> list[Shot]:
    """Frames of scenes, made once for all daemons."""
    studio, shots = evaluation.Studio(), []
    for number, scene in enumerate(scenes.load([name])):
        place = folder / f"{name}-{how}-{number}"
        place.mkdir(parents=True)
        exposures_us = studio.shoot(scene, Input.parse(how), place)
        shots.append(Shot(place, exposures_us, evaluation.reference(scene)))
    return shots


def score(shots: list[Shot]) -> tuple[metrics.Summary, float]:
    """Of the tree's daemon; and how many lights it lists, in the mean."""
    estimates = [
        offline.estimate_folder(shot.folder, shot.exposures_us, offline.Settings())
        for shot in shots
    ]
    scores = [shot.truth.score(estimate) for shot, estimate in zip(shots, estimates, strict=True)]
    listed = sum(len(estimate.lights) for estimate in estimates) / len(estimates)
    return metrics.summarize(scores), listed


def light(s: metrics.Summary) -> str:
    """Relighting error."""
    return f"{100 * s.relighting_mae_median:.2f} % ({100 * s.relighting_mae_worst:.1f} %)"


def measure(plain: list[Shot], bracket: list[Shot], panoramas: list[Shot]) -> list[str]:
    """Figures of the tree's daemon, as a row's cells."""
    (a, _), (b, _), (c, listed) = score(plain), score(bracket), score(panoramas)
    within = a.irradiance_within_1_sigma
    return [
        f"{a.direction_rmse_deg:.4f}° ({a.direction_worst_deg:.3f}°)",
        f"{a.missed + b.missed}, {a.false + b.false}",
        "–" if within is None else f"{100 * within:.0f} %",
        light(b),
        light(c),
        f"{listed:.2f}",
    ]


def accuracy_rows(count: int, folder: Path) -> Iterator[list[str]]:
    """The daemon as it is, then with each constant changed."""
    tree = Tree("accuracy")
    os.environ["LIGHTPROBED"] = str(tree.root / "build/release/bin/lightprobed")
    rooms = f"procedural:{count}"
    shots = [
        shoot(rooms, "unclipped", folder),
        shoot(rooms, "3", folder),
        shoot("blender", "3", folder),
    ]
    tree.build("daemon")
    yield ["as it is", "", "", *measure(*shots)]
    for constant in ACCURACY:
        for present, value in tree.changed(constant):
            tree.build("daemon")
            yield [constant.title, present, value, *measure(*shots)]


def failing(program: Path) -> list[str]:
    """Names of the tests that fail; the program's where it does not get so far."""
    try:
        done = subprocess.run([program], capture_output=True, text=True, timeout=300, check=False)
    except subprocess.TimeoutExpired:
        return [program.name]
    names = re.findall(r"\[  FAILED  \] (test_\w+)$", done.stderr + done.stdout, re.MULTILINE)
    return sorted(set(names)) or ([program.name] if done.returncode else [])


def written_rows(part: str) -> dict[str, list[list[str]]]:
    """Rows of a table of the page, by the constant's title."""
    rows: dict[str, list[list[str]]] = {}
    for line in page.written(PAGE, part).splitlines():
        cells = line.strip("|").split("|")
        rows.setdefault(cells[0].strip(), []).append([cell.strip() for cell in cells])
    return rows


def test_rows(names_of: Collection[str]) -> Iterator[list[str]]:
    """Each constant changed, and the tests that fail.

    `names_of`: only these constants, the others' rows stay as they are written; none: all.
    """
    tree = Tree("tests")
    written = written_rows("tests") if names_of else {}
    for names, constants in SEQUENCES.items():
        programs = [f"build/release/tests/test_{name}" for name in names.split()]
        for constant in constants:
            if constant.name not in names_of and constant.title in written:
                yield from written[constant.title]
                continue
            for present, value in tree.changed(constant):
                tree.build(*programs)
                failed = [name for path in programs for name in failing(tree.root / path)]
                words = ", ".join(f"`{name}`" for name in failed) or "–"
                yield [constant.title, present, value, words]


def table(head: list[str], rows: Iterator[list[str]], total: int) -> str:
    """Markdown; says how far it has come."""
    lines = []
    for number, row in enumerate(rows, 1):
        lines.append(row)
        print(f"constants: {number} of {total}: {' '.join(row[:3])}: {', '.join(row[3:])}",
              file=sys.stderr, flush=True)  # fmt: skip
    return report.table(head, lines)


def without_gone(text: str, constants: Iterable[Constant]) -> str:
    """Rows of a table without those of constants that are not there any more."""
    titles = {constant.title for constant in constants}
    return "\n".join(
        line
        for line in text.splitlines()
        if not line.startswith("| `") or line[2:].partition(" |")[0] in titles
    )


def drop_gone() -> None:
    """Take out of the tables what is not in the sources, and leave the other rows as measured."""
    sequences = [constant for constants in SEQUENCES.values() for constant in constants]
    name = str(PAGE.relative_to(ROOT))
    for part, constants in (("constants", ACCURACY), ("tests", sequences)):
        page.keep(name, part, lambda text, own=constants: without_gone(text, own))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--procedural", type=int, default=20, help="scenes with known lamps")
    parser.add_argument("--only", choices=["accuracy", "tests"], help="one of the two tables")
    parser.add_argument(
        "--names", type=lambda text: text.split(","), default=[], metavar="NAME,…",
        help="only these constants of the tests' table; their rows are written anew",
    )  # fmt: skip
    parser.add_argument(
        "--drop-gone", action="store_true", help="measure nothing: rows of deleted constants go"
    )
    arguments = parser.parse_args()
    if arguments.drop_gone:
        drop_gone()
        return
    if arguments.names:
        arguments.only = "tests"
    if arguments.only != "tests":
        head = ["constant", "is", "tried", "lamp direction, RMSE (worst)", "missed, made up",
                "irradiance within 1σ", "light: rooms", "light: panoramas",
                "lights listed, a panorama"]  # fmt: skip
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as folder:
            rows = accuracy_rows(arguments.procedural, Path(folder))
            part = table(head, rows, 1 + 2 * len(ACCURACY))
        part = f"{arguments.procedural} rooms, 8 panoramas:\n\n{part}"
        page.put(PAGE, {"constants": part})
    if arguments.only != "accuracy":
        total = 2 * sum(len(constants) for constants in SEQUENCES.values())
        part = table(
            ["constant", "is", "tried", "tests that fail"], test_rows(arguments.names), total
        )
        page.put(PAGE, {"tests": part})


if __name__ == "__main__":
    main()
