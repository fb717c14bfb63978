"""Frames of every format as codes, and what becomes of them before a fit."""

import cv2
import numpy as np
import pytest
from lightprobe.calibrate.exposure_series import SeriesError, decode
from lightprobe.calibrate.flat_patches import collect, step_of
from lightprobe.calibrate.response_curve import ResponseError, fit
from lightprobe.sim.encoding import encode


def gradient(height=64, width=128):
    row = np.linspace(20, 220, width)
    red = np.repeat(row[None], height, 0)
    return np.stack([red, red[:, ::-1], 0.5 * red], axis=-1).round().astype(np.uint8)


@pytest.mark.parametrize(("kind", "tolerance"), [("MJPG", 3), ("YUYV", 3), ("NV12", 3)])
def test_colour_formats_come_back(kind, tolerance):
    codes = cv2.GaussianBlur(gradient(), (0, 0), 3)
    data = encode(codes, kind, 98, "444")
    decoded = decode(data, kind, (128, 64))
    assert decoded.shape == codes.shape
    assert np.abs(decoded.astype(int) - codes).mean() < tolerance / 3
    assert np.abs(decoded.astype(int) - codes).max() <= 2 * tolerance


def test_grey_is_luma_thrice_and_strides_are_skipped():
    luma = gradient()[..., 0]
    padded = np.pad(luma, ((0, 0), (0, 32)))
    decoded = decode(padded.tobytes(), "GREY", (128, 64), 160)
    assert np.array_equal(decoded, np.repeat(luma[..., None], 3, 2))


@pytest.mark.parametrize("kind", ["MJPG", "YUYV", "NV12", "GREY"])
def test_what_is_no_picture_is_none(kind):
    assert decode(b"", kind, (128, 64)) is None
    assert decode(b"\xff\xd8 nothing", kind, (128, 64)) is None


def test_float_frames_have_no_codes():
    with pytest.raises(SeriesError, match="radiance"):
        decode(b"", "RGBF", (128, 64))


def pictures(exposure, unrest=0):
    base = np.minimum(gradient() * (exposure / 4), 255)
    return [np.clip(base + k * unrest, 0, 255).astype(np.uint8) for k in (0, 1)]


def test_only_flat_unclipped_places_count():
    steps = [step_of(us, pictures(us)) for us in (1.0, 2.0, 4.0, 8.0)]
    patches, notes = collect(steps)
    assert not notes
    assert patches.top == 255
    known = np.isfinite(patches.codes)
    assert known.any()
    assert np.nanmax(patches.codes) <= 253
    assert np.nanmin(patches.codes) >= 2
    checkers = np.indices((64, 128)).sum(0) % 2 * 200
    busy = np.repeat(checkers[..., None], 3, 2).astype(np.uint8)
    nothing, _ = collect([step_of(us, [busy]) for us in (1.0, 2.0, 4.0)])
    with pytest.raises(ResponseError, match="places"):
        fit(nothing)


def test_restless_steps_are_left_out_and_told():
    steps = [step_of(us, pictures(us, unrest=9 if us == 2.0 else 0)) for us in (1, 2.0, 4, 8)]
    patches, notes = collect(steps)
    assert len(patches.exposures_us) == 3
    assert len(notes) == 1
    assert "2 us left out" in notes[0]
    with pytest.raises(ResponseError, match="usable exposures"):
        collect([step_of(us, pictures(us, unrest=9)) for us in (1, 2, 4)])


def test_a_scale_that_ends_early_is_noticed():
    steps = [
        step_of(us, [np.minimum(picture, 235) for picture in pictures(us)]) for us in (1, 2, 4, 16)
    ]
    patches, notes = collect(steps)
    assert patches.top == 235
    assert "235" in notes[0]
