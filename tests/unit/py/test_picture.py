"""What the eye is shown: relighting, shadows, tables, swatches."""

import cv2
import numpy as np
import pytest
from lightprobe.cli import view
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, Light, LightFlag, SphericalHarmonics
from lightprobe.evaluate import picture, relight
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
    true = relight.draw(relight.Lighting.of_map(radiance, ROOM.lamps), 64)
    packet = relight.draw(relight.Lighting.of_estimate(perfect()), 64)
    assert np.abs(true - packet)[..., :3].mean() < 0.01 * true[..., :3].max()
    assert np.array_equal(true[..., 3], packet[..., 3])


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


def test_unknown_is_a_dash_not_zero():
    light = Light(1, np.array([0, 1.0, 0]), np.zeros(3), 0.5, flags=LightFlag.CLIPPED)
    assert view.number(None) == "–"
    assert view.sigma_percent(light) is None
    assert view.swatch(np.zeros(3)).style == "rgb(0,0,0)"
    assert luminance(light.irradiance) == 0
