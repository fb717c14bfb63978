"""The figures of `make accuracy` about lamps that change are what their names say."""

import json
from collections.abc import Callable
from dataclasses import replace

import changes
import numpy as np
import pytest
import recording
from judge import Packet
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World

pytestmark = pytest.mark.many_frames
SCENE = random_scene(2)
SMALL_PX = (960, 480)
WHERE = ("a scene", "reported", "raw")
BEHAVIOUR = Behaviour(act_s=0, switch_s=changes.SWITCH_S)
FRAMES = np.arange(2 * 30, 8 * 30)


def packet(scene: Scene, t_s: float, powers: np.ndarray, flags: int = 0) -> Packet:
    """All of the light as lamps on black."""
    lights = tuple(
        Light(k, lamp.direction, power * lamp.irradiance, lamp.radius_deg)
        for k, (lamp, power) in enumerate(zip(scene.lamps, powers, strict=True))
    )
    black = SphericalHarmonics("AMBIENT", 0, np.zeros((1, 3)))
    return Packet(
        Estimate(1, 2, 3, 4, 500, EstimateFlag(flags), lights, black, 0.01, None, 1, None),
        geometry.UNTURNED,
        t_s,
    )


def followed(by: Callable[[World, float], np.ndarray], flags: int = 0) -> changes.Step:
    world = World([SCENE], BEHAVIOUR)
    packets = [packet(SCENE, frame / 30 + 1e-3, by(world, frame / 30), flags) for frame in FRAMES]
    return changes.steps(world, packets, WHERE)


def test_frames_until_a_change_shows_are_counted() -> None:
    assert followed(lambda world, t_s: world.at(t_s).powers).frames_worst == 1
    late = followed(lambda world, t_s: world.at(t_s - 4 / 30).powers)
    assert late.frames_median == late.frames_worst == 5
    assert late.overshoot_worst < 1e-9
    assert late.announced == 0
    assert late.changes == 2  # at 4 and 6 s: of the light before 2 s nothing is known
    flagged = followed(lambda world, t_s: world.at(t_s - 4 / 30).powers, EstimateFlag.CLIPPED)
    assert flagged.announced == 1


def test_overshoot_is_of_the_change() -> None:
    def eager(world: World, t_s: float) -> np.ndarray:
        now, before = world.at(t_s).powers, world.at(t_s - 0.1).powers
        return now + 0.3 * (now - before)

    assert followed(eager).overshoot_worst == pytest.approx(0.3, abs=1e-6)


def test_a_change_that_never_shows_took_for_ever() -> None:
    def stuck(world: World, t_s: float) -> np.ndarray:
        return world.at(0).powers * (1 + 1e-3 * (t_s % 0.1))

    found = followed(stuck)
    assert found.frames_median == np.inf
    assert found.error_settled > 0.05
    assert changes.step_rows([found])[0][2] == "never (never)"
    assert json.loads(recording.to_json([found]))[0]["frames_median"] is None


def test_ripple_is_of_the_strongest_lamp() -> None:
    world = World([SCENE], Behaviour(act_s=0))
    powers = [1.2, 0.8, 1.2, 0.8]
    packets = [packet(SCENE, k, np.full(len(SCENE.lamps), p)) for k, p in enumerate(powers)]
    found = changes.flicker(world, packets, WHERE, 100)
    assert found.ripple == pytest.approx(0.2)
    assert found.bias == pytest.approx(0)
    assert found.listed == 1
    none = changes.flicker(world, [packet(SCENE, 0, np.zeros(len(SCENE.lamps)))], WHERE, 100)
    assert none.bias == -1


@pytest.mark.nightly_rows
#: Frames are 1/30 s: on UVC 0.4 s. Smoothed packets follow with a time constant of 0.2 s.
@pytest.mark.parametrize(
    ("exposures", "most_frames"),
    [("reported", {"raw": 2, "default": 18}), ("unreported", {"raw": 12, "default": 24})],
)
def test_a_daemon_follows_switches(exposures: str, most_frames: dict[str, int]) -> None:
    switched, *_ = changes.of_scene(Room(), exposures, size_px=(480, 240))
    for one in changes.judged(switched):
        assert isinstance(one, changes.Step)
        assert one.changes == 4
        assert one.frames_worst <= most_frames[one.subscription]
        assert one.overshoot_worst <= 0.1
        assert one.announced == 1
        assert one.error_settled < 0.02


@pytest.mark.nightly_rows
@pytest.mark.parametrize("exposures", ["reported", "unreported"])
def test_a_lamp_that_flickers_is_its_mean(exposures: str) -> None:
    at_100_hz = next(case for case in changes.of_scene(Room(), exposures) if case.mains_hz == 100)
    recorded = recording.record(replace(at_100_hz.run, judged_s=6.0))
    for name, packets in recorded.packets.items():
        settled = [one for one in packets if one.captured_s > 3.0]  # all phases have been seen
        one = changes.flicker(recorded.world, settled, ("room", exposures, name), 100.0)
        assert one.listed == 1
        if exposures == "reported":
            assert abs(one.bias) < 0.05
            assert one.flagged == 1
            assert one.ripple < 0.15
        else:  # the shortest exposure comes but three times in nine frames, not in all phases alike
            strongest = max(settled[-1].estimate.lights, key=lambda light: light.irradiance[1])
            sigma = strongest.irradiance_sigma[1] / strongest.irradiance[1]
            assert abs(one.bias) < min(2 * sigma, 0.15)
            assert one.flagged > 0.7


@pytest.mark.parametrize(("mains_hz", "flagged"), [(120.0, 1), (0.0, 0)])
def test_bands_tell_flicker_whose_phase_stands_still(mains_hz: float, flagged: int) -> None:
    """At 120.0 Hz and 30 frames per second no lamp changes from frame to frame."""
    flicker = Flicker(mains_hz, (changes.FLICKER_DEPTH,), changes.PHASES)
    behaviour = Behaviour(act_s=0, flicker=flicker)
    run = recording.Run(Room(), behaviour, judged_s=2.0, size_px=SMALL_PX,
                        row_time_us=2 * changes.ROW_TIME_US)  # fmt: skip
    for one in changes.judged(changes.Case(run, mains_hz)):
        assert isinstance(one, changes.Ripple)
        assert one.flagged == flagged
