"""What the simulator publishes as the truth is the light that its scenes cast."""

import numpy as np
import pytest
from lightprobe import sh
from lightprobe.geometry import equirect_directions
from lightprobe.sim import scenes
from lightprobe.sim.truth import Exact
from lightprobe.sim.world import Behaviour, World

NORMALS = equirect_directions(12, 6).reshape(-1, 3)


@pytest.mark.parametrize("name", ["procedural:3", "room"])
def test_irradiance_is_the_scenes(name):
    world = World(scenes.load([name]), Behaviour(act_s=4, turn_deg_s=30, switch_s=1.5), 30.0)
    exact = Exact()
    for t_s in (0.0, 2.0, 3.7, 5.0):
        state = world.at(t_s)
        message = exact.estimate(state, 0.5)
        got = sh.irradiance(np.array(message.sh.coefficients).reshape(-1, 3), NORMALS)
        for light in message.lights:
            cosine = np.maximum(NORMALS @ np.array(light.direction), 0)
            got += cosine[:, None] * np.array(light.irradiance)
        wanted = 0.5 * state.truth().irradiance(NORMALS)
        # Lamps are points here, discs there; the SH end at order 4.
        assert np.abs(got - wanted).max() < 0.03 * wanted.max()


def test_lamps_are_named_from_the_strongest_on():
    world = World(scenes.load(["procedural:5"]), Behaviour(act_s=1))
    for act in range(5):
        lights = Exact().estimate(world.at(act + 0.5), 1.0).lights
        strength = [sum(light.irradiance) for light in lights]
        assert strength == sorted(strength, reverse=True)
        assert [light.id for light in lights] == list(range(1, len(lights) + 1))
