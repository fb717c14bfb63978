"""Fitting a response to codes of known light."""

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.calibrate.response_curve import (
    PatchCodes,
    ResponseError,
    fit,
    monotone,
    residuals,
    step_errors,
)
from lightprobe.cli import calibrate_response

CODES = np.arange(256) / 255
EXPOSURES_US = 8 * np.cumprod([1.0] + [1.5, 2.2] * 7)


def gammas(red, green, blue):
    return np.stack([CODES**red, CODES**green, CODES**blue], axis=1)


def seen(table, places=800, exposures_us=EXPOSURES_US, noise_codes=0.3, seed=0, real_us=None):
    """What a camera with this response shows of places from dark to bright."""
    rng = np.random.default_rng(seed)
    radiance = np.exp(rng.uniform(np.log(1.5), np.log(1500), places))
    light = radiance[:, None] * 1e-6 * (exposures_us if real_us is None else real_us)
    codes = np.stack([np.interp(light, table[:, c], np.arange(256)) for c in range(3)], axis=-1)
    codes = codes + rng.normal(0, noise_codes, codes.shape)
    inside = (codes > 2) & (codes < 253) & (light[..., None] < 1)  # full wells have no noise
    return PatchCodes(np.where(inside, codes, np.nan), np.asarray(exposures_us))


def rms(response, table):
    return np.sqrt(np.mean((response.table - table) ** 2, axis=0))


@settings(max_examples=5)
@given(st.tuples(*[st.floats(0.7, 3.0)] * 3), st.integers(0, 1000))
def test_any_power_is_found_within_half_a_percent(powers, seed):
    table = gammas(*powers)
    response = fit(seen(table, seed=seed))
    assert np.all(rms(response, table) < 0.005)
    assert np.all(np.diff(response.table, axis=0) >= 0)
    assert np.all(response.table[255] == 1)
    assert np.all(response.residual_codes < 0.5)
    assert response.used.all()


def test_the_residual_is_the_noise():
    response = fit(seen(gammas(2, 2, 2), noise_codes=1.0))
    assert response.residual_codes == pytest.approx([1.0] * 3, abs=0.15)
    codes, error = residuals(seen(gammas(2, 2, 2), noise_codes=1.0), response, 1)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(response.residual_codes[1], rel=0.2)
    assert codes.min() > 2


def test_places_that_lie_do_not_spoil_it():
    table = gammas(2.2, 2.2, 2.2)
    patches = seen(table)
    codes = patches.codes.copy()
    codes[:40] = np.random.default_rng(1).uniform(10, 240, codes[:40].shape)
    response = fit(PatchCodes(codes, patches.exposures_us))
    assert np.all(rms(response, table) < 0.01)


def test_an_exposure_that_was_not_obeyed_is_left_out():
    table = gammas(2.2, 2.0, 1.8)
    real = EXPOSURES_US.copy()
    real[6] *= 1.7
    response = fit(seen(table, real_us=real))
    assert list(np.flatnonzero(~response.used)) == [6]
    assert response.step_errors[6] == pytest.approx(0.7, abs=0.05)
    assert np.all(rms(response, table) < 0.01)


def test_effective_exposures_by_a_known_curve():
    table = gammas(2.2, 2.2, 2.2)
    real = EXPOSURES_US * np.where(np.arange(15) == 9, 1.1, 1.0)
    errors = step_errors(seen(table, real_us=real), table)
    assert errors[9] == pytest.approx(0.1, abs=0.01)
    assert np.nanmax(np.abs(np.delete(errors, 9)[3:])) < 0.02


def test_a_camera_that_ignores_exposures_is_refused():
    table = gammas(2.2, 2.2, 2.2)
    with pytest.raises(ResponseError, match="does not follow"):
        fit(seen(table, real_us=np.full(15, 3000.0)))


@pytest.mark.parametrize(
    ("radiances", "text"),
    [((2, 60), "too dark"), ((60000, 300000), r"only \d+ places"), ((1, 1.01), "only|no")],
)
def test_scenes_that_do_not_show_it_are_refused(radiances, text):
    table = gammas(2.2, 2.2, 2.2)
    light = np.linspace(*radiances, 300)[:, None] * 1e-6 * EXPOSURES_US[:11]
    codes = np.stack([np.interp(light, table[:, 0], np.arange(256))] * 3, axis=-1)
    codes = np.where((codes > 2) & (codes < 253), codes, np.nan)
    with pytest.raises(ResponseError, match=text):
        fit(PatchCodes(codes, EXPOSURES_US[:11]))


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=60))
def test_monotone_never_falls_and_is_the_nearest_such(values):
    result = monotone(np.array(values))
    assert len(result) == len(values)
    assert np.all(np.diff(result) >= 0)
    assert np.allclose(monotone(result), result)
    assert np.mean(result) == pytest.approx(np.mean(values), abs=1e-6)
    sorted_values = np.maximum.accumulate(values)
    assert np.sum((result - values) ** 2) <= np.sum((sorted_values - values) ** 2) + 1e-6


def test_the_command_notes_what_the_camera_did(tmp_path, monkeypatch, capsys):
    """With the response, into the camera file: it holds only as long as the camera does so."""

    @contextmanager
    def series(*_, **__):
        yield SimpleNamespace(processing=("sharpness", "gamma"))

    step = SimpleNamespace(mean=np.zeros((20, 40, 3)))
    monkeypatch.setattr(calibrate_response.calibrate, "series", series)
    monkeypatch.setattr(calibrate_response, "of_series", lambda _: [step])
    monkeypatch.setattr(
        calibrate_response.flat_patches, "collect", lambda _: (seen(gammas(2, 2, 2)), [])
    )
    path = tmp_path / "my.camera"
    calibrate_response.command(["v4l2:/dev/video0"], output=path)
    assert "\nprocessing = sharpness, gamma\n" in path.read_text()
    assert "note: the camera alters the light: sharpness, gamma" in capsys.readouterr().err
