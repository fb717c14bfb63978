"""S0, S1, S2 against others: a physically based renderer, and PyPI's polanalyser.

Mitsuba 3 renders a room with a glossy table and a framed picture twice: its Stokes parameters as
they are, and the light behind a sheet that stands before its pinhole, from which they are measured.
It is large, and has a setup of its own: `make test-renderer`.
"""

import importlib.util
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import polanalyser
import pytest
import renderer
from lightprobe.colour import luminance
from lightprobe.imaging import camera, jpeg_noise, stokes
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.image import ImageError
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.polarized import PolishedFloor, StokesPanorama
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.sensor import Sensor, encode_jpeg

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
LENS = camera.load("equirect")
IDEAL = Sheet(1.0, 1e9, index=1.0)
#: A rendered room with a varnished floor, where there is one beside this repository.
ROOM = Path(__file__).resolve().parents[3] / "shared/data/stokes/room_mono_stokes.npz"


def errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """RMS of DoLP, and of AoLP in degrees where DoLP > 0.1, of Stokes parameters (…, 3)."""
    known = np.isfinite(found).all(axis=-1)
    one, other = (
        (np.hypot(s[..., 1], s[..., 2]) / s[..., 0], np.arctan2(s[..., 2], s[..., 1]) / 2)
        for s in (found[known], truth[known])
    )
    turned_deg = (np.degrees(one[1] - other[1]) + 90) % 180 - 90
    polarized = other[0] > 0.1
    assert polarized.sum() > 20
    return (
        float(np.sqrt(np.mean((one[0] - other[0]) ** 2))),
        float(np.sqrt(np.mean(turned_deg[polarized] ** 2))),
    )


def measured(found: stokes.Polarization) -> np.ndarray:
    """Stokes parameters of luminance (H, W, 3)."""
    return np.moveaxis(luminance(found.stokes.astype(np.float64)), 0, -1)


def by_polanalyser(
    directions: np.ndarray, seen: Sequence[np.ndarray], angles_deg: Sequence[float]
) -> np.ndarray:
    """Stokes parameters (n, 3) of n pixels behind an ideal sheet; each has angles of its own.

    Direction by direction, by e = d × (n × p) in the pixel's own frame.
    """
    result = []
    for index, direction in enumerate(directions):
        right = np.cross(direction, [0, 1, 0])
        right /= np.linalg.norm(right)
        up = np.cross(right, direction)
        own = []
        for angle in np.radians(angles_deg):
            axis = np.array([np.cos(angle), np.sin(angle), 0.0])
            field = np.cross(direction, np.cross([0.0, 0.0, -1.0], axis))
            own.append(np.arctan2(field @ up, field @ right))
        result.append(polanalyser.calcStokes([2 * one[index] for one in seen], np.array(own)) / 2)
    return np.array(result)


def bracketed(
    seen: Sequence[np.ndarray], quality: int | None = None
) -> tuple[list[stokes.Picture], list[float]]:
    """Views in three exposures of 8 bits with a camera's noise, and the angle of each.

    `quality`: of JPEG; None: as they are.
    """
    height, width, _ = seen[0].shape
    sensor, pictures = Sensor(width, height), []
    for view in seen:
        for exposure_us in bracket_us(median_luminance(seen[0]), 3):
            codes = sensor.capture(view, exposure_us, frame=len(pictures))
            sigma = None
            if quality:
                data = encode_jpeg(codes, quality)
                sigma = jpeg_noise.code_sigma(data)
                decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
                codes = cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)
            pictures.append(stokes.of_codes(codes, LENS, 1e6 / exposure_us, sigma))
    return pictures, np.repeat(ANGLES_DEG, 3).tolist()


#: Quality (None: no JPEG), and how far off DoLP and AoLP (degrees) may be.
JPEG_LIMITS = ((None, 0.015, 2.0), (95, 0.02, 2.5), (85, 0.06, 3.5))


def scenes() -> list[Scene]:
    """Panoramas whose Stokes parameters are known."""
    found: list[Scene] = [PolishedFloor(random_scene(2))]
    try:
        found.append(StokesPanorama.load(ROOM))
    except ImageError as error:
        print(f"polarization: {error}: the rendered room is left out")
    return found


@pytest.mark.parametrize("scene", scenes(), ids=lambda scene: scene.name)
def test_panoramas_are_measured_as_they_are(scene: Scene) -> None:
    size_px, powers = (512, 256), np.ones(len(scene.lamps))
    layers = scene.render(*size_px)
    s0, s12 = layers.compose(powers), layers.compose_polarized(powers)
    truth = np.moveaxis(luminance(np.stack([s0, *s12]).astype(np.float64)), 0, -1)
    film = Polarizer(IDEAL, LENS, size_px)
    seen = [film.through(s0, s12, (angle,)) for angle in ANGLES_DEG]
    exact = measured(stokes.measure([stokes.Picture(one) for one in seen], ANGLES_DEG, LENS, IDEAL))
    assert errors(exact, truth)[0] < 0.002
    pixels = np.flatnonzero(np.isfinite(exact[..., 0]))[::97]
    other = by_polanalyser(
        LENS.look(*size_px)[0].reshape(-1, 3)[pixels],
        [luminance(one.astype(np.float64)).ravel()[pixels] for one in seen],
        ANGLES_DEG,
    )
    dolp, aolp_deg = errors(exact.reshape(-1, 3)[pixels], other)
    assert dolp < 0.002
    assert aolp_deg < 0.2
    for quality, most_dolp, most_deg in JPEG_LIMITS:
        pictures, angles = bracketed(seen, quality)
        dolp, aolp_deg = errors(measured(stokes.measure(pictures, angles, LENS, IDEAL)), truth)
        kind = f"JPEG {quality}" if quality else "8-bit"
        print(f"{scene.name}: {kind}: DoLP off by {dolp:.4f}, AoLP by {aolp_deg:.2f}° (RMS)")
        assert dolp < most_dolp
        assert aolp_deg < most_deg


@pytest.mark.long
@pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="no Mitsuba: make test-renderer installs it"
)
def test_a_rendered_sheet_shows_the_rendered_polarization() -> None:
    size_px, samples, block_px = 48, 256, 4
    truth = renderer.render(size_px, samples)
    seen = [
        renderer.render(size_px, samples, angle, 1 + int(angle))[..., 0] for angle in ANGLES_DEG
    ]
    pictures = [
        stokes.Picture(np.repeat(one[..., None], 3, axis=-1).astype(np.float32)) for one in seen
    ]
    lens = renderer.Pinhole()
    found = measured(stokes.measure(pictures, ANGLES_DEG, lens, IDEAL))
    other = by_polanalyser(
        lens.look(size_px, size_px)[0].reshape(-1, 3), [one.ravel() for one in seen], ANGLES_DEG
    )
    np.testing.assert_allclose(found.reshape(-1, 3), other, rtol=1e-3, atol=1e-3)
    # The renderer's noise is that of pixels; nothing else differs between them.
    many = size_px // block_px
    found, truth = (
        s.reshape(many, block_px, many, block_px, 3).mean(axis=(1, 3)) for s in (found, truth)
    )
    assert found[..., 0].sum() == pytest.approx(truth[..., 0].sum(), rel=0.01)
    dolp, aolp_deg = errors(found, truth)
    print(f"Mitsuba: DoLP off by {dolp:.4f}, AoLP by {aolp_deg:.2f}° (RMS)")
    assert dolp < 0.03
    assert aolp_deg < 3
