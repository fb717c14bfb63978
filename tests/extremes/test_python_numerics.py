"""What the Python package computes, of any numbers that a packet may hold and a place may have.

No result is NaN, no exception but those that are documented, and what must not matter does not: the
unit of light, how the frame is turned, in what order things are told.
"""

import math
import warnings
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import bundle, geometry, not_negative, sh
from lightprobe.box_fit import BoxFit, Seen
from lightprobe.clock_offset import ClockOffset
from lightprobe.estimate import Estimate, EstimateFlag, Light, Room, SphericalHarmonics
from lightprobe.field import Station, join, with_room
from lightprobe.matching import NOTHING, View, match
from lightprobe.place import estimate_at, light_at
from lightprobe.reflection_map import ReflectionMap, decode_rgb9e5, encode_rgb9e5

#: What is computed with in float32 on the wire: from nothing to the largest.
SIZES = [0.0, 1e-45, 1e-38, 1e-20, 1e-6, 1e-3, 0.5, 1.0, 30.0, 1e3, 1e6, 1e20, 1e30]
LIGHTS = st.sampled_from(SIZES)
#: Metres, as an app may have them.
METRES = st.one_of(
    st.floats(-10, 10),
    st.sampled_from([0.0, 5e-324, 1e-300, -1e-9, 1e-3, -1e3, 1e6, -1e11]),
)
PLACES = st.tuples(METRES, METRES, METRES)
DIRECTIONS = st.one_of(
    st.sampled_from([(1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0), (0, 0, -1.0), (0.6, 0.8, 0)]),
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: math.hypot(*d) > 0.01),
).map(lambda d: geometry.normalize(np.array(d, float)))
TURNS = st.tuples(DIRECTIONS, st.sampled_from([0.0, 1e-6, 90.0, 179.999999, 180.0, 359.0]))
DISTANCES = st.sampled_from([None, 1e-45, 1e-6, 1e-3, 0.3, 2.0, 1e3, 1e6, 3e38])
SIGMAS = st.sampled_from([None, 0.0, 1e-3, 0.1, 1.0, 1000.0])


def maybe(values):
    return st.one_of(st.none(), values)


@st.composite
def lamps(draw, ident=1, strengths=LIGHTS):
    direction = draw(DIRECTIONS)
    irradiance = np.array([draw(strengths) for _ in range(3)])
    distance_m, share = draw(DISTANCES), draw(SIGMAS)
    extended = draw(st.booleans())
    across = np.cross(direction, [1.0, 0, 0] if abs(direction[0]) < 0.7 else [0, 1.0, 0])
    return Light(
        ident, direction, irradiance, draw(st.sampled_from([0.0, 1e-6, 0.27, 30.0, 90.0, 180.0])),
        direction_sigma_deg=draw(maybe(st.sampled_from([0.0, 0.05, 180.0]))),
        irradiance_sigma=None if share is None else share * irradiance,
        shadow_strength=draw(maybe(st.sampled_from([0.0, 1.0]))),
        distance_m=distance_m,
        distance_sigma=None if distance_m is None else draw(SIGMAS),
        nearest_m=None if distance_m is not None else draw(DISTANCES),
        half_angle_deg=(90.0, draw(st.sampled_from([0.0, 10.0]))) if extended else None,
        axis=geometry.normalize(across) if extended else None,
    )  # fmt: skip


@st.composite
def rooms(draw):
    walls_m = [draw(st.sampled_from([1e-45, 1e-9, 1e-3, 0.5, 2.0, 1e4])) for _ in range(6)]
    w, x, y, z = geometry.quaternion(*draw(TURNS))
    return Room(np.array(walls_m), np.full(6, 0.1), np.array([x, y, z, w]), 0.01)


@st.composite
def estimates(draw, order=None, kind="AMBIENT"):
    order = draw(st.integers(0, 4)) if order is None else order
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    coefficients = draw(LIGHTS) * rng.normal(size=((order + 1) ** 2, 3))
    coefficients[0] = np.abs(coefficients[0]) * 3
    lights = tuple(draw(lamps(i + 1)) for i in range(draw(st.integers(0, 4))))
    return Estimate(
        1, 1, 0, 0, 1000, EstimateFlag(0), lights, SphericalHarmonics(kind, order, coefficients),
        None, None, 1, None, relighting_sigma=draw(maybe(st.sampled_from([0.0, 0.1, 1000.0]))),
        room=draw(maybe(rooms())),
    )  # fmt: skip


