"""Subscriptions that say what they draw, with the real daemon, in simulated time."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.room import Room
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription, encode_subscription

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))
import draws

MAPS = "--reflection-map=64"


def probe(*arguments: str) -> LiveProbe:
    """A daemon in a still room."""
    world = World([Room()], Behaviour(act_s=0), median_radiance=30.0)
    limits = draws.SIGHTS["any exposure"]
    camera = SimulatedCamera(world, lenses.load("equirect"), (960, 480), rate_hz=10, limits=limits)
    return LiveProbe(camera, (*arguments, "--brackets=4"))


def maps_of(client: LiveClient) -> list[ReflectionMap]:
    """All maps so far."""
    return [one.message for one in client.received if isinstance(one.message, ReflectionMap)]


@pytest.fixture(scope="module")
def found() -> list[dict[str, draws.Got]]:
    """What the six subscriptions of the bench get in two rooms."""
    return [
        draws.look(scene, draws.subscriptions()) for scene in scenes.load(("room", "procedural:1"))
    ]


def test_what_is_drawn_is_as_exact_as_asked_or_the_packet_says_that_it_is_not(
    found: list[dict[str, draws.Got]],
) -> None:
    for room in found:
        for name, got in room.items():
            assert got.told, (name, got)
    assert sum(got.met for room in found for got in room.values()) >= 10


def test_less_is_sent_to_who_needs_less(found: list[dict[str, draws.Got]]) -> None:
    for room in found:
        colour, matt = room["a colour"], room["matt things"]
        assert colour.sh_order <= 1
        assert not colour.map_size
        assert not matt.map_size
        assert colour.bytes_per_s < matt.bytes_per_s < room["chrome"].bytes_per_s
        assert room["fine metal"].map_size < room["chrome"].map_size == 32
        assert room["chrome"].bytes_per_s < 60e3  # maps come once a second


def test_wishes_that_cannot_be_had_get_the_best_and_are_told() -> None:
    """Chrome of a map of 16 texels, or without one; light by nothing but SH of order 0."""
    with probe(MAPS) as running, probe() as without:
        coarse = running.client(Subscription(draws={"mirrors": 0.02}, reflection_map_size=16))
        dull = running.client(Subscription(draws={"diffuse": 0.01}, sh_order=0, max_lights=0))
        blind = without.client(Subscription(draws={"mirrors": 0.02, "diffuse": 0.1}))
        running.run(3.0)
        without.run(3.0)
        assert {one.size for one in maps_of(coarse)} == {16}
        assert (coarse.estimates[-1].drawn or {})["mirrors"] > 0.05
        assert (maps_of(coarse)[-1].drawn or {})["mirrors"] > 0.05
        last = dull.estimates[-1]
        assert (last.sh.order, len(last.lights)) == (0, 0)
        assert (last.drawn or {})["diffuse"] > 0.1
        assert (blind.estimates[-1].drawn or {})["mirrors"] == 1.0
        assert not maps_of(blind)


def test_a_wish_that_changes_with_every_frame_costs_no_more() -> None:
    """Others get the same, and who changes its mind never gets more than by its largest wish."""
    fixed = Subscription(draws={"diffuse": 0.02, "mirrors": 0.1}, health_period_ms=0)
    counts = []
    for changing in (False, True):
        with probe(MAPS) as running:
            steady = running.client(fixed)
            restless = running.client(fixed)
            running.run(4.0)
            start, before = len(steady.estimates), restless.bytes_received
            for k in range(40):
                if changing:
                    error = 0.02 + 0.001 * (k % 25)
                    wish = Subscription(
                        draws={"diffuse": error, "mirrors": 5 * error}, health_period_ms=0
                    )
                    restless._socket.sendall(encode_subscription(wish, k + 2))
                running.run(0.1)
            models = [(one.sh.order, len(one.lights)) for one in steady.estimates[start:]]
            counts.append((models, restless.bytes_received - before))
            assert not any("warning" in line for line in running.log.splitlines())
    (quiet, steady_bytes), (disturbed, restless_bytes) = counts
    assert set(disturbed) == set(quiet)
    # an answer to each wish besides, and no picture more than five times a second
    assert restless_bytes < steady_bytes + 40 * 700 + 20 * 25_000


def test_who_does_not_say_what_it_draws_gets_what_it_got() -> None:
    with probe(MAPS) as running:
        plain = running.client(Subscription(reflection_map_size=32))
        running.client(Subscription(draws={"shadows": 0.02}))
        running.run(2.0)
        last = plain.estimates[-1]
        assert isinstance(last, Estimate)
        assert last.drawn is None
        assert (last.sh.order, len(last.lights)) == (2, 4)
        assert {one.size for one in maps_of(plain)} == {32}
        assert set(maps_of(plain)[-1].drawn or {}) == {"glossy", "mirrors"}
