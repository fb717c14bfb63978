"""Every fault of the simulator has a name in `lightprobe.testing`, and shows as its table says."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest
from lightprobe.estimate import EstimateFlag
from lightprobe.sim.faults import BOX, Faults
from lightprobe.testing import FAULTS, Options, running
from lightprobe.testing.faults import BOX_FAULTS, CAMERA_FAULTS

pytestmark = pytest.mark.many_frames

PAGE = Path(__file__).resolve().parents[2] / "docs" / "users" / "testing.md"
#: Numbers that say when or how much another fault of the table is, and sensors that are alike.
ALIKE = {f"ldr{k}_{what}" for k in range(9) if k != 3 for what in ("forced", "noise")}
SMALL = Options(size_px=(320, 160), rate_hz=10.0, ambient=10.0)
WRONG = EstimateFlag.STALE | EstimateFlag.RING_ONLY | EstimateFlag.WHEEL_FAULT


def test_every_number_of_the_simulator_has_a_name() -> None:
    named = {key for one in FAULTS.values() for key in one.numbers}
    assert named == {one.name for one in fields(Faults)} | (set(BOX) - ALIKE)


def test_the_page_lists_them_all_as_they_are() -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| `([^`]+)` \| (.*?) \| (.*?) \|$", PAGE.read_text(), re.M)
    assert rows == [(one.name, one.query, one.means, one.shows) for one in FAULTS.values()]


def check(name: str) -> None:
    with running(SMALL) as probe:
        probe.room.lamp(40, 30, irradiance=20, radius_deg=3)
        probe.wait_settled()
        probe.run(2)
        probe.fault(name)
        probe.wait_shown(name, within_s=10)
        probe.heal()
        if name.startswith("ldr-"):
            assert probe.box is not None
            probe.box.restart()
        probe.wait_no_fault()
        probe.wait_estimate(lambda one: not one.flags & WRONG, wanted="healthy estimate")


@pytest.mark.nightly_rows
@pytest.mark.parametrize("name", CAMERA_FAULTS)
def test_a_fault_of_the_camera_shows_and_ends(name: str) -> None:
    check(name)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("name", BOX_FAULTS)
def test_a_fault_of_the_box_shows_and_ends(name: str) -> None:
    check(name)