def assert_numbers(value, finite=True):
    """No NaN anywhere in it; and no infinity, where light of 1e30 is not brought to 1 mm."""
    if is_dataclass(value):
        for one in fields(value):
            assert_numbers(getattr(value, one.name), finite)
    elif isinstance(value, tuple | list):
        for one in value:
            assert_numbers(one, finite)
    elif isinstance(value, float | np.ndarray):
        assert not np.isnan(value).any()
        assert not finite or np.isfinite(value).all()


@pytest.fixture(autouse=True)
def no_warnings():
    """A warning of numpy is a number that nobody meant."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


# ---------------------------------------------------------------- light at a place


@given(light=lamps(), place=PLACES)
def test_a_lamp_from_anywhere(light, place):
    there = light_at(light, place)
    assert_numbers(there)
    assert abs(np.linalg.norm(there.direction) - 1) < 1e-9
    assert (there.irradiance >= 0).all()
    assert 0 <= there.angular_radius_deg <= 180
    for sigma in (there.direction_sigma_deg, there.distance_sigma):
        assert sigma is None or sigma >= 0


@given(light=lamps(strengths=st.sampled_from([0.5, 1.0, 30.0])), place=PLACES, turn=TURNS,
       scale=st.sampled_from([1e-6, 1e6]))  # fmt: skip
def test_neither_the_frame_nor_the_unit_matters_to_a_lamp(light, place, turn, scale):
    q = geometry.quaternion(*turn)
    turned = replace(light, direction=geometry.rotate(q, light.direction), axis=None,
                     irradiance=scale * light.irradiance,
                     irradiance_sigma=None if light.irradiance_sigma is None
                     else scale * light.irradiance_sigma)  # fmt: skip
    if light.distance_m is not None:  # beside the lamp rounding decides
        beside_m = np.linalg.norm(light.distance_m * light.direction - np.array(place))
        if not 1e-3 * light.distance_m < beside_m:
            return
    one, other = (
        light_at(light, place),
        light_at(turned, geometry.rotate(q, np.array(place))),
    )
    assert np.allclose(geometry.rotate(q, one.direction), other.direction, atol=1e-6)
    assert np.allclose(scale * one.irradiance, other.irradiance, rtol=1e-6)
    assert math.isclose(one.angular_radius_deg, other.angular_radius_deg, rel_tol=1e-6)


@given(estimate=estimates(), place=PLACES)
def test_an_estimate_from_anywhere(estimate, place):
    there = estimate_at(estimate, place)
    assert_numbers(there)
    assert len(there.lights) == len(estimate.lights)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e200, -1e30])
def test_a_place_that_is_none(bad):
    estimate = Estimate(1, 1, 0, 0, 1, EstimateFlag(0), (), SphericalHarmonics(
        "AMBIENT", 0, np.ones((1, 3))), None, None, 1, None)  # fmt: skip
    light = Light(1, np.array([0.0, 1, 0]), np.ones(3), 1.0, distance_m=2.0)
    for place in ([bad, 0, 0], [0, 0, bad]):
        with pytest.raises(ValueError, match="expected x, y, z in metres"):
            estimate_at(estimate, place)
        with pytest.raises(ValueError, match="expected x, y, z in metres"):
            light_at(light, place)


@given(room=rooms(), place=PLACES, turn=TURNS, scale=st.sampled_from([1e-20, 1e20]))
def test_ambient_light_from_anywhere(room, place, turn, scale):
    """Light from everywhere stays as it is; neither frame nor unit matters."""
    even = np.zeros((25, 3))
    even[0] = 1.0
    sh_of = lambda light, where: estimate_at(  # noqa: E731
        Estimate(1, 1, 0, 0, 1, EstimateFlag(0), (), SphericalHarmonics("AMBIENT", 4, light),
                 None, None, 1, None, room=where), place).sh.coefficients  # fmt: skip
    assert np.allclose(sh_of(even, room), even, atol=1e-12)
    light = np.random.default_rng(3).normal(size=(25, 3))
    assert np.allclose(sh_of(scale * light, room), scale * sh_of(light, room), rtol=1e-9)


@given(room=rooms(), place=PLACES, light=st.sampled_from([0.0, 1e-38, 1.0, 1e30]))
@settings(max_examples=30)
def test_a_reflection_map_from_anywhere(room, place, light):
    faces = np.full((6, 16, 16, 3), light, np.float32)
    around = ReflectionMap(1, 1, 0, 1, "AMBIENT", faces, np.array([0.0, 0, 0, 1]))
    there = around.at(room, place, "PROBE")
    assert np.allclose(there.radiance, faces, rtol=1e-6)


@given(lights=st.lists(LIGHTS, min_size=12, max_size=12))
def test_texels_come_back(lights):
    radiance = np.array(lights, np.float32).reshape(4, 3)
    texels, scale = encode_rgb9e5(radiance)
    back = decode_rgb9e5(texels, scale)
    largest = radiance.max(axis=-1, keepdims=True).astype(float)
    step = scale * 2.0**-24 + 1.5e-45
    assert (np.abs(back.astype(float) - radiance) <= largest / 512 * 1.001 + step).all()


# ---------------------------------------------------------------- several probes


def station(place_m, yaw_deg=0.0):
    return Station("tcp:a", np.array(place_m, float), yaw_deg)


def seen_by(place_m, bulbs_m, scale=1.0):
    """A probe's estimate of bulbs, which hang in a room of even light."""
    lights = []
    for i, bulb_m in enumerate(bulbs_m):
        way_m = np.array(bulb_m) - place_m
        away_m = max(float(np.linalg.norm(way_m)), 1e-9)
        towards = way_m / away_m if way_m.any() else np.array([0.0, 1, 0])
        lights.append(Light(
            i + 1, geometry.normalize(towards), scale * np.array([3.0, 2.0 + i, 1.0]) / away_m**2,
            1.0, direction_sigma_deg=0.05, irradiance_sigma=np.full(3, 0.02 * scale),
        ))  # fmt: skip
    coefficients = np.zeros((25, 3))
    coefficients[0] = scale
    around = SphericalHarmonics("AMBIENT", 4, coefficients)
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), tuple(lights), around, None, None, 1, None)


