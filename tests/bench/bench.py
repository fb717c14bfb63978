"""Speed, and its trade for accuracy: what `make bench` runs.

    bench.py [--quick] [--rounds N]
    bench.py --scenes NAME[,NAME...] [--rounds N]
    bench.py --film [--rounds N]
    bench.py --stages [--rounds N]
    bench.py --crowd

The first writes build/bench/speed.json; without --quick also speed.md and speed_accuracy.png in
docs/maintainers.
--quick runs everything a little, to see that it works, and says nothing about speed. The second
times scenes one by one, as `lightprobe` names them: a folder of panoramas, room, procedural:5. The
third times a sweep of the polarizer alone. The last two measure one section of speed.md each, and
write it: the stages of an estimate with the reflection map, and the daemon with its subscribers.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import accuracy
import any_scenes
import daemon_load
import frames
import report
import timing
from lightprobe.errors import LightprobeError
from lightprobe.sim import scenes
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "build" / "bench"
ROUNDS, QUICK_ROUNDS = 200, 2
SCENE_ROUNDS = 20
SECONDS, QUICK_SECONDS = 15.0, 2.0
DAEMON_KIND = "equirect_1920x960_420"
#: At tcp:, and at ws:.
SUBSCRIBERS = ((1, 0), (10, 0), (100, 0), (200, 0), (200, 200))
#: The published recipe is the same in C++ and in Python, but for rounding of the decoders.
AGREEMENT_DEG = 1.0


def machine() -> dict[str, Any]:
    """Say what the figures were measured on."""
    cpu = Path("/proc/cpuinfo").read_text().partition("model name")[2]
    model = cpu.partition(":")[2].partition("\n")[0].strip() or platform.machine()
    return {
        "processor": model,
        "architecture": platform.machine(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "date": datetime.date.today().isoformat(),
        "revision": _revision(),
    }


def _revision() -> str:
    done = subprocess.run(
        ["git", "-C", ROOT, "describe", "--always", "--dirty"], capture_output=True, text=True
    )
    return done.stdout.strip() or "unknown"


def check_published(kind: frames.Kind, files: list[Path]) -> None:
    """Both versions of the published recipe must find the same regions."""
    import numpy as np
    from lightprobe import geometry
    from published import published

    with timing.Program(kind.camera, files) as program:
        for index, path in enumerate(files):
            theirs = program.ask("result", index, "published_cpp")
            ours = published(np.fromfile(path, np.uint8))
            if not theirs or not ours:
                raise SystemExit(f"bench: published: nothing found in {path.name}")
            apart = geometry.angle_deg(theirs[0]["direction"], ours[0].direction)
            if apart > AGREEMENT_DEG:
                raise SystemExit(
                    f"bench: published: C++ and Python are {apart:.2f}° apart in {path.name}"
                )


def measure_daemon(files: list[Path], quick: bool) -> dict[str, Any]:
    """Whole daemon at DAEMON_KIND."""
    load = daemon_load.Load(frames.KINDS[DAEMON_KIND], files, QUICK_SECONDS if quick else SECONDS)
    counts = SUBSCRIBERS[:2] if quick else SUBSCRIBERS
    return {
        "frame": DAEMON_KIND,
        "rate_hz": daemon_load.RATE_HZ,
        "subscribers": {f"{tcp} + {web}": daemon_load.crowd(load, tcp, web) for tcp, web in counts},
        "allocations_per_frame": daemon_load.allocations_per_frame(load, OUT),
    }


def progress() -> Progress:
    """Bars on stderr."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    return Progress(*columns, console=Console(stderr=True))


def run_scenes(names: str, rounds: int) -> None:
    """Time scenes one by one; the table goes to stdout."""
    try:
        chosen = scenes.load(names.split(","))
    except LightprobeError as error:
        raise SystemExit(f"bench: {error}") from None
    with progress() as bar:
        rows = any_scenes.measure(chosen, OUT / "frames-scenes", rounds, bar)
    result = {"machine": machine(), "rounds": rounds, "scenes": rows}
    (OUT / "scenes.json").write_text(json.dumps(result, indent=2) + "\n")
    print(any_scenes.table(rows))


def run_film(rounds: int) -> None:
    """Time frames behind a film; the table goes to stdout."""
    kind = frames.KINDS[DAEMON_KIND]
    files = frames.make(kind, OUT / "frames", frames.subjects(False))
    print(report.film(timing.time_some(kind, files, rounds, "balanced", timing.FILM)))


