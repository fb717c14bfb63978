"""A phone that looks around, beside a 360° camera: what it sees, and what it says of the rest."""

import look_around
import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.imaging import camera
from look_around import LOOKS, PHONE, Case, find, run, seen_share, table

pytestmark = pytest.mark.many_frames

ROOMS = ("procedural:2",)
#: More relighting error than by the 360° camera, at most.
BOUND = 0.02


@pytest.fixture(scope="module")
def cases() -> dict[tuple[str, str], Case]:
    """Two rooms, each by a 360° camera, looked at whole, and without the ceiling."""
    scenes = find(ROOMS)
    found = [run(scene, look) for scene in scenes for look in ("360", "three", "low")]
    return {(case.scene, case.look): case for case in found}


def test_what_is_seen():
    """One picture of 43° by 70°: its solid angle; and rings, of which some leave the poles."""
    phone = camera.load(str(PHONE))
    (lens,) = phone.lenses
    right, up = 90 / 228.5, 160 / 228.5
    sr = 4 * np.arctan(right * up / np.sqrt(1 + right**2 + up**2))
    assert seen_share(phone, np.array([[1.0, 0, 0, 0]])) == pytest.approx(
        sr / (4 * np.pi), rel=0.03
    )
    assert lens.max_theta_deg == pytest.approx(np.degrees(np.arctan(np.hypot(right, up))), rel=1e-3)
    tracks = {name: look.track() for name, look in LOOKS.items() if look.rings_deg}
    shares = {name: seen_share(phone, track.rotations[::4]) for name, track in tracks.items()}
    assert shares["three"] > 0.99
    assert 0.9 < shares["two"] < 0.97
    assert shares["low"] < 0.8
    for track in tracks.values():  # no jumps
        steps = geometry.turn_after(geometry.inverse(track.rotations[:-1]), track.rotations[1:])
        assert np.abs(steps[:, 0]).min() > np.cos(np.radians(5) / 2)


@pytest.mark.nightly
def test_looking_around_is_nearly_as_good_as_a_360_camera(cases):
    for case in cases.values():
        assert case.stated is not None
        if case.look == "three":
            whole = cases[case.scene, "360"]
            assert case.seen >= 0.9
            assert case.error < whole.error + BOUND
            assert case.within_3


@pytest.mark.nightly
def test_a_ceiling_that_nobody_saw_is_told(cases):
    for case in cases.values():
        if case.look == "low":
            assert case.partial
            assert case.within_3
            assert case.stated > 0.2


def test_the_table_has_a_row_for_each_look():
    made = [
        Case("a", name, 1.0, error, 2 * error, 0.1, name == "low", False)
        for name, error in (("360", 0.01), ("three", 0.02), ("low", 0.2))
    ]
    lines = table(made).splitlines()
    assert len(lines) == 2 + 3
    assert "+0.010 (+0.010)" in lines[3]
    assert lines[4].split(" | ")[5:7] == ["0 of 1", "1 of 1"]
    assert not made[2].within_3


def test_cases_that_are_known_are_not_run_again(tmp_path):
    file = tmp_path / "cases.json"
    made = [Case("a", "360", 1.0, 0.01, 0.02, None, False, False)]
    assert look_around.read(file) == []
    look_around.write(file, made)
    assert look_around.read(file) == made
