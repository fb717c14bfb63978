"""Instructions of the hot path per frame, by callgrind: a slower kernel is seen without a clock.

    instructions.py            compare with instructions.json
    instructions.py --write    record (make instructions)

Only counts of the machine's own architecture are compared, and only of what one more frame costs:
half of the difference between four frames and two, tables and memory being set up by then.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import tempfile
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
    ("dual_fisheye_1280x720_420", "balanced"),
)
WHOLE = "lp_pipeline_process"
FUNCTIONS = (
    WHOLE, "lp_jpeg_read", "lp_cells_from_jpeg", "lp_remap_apply", "lp_radiance_map_observe",
    "lp_detect", "lp_sh_project", "lp_imager_refine",
)  # fmt: skip
_LINE = re.compile(r"^\s*([\d,]+) .*?[:/ ](\w+)(?:\(|\s|$)")


def _inclusive(camera: str, picture: Path, contestant: str, runs: int) -> dict[str, int]:
    """Inclusive counts of FUNCTIONS while the pipeline runs; those not called are left out."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", "--quiet",
             f"--toggle-collect={WHOLE}", PROGRAM, camera, picture],
            input=f"run 0 {contestant}\n" * runs, text=True, check=True, stdout=subprocess.DEVNULL,
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


def measure() -> dict[str, dict[str, int]]:
    """Give "kind contestant" -> function -> instructions per frame."""
    result = {}
    for name, contestant in CASES:
        kind = frames.KINDS[name]
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "room.jpg"
            picture.write_bytes(frames.shoot(kind, Room(), seed=0)[0])
            two = _inclusive(kind.camera, picture, contestant, 2)
            four = _inclusive(kind.camera, picture, contestant, 4)
        result[f"{name} {contestant}"] = {
            function: (four[function] - two[function]) // 2
            for function in FUNCTIONS
            if function in four
        }
    return result


def recorded() -> dict[str, dict[str, int]] | None:
    """What is on record for this architecture."""
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
    new = measure()
    if parser.parse_args().write:
        record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
        record[platform.machine()] = new
        RECORD.write_text(json.dumps(record, indent=2) + "\n")
    changed = differences(recorded() or {}, new)
    for what, before, after in changed:
        print(f"instructions: {what}: {before} recorded, {after} now ({after / before - 1:+.1%})")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
