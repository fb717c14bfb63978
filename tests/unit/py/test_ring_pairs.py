"""Pairs of camera and ring belong together, however late each of the two arrives."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.calibrate.ring_pairs import Watch
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.geometry import Array

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
STEP_S, SECONDS = 4.0, 40.0
#: Where the clocks of both devices begin; the microcontroller's wraps on the way.
MCU_START_US, PROBE_START_NS = 2**32 - 5_000_000, 10**18


def light(t_s: float) -> float:
    """Light that is switched every STEP_S, from 1 to 10 times and back."""
    return 1.0 + 9.0 * (int(t_s / STEP_S) % 2)


def an_estimate(capture_s: float, sent_s: float, flags: EstimateFlag) -> Estimate:
    even = SphericalHarmonics("TOTAL", 0, np.full((1, 3), light(capture_s)))
    capture_ns = round(1e9 * capture_s)
    delay_us = round(1e6 * (sent_s - capture_s))
    return Estimate(1, 2, capture_ns, delay_us, 500, flags, (), even, 0.01, None, 1, None)


def watched(rng: np.random.Generator, late_s: float, flags: EstimateFlag) -> tuple[Array, Array]:
    """Pairs of a reader that sleeps up to `late_s` at a time; the level tells the light itself."""
    watch = Watch()
    wakes = np.cumsum(rng.uniform(0.01, late_s, 10_000))
    for t in np.arange(0.0, SECONDS, 0.1):
        now_ns = round(1e9 * wakes[np.searchsorted(wakes, t)])
        levels = np.full(9, 100 * light(t))
        levels[4] = np.nan
        watch.ring((MCU_START_US + round(1e6 * t)) % 2**32, levels, now_ns)
        estimate = an_estimate(t - 0.2, t - 0.1, flags)
        watch.estimate(estimate, 1.0, now_ns)
    return watch.pairs()


@given(rng=seeds, late_s=st.floats(0.02, 1.5))
def test_pairs_are_of_one_light(rng: np.random.Generator, late_s: float) -> None:
    lux, level = watched(rng, late_s, EstimateFlag(0))
    assert len(lux) >= 10
    assert np.all(np.isnan(level[:, 4]))
    known = np.delete(np.arange(9), 4)
    ratio = level[:, known] / lux[:, known]
    assert np.ptp(ratio) < 1e-6 * ratio.mean()
    assert np.ptp(lux[:, 0]) > lux[:, 0].min()  # of both lights


def test_unfit_estimates_give_none() -> None:
    lux, level = watched(np.random.default_rng(1), 0.1, EstimateFlag.BRACKET_INCOMPLETE)
    assert lux.shape == level.shape == (0, 9)


def test_nothing_seen_gives_none() -> None:
    lux, level = Watch().pairs()
    assert lux.shape == level.shape == (0, 9)
