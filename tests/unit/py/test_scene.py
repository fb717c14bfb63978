"""Scenes: what is rendered is what is true."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.lamp import Lamp
from lightprobe.sim import procedural, scene
from lightprobe.sim.motion import turned

SIZE = (1920, 960)
NORMALS = geometry.sphere_normals(1)


def flux(layer, width, height):
    weight = np.repeat(geometry.equirect_solid_angles(width, height), width)[layer.index]
    return weight @ layer.values.astype(np.float64), weight


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(0.25, 7.5))
def test_disc_has_its_flux_and_its_direction_anywhere(azimuth_deg, elevation_deg, radius_deg):
    direction = geometry.direction_from_angles(azimuth_deg, elevation_deg)
    lamp = Lamp(direction, radius_deg, np.array([3.0, 2.0, 1.0]))
    layer = scene.disc_layer(lamp, *SIZE)
    got, weight = flux(layer, *SIZE)
    assert got == pytest.approx(lamp.irradiance, rel=1e-5)
    row, column = np.divmod(layer.index, SIZE[0])
    looks = geometry.equirect_direction(column, row, *SIZE)
    centroid = (weight * layer.values[:, 0]) @ looks
    assert geometry.angle_deg(centroid, direction) < 0.01
    assert layer.values[:, 0].max() == pytest.approx(lamp.radiance[0], rel=0.06)


def test_truth_is_the_rendered_map_s():
    for seed in (1, 4):
        room = procedural.random_scene(seed)
        powers = np.linspace(0.5, 1, len(room.lamps))
        radiance = room.render(*SIZE).compose(powers)
        drawn, exact = scene.MapTruth(radiance), room.truth(powers)
        assert sh.project(radiance, 4) == pytest.approx(
            exact.total[:25], abs=2e-4 * np.abs(exact.total).max()
        )
        assert drawn.irradiance(NORMALS) == pytest.approx(exact.irradiance(NORMALS), rel=2e-3)


def test_turned_scene_is_the_map_rolled_to_the_right():
    room = procedural.random_scene(3)
    powers = np.ones(len(room.lamps))
    radiance = room.render(640, 320).compose(powers)
    rolled = scene.MapTruth(np.roll(radiance, 80, axis=1))
    for seen in (room.truth(powers, turned(45)), scene.MapTruth(radiance, turned(45))):
        assert seen.irradiance(NORMALS) == pytest.approx(rolled.irradiance(NORMALS), rel=5e-3)
        assert seen.total[:9] == pytest.approx(
            rolled.total[:9], abs=2e-3 * np.abs(rolled.total).max()
        )


def test_lamps_that_are_off_are_not_true():
    room = procedural.random_scene(4)
    powers = np.zeros(5)
    powers[2] = 0.5
    truth = room.truth(powers)
    assert len(truth.lamps) == 1
    assert truth.lamps[0].irradiance == pytest.approx(0.5 * room.lamps[2].irradiance)


@pytest.mark.parametrize("seed", range(40))
def test_drawn_scenes_are_as_promised(seed):
    room = procedural.random_scene(seed)
    assert 1 <= len(room.lamps) <= 5
    assert sh.radiance(room.background, geometry.sphere_normals()).min() > 0
    radiances = [luminance(lamp.radiance) for lamp in room.lamps]
    assert max(radiances) <= 100.001 * min(radiances)
    for index, lamp in enumerate(room.lamps):
        assert 0.25 <= lamp.radius_deg <= 7.5
        for other in room.lamps[:index]:
            assert geometry.angle_deg(lamp.direction, other.direction) > 12


def test_drawn_scenes_repeat_and_differ():
    again = procedural.random_scene(7)
    assert np.array_equal(again.background, procedural.random_scene(7).background)
    assert not np.array_equal(again.background, procedural.random_scene(8).background)


def test_hard_places_are_visited():
    firsts = [procedural.random_scene(seed).lamps[0].direction for seed in range(20)]
    assert any(d[1] > 0.99 for d in firsts)
    assert any(d[1] < -0.99 for d in firsts)
    assert any(abs(geometry.angles_from_direction(d)[0]) > 178.9 for d in firsts)


def lamp_map():
    """A map of two lamps, one across the seam, over a dim room."""
    radiance = np.full((128, 256, 3), 0.1, np.float32)
    radiance[60:64, :2] = radiance[60:64, -2:] = 50
    radiance[:2, :] = (40, 30, 20)  # the zenith: all columns are one place
    return radiance


def test_panorama_is_split_into_lamps_and_rest():
    room = scene.PanoramaScene.of("map", lamp_map())
    assert len(room.lamps) == 2
    zenith, seam = sorted(room.lamps, key=lambda lamp: -lamp.direction[1])
    assert geometry.angle_deg(zenith.direction, [0, 1, 0]) < 0.1
    assert zenith.irradiance[0] > 1.9 * zenith.irradiance[2]
    assert geometry.angle_deg(seam.direction, [0, np.sin(np.radians(2.8)), 1]) < 0.5
    whole = room.render(256, 128).compose([1, 1])
    assert whole == pytest.approx(lamp_map(), rel=1e-5)
    assert room.base.max() == pytest.approx(0.1, rel=1e-5)


def test_resampling_keeps_the_light():
    room = scene.PanoramaScene.of("map", lamp_map())
    for width in (128, 640):
        radiance = room.render(width, width // 2).compose([1, 1])
        got = scene.MapTruth(radiance).total[:4]
        assert got == pytest.approx(scene.MapTruth(lamp_map()).total[:4], abs=0.05)


def test_map_truth_is_the_closed_form_of_a_constant_sky():
    truth = scene.MapTruth(np.full((64, 128, 3), 2.0, np.float32))
    assert truth.irradiance(NORMALS) == pytest.approx(2 * np.pi, rel=2e-3)
    assert truth.total[0] == pytest.approx(2 * np.sqrt(4 * np.pi))
    assert truth.total[1:] == pytest.approx(0, abs=1e-2)
