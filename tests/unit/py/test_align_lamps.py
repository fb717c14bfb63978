"""The mount's rotation from lamps that two lists have in common."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.align.lamps import Lamps, match
from lightprobe.align.track import AlignError
from lightprobe.geometry import direction_from_angles
from scipy.spatial.transform import Rotation

ROOM = direction_from_angles([-120, -40, 15, 75, 160], [35, 60, 12, 48, 20])
LIGHT = np.array([5.0, 3.0, 8.0, 1.0, 2.0])
MOUNT = Rotation.from_euler("yxz", [20, -35, 8], degrees=True)


def lists(rng, mount=MOUNT, noise_deg=0.3, keep=(0, 1, 2, 3, 4), extra=0, scale=2.5):
    """Lamps of head and probe, each shuffled, with noise of its own; `extra` only in the head's."""
    probe = noisy(rng, ROOM[rng.permutation(5)], noise_deg)
    order = rng.permutation(list(keep))
    head = noisy(rng, mount.apply(ROOM[order]), noise_deg)
    light = LIGHT[order] * scale
    if extra:
        head = np.vstack([head, Rotation.random(extra, random_state=rng).apply([0, 0, 1.0])])
        light = np.concatenate([light, rng.uniform(1, 10, extra)])
    unknown = np.full(5, np.nan)
    return Lamps.of("head", head, light), Lamps.of("probe", probe, unknown)


def noisy(rng, directions, sigma_deg):
    turns = Rotation.from_rotvec(sigma_deg * rng.standard_normal(directions.shape), degrees=True)
    return turns.apply(directions)


def error_deg(found, mount=MOUNT):
    return float(np.degrees((found.rotation.inv() * mount).magnitude()))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_any_mount_and_order(seed):
    mount = Rotation.random(random_state=seed)
    found = match(*lists(np.random.default_rng(seed), mount))
    assert len(found.pairs) == 5
    assert error_deg(found, mount) < 1


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_lamps_that_only_one_of_the_two_sees(seed):
    found = match(*lists(np.random.default_rng(seed), keep=(0, 1, 2, 3), extra=1))
    assert len(found.pairs) >= 4
    assert error_deg(found) < 2


def test_the_sigma_holds():
    errors = []
    for seed in range(40):
        found = match(*lists(np.random.default_rng(seed)))
        errors.append(error_deg(found) / found.sigma_deg)
    assert 0.5 < np.median(errors) < 1.9
    assert np.quantile(errors, 0.95) < 3.5


def two(light_head, light_probe):
    pair = ROOM[:2]
    return (
        Lamps.of("head", MOUNT.apply(pair), np.array(light_head)),
        Lamps.of("probe", pair, np.array(light_probe)),
    )


def test_two_lamps_are_told_apart_by_their_light():
    assert error_deg(match(*two([9.0, 2.0], [4.5, 1.0]))) < 0.1
    assert error_deg(match(*two([2.0, 9.0], [1.0, 4.5]))) < 0.1
    with pytest.raises(AlignError, match="switch one more lamp on"):
        match(*two([2.0, 2.1], [1.0, 1.0]))


def test_patterns_that_fit_twice():
    triangle = direction_from_angles([0, 120, 240], [30, 30, 30])
    same = np.ones(3)
    with pytest.raises(AlignError, match="two rotations, 120° apart"):
        match(Lamps.of("head", triangle, same), Lamps.of("probe", triangle, same))


def test_lamps_of_another_room():
    other = direction_from_angles([0, 20, 33], [0, 5, -8])
    with pytest.raises(AlignError, match="no two lamps are as far apart"):
        match(Lamps.of("head", other, np.ones(3)), two([1.0, 1.0], [1.0, 1.0])[1])


def test_bad_lists():
    with pytest.raises(AlignError, match="head: 1 lamps"):
        Lamps.of("head", ROOM[:1], LIGHT[:1])
    with pytest.raises(AlignError, match="not finite, or zero"):
        Lamps.of("head", np.array([[0, 0, 0], [0, 0, 1.0]]), LIGHT[:2])
