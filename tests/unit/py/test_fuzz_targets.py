# SPDX-License-Identifier: Apache-2.0
"""`make fuzz` fails where a target has not run; what Python targets once found stays mended."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FUZZ = ROOT / "tests" / "fuzz"


def run(tmp_path: Path, script: str, runs: int = 100) -> subprocess.CompletedProcess[str]:
    """Run a target that is this shell script."""
    program = tmp_path / "target"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    arguments = ["--runs", str(runs), "--out", str(tmp_path / "found"), str(program)]
    return subprocess.run(
        [sys.executable, str(FUZZ / "run.py"), *arguments], capture_output=True, text=True
    )


def test_a_target_that_has_run_is_right(tmp_path: Path) -> None:
    done = run(tmp_path, "echo stat::number_of_executed_units: 100 >&2")
    assert done.returncode == 0, done.stderr
    assert "target: 100 inputs" in done.stdout


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("echo stat::number_of_executed_units: 99 >&2", "99 of 100 inputs"),
        ("exit 0", "0 of 100 inputs"),
        ("echo stat::number_of_executed_units: 100 >&2; exit 77", "exit 77 after 100 inputs"),
        ("kill -SEGV $$", "after 0 inputs"),
    ],
)
def test_a_target_that_has_not_fails_by_name(tmp_path: Path, script: str, says: str) -> None:
    done = run(tmp_path, script)
    assert done.returncode == 1
    assert "target" in done.stderr
    assert says in done.stderr


CORPORA = [
    pytest.param(module, seed, id=f"{module.stem}-{seed.name}")
    for module in sorted(FUZZ.glob("fuzz_*.py"))
    for seed in sorted((FUZZ / "corpus" / module.stem.removeprefix("fuzz_")).iterdir())
]


@pytest.mark.parametrize(("module", "seed"), CORPORA)
def test_corpora_of_targets_in_python_find_nothing(module: Path, seed: Path) -> None:
    spec = importlib.util.spec_from_file_location(module.stem, module)
    assert spec is not None
    assert spec.loader is not None
    target = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(target)
    target.one_input(seed.read_bytes())


def test_every_target_has_a_corpus() -> None:
    targets = {path.stem.removeprefix("fuzz_") for path in FUZZ.glob("fuzz_*")}
    with_seeds = {path.name for path in (FUZZ / "corpus").iterdir() if any(path.iterdir())}
    assert targets == with_seeds
