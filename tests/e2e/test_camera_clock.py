"""A camera's time stamps: exact where they can be true, told and replaced where they cannot.

In simulated time. The camera swings, so that a wrong time is a wrong direction.
"""

import time
from dataclasses import dataclass

import numpy as np
import pytest
from harness import STALE, Daemon, camera, jpeg
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

WISH = Subscription(smoothing="RAW", max_lights=8, health_period_ms=100)
SWING = Behaviour(act_s=0, swing_deg=40, swing_hz=0.5)
RATE_HZ = 15.0
TTL_S = 1.0
EXPOSURE_US = 4000
FIRST_US = 33000  # automatic, before the command
#: By which the time of a frame may be wrong where its arrival stands in.
MOST_WRONG_S = 0.04


@dataclass
class Story:
    """What came in some simulated seconds."""

    estimates: list[Estimate]
    ages_s: list[float]  # of their frames, when they came
    late_s: list[float]  # by how much the time of their frames is later than the truth
    faults: list[tuple[float, dict[str, str]]]  # when a health message came, and their texts
    log: str

    def told(self, from_s: float, to_s: float = np.inf) -> set[str]:
        """Every fault that health told in that time."""
        return {fault for t_s, ids in self.faults if from_s <= t_s < to_s for fault in ids}


def tell(faults: Faults, seconds: float = 4.0) -> Story:
    world = World(scenes.load(["room"]), SWING, 4.0)
    cam = SimulatedCamera(world, lenses.load("equirect"), (240, 120), rate_hz=RATE_HZ)
    with LiveProbe(cam, [f"--exposure-us={EXPOSURE_US}"], faults=faults) as probe:
        client = probe.client(WISH)
        probe.run(seconds)
        got = [(r.t_s, r.message) for r in client.received if isinstance(r.message, Estimate)]
        captured_s = [probe.captured_s(e) for _, e in got]
        # An estimate comes as its frame has been read.
        frames = range(int(seconds * RATE_HZ) + 2)
        reads_s = [min(map(cam.read_s, frames), key=lambda r_s, t_s=t_s: abs(t_s - r_s))
                   for t_s, _ in got]  # fmt: skip
        return Story(
            [e for _, e in got],
            [now_s - then_s for (now_s, _), then_s in zip(got, captured_s, strict=True)],
            [min((then_s - read_s + 5e-7 * us for us in (EXPOSURE_US, FIRST_US)), key=abs)
             for then_s, read_s in zip(captured_s, reads_s, strict=True)],
            [(r.t_s, {f.id: f.text for f in r.message.faults})
             for r in client.received if type(r.message).__name__ == "Health"],
            probe.log,
        )  # fmt: skip


@pytest.fixture(scope="module")
def honest() -> Story:
    return tell(Faults())


def test_an_honest_clock_is_believed_to_the_microsecond(honest: Story) -> None:
    assert len(honest.estimates) > 50
    assert max(map(abs, honest.late_s)) < 2e-6
    assert honest.told(0) == set()


def test_delays_of_the_way_leave_the_stamps_as_they_are() -> None:
    story = tell(Faults(late_ms=120, jitter_ms=25))
    assert story.told(0) == set()
    assert min(story.ages_s) > 0.12
    assert max(story.ages_s) < 0.3


LIES = {
    "frozen": (Faults(clock_stop_s=0.001), 0.0, "stand still"),
    "frozen later": (Faults(clock_stop_s=2), 2.0, "stand still"),
    "past": (Faults(clock_ahead_ms=-5000), 0.0, "older"),
    "an hour past": (Faults(clock_ahead_ms=-3.6e6), 0.0, "older"),
    "future": (Faults(clock_ahead_ms=3.6e6), 0.0, "to come"),
    "Unix time": (Faults(clock_ahead_ms=1.7e12), 0.0, "to come"),
    "steps back": (
        Faults(clock_ahead_ms=-3000, clock_step_s=2),
        2.0,
        "stand still or go back",
    ),
    "steps forth": (Faults(clock_ahead_ms=3000, clock_step_s=2), 2.0, "to come"),
    "drifts": (Faults(clock_drift_ppm=-20000), 8.1, "faster or slower"),
}


@pytest.mark.parametrize("name", LIES)
def test_a_clock_that_cannot_be_right_is_told_and_the_arrival_counts(name: str) -> None:
    faults, from_s, words = LIES[name]
    story = tell(faults, from_s + 4.0)
    settled = [k for k, e in enumerate(story.estimates) if k / RATE_HZ > from_s + 0.5]
    assert len(story.estimates) > 0.9 * RATE_HZ * (from_s + 4.0)
    assert max(story.ages_s) < TTL_S
    assert not any(e.flags & STALE for e in story.estimates)
    assert max(abs(story.late_s[k]) for k in settled) < MOST_WRONG_S
    assert story.told(0, from_s - 0.1) == set()
    assert story.told(from_s + 0.5) == {"camera-clock"}
    assert words in story.faults[-1][1]["camera-clock"]
    assert sum(": clock: " in line for line in story.log.splitlines()) == 1


def sigmas_deg(story: Story) -> float:
    """Median of what lamps say of their directions while the camera turns fast."""
    return float(np.median([
        lamp.direction_sigma_deg for k, e in enumerate(story.estimates)
        if k > 20 and abs(np.cos(np.pi * k / RATE_HZ)) > 0.7 for lamp in e.lights
    ]))  # fmt: skip


def test_directions_are_stated_less_certainly(honest: Story) -> None:
    assert sigmas_deg(tell(LIES["past"][0])) > 1.4 * sigmas_deg(honest)


def test_a_clock_that_is_right_again_is_believed_again() -> None:
    world = World(scenes.load(["room"]), SWING, 4.0)
    cam = SimulatedCamera(world, lenses.load("equirect"), (240, 120), rate_hz=RATE_HZ)
    with LiveProbe(cam) as probe:
        client = probe.client(WISH)
        probe.run(3.0)
        probe.link.misbehave("clock_ahead_ms=-2500")
        probe.run(2.0)
        assert client.health is not None
        assert [f.id for f in client.health.faults] == ["camera-clock"]
        probe.link.misbehave("clock_ahead_ms=0")
        probe.run(1.0)
        assert [f.id for f in client.health.faults] == ["camera-clock"]
        probe.run(2.0)
        assert client.health.faults == ()


def test_an_estimate_of_an_old_frame_says_so() -> None:
    """As after a pause of the daemon: what waited meanwhile is no newer for having come now."""
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", "--ttl-ms=300") as daemon,
        daemon.client() as client,
    ):
        cam.accept()
        cam.send(jpeg(), t_start_ns=time.monotonic_ns() - 400_000_000)
        assert client.until(lambda e: e.sequence == 1).flags & STALE
