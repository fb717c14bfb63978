"""What the ring of light sensors adds to a live camera: lamps that are switched, a sun that clips.

Everything is simulated in lock-step with the daemon's time: the firmware that reads the LDRs, their
lag, the line, the camera. So no load changes a figure.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.lamp import Lamp
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.live_ring import LiveRing
from lightprobe.sim.scene import ProceduralScene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

CD_M2_PER_UNIT = 10.0
SWITCH_S = 4.03  # between two frames
#: From a step at the sensor to its sample in the daemon (test_daemon_ring_latency.py), and the
#: daemon's own share.
SAMPLE_S, LIMIT_S = 0.022, 0.015
EARLIEST_S = 0.010  # no sample is earlier
PERIOD_S = 0.002  # of the simulation


def lamp(azimuth_deg: float, elevation_deg: float, strength: float) -> Lamp:
    return Lamp(
        geometry.direction_from_angles(azimuth_deg, elevation_deg), 2.0, np.full(3, strength)
    )


def room(*lamps: Lamp) -> ProceduralScene:
    """Lamps in a room whose walls are not all alike."""
    walls = np.zeros((9, 3))
    walls[0] = 0.5 * np.sqrt(4 * np.pi)
    walls[1:] = 0.1 * np.random.default_rng(3).normal(size=(8, 3))
    return ProceduralScene("room", walls, lamps)


THREE = room(lamp(30, 35, 4.0), lamp(150, 20, 2.5), lamp(-100, 50, 3.0))
#: In the shortest exposure, 100 us, a radiance of 10 000 is full scale: this sun has twice that.
SUN = room(Lamp(geometry.direction_from_angles(60, 40), 1.0, np.full(3, 19.0)))
TWO = room(lamp(30, 35, 4.0), lamp(170, 20, 2.5))


@dataclass
class Run:
    probe: LiveProbe
    ring: LiveRing
    raw: LiveClient
    smoothed: LiveClient
    world: World

    def packets(self, client: LiveClient) -> list[tuple[float, float, Estimate]]:
        """When each came, when its frame was captured, and itself."""
        return [
            (r.t_s, self.probe.captured_s(r.message), r.message)
            for r in client.received
            if isinstance(r.message, Estimate)
        ]

    def between_frames(self) -> list[float]:
        """When packets came that no new frame brought."""
        packets = self.packets(self.raw)
        return [
            packets[i][0]
            for i in range(1, len(packets))
            if packets[i][1] <= packets[i - 1][1] and not packets[i][2].flags & EstimateFlag.STALE
        ]


@contextlib.contextmanager
def run(
    scene: ProceduralScene,
    behaviour: Behaviour,
    rate_hz: float = 5.0,
    spoil: Callable[[float, Array], Array] = lambda t_s, lux: lux,
    firmware: str = "host",
) -> Iterator[Run]:
    """A daemon before camera and ring; `spoil` gives the light on the sensors from the true one."""
    world = World([scene], behaviour)
    camera = SimulatedCamera(world, lenses.load("equirect"), (960, 480), rate_hz=rate_hz)
    light = RingLight(world, CD_M2_PER_UNIT)
    with (
        LiveRing(firmware) as ring,
        LiveProbe(camera, ring.daemon_arguments(CD_M2_PER_UNIT)) as probe,
    ):
        ring.shine(lambda: spoil(probe.t_s, light.lux(probe.link.state_now())))
        probe.apps.append(ring)
        yield Run(
            probe, ring, probe.client(Subscription(smoothing="RAW", max_lights=8)),
            probe.client(Subscription(max_lights=8)), world,
        )  # fmt: skip


def strength(estimate: Estimate, lamp: Lamp, turn: Array | None = None) -> float:
    """Of the lamp, 0 where it is not listed."""
    direction = lamp.direction if turn is None else turn @ lamp.direction
    near = [one for one in estimate.lights if one.direction @ direction > np.cos(np.radians(8))]
    return sum(float(luminance(one.irradiance)) for one in near)


def first(packets: list[tuple[float, float, Estimate]], t_s: float, shows) -> tuple[float, float]:
    """When the first packet after t_s came that shows the change, and its frame's time."""
    return next((came, captured) for came, captured, e in packets if came >= t_s and shows(e))


def told_in_time(came_s: float, switched_s: float, what: str) -> bool:
    """Whether the packet came in time; prints when (`pytest -s`)."""
    late_s = came_s - switched_s
    print(
        f"{what}: in a packet {1e3 * late_s:.0f} ms after the light, whose sample comes after "
        f"{1e3 * EARLIEST_S:.0f} to {1e3 * SAMPLE_S:.0f} ms (simulated time)"
    )
    return late_s <= SAMPLE_S + LIMIT_S + PERIOD_S


