"""Calibration of wheel and ring: the numerics, against numbers that were put in."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.calibrate import ring
from lightprobe.calibrate import ring_fit as ring_calibration
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.wheel_fit import Crossing, Reading, WheelCalibration, crossings, fit

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def swept(
    zero: float, gain: float, lag: float, backlash: float, noise_us: float, rng: np.random.Generator
) -> list[Crossing]:
    edges = -16.5 + 3.0 * np.arange(4, 66)
    return [
        Crossing(
            edge,
            zero + gain * (edge + lag * speed - (backlash if speed < 0 else 0))
            + noise_us * rng.standard_normal(),
            speed,
        )
        for speed in (40.0, -40.0, 15.0, -15.0)
        for edge in edges
    ]  # fmt: skip


@given(
    rng=seeds, zero=st.floats(600, 1000), gain=st.floats(5, 11), lag=st.floats(0, 0.1),
    backlash=st.floats(0, 5), sign=st.sampled_from([1, -1]),
)  # fmt: skip
def test_what_was_put_in_comes_out(
    rng: np.random.Generator, zero: float, gain: float, lag: float, backlash: float, sign: int
) -> None:
    found = fit(swept(zero, sign * gain, lag, backlash, 0.3, rng))
    assert found.zero_us == pytest.approx(zero, abs=6 * found.zero_sigma_us)
    assert found.gain_us_deg == pytest.approx(sign * gain, abs=6 * found.gain_sigma_us_deg)
    assert found.backlash_deg == pytest.approx(backlash, abs=6 * found.backlash_sigma_deg)
    assert found.lag_s == pytest.approx(lag, abs=0.003)
    assert found.gain_sigma_us_deg < 0.01


@given(rng=seeds)
def test_edges_that_were_read_wrongly_do_no_harm(rng: np.random.Generator) -> None:
    passed = swept(800, 7.4, 0.02, 1.0, 0.3, rng)
    for k in rng.choice(len(passed), 8, replace=False):
        passed[k] = Crossing(passed[k].edge_deg, passed[k].pulse_us + 22, passed[k].speed_deg_s)
    found = fit(passed)
    assert found.gain_us_deg == pytest.approx(7.4, abs=0.01)
    assert found.backlash_deg == pytest.approx(1, abs=0.1)
    assert found.crossings <= len(passed) - 8 + 1


def test_crossings_are_between_readings_of_the_same_way() -> None:
    up = [Reading(800 + 10 * k, k // 2) for k in range(20)]
    up.insert(12, Reading(up[11].pulse_us, up[11].edges))  # the same twice
    passed = crossings(up, -16.5, 3.0, 40)
    assert [c.edge_deg for c in passed] == [-16.5 + 3 * k for k in range(2, 9)]
    assert passed[0].pulse_us == 800 + 55
    assert crossings(up[::-1], -16.5, 3.0, -40)[-1].edge_deg == -16.5
    assert crossings(up, -16.5, 3.0, -40) == []
    reversed_servo = [Reading(3000 - one.pulse_us, one.edges) for one in up]
    mirrored = crossings(reversed_servo, -16.5, 3.0, 40)
    assert [c.edge_deg for c in mirrored] == [c.edge_deg for c in passed]
    standing = [Reading(900, k) for k in range(9)]
    assert crossings(standing, 0, 3, 40) == []


def test_too_little_is_refused() -> None:
    rng = np.random.default_rng(1)
    passed = swept(800, 7.4, 0.02, 1, 0, rng)
    with pytest.raises(CalibrationError, match="only 20 edges"):
        fit(passed[:20])
    with pytest.raises(CalibrationError, match="both ways, at two speeds"):
        fit(passed[:62])
    assert isinstance(fit(passed), WheelCalibration)


# ---------------------------------------------------------------- ring


def drawn(rng: np.random.Generator) -> ring.Ring:
    return ring.Ring(
        r10_ohm=np.exp(rng.uniform(np.log(8e3), np.log(2e4), 9)),
        gamma=rng.uniform(0.6, 0.8, 9),
        series_ohm=85 + rng.uniform(-20, 20) + rng.uniform(-4.5, 4.5, 9),
    )


def same_on_all(*lux: float) -> np.ndarray:
    return np.repeat(np.array(lux)[:, None], 9, axis=1)


@given(rng=seeds)
def test_ldrs_come_out_of_levels(rng: np.random.Generator) -> None:
    true = drawn(rng)
    lux = same_on_all(10, 100, 1000, 20_000)
    found = ring_calibration.fit(lux, np.rint(true.level(lux)), 0.01)
    assert found.r10_ohm == pytest.approx(true.r10_ohm, rel=0.03)
    assert found.gamma == pytest.approx(true.gamma, abs=0.015)
    assert found.series_ohm == pytest.approx(true.series_ohm, abs=8)
    other = np.exp(rng.uniform(np.log(20), np.log(5000), (4, 9)))
    assert found.lux(true.level(other)) == pytest.approx(other, rel=0.04)
    assert np.all((found.sigma >= 0.01) & (found.sigma < 0.03))


def test_without_bright_light_sunlight_is_uncertain_and_says_so() -> None:
    rng = np.random.default_rng(4)
    dim, bright = same_on_all(10, 100, 1000), same_on_all(10, 100, 1000, 20_000)
    ratios = []
    for _ in range(40):
        true = drawn(rng)
        by_dim = ring_calibration.fit(dim, true.level(dim), 0.03)
        by_bright = ring_calibration.fit(bright, true.level(bright), 0.03)
        sun = true.level(np.full(9, 1e5))
        ratios.append(by_dim.total_sigma_of(sun) / by_bright.total_sigma_of(sun))
        for found in (by_dim, by_bright):
            assert np.all(found.total_sigma_of(true.level(np.full(9, 100.0))) < 0.18)
    assert np.median(ratios) > 1.5


@given(rng=seeds)
def test_one_level_leaves_gamma_to_the_data_sheet_and_says_so(rng: np.random.Generator) -> None:
    true = drawn(rng)
    lux = np.full((1, 9), 300.0)
    found = ring_calibration.fit(lux, true.level(lux), 0.0)
    assert found.gamma == pytest.approx(0.7, abs=0.05)
    assert np.all(found.gamma_sigma > 0.08)
    assert found.lux(true.level(lux)) == pytest.approx(lux, rel=0.02)
    away = np.full(9, 10.0)
    wrong = np.log(found.lux(true.level(away)) / away)
    sigma = found.total_sigma_of(true.level(away))
    assert np.all(np.abs(wrong) < 2.2 * sigma)
    assert np.all(sigma > 0.25)


def test_stated_sigmas_are_those_of_rings_that_have_drifted() -> None:
    """By temperature and former light: 1 and 2 sigma hold as often as they should."""
    rng = np.random.default_rng(5)
    lux, seen_lux = same_on_all(10, 100, 1000, 20_000), same_on_all(1, 10, 100, 1000, 10_000)
    sigmas = []
    for _ in range(200):
        true = drawn(rng)
        noisy = lux * np.exp(0.03 * rng.standard_normal((4, 1)))
        found = ring_calibration.fit(lux, true.level(noisy), 0.03)
        own = found.drift_sigma * rng.standard_normal(9)
        drift = np.exp(true.gamma * (own + found.drift_common_sigma * rng.standard_normal()))
        seen = dataclasses.replace(true, r10_ohm=true.r10_ohm * drift).level(seen_lux)
        sigmas.append(np.log(found.lux(seen) / seen_lux) / np.log1p(found.total_sigma_of(seen)))
    off = np.abs(np.array(sigmas))
    for k, lux_seen in enumerate(seen_lux[:, 0]):
        print(f"{lux_seen:6g} lx: {np.mean(off[:, k] < 1):.3f} {np.mean(off[:, k] < 2):.3f}")
        assert 0.6 < np.mean(off[:, k] < 1) < 0.9
        assert np.mean(off[:, k] < 2) > 0.92


def test_a_sensor_that_is_dark_or_no_ldr_is_named() -> None:
    true = ring.Ring()
    lux = same_on_all(10, 100)
    level = true.level(lux)
    dark = level.copy()
    dark[:, 4] = np.nan
    with pytest.raises(CalibrationError, match="sensor 4: no usable reading"):
        ring_calibration.fit(lux, dark, 0.03)
    backwards = level.copy()
    backwards[:, 7] = level[::-1, 7]
    with pytest.raises(CalibrationError, match="sensor 7: its readings lie on no LDR's curve"):
        ring_calibration.fit(lux, backwards, 0.03)