#: Bulbs and probes in one place, in one line, 1 mm and 1000 km away.
SPOTS = st.tuples(*[st.sampled_from([0.0, 1e-9, 1e-3, 0.5, -1.0, 2.0, 1e6])] * 3)


@given(
    bulbs_m=st.lists(SPOTS, max_size=5),
    probes_m=st.lists(SPOTS, min_size=1, max_size=3),
)
@settings(max_examples=12)
def test_probes_and_lamps_anywhere(bulbs_m, probes_m):
    stations = [station((0, 0, 0)), *(station(place) for place in probes_m)]
    base, *others = [seen_by(one.place_m, bulbs_m) for one in stations]
    joined = join(stations, base, others)
    assert_numbers(joined.estimate)
    assert_numbers(list(joined.turns_wxyz))
    assert_numbers(list(joined.yaw_sigma_deg))
    assert len(joined.estimate.lights) == len(bulbs_m)
    for light in joined.estimate.lights:
        if light.distance_m is not None:
            assert light.distance_m > 0
            assert light.distance_sigma > 0
    found = with_room(stations, joined, others, BoxFit())
    assert_numbers(found.estimate)


@given(bulbs_m=st.lists(SPOTS, min_size=1, max_size=6), place=SPOTS,
       scale=st.sampled_from([1e-6, 1e6]), order=st.randoms())  # fmt: skip
@settings(max_examples=40)
def test_neither_unit_nor_order_matter_to_a_match(bulbs_m, place, scale, order):
    def view(where, unit, indices):
        one = seen_by(np.array(where), bulbs_m, unit)
        lights = tuple(one.lights[i] for i in indices)
        return View(replace(one, lights=lights), np.array(where, float), 0.01,
                    np.array(geometry.UNTURNED), 3.0, 0.5)  # fmt: skip

    plain, mixed = list(range(len(bulbs_m))), list(range(len(bulbs_m)))
    order.shuffle(mixed)
    one = match(view((0, 0, 0), 1.0, plain), view(place, 1.0, plain))
    other = match(view((0, 0, 0), 1.0, plain), view(place, scale, mixed))
    assert_numbers(list(one.yaws_rad))
    assert sorted(one.pairs) == sorted((i, mixed[j]) for i, j in other.pairs)
    if not any(place):
        assert one is NOTHING  # a probe in the same place tells of no distance


