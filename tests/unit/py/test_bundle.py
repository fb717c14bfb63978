"""Lamps and probes fitted together: errors as large as they are said to be."""

import numpy as np
import pytest
from lightprobe import bundle, geometry

DIRECTION_RAD = np.radians(0.05)


def case(rng, yaw_deg, lamps, probes, place_m=0.01):
    """Give the arguments of a fit, true inverse distances and true turns."""
    hung_m = rng.uniform([-2.5, -0.2, -3], [2, 1.3, 2.5], size=(lamps, 3))
    away = [geometry.normalize(rng.normal(size=3)) * [1, 0.3, 1] for _ in range(probes - 1)]
    places_m = np.array([np.zeros(3), *away])
    sigma_rad = np.tile(np.radians([0.5, yaw_deg, 0.5]), (probes, 1))
    turns = sigma_rad * rng.normal(size=(probes, 3))
    found = []
    for k in range(probes):
        true_m = places_m[k] + (place_m * rng.normal(size=3) if k else 0)
        for i, lamp_m in enumerate(hung_m):
            towards = geometry.normalize(lamp_m - true_m)
            size = float(np.linalg.norm(turns[k]))
            back = geometry.quaternion(-turns[k], np.degrees(size))
            seen = geometry.rotate(back, towards) + DIRECTION_RAD * rng.normal(size=3)
            found.append((k, i, geometry.normalize(seen)))
    probe, lamp, directions = (np.array(one) for one in zip(*found, strict=True))
    sightings = bundle.Sightings(probe, lamp, directions, np.full(len(lamp), DIRECTION_RAD))
    place_sigma_m = np.array([0.0] + [place_m] * (probes - 1))
    arguments = (places_m, place_sigma_m, sigma_rad, sightings)
    return arguments, 1 / np.linalg.norm(hung_m, axis=1), turns


@pytest.mark.parametrize(
    ("yaw_deg", "lamps", "probes"), [(3.0, 6, 2), (0.3, 4, 2), (10.0, 8, 2), (3.0, 4, 3)]
)
def test_errors_are_as_stated(yaw_deg, lamps, probes):
    rng = np.random.default_rng(4)
    offs, turns, chi2 = [], [], []
    for _ in range(40):
        arguments, inverse_per_m, true_turns = case(rng, yaw_deg, lamps, probes)
        fit = bundle.fit(*arguments)
        if not fit.agrees:
            continue
        offs += ((fit.inverse_per_m - inverse_per_m) / fit.inverse_sigma_per_m).tolist()
        turns += ((fit.turns_rad - true_turns) / fit.turn_sigma_rad).ravel().tolist()
        chi2.append(fit.chi2)
    assert len(chi2) >= 37  # of 40
    for errors in (np.abs(offs), np.abs(turns)):
        assert 0.55 < np.mean(errors < 1) < 0.82
        assert np.mean(errors < 3) > 0.97
    assert np.median(chi2) == pytest.approx(fit.degrees_of_freedom, rel=0.35)


def test_lamps_tell_how_the_probes_are_turned():
    """By ten degrees unknown, with eight lamps within one."""
    (arguments, *_) = case(np.random.default_rng(7), 10.0, 8, 2)
    assert np.degrees(bundle.fit(*arguments).turn_sigma_rad[:, 1]).max() < 1.5


def test_one_lamp_tells_nothing_of_the_turns_and_little_of_itself():
    arguments, _, _ = case(np.random.default_rng(8), 3.0, 1, 2)
    fit = bundle.fit(*arguments)
    assert np.degrees(fit.turn_sigma_rad[:, 1]).min() > 1
    assert np.isfinite(fit.inverse_sigma_per_m).all()


def test_probes_at_one_place_tell_no_distance():
    places_m, place_sigma_m, turn_sigma_rad, sightings = case(np.random.default_rng(9), 3.0, 4, 2)[
        0
    ]
    fit = bundle.fit(0 * places_m, place_sigma_m, turn_sigma_rad, sightings)
    assert np.isfinite(fit.chi2)
    assert (fit.inverse_sigma_per_m > 0.5).all()
