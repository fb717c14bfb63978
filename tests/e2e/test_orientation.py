"""Head poses from an app, in simulated time: right where they are right, told where they are not.

The camera sits on the head. A packet in the app's world is compared with the app's own idea of how
its head was turned; one in the probe's frame with the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.estimate import Estimate, Health
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS
from lightprobe.sim.faults import Faults
from lightprobe.sim.head import Habits, Head, Turned, true_turn
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

WISH = Subscription(smoothing="RAW", max_lights=8, sh_order=4, frame="WORLD", health_period_ms=100)
LIKE_A_HEAD = Behaviour(act_s=0, swing_deg=40, swing_hz=0.5)
STILL = Behaviour(act_s=0)
#: Of a packet that says WORLD; what is further off must not have been sent.
MOST_WRONG_DEG = 2.5


def simulated(behaviour: Behaviour) -> SimulatedCamera:
    world = World(scenes.load(["room"]), behaviour, 4.0)
    return SimulatedCamera(world, lenses.load("equirect"), (960, 480), rate_hz=30)


@dataclass
class Story:
    """What came in simulated seconds, and how wrong it was."""

    estimates: list[Estimate]
    captured_s: list[float]
    faults: list[tuple[float, set[str]]]  # when a health message came, and their ids
    errors: list[
        tuple[float, float]
    ]  # when, and degrees, of packets in the world as the app has it
    refusals: list[str]

    def in_world(self, from_s: float, to_s: float = np.inf) -> float:
        """Share of the packets."""
        some = [
            e.frame == "WORLD"
            for e, t_s in zip(self.estimates, self.captured_s, strict=True)
            if from_s <= t_s < to_s
        ]
        return float(np.mean(some))

    def errors_deg(self, from_s: float = 0.0, to_s: float = np.inf) -> list[float]:
        """Of the packets in the world."""
        return [deg for t_s, deg in self.errors if from_s <= t_s < to_s]

    def told(self, from_s: float, to_s: float = np.inf) -> set[str]:
        """Every fault that health told in that time."""
        return set().union(*(ids for t_s, ids in self.faults if from_s <= t_s < to_s))


def tell(
    seconds: float,
    behaviour: Behaviour = LIKE_A_HEAD,
    turned: Turned | None = None,
    habits: Habits | None = None,
    arguments: Sequence[str] = ("--orientation=client",),
    faults: Faults | None = None,
    wish: Subscription = WISH,
) -> Story:
    camera = simulated(behaviour)
    idea = turned or true_turn(camera)
    with LiveProbe(camera, arguments, faults=faults) as probe:
        client = probe.client(wish)
        head = Head(client, idea, START_NS, habits)
        if "--orientation=client" in arguments:
            probe.apps.append(head)
        probe.run(seconds)
        estimates = client.estimates
        captured_s = [probe.captured_s(one) for one in estimates]
        health = [(r.t_s, r.message) for r in client.received if isinstance(r.message, Health)]
    errors = [
        (t_s, off_deg(one, idea(t_s)))
        for one, t_s in zip(estimates, captured_s, strict=True)
        if one.frame == "WORLD"
    ]
    ids = [(t_s, {fault.id for fault in one.faults}) for t_s, one in health]
    return Story(estimates, captured_s, ids, errors, head.refusals)


def off_deg(estimate: Estimate, wxyz: np.ndarray | None) -> float:
    """Between the orientation that a packet states and what the app meant at that time."""
    assert estimate.orientation is not None
    if wxyz is None:
        return 0.0
    x, y, z, w = estimate.orientation
    stated, meant = geometry.rotation_matrix([w, x, y, z]), geometry.rotation_matrix(wxyz)
    cosine = (np.trace(stated.T @ meant) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def turned_by(axis: Sequence[float], deg: float, camera: SimulatedCamera, t_s: float) -> np.ndarray:
    """The truth, on a mount that is turned by so much."""
    return geometry.turn_after(true_turn(camera)(t_s), geometry.quaternion(axis, deg))


def test_good_poses_give_packets_in_the_world() -> None:
    story = tell(5)
    assert story.in_world(0.2) == 1
    assert story.told(0.2) == set()
    assert story.refusals == []
    assert np.median(story.errors_deg()) < 0.5
    assert max(story.errors_deg(1)) < 1.5
    sigmas = [one.orientation_sigma_deg for one in story.estimates if one.frame == "WORLD"][30:]
    assert 0.05 < np.median(sigmas) < 0.5


def test_lamps_of_the_world_stay_where_they_are() -> None:
    """Their directions, by packets in the world of a head that turns."""
    story = tell(4)
    strongest = [one.lights[0].direction for one in story.estimates[30:] if one.frame == "WORLD"]
    mean = geometry.normalize(np.mean(strongest, axis=0))
    spread_deg = np.degrees(np.arccos(np.clip(np.array(strongest) @ mean, -1, 1)))
    assert np.median(spread_deg) < 0.5
    assert spread_deg.max() < 1.5


def test_noisy_poses_with_gaps() -> None:
    story = tell(5, habits=Habits(noise_deg=0.5, drop=0.4))
    assert story.in_world(0.5) > 0.9
    assert story.told(0.5) == set()
    assert max(story.errors_deg(1)) < 5
    sigmas = [one.orientation_sigma_deg for one in story.estimates if one.frame == "WORLD"][30:]
    assert np.median(sigmas) > 0.4


def test_a_still_camera_is_still_to_the_bit() -> None:
    """Noise of what tells the orientation enters nothing but the orientation."""
    probe_frame = replace(WISH, frame="PROBE")
    faults = Faults(orientation_noise_deg=0.3)
    alone, told = (
        tell(3, STILL, arguments=[f"--orientation={kind}"], faults=faults, wish=probe_frame)
        for kind in ("visual", "sim")
    )
    unsaid = {"boot_id": 0, "orientation": None, "orientation_sigma_deg": None}
    assert len(alone.estimates) > 60
    assert [repr(replace(one, **unsaid)) for one in told.estimates] == [
        repr(replace(one, **unsaid)) for one in alone.estimates
    ]


def test_poses_that_stop_and_come_again() -> None:
    camera = simulated(LIKE_A_HEAD)
    story = tell(7, turned=lambda t_s: None if 2 < t_s < 4 else true_turn(camera)(t_s))
    assert story.in_world(0.2, 1.9) == 1
    assert story.in_world(2.1, 3.9) == 0
    assert "orientation-silent" in story.told(3.2, 4.0)
    assert story.in_world(5.5) == 1
    assert story.told(5.5) == set()
    assert max(story.errors_deg()) < MOST_WRONG_DEG


def test_a_world_that_jumps() -> None:
    """As apps do that recognise the room anew: left out until its new world has proved to stay."""
    camera = simulated(LIKE_A_HEAD)

    def jumping(t_s: float) -> np.ndarray:
        by = geometry.quaternion([0.3, 1, 0], 10 if t_s > 2 else 0)
        return geometry.turn_after(by, true_turn(camera)(t_s))

    story = tell(13, turned=jumping)
    assert "orientation-contradicts" in story.told(2.0, 3.0)
    assert story.in_world(2.1, 3.0) == 0
    assert story.in_world(12) == 1
    assert story.told(12) == set()
    assert max(story.errors_deg(1, 2)) < MOST_WRONG_DEG
    assert max(story.errors_deg(2.05)) < MOST_WRONG_DEG  # what was on its way is of the old world


def test_a_mount_that_is_not_as_told() -> None:
    """10 degrees off: found out as soon as the head has turned a little."""
    camera = simulated(LIKE_A_HEAD)
    story = tell(4, turned=lambda t_s: turned_by([1, 0, 0.5], 10, camera, t_s))
    assert "orientation-contradicts" in story.told(0.0, 1.0)
    assert story.in_world(0.3) < 0.05


def test_poses_of_a_moment_ago() -> None:
    """Stamped as of now, but measured 100 ms before: the pictures tell."""
    camera = simulated(LIKE_A_HEAD)
    story = tell(4, turned=lambda t_s: true_turn(camera)(t_s - 0.1))
    assert "orientation-contradicts" in story.told(0.0, 1.5)
    assert story.in_world(1) < 0.05


def test_poses_that_come_late() -> None:
    story = tell(4, habits=Habits(transfer_ms=100))
    assert "orientation-late" in story.told(1.5)
    assert story.in_world(0.5) == 0


@pytest.mark.parametrize("seconds", [-3600, 3600])
def test_poses_of_another_clock(seconds: int) -> None:
    story = tell(3, habits=Habits(stamp_ns=seconds * 1_000_000_000))
    assert "orientation-clock" in story.told(1)
    assert story.in_world(0.5) == 0
    assert 0 < len(story.refusals) < 6  # told, once a second
    assert "clock of the pings" in story.refusals[0]


@pytest.mark.parametrize(
    "faults",
    [
        Faults(orientation_noise_deg=0.1, orientation_late_ms=100),
        Faults(orientation_jump_s=2, orientation_jump_deg=10),
    ],
)
def test_a_sensor_on_the_camera_that_is_wrong(faults: Faults) -> None:
    story = tell(5, arguments=("--orientation=sim",), faults=faults)
    assert "orientation-contradicts" in story.told(0, 3)


def test_a_sensor_on_the_camera_with_gaps() -> None:
    faults = Faults(orientation_noise_deg=0.2, orientation_drop=0.3)
    story = tell(5, arguments=("--orientation=sim",), faults=faults)
    assert story.told(0) == set()
    assert 0.6 < story.in_world(0.5) < 0.8
    assert max(story.errors_deg()) < MOST_WRONG_DEG
