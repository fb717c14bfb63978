# SPDX-License-Identifier: Apache-2.0
"""The simulated room: its pictures, its truth, and a simulator that shows it live."""

import json
import math
import os
import subprocess
from pathlib import Path

import pytest
from machine import wait_for

from daemon import Daemon

PICTURES = Path(os.environ["LP_BUILD"]).parent / "kernel" / "pictures"
PROGRAM = PICTURES.parents[1] / "venv" / "bin" / "lightprobe"
TRUTH = json.loads((PICTURES / "truth.json").read_text())
CLIPPED = 4  # ESTIMATE_FLAG_CLIPPED


def simulate(link: Path) -> subprocess.Popen[bytes]:
    """Start a simulator that serves one camera after the other at `link`."""
    process = subprocess.Popen(
        [PROGRAM, "simulate", f"--socket={link}", "--scenes=room", "--act-s=0", "--size=640x320",
         "--rate=8", f"--median-radiance={TRUTH['median_radiance']}"],
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for("the simulator", link.exists, timeout_s=240)
    return process


def angle_deg(one, other) -> float:
    """Angle between two unit vectors."""
    return math.degrees(math.acos(min(1, sum(a * b for a, b in zip(one, other, strict=True)))))


def assert_room(estimate) -> None:
    """Every lamp of the room is found where it is, as strong as it is."""
    assert not estimate.flags & CLIPPED
    for lamp in TRUTH["lamps"]:
        found = min(
            estimate.lights, key=lambda light: angle_deg(light.direction, lamp["direction"])
        )
        assert angle_deg(found.direction, lamp["direction"]) < 1
        facts = f"{lamp}: {found}\n{estimate.flags:#x}"
        strength = sum(found.irradiance) / sum(lamp["irradiance"])
        assert strength == pytest.approx(1, abs=0.08), facts
        # the chroma of a JPEG of this size and quality tells no more of lamps of seven pixels
        for channel, true in zip(found.irradiance, lamp["irradiance"], strict=True):
            assert channel / true == pytest.approx(1, abs=0.22), facts


def wait_whole_bracket(daemon: Daemon):
    """Wait for an estimate from three exposures, nothing clipped in all of them."""

    def whole():
        estimate = daemon.wait_estimate()
        return estimate if estimate.exposure_count == 3 and not estimate.flags & CLIPPED else None

    return wait_for("three exposures", whole, timeout_s=180)
