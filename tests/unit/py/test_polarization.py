"""Stokes parameters of pictures through a polarizer: `lightprobe polarization`."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.imaging import camera, image, jpeg_noise, stokes, stokes_filter
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim import scenes
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.polarized import PolishedFloor, Sky
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.sensor import Sensor, encode_jpeg

SIZE_PX = (128, 64)
LENS = camera.load("equirect")
LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


def views(scene, angles, size_px=SIZE_PX, sheet=None):
    """S0, S1 and S2 of a scene, and what passes a film at each angle."""
    layers, powers = scene.render(*size_px), np.ones(len(scene.lamps))
    s0, s12 = layers.compose(powers), layers.compose_polarized(powers)
    film = Polarizer(sheet or Sheet(), LENS, size_px)
    return np.stack([s0, *s12]), [film.through(s0, s12, (angle,)) for angle in angles]


def pictures(seen):
    return [stokes.Picture(light) for light in seen]


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(0, 179), min_size=3, max_size=6),
    st.integers(0, 30),
    st.floats(0.3, 1),
    st.floats(20, 1e6),
)
def test_any_three_angles_that_differ_give_the_truth(angles, seed, transmission, extinction):
    turned = np.sort(np.mod(angles, 180))
    gaps = np.diff(turned, append=turned[0] + 180)
    if (gaps > 12).sum() < 3:
        return
    sheet = Sheet(transmission, extinction)
    truth, seen = views(PolishedFloor(random_scene(seed)), angles, sheet=sheet)
    found = stokes.measure(pictures(seen), angles, LENS, sheet).stokes
    known = np.isfinite(found)
    assert 0.58 < known.mean() < 0.64  # pixels; the film is edge-on in 26 % of the sphere
    error = np.abs(found - truth)[known]
    assert error.max() < 5e-3 * truth.max()


def test_a_sky_is_polarized_across_its_plane_with_the_sun():
    angles = (0, 45, 90, 135)
    truth, seen = views(Sky(), angles)
    found = stokes.measure(pictures(seen), angles, LENS)
    known = np.isfinite(found.dolp)
    degree = np.hypot(truth[1], truth[2])[..., 1] / truth[0][..., 1]
    assert np.sqrt(np.mean((found.dolp - degree)[known] ** 2)) < 0.01
    angle = np.degrees(np.arctan2(truth[2], truth[1]))[..., 1] / 2
    off = (found.aolp_deg - angle + 90) % 180 - 90
    assert np.sqrt(np.mean(off[known & (degree > 0.1)] ** 2)) < 0.5


@pytest.mark.parametrize("angles", [(0, 90), (0, 90, 180), (45, 45, 45, 45), (0, 60, 240)])
def test_too_few_angles_are_named(angles):
    with pytest.raises(UsageError, match="need three"):
        stokes.check_angles(angles, len(angles))


def test_one_angle_for_each_picture():
    with pytest.raises(UsageError, match="3 pictures and 2 angles"):
        stokes.check_angles((0, 45), 3)


def test_clipped_pixels_are_not_known(tmp_path):
    codes = np.full((64, 128, 3), 100, np.uint8)
    codes[30:34, 60:68] = 255
    files = []
    for index in range(3):
        files.append(tmp_path / f"{index}.png")
        cv2.imwrite(str(files[-1]), codes)
    ideal = Sheet(index=1.0)  # else a picture that is grey all over is no light behind a film
    found = stokes.measure(stokes.read(files, LENS), (0, 60, 120), LENS, ideal)
    assert np.isnan(found.dolp[30:34, 60:68]).all()
    assert found.dolp[20, 64] < 1e-3


def test_short_exposures_tell_of_what_clips(tmp_path):
    """A bracket at each angle; sigma covers the error."""
    angles = (0, 45, 90, 135)
    truth, seen = views(PolishedFloor(random_scene(2)), angles, (256, 128))
    sensor = Sensor(256, 128)
    files, exposures = [], bracket_us(median_luminance(seen[0]), 3)
    for index, view in enumerate(seen):
        for step, exposure_us in enumerate(exposures):
            codes = sensor.capture(view, exposure_us, frame=len(files))
            files.append(tmp_path / f"{index}-{step}.jpg")
            files[-1].write_bytes(encode_jpeg(codes))
    read = stokes.read(files, LENS, exposures * 4)
    found = stokes.measure(read, np.repeat(angles, 3), LENS)
    alone = stokes.measure(read[::3], angles, LENS)
    known = np.isfinite(found.dolp)
    assert known.sum() > np.isfinite(alone.dolp).sum()
    light = truth @ [0.2126, 0.7152, 0.0722]
    degree = np.hypot(light[1], light[2]) / light[0]
    error = (found.dolp - degree)[known]
    assert np.sqrt(np.mean(error**2)) < 0.03
    sigmas = np.abs(error) / found.dolp_sigma[known]
    assert np.mean(sigmas < 3) > 0.95


def bracketed(scene, quality, size_px=(256, 128)):
    """Truth (3, H, W), and pictures of four angles in three exposures each."""
    truth, seen = views(scene, (0, 45, 90, 135), size_px)
    sensor, found = Sensor(*size_px), []
    for view in seen:
        for exposure_us in bracket_us(median_luminance(seen[0]), 3):
            codes = sensor.capture(view, exposure_us, frame=len(found))
            data = encode_jpeg(codes, quality)
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
            sigma = jpeg_noise.code_sigma(data)
            found.append(stokes.of_codes(decoded, LENS, 1e6 / exposure_us, sigma))
    return luminance(truth.astype(np.float64)), found


@pytest.mark.parametrize("quality", [85, 95])
@pytest.mark.parametrize("seed", [2, 103])
def test_neighbours_lessen_noise_and_sigmas_cover_what_is_left(quality, seed, monkeypatch):
    truth, read = bracketed(PolishedFloor(random_scene(seed)), quality)
    angles = np.repeat((0, 45, 90, 135), 3)
    degree = np.hypot(truth[1], truth[2]) / truth[0]
    off, ratio = [], []
    for width in (1, 5):
        monkeypatch.setattr(stokes_filter, "_WIDTH", width)
        found = stokes.measure(read, angles, LENS)
        known = np.isfinite(found.dolp)
        error = (found.dolp - degree)[known]
        off.append(float(np.sqrt(np.mean(error**2))))
        ratio.append(float(np.mean(np.abs(error) < 3 * found.dolp_sigma[known])))
        assert np.all(found.dolp_sigma[known] > 0)
    assert off[1] < 0.6 * off[0]
    assert ratio[1] > 0.95


def test_a_filter_keeps_edges_and_what_is_exact():
    """A step in polarization stays where noise does not explain it; S0 stays in any case."""
    height, width = 32, 64
    s0 = np.ones((height, width, 3), np.float32)
    s1 = np.where(np.arange(width) < 32, 0.0, 0.8).astype(np.float32)[None, :, None] * s0
    light = np.stack([s0, s1, 0 * s0])
    light[:, 5, 7] = np.nan
    for sigma, step in ((1e-3, 0.79), (3.0, 0.2)):
        covariance = np.broadcast_to(np.diag([sigma**2] * 3), (height, width, 3, 3))
        found, left = stokes_filter.smoothed(light, covariance)
        assert np.array_equal(np.isnan(found), np.isnan(light))
        np.testing.assert_array_equal(found[0], light[0])
        across = found[1, 16, 32, 0] - found[1, 16, 31, 0]
        assert across > step if sigma < 1 else across < step
        assert np.nanmax(left[..., 1, 1]) <= sigma**2 * 1.2
    assert left[16, 10, 1, 1] < 0.1 * 3.0**2  # the mean of 25
    same = np.broadcast_to(np.float32([[[[1.0]]], [[[0.3]]], [[[0.1]]]]), (3, height, width, 3))
    found, _ = stokes_filter.smoothed(same, covariance)
    np.testing.assert_allclose(found, same, rtol=1e-5)


def test_what_jpeg_does_to_codes_is_in_its_table():
    """Within a factor of noise that fills every coefficient; of what is no JPEG nothing is said."""
    rng = np.random.default_rng(3)
    codes = np.repeat(rng.normal(128, 25, (256, 256, 1)), 3, axis=-1).clip(0, 255).astype(np.uint8)
    for quality in (60, 85, 95):
        data = encode_jpeg(codes, quality)
        luma = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., 1]
        off = float(np.std(luma.astype(float) - codes[..., 1]))
        assert jpeg_noise.code_sigma(data) == pytest.approx(off, rel=0.25)
    whole = encode_jpeg(codes, 85)
    for length in (0, 1, 2, 5, 30, 90, 160):
        assert jpeg_noise.code_sigma(whole[:length]) is None
    assert jpeg_noise.code_sigma(b"\x89PNG\r\n\x1a\n") is None


def test_one_exposure_for_each_picture(tmp_path):
    with pytest.raises(UsageError, match="2 pictures and 1 exposures"):
        stokes.read([tmp_path / "a.png", tmp_path / "b.png"], LENS, [100.0])


def test_the_command_writes_pictures_and_a_scene(tmp_path):
    angles = (0, 45, 90, 135)
    truth, seen = views(PolishedFloor(random_scene(2)), angles)
    files = []
    for index, view in enumerate(seen):
        files.append(tmp_path / f"{index}.pfm")
        image.write_pfm(files[-1], np.ascontiguousarray(view))
    out = tmp_path / "out"
    done = subprocess.run(
        [LIGHTPROBE, "polarization", *files, "--wheel-deg", "0,45,90,135", "--out", out, "--json"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert [Path(name).name for name in summary["files"]] == [
        "s0.pfm", "stokes.npz", "dolp.png", "aolp.png",
    ]  # fmt: skip
    assert 0.58 < summary["known_share"] < 0.64  # of the pixels
    dolp = cv2.imread(str(out / "dolp.png"), cv2.IMREAD_UNCHANGED)
    row, column = 64 * (90 + 34) // 180, 64  # Brewster's angle, ahead
    expected = np.hypot(truth[1], truth[2])[row, column, 1] / truth[0][row, column, 1]
    assert abs(dolp[row, column] / 255 - expected) < 0.05
    assert scenes.load([str(out / "stokes.npz")])[0].render(*SIZE_PX).polarized is not None


def test_wrong_options_are_named(tmp_path):
    for arguments, words in [
        (["a.png", "--wheel-deg", "0,x"], "expected degrees"),
        (["a.png", "b.png", "--wheel-deg", "0,90"], "need three"),
        (
            ["a.png", "b.png", "c.png", "--wheel-deg", "0,60,120", "--film", "2,3"],
            "--film 2,3",
        ),
        (["a.png", "b.png", "c.png", "--wheel-deg", "0,60,120"], "a.png"),
    ]:
        done = subprocess.run(
            [LIGHTPROBE, "polarization", *arguments], capture_output=True, text=True, timeout=60,
            cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode != 0
        assert words in done.stderr, done.stderr
