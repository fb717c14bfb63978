"""A client that wants nothing but news: `quiet_ms` of its subscription, in simulated time."""

from __future__ import annotations

import pytest
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.evaluate.metrics import relighting_relative
from lightprobe.geometry import sphere_normals
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.room import Room
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

SIZE_PX, RATE_HZ = (960, 480), 10.0
QUIET_MS = 2000
EVERYTHING = Subscription(max_lights=8)
NEWS = Subscription(max_lights=8, quiet_ms=QUIET_MS)


def heard(
    behaviour: Behaviour, settle_s: float, then_s: float, *wishes: Subscription
) -> list[list[Estimate]]:
    """What clients with these wishes get in the room, once it has settled."""
    camera = SimulatedCamera(
        World([Room()], behaviour, median_radiance=30.0),
        lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ,
    )  # fmt: skip
    with LiveProbe(camera) as probe:
        clients = [probe.client(wish) for wish in wishes]
        probe.run(settle_s)
        before = [len(client.estimates) for client in clients]
        probe.run(then_s)
        return [client.estimates[n:] for client, n in zip(clients, before, strict=True)]


def test_a_still_room_is_a_packet_every_two_seconds_and_no_more() -> None:
    everything, news = heard(Behaviour(act_s=0), 4.0, 10.0, EVERYTHING, NEWS)
    assert len(everything) >= 95
    assert 4 <= len(news) <= 6
    assert all(one.ttl_ms == 1000 + QUIET_MS for one in news)
    assert all(one.ttl_ms == 1000 for one in everything)
    assert not any(one.flags & EstimateFlag.STALE for one in news)


def test_what_is_new_comes_with_the_frame_that_shows_it() -> None:
    """Each packet that is left out says what the last one sent did, within the tolerance."""
    everything, news = heard(Behaviour(act_s=0, switch_s=3), 4.0, 10.0, EVERYTHING, NEWS)
    normals = sphere_normals(2)
    sent = {one.sequence: one for one in news}
    assert len(sent) < 0.7 * len(everything)
    last: Estimate | None = None
    for one in everything:
        last = sent.get(one.sequence, last)
        if last is None:
            continue
        assert [light.id for light in one.lights] == [light.id for light in last.lights]
        assert one.flags == last.flags
        error = relighting_relative(one.irradiance(normals), last.irradiance(normals))
        assert error < 0.006  # 0.004 by the coefficients of order 4


def test_a_head_that_turns_hears_everything() -> None:
    turning = Behaviour(act_s=0, turn_deg_s=30)
    everything, news = heard(turning, 2.0, 3.0, EVERYTHING, NEWS)
    assert len(news) >= 0.95 * len(everything)


def test_a_new_subscription_is_answered_and_frames_that_stay_away_are_told() -> None:
    camera = SimulatedCamera(
        World([Room()], Behaviour(act_s=0), median_radiance=30.0),
        lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ,
    )  # fmt: skip
    with LiveProbe(camera) as probe:
        client = probe.client(NEWS)
        probe.run(4.0)
        before = len(client.estimates)
        client.subscribe(Subscription(max_lights=3, quiet_ms=QUIET_MS))
        probe.run(0.3)
        assert len(client.estimates) > before
        probe.link.close()
        probe.run(2.0)  # as soon as to any other client, though what it was sent lasts 3 s
        assert client.estimates[-1].flags & EstimateFlag.STALE


@pytest.mark.parametrize("tolerance", [0.0, 0.02])
def test_a_slow_change_adds_up(tolerance: float) -> None:
    """The room turns by 0.2 degrees a second: no packet in force is off by more than it may be."""
    wish = Subscription(max_lights=8, quiet_ms=60000, tolerance=tolerance)
    turning = Behaviour(act_s=0, turn_deg_s=0.2)
    everything, news = heard(turning, 4.0, 10.0, EVERYTHING, wish)
    normals = sphere_normals(2)
    last = news[0]
    sent = {one.sequence: one for one in news}
    for one in everything:
        last = sent.get(one.sequence, last)
        if one.sequence < news[0].sequence:
            continue
        error = relighting_relative(one.irradiance(normals), last.irradiance(normals))
        assert error < max(tolerance, 0.004) + 0.002 + tolerance  # and what its model leaves out
    assert 2 <= len(news) < 0.7 * len(everything)
