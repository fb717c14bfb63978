# SPDX-License-Identifier: Apache-2.0
"""Run every fuzz target for a number of inputs; fails if one finds something or runs fewer.

A target is a program with libFuzzer's arguments: build/fuzz/fuzz/NAME, or a module fuzz_NAME.py.
They run side by side, each for as long as its inputs take: slow ones are no exception. What makes
one slow is bounded in its harness (simulated time, pixels) and by the length of its inputs here.
"""

import argparse
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
#: Longest input of a target, in bytes; enough for all that its parsers branch on.
MOST_BYTES = {"config": 16384, "jpeg": 4096, "mcap": 4096, "series": 4096, "link": 2048, "mcu": 256}
USUAL_BYTES = 8192
#: Slow targets are shared by so many processes, which take turns with the other targets.
PROCESSES = {"mcu": 8, "jpeg": 4, "link": 2, "mcap": 2, "series": 2}
#: One input that takes longer is a fault.
LONGEST_S = 20


def command(program: Path) -> list[str]:
    """How a target is started: a program as it is, a module under atheris."""
    if program.suffix == ".py":
        name = program.stem.removeprefix("fuzz_")
        return [sys.executable, str(HERE / "atheris_main.py"), name]
    return [str(program)]


def name_of(program: Path) -> str:
    """The target's name, as its corpus is called."""
    return program.stem.removeprefix("fuzz_")


def run(program: Path, part: int, runs: int, out: Path) -> tuple[int, str]:
    """Run one process of a target; returns how many inputs, and what is wrong, or nothing."""
    name = name_of(program)
    seeds, found, log = HERE / "corpus" / name, out / name, out / f"{name}.{part}.log"
    found.mkdir(parents=True, exist_ok=True)
    quiet = [] if program.suffix == ".py" else ["-close_fd_mask=2"]  # the daemon's own log
    with open(log, "wb") as stream:
        status = subprocess.run(
            [
                *command(program), f"-runs={runs}", f"-timeout={LONGEST_S}", *quiet,
                f"-max_len={MOST_BYTES.get(name, USUAL_BYTES)}", f"-artifact_prefix={out / name}-",
                "-print_final_stats=1", str(found), *([str(seeds)] if seeds.is_dir() else []),
            ],
            stdin=subprocess.DEVNULL, stdout=stream, stderr=stream, check=False,
        ).returncode  # fmt: skip
    counts = re.findall(rb"stat::number_of_executed_units:\s*(\d+)", log.read_bytes())
    count = int(counts[-1]) if counts else 0
    if status != 0:
        return count, f"fuzz: {name}: exit {status} after {count} inputs: see the end of {log}"
    if count < runs:
        return count, f"fuzz: {name}: {count} of {runs} inputs were run: see {log}"
    return count, ""


def main() -> int:
    """Run the targets that are named; 1: something was found, or not all have run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1_000_000, help="inputs of each target")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--out", type=Path, required=True, help="folder for corpora and findings")
    parser.add_argument("programs", type=Path, nargs="+")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    wrong: list[str] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        began = time.monotonic()
        parts = {
            program: [
                pool.submit(run, program, part, -(-options.runs // count), options.out)
                for part in range(count)
            ]
            for program in options.programs
            if (count := PROCESSES.get(name_of(program), 1))
        }
        for program, futures in parts.items():
            results = [future.result() for future in futures]
            inputs, passed_s = sum(count for count, _ in results), time.monotonic() - began
            print(f"fuzz {name_of(program)}: {inputs} inputs, {passed_s:.0f} s", flush=True)
            wrong += [text for _, text in results if text]
    print(*wrong, sep="\n", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
