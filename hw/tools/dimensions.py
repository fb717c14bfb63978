# SPDX-License-Identifier: Apache-2.0
"""Dimensions of the box, from hw/cad by OpenSCAD itself: nothing is computed twice."""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from pathlib import Path

HW = Path(__file__).resolve().parents[1]
CAD = HW / "cad"
ROOT = HW.parent

Value = float | list["Value"]


def names() -> list[str]:
    """Names of all constants in params.scad and derived.scad."""
    text = "\n".join((CAD / f).read_text() for f in ("params.scad", "derived.scad"))
    return re.findall(r"^([a-z]\w*) = ", text, re.MULTILINE)


def dimensions(**overrides: float) -> dict[str, float]:
    """All constants that are numbers, in mm and degrees, as OpenSCAD evaluates them.

    overrides: constants of params.scad set to other values, as with `openscad -D`.
    Raises RuntimeError with OpenSCAD's own words when it fails.
    """
    return {n: v for n, v in _evaluate(overrides).items() if isinstance(v, float)}


def lists(**overrides: float) -> dict[str, list[Value]]:
    """All constants that are lists."""
    return {n: v for n, v in _evaluate(overrides).items() if isinstance(v, list)}


def _evaluate(overrides: dict[str, float]) -> dict[str, Value]:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "dimensions.scad"
        echo = Path(folder) / "dimensions.echo"
        lines = [f"include <{CAD / 'derived.scad'}>"]
        lines += [f'echo("{name}", {name});' for name in names()]
        source.write_text("\n".join(lines))
        define = [word for n, v in overrides.items() for word in ("-D", f"{n}={v}")]
        command = ["openscad", *define, "-o", str(echo), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        text = echo.read_text() if echo.exists() else ""
    found = re.findall(r'^ECHO: "(\w+)", (.*)$', text, re.MULTILINE)
    if done.returncode != 0 or "WARNING" in text + done.stderr or len(found) != len(names()):
        raise RuntimeError(f"openscad: hw/cad/derived.scad: {text}{done.stderr}")
    return {name: _floats(json.loads(value)) for name, value in found}


def _floats(value: object) -> Value:
    if isinstance(value, list):
        return [_floats(v) for v in value]
    assert isinstance(value, int | float)
    return float(value)
