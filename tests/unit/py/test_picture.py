"""What the eye is shown: relighting, shadows, tables, swatches."""

import dataclasses

import cv2
import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.cli import view
from lightprobe.colour import luminance
from lightprobe.estimate import (
    Estimate,
    EstimateFlag,
    Light,
    LightFlag,
    Room,
    SphericalHarmonics,
)
from lightprobe.evaluate import marks, picture, relight
from lightprobe.sim import scene
from lightprobe.sim.procedural import random_scene

ROOM = random_scene(2)
POWERS = np.ones(3)


def perfect(flags=EstimateFlag(0)):  # noqa: B008 - immutable
    lights = tuple(
        Light(k + 1, lamp.direction, lamp.irradiance, lamp.radius_deg, 0.1, 0.02 * lamp.irradiance)
        for k, lamp in enumerate(ROOM.lamps)
    )
    ambient = SphericalHarmonics("AMBIENT", 2, ROOM.background)
    return Estimate(1, 2, 3, 4, 500, flags, lights, ambient, 0.01, None, 1, None)


def test_a_perfect_packet_lights_as_the_truth_does():
    radiance = ROOM.render(1024, 512).compose(POWERS)
    true = relight.draw(relight.Lighting.of_map(radiance), 64)
    packet = relight.draw(relight.Lighting.of_estimate(perfect()), 64)
    assert np.abs(true - packet)[..., :3].mean() < 0.01 * true[..., :3].max()
    assert np.array_equal(true[..., 3], packet[..., 3])


def street_lights() -> np.ndarray:
    """A dim map with bright regions that are no discs: a tube, an L, one pixel."""
    radiance = np.full((256, 512, 3), 0.2, np.float32)
    radiance[60:62, 100:130] = (90, 80, 60)
    radiance[90:110, 300:302] = radiance[108:110, 300:320] = (40, 60, 90)
    radiance[30, 420] = 900
    return radiance


@pytest.mark.parametrize("height", [256, 250])
def test_light_of_a_map_counts_once_whatever_the_shape_of_its_lamps(height):
    """Lamps as discs that are taken out of the map and put in again: up to 1.58 × the truth."""
    radiance = street_lights()[:height]
    true = scene.MapTruth(radiance)
    assert len(scene.PanoramaScene.of("street", radiance).lamps) >= 2
    lighting = relight.Lighting.of_map(radiance)
    solid_angle = geometry.equirect_solid_angles(512, height)[:, None, None]
    total = (radiance.astype(np.float64) * solid_angle).sum(axis=(0, 1))
    assert lighting.powers.sum(axis=0) == pytest.approx(total, rel=1e-9)
    normals = geometry.sphere_normals()
    irradiance = np.maximum(normals @ lighting.directions.T, 0) @ lighting.powers
    exact = true.irradiance(normals)
    assert np.abs(irradiance - exact).max() < 0.002 * exact.max()
    assert len(lighting.powers) < 8000  # what is dim stays coarse


def test_a_black_map_gives_no_light():
    lighting = relight.Lighting.of_map(np.zeros((64, 128, 3), np.float32))
    assert lighting.sphere(geometry.sphere_normals()).max() == 0


def test_shadows_fall_away_from_the_lamp():
    """A lamp on the left, halfway up: the floor is dark on the right of the sphere."""
    lamp = Light(1, np.array([-1, 1, 0]) / 2**0.5, np.array([5.0, 5, 5]), 1.0)
    dark = SphericalHarmonics("AMBIENT", 0, np.full((1, 3), 0.05))
    estimate = Estimate(1, 2, 3, 4, 500, EstimateFlag(0), (lamp,), dark, None, None, 1, None)
    lighting = relight.Lighting.of_estimate(estimate)
    left, right, far = lighting.floor(np.array([[-1.4, -1, 0], [1.4, -1, 0], [0, -1, 6.0]]))
    assert right[0] < 0.1 * left[0]
    assert far[0] == pytest.approx(left[0], rel=0.1)
    lit, unlit = lighting.sphere(np.array([[-1.0, 0, 0], [1.0, 0, 0]]))
    assert unlit[0] < 0.1 * lit[0]


def test_lamps_in_the_sh_are_not_added_again():
    estimate = perfect()
    total = relight.Lighting.of_estimate(
        Estimate(1, 2, 3, 4, 500, EstimateFlag(0), estimate.lights, estimate.total(), None, None, 1,
                 None)
    )  # fmt: skip
    assert total.powers.sum() == pytest.approx(
        relight.Lighting.of_estimate(estimate).powers.sum(), rel=0.02
    )


@pytest.mark.parametrize("known", [True, False])
def test_picture_is_written_whole(tmp_path, known):
    scenery = picture.Scenery("room", ROOM.render(512, 256).compose(POWERS), ROOM.lamps)
    path = tmp_path / "new" / "x.png"
    figures = picture.draw(path, perfect(), scenery if known else None, "footer")
    assert cv2.imread(str(path)).shape == (650, 1600, 3)
    assert [p.name for p in path.parent.iterdir()] == ["x.png"]
    if known:
        assert figures["found"] == figures["lamps"] == 3
        assert figures["direction_rmse_deg"] < 1e-6
        assert figures["relighting_mae"] < 0.003
    else:
        assert figures == {}


