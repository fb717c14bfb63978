"""The ring's model: against its own inversion, the data sheet, and the simulated box in C."""

import dataclasses
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError

BOX = Path(__file__).resolve().parents[3] / "build" / "firmware" / "lightprobe-mcu-host"

nine = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def drawn(rng: np.random.Generator) -> ring.Ring:
    return ring.Ring(
        r10_ohm=np.exp(rng.uniform(np.log(5e3), np.log(3e4), 9)),
        gamma=rng.uniform(0.5, 0.9, 9),
        series_ohm=rng.uniform(0, 150, 9),
        sigma=rng.uniform(0, 1, 9),
        gamma_sigma=rng.uniform(0, 0.1, 9),
        series_sigma_ohm=rng.uniform(0, 3, 9),
        pivot_lux=np.exp(rng.uniform(0, 7, 9)),
        divider_ohm=rng.uniform(1e3, 1e4),
        drift_sigma=rng.uniform(0, 0.3),
    )


@given(rng=nine)
def test_levels_and_illuminance_are_each_others_inverse(rng: np.random.Generator) -> None:
    sensors = drawn(rng)
    lux = np.exp(rng.uniform(np.log(0.1), np.log(1000), (5, 9)))
    assert sensors.lux(sensors.level(lux)) == pytest.approx(lux, rel=1e-9)
    assert np.all(np.diff(sensors.level(np.sort(lux, axis=0)), axis=0) >= 0)


@given(rng=nine)
def test_sigma_is_least_where_it_was_calibrated_and_grows_both_ways(
    rng: np.random.Generator,
) -> None:
    sensors = drawn(rng)
    at_pivot = sensors.sigma_of(sensors.level(sensors.pivot_lux))
    for factor in (50, 1 / 50):
        away = sensors.sigma_of(sensors.level(sensors.pivot_lux * factor))
        by_gamma = np.log(50) * sensors.gamma_sigma / sensors.gamma
        least = np.sqrt(sensors.sigma**2 + sensors.drift_sigma**2 + by_gamma**2)
        assert np.all(away >= least)
    assert np.all(at_pivot >= np.hypot(sensors.sigma, sensors.drift_sigma))
    known = dataclasses.replace(sensors, gamma_sigma=np.zeros(9))
    assert at_pivot == pytest.approx(known.sigma_of(known.level(known.pivot_lux)), abs=1e-3)


@given(rng=nine)
def test_sigma_holds_what_the_series_resistance_may_be_off(rng: np.random.Generator) -> None:
    """First order: another series resistance, the same level."""
    sensors = drawn(rng)
    other = dataclasses.replace(
        sensors, series_ohm=sensors.series_ohm + 0.1 * sensors.series_sigma_ohm
    )
    level = sensors.level(np.full(9, 500.0))
    change = other.lux(level) / sensors.lux(level) - 1
    alone = dataclasses.replace(
        sensors, sigma=np.zeros(9), gamma_sigma=np.zeros(9), drift_sigma=0.0
    )
    assert np.all(change <= 0.11 * alone.sigma_of(level) + 1e-9)
    exact = dataclasses.replace(alone, series_sigma_ohm=np.zeros(9))
    by_series = np.sqrt(alone.sigma_of(level) ** 2 - exact.sigma_of(level) ** 2)
    assert change == pytest.approx(0.1 * by_series, rel=0.05, abs=1e-6)


def test_a_level_beyond_what_any_ldr_can_have_is_bright_and_uncertain() -> None:
    """A short, or the sun on a sensor whose series resistance is known badly."""
    sensors = ring.Ring()
    level = np.full(9, 4050.0)  # less is in series than stated
    assert np.all(sensors.lux(level) > 5e4)
    assert np.all(sensors.sigma_of(level) > 1)


@given(rng=nine)
def test_one_level_more_or_less_costs_what_the_slope_says(rng: np.random.Generator) -> None:
    """Without series resistance dE/E = dlevel / (gamma · level · (1 − level / full scale))."""
    sensors = drawn(rng)
    level = rng.uniform(50, sensors.level(np.full(9, 1000.0)))
    change = sensors.lux(level + 0.01) / sensors.lux(level) - 1
    total = ring.total_ohm(level, sensors.divider_ohm)
    slope = total / (total - sensors.series_ohm)  # of ln R by ln (R + series)
    slope /= sensors.gamma * level * (1 - level / ring.FULL_SCALE)
    assert change == pytest.approx(0.01 * slope, rel=1e-2)


