"""The figures of `make accuracy` about turning cameras are what their names say."""

import live
import numpy as np
import pytest
from lightprobe import sh
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import World

pytestmark = pytest.mark.usefixtures("released_daemon")


def estimate(world: World, yaw_deg: float, *, flags: int = 0, gain: float = 1.0) -> Estimate:
    """A perfect one of the world, turned; or too bright by a factor."""
    truth = world.scenes[0].truth(np.ones(len(world.scenes[0].lamps)), yaw_deg)
    ambient = gain * truth.total.copy()
    lights = []
    for k, lamp in enumerate(truth.lamps):
        lights.append(Light(k, lamp.direction, gain * lamp.irradiance, lamp.radius_deg))
        ambient -= sh.lamp(lamp.direction, sh.order_of(ambient))[:, None] * lights[k].irradiance
    harmonics = SphericalHarmonics("AMBIENT", sh.order_of(ambient), ambient)
    lit = tuple(lights)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(flags), lit, harmonics, 0.01, None, 1, None)


def test_perfect_estimates_are_judged_so_at_any_yaw() -> None:
    world = World([random_scene(3)])
    yaws = [0.0, 77.0, 200.0]
    good = [estimate(world, yaw_deg) for yaw_deg in yaws]
    found = live.figures(world, "30", "reported", good, yaws, good)
    assert found.error_median < 0.01
    assert found.wrong_and_healthy == found.births_per_s == 0
    assert found.healthy == 1
    assert found.ambient_step < 1e-6
    late = live.figures(world, "30", "reported", good, [yaw - 60 for yaw in yaws], good)
    assert late.error_median > 0.05


def test_wrong_is_told_from_wrong_and_flagged() -> None:
    world = World([random_scene(3)])
    bad = [estimate(world, 0, gain=1.5), estimate(world, 0, gain=1.5, flags=1)]
    found = live.figures(world, "0", "reported", bad, [0, 0], bad)
    assert found.wrong_and_healthy == 0.5
    assert found.healthy == 0.5


def test_births_and_steps_are_of_one_packet_to_the_next() -> None:
    world = World([random_scene(3)])
    one, other = estimate(world, 0), estimate(world, 0, gain=1.2)
    renamed = tuple(
        Light(9 + light.id, light.direction, light.irradiance, 1) for light in one.lights
    )
    gone = Estimate(1, 2, 3, 4, 500, EstimateFlag(0), renamed, one.sh, 0.01, None, 1, None)
    assert live.births([one, one, gone, gone]) == len(one.lights)
    assert live.ambient_step([one, other]) > 0.05
    assert live.ambient_step([one, one]) == 0


def test_a_turning_camera_does_not_call_a_wrong_estimate_healthy() -> None:
    found = live.judge(random_scene(3), "100", "reported", size_px=(480, 240))
    assert found.error_median > 0.05  # otherwise nothing is tested
    assert found.wrong_and_healthy == 0


def test_a_still_room_is_right_all_the_time() -> None:
    found = live.judge(random_scene(3), "0", "reported", size_px=(480, 240))
    assert found.packets > 100
    assert found.error_p90 < 0.1
    assert found.healthy == 1
    assert found.wrong_and_healthy == 0
