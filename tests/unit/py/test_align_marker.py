"""A printed marker in rendered pictures: its rotation, and pictures that do not tell it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from lightprobe.align import marker
from lightprobe.align.track import AlignError
from scipy.spatial.transform import Rotation

CAMERA = marker.Intrinsics(900, 900, 479.5, 359.5, (0.05, -0.02, 0.001, -0.001))
SIZE_PX = (960, 720)


def photo(rotation: Rotation, place_m, side="back", number=7, noise=3.0, seed=0):
    """Picture of a 5 cm marker on the probe; `rotation`: probe → camera (+Y up, −Z forward)."""
    paper = marker.draw(number, 600)
    edge = 800 / 600 / 2  # half the paper's side, in sides of the black square
    # Fine pixels of the camera → directions → the marker's plane → pixels of the paper.
    fine = 2
    x, y = np.meshgrid(np.arange(SIZE_PX[0] * fine), np.arange(SIZE_PX[1] * fine))
    pixels = np.stack([(x + 0.5) / fine - 0.5, (y + 0.5) / fine - 0.5], axis=-1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, CAMERA.matrix, np.array(CAMERA.distortion)).reshape(-1, 2)
    rays = np.column_stack([rays[:, 0], -rays[:, 1], -np.ones(len(rays))])
    axes = (rotation * Rotation.from_matrix(marker.SIDES[side])).as_matrix()
    normal, centre = axes[:, 2], np.asarray(place_m) / 0.05
    reach = (centre @ normal) / (rays @ normal)
    on_paper = (rays * reach[:, None] - centre) @ axes
    u = ((on_paper[:, 0] + edge) / (2 * edge) * 800 - 0.5).astype(np.float32)
    v = ((edge - on_paper[:, 1]) / (2 * edge) * 800 - 0.5).astype(np.float32)
    shape = (SIZE_PX[1] * fine, SIZE_PX[0] * fine)
    seen = cv2.remap(paper, u.reshape(shape), v.reshape(shape), cv2.INTER_LINEAR, borderValue=140)
    small = cv2.resize(seen, SIZE_PX, interpolation=cv2.INTER_AREA).astype(float)
    small += noise * np.random.default_rng(seed).standard_normal(small.shape)
    return np.clip(small, 0, 255).astype(np.uint8)


def off_deg(a: Rotation, b: Rotation) -> float:
    return float(np.degrees((a.inv() * b).magnitude()))


@pytest.mark.parametrize("side", list(marker.SIDES))
def test_each_side_of_the_box(side):
    """The camera looks at the marker aslant; each side's frame is right-handed and its own."""
    sides = Rotation.from_matrix(marker.SIDES[side])
    assert np.linalg.det(marker.SIDES[side]) == pytest.approx(1)
    towards = Rotation.from_euler("yx", [35, -25], degrees=True)  # marker → camera
    rotation = towards * sides.inv()
    sight = marker.find(photo(rotation, [0.01, 0.02, -0.25], side), 7, CAMERA, side)
    assert isinstance(sight, marker.Sight)
    assert off_deg(sight.rotation, rotation) < 0.4
    assert 0.02 < sight.sigma_deg < 1


def test_where_the_sides_point():
    """Out of the paper, and up on it, in the probe's frame."""
    outward = {"front": [0, 0, -1], "back": [0, 0, 1], "right": [1, 0, 0], "left": [-1, 0, 0],
               "top": [0, 1, 0], "bottom": [0, -1, 0]}  # fmt: skip
    for side, out in outward.items():
        assert (marker.SIDES[side] @ [0, 0, 1] == out).all()
        up = [0, 0, -1] if side in ("top", "bottom") else [0, 1, 0]
        assert (marker.SIDES[side] @ [0, 1, 0] == up).all()


def test_the_mean_of_pictures_is_better_and_its_sigma_holds():
    """The head's camera looks at the probe from one place; noise differs."""
    rotation = Rotation.from_euler("yxz", [30, 20, 4], degrees=True)
    eyes = Rotation.from_euler("x", 12, degrees=True)  # camera → head
    sights = [
        marker.find(photo(rotation, [0.03, -0.02, -0.3], seed=k, noise=8.0), 7, CAMERA, "back")
        for k in range(5)
    ]
    found = marker.combine(sights, eyes)
    error_deg = off_deg(found.rotation, eyes * rotation)
    assert error_deg < 0.3
    assert error_deg < 4 * found.sigma_deg
    assert found.sigma_deg < min(sight.sigma_deg for sight in sights)


def test_an_outlier_is_left_out_and_contradictions_are_named():
    good = Rotation.from_euler("y", 10, degrees=True)
    sights = [marker.Sight(good, 0.2)] * 4
    wrong = marker.Sight(Rotation.from_euler("y", 60, degrees=True), 0.2)
    found = marker.combine([*sights, wrong], Rotation.identity())
    assert found.used == (True, True, True, True, False)
    assert off_deg(found.rotation, good) < 1e-6
    with pytest.raises(AlignError, match="contradict each other"):
        marker.combine([sights[0], wrong], Rotation.identity())
    with pytest.raises(AlignError, match="no picture"):
        marker.combine([], Rotation.identity())


def test_pictures_that_do_not_tell():
    aslant = Rotation.from_euler("y", 30, degrees=True)
    near = photo(aslant, [0, 0, -0.3])
    assert marker.find(near, 8, CAMERA, "back") == "the marker is not found"
    assert marker.find(np.full((720, 960), 128, np.uint8), 7, CAMERA, "back") == (
        "the marker is not found"
    )
    far = marker.find(photo(aslant, [0, 0, -2.8], noise=0.5), 7, CAMERA, "back")
    assert isinstance(far, str)
    assert "go nearer" in far or "not found" in far
    straight = marker.find(
        photo(Rotation.from_euler("y", 2, degrees=True), [0, 0, -1.2]), 7, CAMERA, "back"
    )
    assert isinstance(straight, str)
    assert "look alike" in straight
    twice = np.hstack([near[:, 240:720], near[:, 240:720]])
    assert marker.find(twice, 7, CAMERA, "back") == "the marker is there twice"