def run_crowd(quick: bool) -> None:
    """Measure the daemon with subscribers, and write this section of speed.md."""
    files = frames.make(frames.KINDS[DAEMON_KIND], OUT / "frames", frames.subjects(False))
    write_section(report.daemon(measure_daemon(files, quick)), "--crowd", quick)


def run_stages(quick: bool, rounds: int) -> None:
    """Time the stages of an estimate, and write this section of speed.md."""
    kinds = {}
    for name, kind in frames.KINDS.items():
        files = frames.make(kind, OUT / "frames", frames.subjects(False))
        times = timing.time_some(kind, files, rounds, "stages")
        kinds[name] = {"stages": timing.stages_of(times)}
    write_section(report.stages({"frames": kinds}), "--stages", quick)


def write_section(section: str, option: str, quick: bool) -> None:
    """Print a section of speed.md; without `quick`, put it in the place of the former one."""
    on = machine()
    section = (
        f"{section.strip()}\n\nThis section alone is by `tests/bench/bench.py {option}`, on "
        f"{on['processor']}, {on['cores']} cores, {on['date']}, revision {on['revision']}.\n"
    )
    print(section)
    if quick:
        return
    page = ROOT / "docs/maintainers/speed.md"
    head = section.partition("\n")[0]
    before, found, rest = page.read_text().partition(f"{head}\n")
    after = rest.partition("\n## ")[2]
    if not (found and after):
        raise SystemExit(f"{page}: has no section {head.lstrip('# ')}: run make bench")
    page.write_text(f"{before}{section}\n## {after}")


def run(quick: bool, rounds: int) -> dict[str, Any]:
    """Measure everything."""
    speed: dict[str, Any] = {"machine": machine(), "quick": quick, "frames": {}}
    with progress() as bar:
        folder = OUT / ("frames-quick" if quick else "frames")
        task = bar.add_task("pictures", total=len(frames.KINDS))
        pictures = {}
        for name, kind in frames.KINDS.items():
            pictures[name] = frames.make(kind, folder, frames.subjects(quick))
            bar.advance(task)
        check_published(frames.KINDS[DAEMON_KIND], pictures[DAEMON_KIND])
        for name, kind in frames.KINDS.items():
            # 4K takes four times as long
            number = (rounds + 1) // 2 if kind.width_px > 1920 else rounds
            speed["frames"][name] = timing.time_kind(kind, pictures[name], number, bar)
        task = bar.add_task("daemon", total=1)
        speed["daemon"] = measure_daemon(pictures[DAEMON_KIND], quick)
        bar.advance(task)
        save(speed)  # what is there already, should the rest fail
        speed["accuracy"] = accuracy.measure(quick, bar)
    return speed


def save(speed: dict[str, Any]) -> Path:
    """Write speed.json; returns its path."""
    path = OUT / ("speed-quick.json" if speed["quick"] else "speed.json")
    path.write_text(json.dumps(speed, indent=2) + "\n")
    return path


def main() -> int:
    """Run; exit status 1 when something does not work."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="only check that it runs")
    parser.add_argument("--rounds", type=int, help=f"how often; default {ROUNDS}")
    parser.add_argument("--scenes", help="time these scenes one by one, and nothing else")
    parser.add_argument("--film", action="store_true", help="time a sweep of the polarizer alone")
    parser.add_argument(
        "--crowd",
        action="store_true",
        help="the daemon with subscribers alone; writes that section",
    )
    parser.add_argument(
        "--stages", action="store_true", help="the stages of an estimate alone; writes that section"
    )
    arguments = parser.parse_args()
    quick = arguments.quick
    OUT.mkdir(parents=True, exist_ok=True)
    if arguments.scenes:
        run_scenes(arguments.scenes, arguments.rounds or SCENE_ROUNDS)
        return 0
    if arguments.film:
        run_film(arguments.rounds or ROUNDS)
        return 0
    if arguments.crowd:
        run_crowd(quick)
        return 0
    if arguments.stages:
        run_stages(quick, arguments.rounds or (QUICK_ROUNDS if quick else ROUNDS))
        return 0
    speed = run(quick, arguments.rounds or (QUICK_ROUNDS if quick else ROUNDS))
    path = save(speed)
    docs = OUT if quick else ROOT / "docs/maintainers"
    (docs / "speed.md").write_text(report.markdown(speed))
    report.plot(speed, docs / "speed_accuracy.png")
    print(f"bench: {path.relative_to(ROOT)}, {(docs / 'speed.md').relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