def mean_light(estimate: Estimate) -> float:
    return float(luminance(estimate.irradiance(geometry.sphere_normals(2))).mean())


@pytest.mark.parametrize("which", ["raw", "smoothed"])
def test_a_lamp_that_goes_off_is_told_before_the_camera_sees_it(which):
    with run(THREE, Behaviour(act_s=0, switch_s=SWITCH_S)) as r:
        r.probe.run(SWITCH_S + 0.9)
        packets = r.packets(getattr(r, which))
        lamps = r.world.scenes[0].lamps
        full = float(luminance(lamps[0].irradiance))
        before = [e for came, _, e in packets if came < SWITCH_S][-1]
        assert strength(before, lamps[0]) == pytest.approx(full, rel=0.1)
        came, captured = first(packets, SWITCH_S, lambda e: strength(e, lamps[0]) < full / 2)
        assert told_in_time(came, SWITCH_S, f"a lamp goes off, {which}")
        assert captured < SWITCH_S  # its newest frame has not seen it
        others = next(e for t, _, e in packets if t == came)
        for lamp in lamps[1:]:
            assert strength(others, lamp) == pytest.approx(
                float(luminance(lamp.irradiance)), rel=0.15
            )
        # and nothing jumps back when frames show it
        levels = [mean_light(e) for t, _, e in packets if t > came + 0.05]
        step = mean_light(before) - levels[-1]
        assert len(levels) >= 3
        assert max(abs(level - levels[-1]) for level in levels) < 0.15 * step


def test_a_lamp_that_goes_on_again_is_told_before_the_camera_sees_it():
    with run(TWO, Behaviour(act_s=0, switch_s=SWITCH_S)) as r:
        on_s = 3 * SWITCH_S  # all are on again
        r.probe.run(on_s + 0.1)
        lamp = r.world.scenes[0].lamps[1]
        full = float(luminance(lamp.irradiance))
        packets = r.packets(r.raw)
        assert strength([e for came, _, e in packets if came < on_s][-1], lamp) == 0
        came, captured = first(packets, on_s, lambda e: strength(e, lamp) > full / 2)
        assert told_in_time(came, on_s, "a lamp goes on again")
        assert captured < on_s
        light = max(
            next(e for t, _, e in packets if t == came).lights,
            key=lambda one: float(one.direction @ lamp.direction),
        )
        assert light.flags & LightFlag.RING


def shaded(t_s: float, lux: Array) -> Array:
    """A hand before sensor 2, and a little before its neighbour, for half a second."""
    hand = np.ones(9)
    hand[2:4] = 0.2, 0.7
    return lux * hand if 2.5 <= t_s % 3 < 3 else lux


NO_STEPS = {
    "a hand before a sensor": (Behaviour(act_s=0), 5.0, shaded, {}),
    "a head that turns": (Behaviour(act_s=0, swing_deg=40, swing_hz=0.5), 30.0, None, {}),
    "a fast turn": (Behaviour(act_s=0, turn_deg_s=100), 30.0, None, {}),
    "mains of 50 Hz": (Behaviour(act_s=0), 5.0, None, {"flicker_hz": 100, "flicker_share": 0.5}),
    "mains of 60 Hz": (Behaviour(act_s=0), 5.0, None, {"flicker_hz": 120, "flicker_share": 0.5}),
}


@pytest.mark.nightly_rows
@pytest.mark.parametrize("name", NO_STEPS)
def test_what_is_no_step_is_not_told(name):
    behaviour, rate_hz, spoil, numbers = NO_STEPS[name]
    with run(THREE, behaviour, rate_hz, spoil or (lambda t_s, lux: lux)) as r:
        r.ring.box.set(**numbers)
        r.probe.run(5.0)
        assert len(r.packets(r.raw)) > 2 * rate_hz
        assert [t_s for t_s in r.between_frames() if t_s > 2] == []


def test_a_sun_that_clips_in_every_exposure_has_its_strength():
    """The flashed binary in simavr, its line, the daemon, a client."""
    with run(SUN, Behaviour(act_s=0), firmware="avr") as r:
        r.probe.run(4.0)
        sun = r.world.scenes[0].lamps[0]
        estimate = r.packets(r.raw)[-1][2]
        (light,) = [one for one in estimate.lights if one.direction @ sun.direction > 0.99]
        assert light.flags & LightFlag.CLIPPED
        assert light.flags & LightFlag.RING
        assert strength(estimate, sun) == pytest.approx(float(luminance(sun.irradiance)), rel=0.1)
        smoothed = r.packets(r.smoothed)[-1][2]
        assert strength(smoothed, sun) == pytest.approx(float(luminance(sun.irradiance)), rel=0.1)