@given(
    directions=st.lists(st.lists(DIRECTIONS, min_size=2, max_size=2), min_size=1, max_size=4),
    place=SPOTS, place_sigma=st.sampled_from([0.0, 1e-9, 0.01, 1e3]),
    turn_sigma=st.sampled_from([0.0, 1e-6, 0.1, 10.0]),
    sigma=st.sampled_from([1e-9, 1e-3, 1.0]),
)  # fmt: skip
@settings(max_examples=25)
def test_a_bundle_of_anything(directions, place, place_sigma, turn_sigma, sigma):
    """Also where sightings contradict each other, or come from one place."""
    lamp = np.repeat(np.arange(len(directions)), 2)
    sightings = bundle.Sightings(
        np.tile([0, 1], len(directions)), lamp, np.array([d for pair in directions for d in pair]),
        np.full(len(lamp), sigma),
    )  # fmt: skip
    fit = bundle.fit(
        np.array([(0, 0, 0), place], float), np.full(2, place_sigma), np.full((2, 3), turn_sigma),
        sightings,
    )  # fmt: skip
    for one in (
        fit.turns_rad,
        fit.turn_sigma_rad,
        fit.inverse_per_m,
        fit.inverse_sigma_per_m,
    ):
        assert_numbers(one)
    assert_numbers(fit.chi2)
    assert (fit.inverse_sigma_per_m > 0).all()
    assert fit.agrees in (True, False)


@given(
    places=st.lists(SPOTS, min_size=0, max_size=2), light=LIGHTS, seed=st.integers(0, 9),
    uneven=st.sampled_from([0.0, 1e-12, 0.3, 10.0]),
)  # fmt: skip
@settings(max_examples=4)
def test_a_box_of_anything(places, light, seed, uneven):
    rng = np.random.default_rng(seed)
    views = []
    for place in [(0.0, 0.0, 0.0), *places]:
        coefficients = uneven * light * rng.normal(size=(25, 3))
        coefficients[0] = light
        views.append(Seen(coefficients, np.array(place)))
    room = BoxFit().look(views)
    if room is not None:
        assert_numbers(room)
        assert (room.walls_m > 0).all()


# ---------------------------------------------------------------- light that is not negative


@given(light=LIGHTS, seed=st.integers(0, 99), order=st.integers(0, 4),
       uneven=st.sampled_from([0.0, 0.1, 1.0, 100.0]))  # fmt: skip
@settings(max_examples=40)
def test_light_that_is_not_negative(light, seed, order, uneven):
    rng = np.random.default_rng(seed)
    given_sh = light * uneven * rng.normal(size=((order + 1) ** 2, 3))
    given_sh[0] = light
    fitted = not_negative.fit(given_sh)
    assert_numbers(fitted)
    if 1e-30 < light < 1e20:
        assert np.allclose(not_negative.fit(given_sh / light) * light, fitted, rtol=1e-6)
    assert_numbers(not_negative.irradiance_error(given_sh, fitted))


@given(first=DIRECTIONS, turn=TURNS, other=TURNS)
def test_turns_of_turns(first, turn, other):
    a, b = geometry.quaternion(*turn), geometry.quaternion(*other)
    both = geometry.turn_after(a, b)
    assert np.allclose(geometry.rotate(both, first), geometry.rotate(a, geometry.rotate(b, first)))
    assert np.allclose(geometry.rotate(geometry.inverse(a), geometry.rotate(a, first)), first)
    light = sh.lamp(first, 4)
    assert np.allclose(sh.rotate(light[:, None] * np.ones(3), a)[:, 0],
                       sh.lamp(geometry.rotate(a, first), 4), atol=1e-12)  # fmt: skip


# ---------------------------------------------------------------- clocks


@given(
    steps_s=st.lists(
        st.sampled_from([0.0, 1e-3, 60.0, -60.0, 49 * 86400.0, -49 * 86400.0, 2.0**31]),
        min_size=1, max_size=8,
    ),
    both=st.booleans(),
)  # fmt: skip
def test_a_clock_that_is_set(steps_s, both):
    """Forwards, backwards, by 49 days, beyond 2038: soon its times are right again."""
    offset, theirs_ns, now_ns = ClockOffset(), 0, 10**18
    for step_s in steps_s:
        theirs_ns += int(step_s * 1e9)
        for _ in range(40):
            now_ns += 10**7
            if both:
                offset.was_there(now_ns - 10**6, now_ns - 5 * 10**5 + theirs_ns)
            offset.arrived(now_ns - 5 * 10**5 + theirs_ns, now_ns)
        assert abs(offset.ours_ns(now_ns + theirs_ns) - now_ns) <= 10**6
        assert offset.sigma_s >= 0
