"""Instructions of the hot path per frame, by callgrind: a slower kernel is seen without a clock.

    instructions.py            compare with instructions.json
    instructions.py --write    record (make instructions)

Only counts of the machine's own architecture are compared, and only of what one more frame costs:
half of what two more frames cost after the first ones, when tables and memory are set up and a
camera that turns is known to turn.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import frames
from lightprobe.sim.room import Room

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PROGRAM = ROOT / "build" / "release" / "bench" / "bench"
RECORD = HERE / "instructions.json"
#: Compilers and libraries of one Debian release differ by less, kernels worth a look by more.
TOLERANCE = 0.05
CASES = (
    ("equirect_1920x960_420", "balanced"),
    ("equirect_1920x960_420", "exposures_2"),
    ("equirect_1920x960_422", "fast"),
    ("equirect_960x480_420", "balanced"),
    ("dual_fisheye_1280x720_420", "balanced"),
    ("equirect_1920x960_420", "turning"),
)
#: Frames before those that count; of a camera that turns.
SETTLING, SETTLING_TURNING = 2, 8
WHOLE = "lp_pipeline_process"
FUNCTIONS = (
    WHOLE, "lp_jpeg_read", "lp_cells_from_jpeg", "lp_remap_apply", "lp_radiance_map_observe",
    "lp_detect", "lp_sh_project", "lp_imager_refine", "lp_imager_follow", "lp_lookup_radiance",
)  # fmt: skip
_LINE = re.compile(r"^\s*([\d,]+) .*?[:/ ](\w+)(?:\(|\s|$)")


def _inclusive(camera: str, pictures: Sequence[Path], contestant: str, runs: int) -> dict[str, int]:
    """Inclusive counts of FUNCTIONS while the pipeline runs; those not called are left out.

    Frame after frame is the next picture, or the last one again.
    """
    indices = [min(number, len(pictures) - 1) for number in range(runs)]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", "--quiet",
             f"--toggle-collect={WHOLE}", PROGRAM, camera, *pictures],
            input="".join(f"run {index} {contestant}\n" for index in indices),
            text=True, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        listing = subprocess.run(
            ["callgrind_annotate", "--inclusive=yes", "--threshold=100", "--auto=no", out],
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
    counts: dict[str, int] = {}
    for line in listing.splitlines():
        found = _LINE.match(line.partition(" [")[0].replace("'2", ""))
        name = found.group(2) if found else ""
        if found and name in FUNCTIONS:  # inlined parts of it are listed besides
            counts[name] = max(counts.get(name, 0), int(found.group(1).replace(",", "")))
    return counts


def _pictures(kind: frames.Kind, contestant: str, folder: Path) -> tuple[list[Path], int]:
    """Give what is shown to a contestant, and how many frames go before those that count."""
    if contestant == "turning":
        count = SETTLING_TURNING + 2
        return frames.make_turning(kind, folder, Room(), 0, count), SETTLING_TURNING
    picture = folder / "room.jpg"
    frames.shoot_bracket(kind, Room(), 0, picture)
    return [picture], SETTLING


def measure(name: str, contestant: str) -> dict[str, int]:
    """Give function -> instructions per frame, of one of CASES."""
    kind = frames.KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        pictures, first = _pictures(kind, contestant, Path(folder))
        before = _inclusive(kind.camera, pictures, contestant, first)
        after = _inclusive(kind.camera, pictures, contestant, first + 2)
    return {
        function: (after[function] - before.get(function, 0)) // 2
        for function in FUNCTIONS
        if function in after
    }


def recorded() -> dict[str, dict[str, int]] | None:
    """What is on record for this architecture: "kind contestant" -> function -> instructions."""
    record: dict[str, dict[str, dict[str, int]]] = json.loads(RECORD.read_text())
    return record.get(platform.machine())


def differences(
    old: dict[str, dict[str, int]], new: dict[str, dict[str, int]]
) -> list[tuple[str, int, int]]:
    """List what is on record and differs by more than TOLERANCE: (what, old, new)."""
    return [
        (f"{group} {function}", count, new[group].get(function, 0))
        for group, functions in old.items()
        for function, count in functions.items()
        if abs(new[group].get(function, 0) - count) > TOLERANCE * count
    ]


def main() -> int:
    """Exit status 1 when counts differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="record the counts")
    args = parser.parse_args()
    new = {f"{name} {contestant}": measure(name, contestant) for name, contestant in CASES}
    if args.write:
        record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
        record[platform.machine()] = new
        RECORD.write_text(json.dumps(record, indent=2) + "\n")
    changed = differences(recorded() or {}, new)
    for what, before, after in changed:
        print(f"instructions: {what}: {before} recorded, {after} now ({after / before - 1:+.1%})")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
