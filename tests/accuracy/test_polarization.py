"""What a varnished floor mirrors is told from lamps, in 8-bit frames of the simulated camera."""

from pathlib import Path

import glossy
import numpy as np
import polarization
import pytest
from lightprobe import geometry
from lightprobe.calibrate import camera_file, polarizer
from lightprobe.colour import luminance
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.imaging import camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.stokes import Picture
from lightprobe.sim.glossy_rooms import glossy_room
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene

pytestmark = pytest.mark.many_frames


@pytest.mark.parametrize(
    "seed",
    [
        0,  # near the nadir, of a lamp that clips
        10,  # a lamp of one pixel and its image, which clip alike
        16,  # where the film is edge-on
        18,  # an image that clips at all angles but one
        36,  # a lamp that clips at all of them
        214,  # few clipped pixels in a bright block
    ],
)
def test_a_sweep_tells_every_reflection(seed: int) -> None:
    scene = PolishedFloor(random_scene(seed))
    studio = polarization.Studio(scene, "8-bit")
    estimate = studio.estimate(*polarization.WAYS[polarization.SWEPT](studio))
    found = polarization.count(scene, estimate, estimate)
    assert (found.lost, found.false) == (0, 0), estimate.lights
    assert found.reflections >= 1


@pytest.mark.parametrize(
    ("seed", "images"),
    [
        (1, 3),  # two panes; a floor seen edge-on, where the film passes more of its image
        (15, 3),  # two panes that face anyhow, a floor, a screen, a window
        (17, 2),  # aslant to the probe's axes
        (139, 1),  # a lamp right above the floor, and its image right below
    ],
)
def test_panes_screens_and_the_sky(seed: int, images: int) -> None:
    """Images in upright glass and near floors are told, or unsure; nothing else is called one."""
    room = glossy_room(seed)
    studio = polarization.Studio(room, "float")
    estimate = studio.estimate(*polarization.WAYS[polarization.SWEPT](studio))
    found = glossy.lights(room, estimate)
    assert not glossy.NEVER & found.keys(), found
    named = sum(found[what, glossy.CALLED] for what in (glossy.UPRIGHT, glossy.FLOOR))
    unsure = sum(found[what, glossy.UNSURE] for what in (glossy.UPRIGHT, glossy.FLOOR))
    assert named >= images - 1
    assert named + unsure >= images
    assert not estimate.flags & EstimateFlag.FILM_TURNED


@pytest.mark.nightly_rows
@pytest.mark.parametrize("kind", ["float", "8-bit"])
@pytest.mark.parametrize("seed", [0, 3])  # images of lamps do not tell it in 8-bit frames
def test_a_film_put_in_wrong_shows_in_any_room(seed: int, kind: str) -> None:
    """By what its surfaces take, also where nothing mirrors."""
    settings = offline.Settings(wheel_deg=polarization.ANGLES_DEG)
    turned = [(angle + 90) % 180 for angle in polarization.ANGLES_DEG]
    for scene in (PolishedFloor(random_scene(seed)), random_scene(seed)):
        studio = polarization.Studio(scene, kind)
        wrong = studio.estimate(studio.sheet_at(*turned), settings)
        right = studio.estimate(studio.sheet_at(*polarization.ANGLES_DEG), settings)
        assert wrong.flags & EstimateFlag.FILM_TURNED
        assert not right.flags & EstimateFlag.FILM_TURNED


@pytest.mark.parametrize("seed", [204, 206, 207, 210, 211])  # their images are polarized
def test_behind_a_film_put_in_wrong_no_image_is_said_to_be_a_lamp(seed: int) -> None:
    """What is polarized as no floor does it says nothing then; place and strength tell."""
    scene = PolishedFloor(random_scene(seed))
    studio = polarization.Studio(scene, "float")
    estimate = studio.estimate(*polarization.WAYS[polarization.TURNED](studio))
    assert estimate.flags & EstimateFlag.FILM_TURNED
    assert not any(light.dolp for light in estimate.lights)
    counted = polarization.count(scene, estimate, estimate)
    assert (counted.lost, counted.false, counted.reflections) == (0, 0, 1), estimate.lights


def test_a_film_put_in_wrong_is_found_and_calibrated(tmp_path: Path) -> None:
    """A quarter turn wrong, by the reflection of a lamp in the floor; the camera file mends it."""
    scene = PolishedFloor(random_scene(8))
    studio = polarization.Studio(scene, "float")
    seen = studio.sheet_at(*(angle + 88 for angle in polarization.ANGLES_DEG))
    wrong = studio.estimate(seen, offline.Settings(wheel_deg=polarization.ANGLES_DEG))
    assert wrong.flags & EstimateFlag.FILM_TURNED
    # a lamp near Brewster's angle whose image the film does not show edge-on
    lamp = min(
        (one for one in scene.lamps if abs(one.direction[2]) > 0.5),
        key=lambda one: abs(one.direction[1] - 0.5),
    )
    azimuth, elevation = np.degrees(
        [np.arctan2(lamp.direction[0], -lamp.direction[2]), np.arcsin(-lamp.direction[1])]
    )
    found = polarizer.fit(
        [Picture(one) for one in seen], polarization.ANGLES_DEG, camera.load("equirect"),
        polarizer.Target(aolp_deg=0.0), polarizer.Region(azimuth, elevation, 3.0),
    )  # fmt: skip
    assert found.is_turned
    file = tmp_path / "my.camera"
    camera_file.save(file, polarization.SIZE_PX, "polarizer", found.values())
    right = studio.estimate(
        seen, offline.Settings(camera=str(file), wheel_deg=polarization.ANGLES_DEG)
    )
    assert not right.flags & EstimateFlag.FILM_TURNED
    counted = polarization.count(scene, right, right)
    assert (counted.lost, counted.false) == (0, 0)
    assert counted.reflections >= polarization.count(scene, wrong, wrong).reflections


@pytest.mark.parametrize("seed", [3, 8])
def test_a_room_without_polarization_seems_so_behind_a_turning_film(seed: int) -> None:
    """Off the axis the film's surfaces take light, of one polarization more than of the other.

    A daemon that is told of a film without surfaces (index 1) takes that for the room's.
    """
    scene = random_scene(seed)
    studio = polarization.Studio(scene, "float")
    views = studio.sheet_at(*polarization.ANGLES_DEG)
    bare = studio.estimate(studio.bare(), offline.Settings())

    def behind(index: float) -> tuple[float, float, float]:
        """How polarized a lamp seems at most; how far lamps and the whole are off in strength."""
        film = Sheet(index=index)
        found = studio.estimate(
            views, offline.Settings(wheel_deg=polarization.ANGLES_DEG, film=film)
        )
        pairs = geometry.match_directions(
            [lamp.direction for lamp in scene.lamps], [light.direction for light in found.lights]
        )
        assert len(pairs) == len(scene.lamps)
        strength = [luminance(found.lights[j].irradiance) / luminance(scene.lamps[i].irradiance)
                    for i, j, _ in pairs]  # fmt: skip
        whole = luminance(found.sh.coefficients)[0] / luminance(bare.sh.coefficients)[0]
        dolp = max(light.dolp or 0.0 for light in found.lights)
        return dolp, max(abs(one - 1) for one in strength), abs(whole - 1)

    right, wrong = behind(1.5), behind(1.0)
    assert right == pytest.approx((0, 0, 0), abs=0.01)
    assert wrong[0] > 0.08
    assert wrong[1] > 0.2
    assert wrong[2] > 0.15