def test_a_lamp_that_is_not_there_is_counted_and_drawn(tmp_path):
    estimate = perfect()
    away = Light(9, np.array([0.0, -1, 0]), np.ones(3), 3.0)
    more = dataclasses.replace(estimate, lights=(*estimate.lights, away))
    scenery = picture.Scenery("room", ROOM.render(512, 256).compose(POWERS), ROOM.lamps)
    figures = picture.draw(tmp_path / "x.png", more, scenery, "footer")
    assert (figures["lamps"], figures["found"], figures["extra"]) == (3, 3, 1)
    without = picture.draw(tmp_path / "y.png", estimate, scenery, "footer")
    assert without["extra"] == 0
    drawn, plain = (cv2.imread(str(tmp_path / name)).astype(int) for name in ("x.png", "y.png"))
    pink = np.abs(drawn - (0xC6, 0x7A, 0xFF)).sum(axis=2) < 30
    assert pink.sum() > (np.abs(plain - (0xC6, 0x7A, 0xFF)).sum(axis=2) < 30).sum() + 50


def a_sky_with_leaves() -> np.ndarray:
    """A sky that twigs cut into pieces, and a bright window elsewhere."""
    radiance = np.full((256, 512, 3), 0.2, np.float32)
    radiance[40:110, 150:350] = 10
    radiance[40:110, 150:350:9] = 0.2
    radiance[120:135, 20:35] = 12
    return radiance


def at(azimuth_deg: float, elevation_deg: float) -> Light:
    direction = geometry.direction_from_angles(azimuth_deg, elevation_deg)
    return Light(int(azimuth_deg) + 181, direction, np.ones(3), 3.0)


def test_lamps_of_one_sky_are_one_area_and_none_of_them_is_extra(tmp_path):
    """Real panoramas were shown with up to seven lamps "extra", all of them in one sky."""
    sky = [at(azimuth, 40) for azimuth in (-60, -30, 0, 30, 55)]
    estimate = dataclasses.replace(perfect(), lights=(*sky, at(-160, 0), at(120, -50)))
    marked = marks.of_map(estimate, a_sky_with_leaves())
    assert marked.names == ("1", "", "", "", "", "2", "extra")
    assert marked.figures == {"areas": 2, "listed": 6, "extra": 1}
    assert marked.rows[0].endswith("as 5 lamps")
    assert marked.rows[1].endswith("as 1 lamp")
    scenery = picture.Scenery("park", a_sky_with_leaves(), None)
    figures = picture.draw(tmp_path / "x.png", estimate, scenery, "footer")
    assert "direction_rmse_deg" not in figures
    drawn = cv2.imread(str(tmp_path / "x.png")).astype(int)
    assert (np.abs(drawn - (0x4D, 0xD3, 0xFF)).sum(axis=2) < 60).sum() > 300  # its outline


def test_a_lamp_across_the_seam_lies_in_the_area_there():
    radiance = np.full((256, 512, 3), 0.2, np.float32)
    radiance[100:120, :10] = radiance[100:120, -10:] = 10
    estimate = dataclasses.replace(perfect(), lights=(at(179, 13), at(-177, 13)))
    assert marks.of_map(estimate, radiance).names == ("1", "")


def test_tables_and_lines_tell_everything():
    estimate = perfect(EstimateFlag.CLIPPED | EstimateFlag.STALE)
    console = view.console()
    with console.capture() as capture:
        console.print(view.lights_table(estimate))
        console.print(view.sh_table(estimate))
    text = capture.get()
    for light in estimate.lights:
        assert f"#{light.id}" in text
        assert f"{light.azimuth_deg:+.2f}°" in text
    assert "2%" in text
    assert "l = 2" in text
    line = view.plain(estimate)
    assert "lamps 3" in line
    assert "flags STALE,CLIPPED" in line
    words = view.flag_lines(["CLIPPED", "BIT_31"])
    assert "light is missing" in words[0]
    assert "unknown to this version" in words[1]


def test_the_room_is_one_line_where_it_is_known():
    walls_m = np.array([1.8, 3.0, 1.2, 1.5, 2.0, 4.0])
    room = Room(walls_m, np.zeros(6), np.array([0, 0, 0, 1.0]), 0.0125)
    line = view.plain(dataclasses.replace(perfect(), room=room))
    assert line.endswith("room 4.8 × 2.7 × 6.0 m, ambient light off by 1.2 % a metre away")
    assert "room" not in view.plain(perfect())


def test_how_dark_a_lamps_shadow_is_is_shown():
    lamp = perfect().lights[0]
    for strength, words in ((0.625, "62%"), (None, "–")):
        changed = dataclasses.replace(lamp, shadow_strength=strength)
        console = view.console()
        with console.capture() as capture:
            table = view.lights_table(dataclasses.replace(perfect(), lights=(changed,)))
            console.print(table)
        assert "shadow" in capture.get()
        assert words in list(table.columns[8].cells)


def test_how_lamps_are_polarized_is_shown_where_it_is_known():
    def shown(light: Light) -> str:
        console = view.console()
        with console.capture() as capture:
            console.print(view.lights_table(dataclasses.replace(perfect(), lights=(light,))))
        return capture.get()

    lamp = perfect().lights[0]
    assert "mirrored" not in shown(lamp)
    image = dataclasses.replace(
        lamp, dolp=0.43, dolp_sigma=0.021, aolp_deg=178.2, aolp_sigma_deg=1.5, reflection=0.57
    )
    for word in ("43±2.1%", "178±1.5°", "57%"):
        assert word in shown(image)
    assert "°" not in view.polarization_words(dataclasses.replace(image, aolp_sigma_deg=45.0))[0]
    unknown = dataclasses.replace(lamp, reflection=0.12)
    assert view.polarization_words(unknown) == ("–", "12%")


def test_unknown_is_a_dash_not_zero():
    light = Light(1, np.array([0, 1.0, 0]), np.zeros(3), 0.5, flags=LightFlag.CLIPPED)
    assert view.number(None) == "–"
    assert view.sigma_percent(light) is None
    assert view.swatch(np.zeros(3)).style == "rgb(0,0,0)"
    assert luminance(light.irradiance) == 0
