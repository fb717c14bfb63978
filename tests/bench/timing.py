"""Time contestants on pictures of one kind: the C++ program's and Python's take turns."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from frames import Kind
from lightprobe.evaluate import metrics
from published import project_ducc0, published
from rich.progress import Progress

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "build" / "release" / "bench" / "bench"

YARDSTICK = "decode_1_1"
PRESETS = ("fast", "balanced", "accurate", "reference")
DECODES = ("decode_1_2", "decode_1_4", "decode_1_8")
DIVISORS = tuple(f"balanced_decode_1_{n}" for n in (1, 2, 4, 8))
LIGHTS = tuple(f"lights_{n}" for n in (0, 1, 2, 4, 8))
EXPOSURES = ("exposures_2", "exposures_3", "exposures_4")
#: One contestant, three times.
FILM, FILM_TIMES = "film", ("film_frame", "film_sweep", "film_map")
PUBLISHED = "published_cpp"
EVERY_ROUND = (
    YARDSTICK, *PRESETS, *DECODES, *DIVISORS, *LIGHTS, *EXPOSURES, FILM, PUBLISHED, "stages",
)  # fmt: skip
#: Slow ones run in one of so many rounds.
SELDOM = 5
SLOW = ("sh_naive_cpp", "sh_separable_cpp")
IN_PYTHON: dict[str, Callable[[Any], Any]] = {
    "published_python": published,
    "sh_ducc0_python": project_ducc0,
}
SLOW_IN_PYTHON = ("sh_ducc0_python",)
BASELINES = (*DECODES, *DIVISORS, PUBLISHED, *SLOW, *IN_PYTHON)


class Program:
    """The C++ program with its pictures loaded; one request at a time."""

    def __init__(self, camera: str, files: Iterable[Path]) -> None:
        self._process = subprocess.Popen(
            [PROGRAM, camera, *files], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def ask(self, *words: object) -> Any:
        """Send one line, read one line of JSON; SystemExit when the program has ended."""
        assert self._process.stdin
        assert self._process.stdout
        print(*words, file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"bench: the program ended at: {' '.join(map(str, words))}")
        return json.loads(line)


def add(samples: dict[str, list[int]], times: dict[str, int]) -> None:
    """Note one more run of some contestants."""
    for name, ns in times.items():
        samples.setdefault(name, []).append(ns)


def is_slow_round(number: int, pictures: int) -> bool:
    """One in SELDOM, with another picture each time the pictures have gone round: all meet all."""
    turn, index = divmod(number, pictures)
    return (turn + index) % SELDOM == 0


def suits(name: str, kind: Kind) -> bool:
    """Projections over pixels only know equirectangular pictures."""
    return kind.camera == "equirect" or not name.startswith("sh_")


def time_kind(kind: Kind, files: Sequence[Path], rounds: int, bar: Progress) -> dict[str, Any]:
    """Run `rounds` rounds; each is one picture through every contestant, in an order of its own."""
    rng = np.random.default_rng(0)
    jpegs = [np.fromfile(path, np.uint8) for path in files]
    samples: dict[str, list[int]] = {}
    task = bar.add_task(kind.name, total=rounds)
    cv2.setNumThreads(1)
    with Program(kind.camera, files) as program:
        for index in range(len(files)):  # warm-up: tables, memory, geometry
            program.ask("run", index, *EVERY_ROUND)
        for number in range(rounds):
            index = number % len(files)
            slow = is_slow_round(number, len(files))
            names = rng.permutation([*EVERY_ROUND, *(n for n in SLOW if slow and suits(n, kind))])
            add(samples, program.ask("run", index, *names))
            for name, run in IN_PYTHON.items():
                if suits(name, kind) and (slow or name not in SLOW_IN_PYTHON):
                    begin = time.thread_time_ns()
                    run(jpegs[index])
                    add(samples, {name: time.thread_time_ns() - begin})
            bar.advance(task)
        fidelity = _fidelity(program, len(files)) if kind.camera == "equirect" else {}
    return _summary(kind, files, samples, fidelity)


def time_some(
    kind: Kind, files: Sequence[Path], rounds: int, *names: str
) -> dict[str, dict[str, float]]:
    """Median milliseconds of the times of some contestants, and their ratio to the yardstick."""
    samples: dict[str, list[int]] = {}
    with Program(kind.camera, files) as program:
        for number in range(rounds + len(files)):
            times = program.ask("run", number % len(files), YARDSTICK, *names)
            if number >= len(files):  # the first ones warm up
                add(samples, times)
    plain = float(np.median(samples[YARDSTICK]))
    return {
        name: {"median_ms": float(np.median(ns)) / 1e6, "ratio": float(np.median(ns)) / plain}
        for name, ns in samples.items()
    }


def stages_of(times: dict[str, Any]) -> dict[str, Any]:
    """Those of stages, by the stage's name."""
    return {
        name.removeprefix("stage_"): value
        for name, value in times.items()
        if name.startswith("stage_")
    }


def _fidelity(program: Program, count: int) -> dict[str, list[float]]:
    """SH error of each preset, order 2, against all pixels of the same picture linearised."""
    errors: dict[str, list[float]] = {name: [] for name in (*PRESETS, *DIVISORS)}
    for index in range(count):
        # 100: pictures are of 10 ms, and pixels are of full scale
        full = 100 * np.array(program.ask("result", index, "sh_separable_cpp"))
        for name, values in errors.items():
            got = np.array(program.ask("result", index, name)["sh"])[:9]
            values.append(metrics.sh_error(full, got))
    return errors


def _summary(
    kind: Kind,
    files: Sequence[Path],
    samples: dict[str, list[int]],
    fidelity: dict[str, list[float]],
) -> dict[str, Any]:
    plain_ms = float(np.median(samples[YARDSTICK])) / 1e6

    def figures(name: str) -> dict[str, float]:
        values_ms = np.array(samples[name]) / 1e6
        result = {
            "median_ms": float(np.median(values_ms)),
            "p99_ms": float(np.percentile(values_ms, 99)),
            "ratio": float(np.median(values_ms)) / plain_ms,
            "runs": len(values_ms),
        }
        if name in fidelity:
            result["sh_error_median"] = float(np.median(fidelity[name]))
            result["sh_error_worst"] = float(np.max(fidelity[name]))
        return result

    return {
        "width_px": kind.width_px,
        "height_px": kind.height_px,
        "chroma": kind.chroma,
        "quality": kind.quality,
        "pictures": len(files),
        "mean_jpeg_bytes": int(np.mean([path.stat().st_size for path in files])),
        "plain_decode_ms": plain_ms,
        "presets": {name: figures(name) for name in PRESETS},
        "baselines": {name: figures(name) for name in BASELINES if name in samples},
        "stages": {name: figures(f"stage_{name}") for name in stages_of(samples)},
        "lights": {name.removeprefix("lights_"): figures(name) for name in LIGHTS},
        "exposures": {name.removeprefix("exposures_"): figures(name) for name in EXPOSURES},
        "film": {name.removeprefix("film_"): figures(name) for name in FILM_TIMES},
    }
