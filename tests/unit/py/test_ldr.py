"""The simulated LDRs: as different as their data sheets allow, and no cosine sensors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.evaluate.ring_model import CALIBRATED, UNCALIBRATED, RingModel
from lightprobe.sim import illuminance, ldr
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.ldr import Ldrs
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, State, World


def drawn(seed: int = 0, spread: float = 1.0) -> Ldrs:
    return Ldrs.draw(np.random.default_rng(seed), spread)


def test_parts_differ_as_the_data_sheet_allows_and_no_more() -> None:
    parts = [drawn(seed) for seed in range(200)]
    r10 = np.array([p.r10_ohm for p in parts])
    assert 8e3 <= r10.min() < 9e3
    assert 18e3 < r10.max() <= 20e3
    seats = np.array([p.seats_deg for p in parts])
    assert np.std(seats) == pytest.approx(2, rel=0.05)
    same = drawn(spread=0)
    assert np.all(same.r10_ohm == ring.NOMINAL_R10_OHM)
    assert np.all(same.gamma == ring.NOMINAL_GAMMA)
    assert same.directions() == pytest.approx(ring.directions())


def test_uncalibrated_they_are_wrong_by_a_factor_of_two() -> None:
    levels = [drawn(seed).level(np.full(9, 1000.0)) for seed in range(50)]
    off = np.abs(np.log(ring.Ring().lux(levels) / 1000))
    assert 2 < np.exp(np.quantile(off, 0.95)) < 4
    sigma = ring.Ring().sigma_of(levels)
    assert np.mean(off <= sigma) > 0.6  # and are said to be


@given(degrees=st.floats(0, 90))
def test_light_from_aside_counts_less_as_fresnel_says(degrees: float) -> None:
    cosine = float(np.cos(np.radians(degrees)))
    inside = np.sqrt(1 - (1 - cosine**2) / 1.5**2)
    across = ((cosine - 1.5 * inside) / (cosine + 1.5 * inside)) ** 2
    along = ((1.5 * cosine - inside) / (1.5 * cosine + inside)) ** 2
    exact = cosine * (1 - (across + along) / 2) / (1 - 0.04)
    assert ldr.response(np.array(cosine)) == pytest.approx(exact, abs=0.02)
    assert ldr.response(np.array(-cosine)) <= 0 or degrees == 90


def test_warmth_and_a_bright_past_change_the_resistance() -> None:
    assert ldr.drift(100.0, 25.0) == 1
    assert ldr.drift(100.0, 35.0) == pytest.approx(np.exp(0.05))
    assert ldr.drift(100.0, 25.0, 10.0) == pytest.approx(np.exp(0.04))
    assert ldr.drift(100.0, 25.0, 1e9) == pytest.approx(np.exp(-0.12))


@pytest.mark.parametrize(("nod_deg", "roll_deg"), [(0.0, 0.0), (20.0, 0.0), (15.0, -12.0)])
@pytest.mark.parametrize("as_path", [False, True])
def test_seats_and_tilts_turn_what_a_sensor_sees(
    nod_deg: float, roll_deg: float, as_path: bool
) -> None:
    scene = random_scene(3)
    rotation = turned(70, nod_deg, roll_deg)
    behaviour = Behaviour(nod_deg=nod_deg, roll_deg=abs(roll_deg))
    if as_path:
        behaviour = Behaviour(path=Track(np.zeros(1), rotation[None], np.zeros((1, 3))))
    world = World([scene], behaviour)
    powers = np.ones(len(scene.lamps))
    light = RingLight(world, 1.0)
    state = State(0, 0, scene, rotation, powers)
    truth = luminance(scene.truth(powers, rotation).irradiance(ring.directions()))
    assert light.lux(state) == pytest.approx(truth, rel=0.01, abs=0.005 * truth.max())
    parts = drawn(5)
    still = State(0, 0, scene, turned(), powers)
    assert RingLight(World([scene]), 1.0, parts).lux(still) == pytest.approx(
        illuminance.on_ldrs(scene, parts), rel=0.01
    )
    seats = luminance(scene.truth(powers).irradiance(parts.directions()))
    assert np.all(illuminance.on_ldrs(scene, parts) < seats * 1.005)  # less from aside


def test_directions_turn_right_and_up_as_seen_from_inside() -> None:
    seats = np.zeros((9, 2))
    seats[6] = [10, 0]  # sensor 6 looks along -Z
    seats[0] = [0, 10]
    seats[8] = [10, 0]
    turned = ring.directions(seats)
    assert turned[6] == pytest.approx(geometry.normalize([np.tan(np.radians(10)), 0, -1]))
    assert turned[0] == pytest.approx(geometry.normalize([1, np.tan(np.radians(10)), 0]))
    assert turned[8] == pytest.approx(geometry.normalize([np.tan(np.radians(10)), 1, 0]))


def test_a_calibrated_ring_reads_a_scene_better_than_one_as_it_comes() -> None:
    off = {CALIBRATED: [], UNCALIBRATED: []}
    for seed in range(12):
        scene = random_scene(seed)
        true = 150 * illuminance.on_ring(scene)
        for parts, errors in off.items():
            read = RingModel(parts=parts).read(scene, 0)
            errors.append(np.log(np.array(read.ring_lux.split(","), float) / true))
            assert len(read.ring_sigma.split(",")) == 9
    rms = {parts: np.sqrt(np.nanmean(np.square(errors))) for parts, errors in off.items()}
    assert rms[CALIBRATED] < 0.2 < 0.4 < rms[UNCALIBRATED]