def test_the_data_sheets_points() -> None:
    sensors = ring.Ring()
    assert sensors.resistance_ohm(np.full(9, 10.0)) == pytest.approx(14000)
    ratio = sensors.resistance_ohm(np.full(9, 10.0)) / sensors.resistance_ohm(np.full(9, 100.0))
    assert np.log10(ratio) == pytest.approx(0.7)
    assert np.isnan(sensors.lux(np.array([0, 4092, 4095, -1, *[5] * 5]))[:4]).all()
    assert sensors.level(np.zeros(9)) == pytest.approx(0)


def test_directions_are_the_conventions() -> None:
    looks = ring.directions()
    assert looks.shape == (9, 3)
    assert np.linalg.norm(looks, axis=1) == pytest.approx(1)
    assert looks[0] == pytest.approx([1, 0, 0])
    assert looks[2] == pytest.approx([0, 0, 1])
    assert looks[6] == pytest.approx([0, 0, -1])
    assert looks[8] == pytest.approx([0, 1, 0])


def test_the_simulated_box_has_the_same_model() -> None:
    """An oracle written in another language: voltages of the box, at rest."""
    rng = np.random.default_rng(5)
    sensors = drawn(rng)
    lux = np.exp(rng.uniform(np.log(1), np.log(2e4), 9))
    lines = [f"set ldr_divider_ohm {sensors.divider_ohm}"]
    for k in range(9):
        lines += [
            f"set ldr{k}_r10_ohm {sensors.r10_ohm[k]}",
            f"set ldr{k}_gamma {sensors.gamma[k]}",
            f"set ldr{k}_mux_ohm {sensors.series_ohm[k]}",
        ]
        lines += [f"set ldr{k}_lux {lux[k]}"]
    lines += ["run 2000000", *(f"get ldr{k}_mv" for k in range(9))]
    done = subprocess.run(
        [BOX, "--lock-step"], input="\n".join(lines) + "\n", capture_output=True, text=True
    )
    mv = [float(line) for line in done.stdout.splitlines()[-9:]]
    assert mv == pytest.approx(sensors.level(lux) / ring.FULL_SCALE * 5000, rel=1e-5)


@given(rng=nine)
def test_a_file_gives_back_what_was_written(
    rng: np.random.Generator, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("ring") / "ring.ini"
    written = drawn(rng)
    path.write_text(written.text())
    read = ring.load(path)
    for name in (*ring.LIMITS, *ring.ALIKE_LIMITS, *ring.LAG_LIMITS):
        assert getattr(read, name) == pytest.approx(getattr(written, name), rel=1e-5)


def test_the_lag_may_be_left_out(tmp_path: Path) -> None:
    path = tmp_path / "ring.ini"
    text = ring.Ring(rise_ms=12, fall_ms=45).text()
    path.write_text(text)
    assert (ring.load(path).rise_ms, ring.load(path).fall_ms) == (12, 45)
    path.write_text(text.replace("rise_ms = 12\n", "").replace("fall_ms = 45\n", ""))
    assert (ring.load(path).rise_ms, ring.load(path).fall_ms) == (20, 30)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rise_ms = 20", "rise_ms = -1", "rise_ms = -1: expected 1 numbers"),
        ("version = 2", "version = 1", "version 1: this program reads version 2: calibrate again"),
        ("version = 2", "", "version none"),
        ("gamma = 0.7,", "gamma = 0.1,", "gamma = 0.1.*expected 9 numbers from 0.3 to 1.5"),
        ("gamma = 0.7,", "gamma =", "expected 9 numbers"),
        ("\nsigma = 0.4,", "\nsigma = nan,", "expected 9 numbers"),
        ("series_ohm = 85,", "series_ohm = -1,", "expected 9 numbers from 0 to 1000"),
        ("drift_sigma = 0.15", "", "drift_sigma = : expected 1 numbers"),
        ("[ring]", "[rang]", r"section \[ring\] is missing"),
        ("[ring]", "[ring]\ncolour = blue", "unknown key colour"),
        ("[ring]", "ring", "parse"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "ring.ini"
    path.write_text(ring.Ring().text().replace(old, new, 1))
    with pytest.raises(CalibrationError, match=rf"ring\.ini: .*{message}"):
        ring.load(path)
    with pytest.raises(CalibrationError, match="open: No such file"):
        ring.load(tmp_path / "none")
