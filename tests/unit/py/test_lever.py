"""The lever arm of a probe on a head, and what does not tell it."""

from __future__ import annotations

import numpy as np
import pytest
from lightprobe.align import lever
from lightprobe.align.lever import Lever, Sightings
from lightprobe.align.track import make
from scipy.spatial.transform import Rotation

MOUNT = Rotation.from_euler("YXZ", [20, -35, 8], degrees=True)
OFFSET_M = np.array([0.02, 0.07, -0.09])
LAMPS_M = np.array([[1.2, 1.3, -1.5], [-2.0, 1.1, -0.8], [0.4, 1.4, 2.1], [2.4, 0.2, 0.9],
                    [-0.6, -0.7, -3.3]])  # fmt: skip
AHEAD_NS = 1_700_000_000_000_000_000


def looks(t_s, yaw_deg=40.0, nod_deg=18.0, roll_deg=6.0):
    """Head → world, as a head looks around."""
    yaw = yaw_deg * np.sin(1.5 * t_s) + 0.4 * yaw_deg * np.sin(0.7 * t_s + 1)
    nod = nod_deg * np.sin(1.1 * t_s + 2)
    roll = roll_deg * np.sin(2.1 * t_s + 3)
    return Rotation.from_euler("YXZ", np.stack([yaw, nod, roll], axis=-1), degrees=True)


def places(t_s, size_m=0.25):
    way = [np.sin(1.9 * t_s), 0.4 * np.sin(1.3 * t_s), np.sin(2.7 * t_s + 1)]
    return size_m * np.stack(way, axis=-1)


def seen_by(
    *, seconds=20.0, seed=1, lamps_m=LAMPS_M, size_m=0.25, unit=1.0, late_s=0.0, rest_deg=0.0,
    lasting=False, **look,
):  # fmt: skip
    """Track of the head (0.1°, 5 mm), and sightings (0.1°) by a probe of another clock."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 1 / 72)
    rough = rng.standard_normal((len(t_s), 6))
    if lasting:  # errors of trackers last for a second
        kernel = np.hanning(144) / np.linalg.norm(np.hanning(144))
        rough = np.stack([np.convolve(one, kernel, mode="same") for one in rough.T], axis=-1)
    told = looks(t_s, **look) * Rotation.from_rotvec(0.1 * rough[:, :3], degrees=True)
    told_m = unit * (places(t_s, size_m) + 0.005 * rough[:, 3:])
    stamps = [AHEAD_NS + round(1e9 * (t + late_s)) for t in t_s]
    head = make("head", stamps, told.as_quat(), told_m)
    frames_s = np.arange(0.3, seconds - 0.3, 1 / 15)
    rows = []
    for t, turn, place in zip(frames_s, looks(frames_s, **look), places(frames_s, size_m),
                              strict=True):  # fmt: skip
        for number, lamp_m in enumerate(lamps_m):
            towards = (turn * MOUNT).inv().apply(lamp_m - place - turn.apply(OFFSET_M))
            off = Rotation.from_rotvec(0.1 * rng.standard_normal(3), degrees=True)
            towards = off.apply(towards / np.linalg.norm(towards))
            rows.append((round(1e9 * t), 7 * number, towards, 0.1))
    return head, Sightings.of(rows)


def solve(head, seen, off_deg=0.5, off_s=0.004):
    """From a mount and a clock that are not quite right."""
    start = Rotation.from_rotvec([0, off_deg, 0], degrees=True) * MOUNT
    return lever.solve(head, seen, start, 1e-9 * AHEAD_NS + off_s)


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_the_offset_is_found_within_a_centimetre(seed, lasting):
    found = solve(*seen_by(seed=seed, lasting=lasting, late_s=0.02))
    assert isinstance(found, Lever), found
    off_m = np.abs(found.offset_m - OFFSET_M)
    assert off_m.max() < 0.01
    assert (off_m < 3 * found.sigma_m).all() or off_m.max() < 0.001
    assert (found.sigma_m < 0.01).all()
    assert np.degrees((found.rotation.inv() * MOUNT).magnitude()) < (0.3 if lasting else 0.1)
    assert found.residual_deg < 0.4
    assert found.lamps == len(LAMPS_M)


def test_a_mount_that_is_off_by_some_degrees_and_a_lamp_that_is_carried_do_little_harm():
    head, seen = seen_by()
    carried = seen.lamp == 14
    way = Rotation.from_euler("Y", np.linspace(0, 40, carried.sum())[:, None], degrees=True)
    seen.directions[carried] = way.apply(seen.directions[carried])
    found = solve(head, seen, off_deg=3.0)
    assert isinstance(found, Lever), found
    assert np.abs(found.offset_m - OFFSET_M).max() < 0.015


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"size_m": 0.0}, "hardly changes its place"),
        ({"nod_deg": 0.0, "roll_deg": 0.0}, "about one axis only"),
        ({"lamps_m": 40 * LAMPS_M}, "not far away"),
        ({"seconds": 2.0}, "no lamp is seen 40 times"),
        ({"lamps_m": LAMPS_M[:0]}, "no lamp is seen 40 times"),
        ({"unit": 1000.0}, "give metres"),
    ],
)
def test_what_does_not_tell_it_is_named(changes, words):
    found = solve(*seen_by(**changes))
    assert isinstance(found, str), (found.offset_m, found.sigma_m)
    assert words in found


def test_without_positions_there_is_none():
    head, seen = seen_by(seconds=6.0)
    bare = make("head", [head.start_ns + round(1e9 * t) for t in head.time_s],
                head.rotation.as_quat())  # fmt: skip
    assert solve(bare, seen) == "the poses have no positions"
