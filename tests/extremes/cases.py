"""Inputs at the edge, each with what must come out: the tests' list and the documentation's table.

Every case goes through the daemon as files do (`lightprobe estimate` runs the same). Its error is a
number with a stated bound; flags that must, and must not, be there are part of the case. Wherever
an estimate holds a number that is none (NaN, infinite), the case fails.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lightprobe import geometry, sh
from lightprobe.colour import luminance, srgb_table
from lightprobe.estimate import Estimate
from lightprobe.evaluate import metrics, offline
from lightprobe.imaging import image
from lightprobe.sim.sensor import encode_jpeg

SIZE_PX = (960, 480)
LINEAR = srgb_table()
Y0 = math.sqrt(4 * math.pi)  # coefficient 0 of radiance 1 from everywhere


@dataclass(frozen=True)
class Result:
    """Estimates of one case."""

    error: float
    flags: frozenset[str]  # of any estimate


@dataclass(frozen=True)
class Case:
    """What goes in, how its error is defined, and how large it may be."""

    name: str
    measure: Callable[[Path], Result]
    error: str  # what the number is
    bound: float
    must: frozenset[str] = frozenset()  # flags


def estimate_floats(folder: Path, radiance: np.ndarray, **settings: object) -> Estimate:
    """One estimate of a float map."""
    image.write_pfm(folder / "0.pfm", radiance.astype(np.float32))
    return _checked(offline.estimate_folder(folder, (), offline.Settings(**settings)))


def estimate_codes(
    folder: Path, codes: np.ndarray, exposure_us: float = 1e6, quality: int = 95,
    chroma: str = "420", **settings: object,
) -> Estimate:  # fmt: skip
    """One estimate of an 8-bit JPEG; radiance 1 = full scale at the default exposure."""
    (folder / "0.jpg").write_bytes(encode_jpeg(codes, quality, chroma))
    return _checked(offline.estimate_folder(folder, [exposure_us], offline.Settings(**settings)))


def _checked(estimate: Estimate) -> Estimate:
    json.dumps(estimate.to_json(), allow_nan=False)
    assert np.isfinite(estimate.total().coefficients).all()
    for light in estimate.lights:
        assert np.isfinite(light.direction).all()
        assert abs(np.linalg.norm(light.direction) - 1) < 1e-5
        assert np.isfinite(light.irradiance).all()
        assert (light.irradiance >= 0).all()
        assert 0 < light.angular_radius_deg <= 180
    return estimate


def _flags(*estimates: Estimate) -> frozenset[str]:
    return frozenset(name for e in estimates for name in e.to_json()["flags"])


def _uniform_error(estimate: Estimate, radiance: object) -> float:
    """Relative L2 of TOTAL against the same light from everywhere."""
    total = estimate.total().coefficients
    truth = np.zeros_like(total)
    truth[0] = Y0 * np.asarray(radiance, float)
    return metrics.sh_error(truth, total)


def constant(value: object, width: int = SIZE_PX[0]) -> np.ndarray:
    """A map (width/2, width, 3) of one colour."""
    return np.broadcast_to(np.asarray(value, np.float32), (width // 2, width, 3)).copy()


def dark_floats(folder: Path) -> Result:
    """Nothing at all."""
    e = estimate_floats(folder, constant(0))
    return Result(float(np.abs(e.total().coefficients).max()) + len(e.lights), _flags(e))


def dark_codes(folder: Path) -> Result:
    """A JPEG of zeros."""
    e = estimate_codes(folder, constant(0).astype(np.uint8))
    return Result(float(np.abs(e.total().coefficients).max()) + len(e.lights), _flags(e))


def white_codes(folder: Path) -> Result:
    """Every pixel saturated: full scale is the lower bound that it is."""
    e = estimate_codes(folder, constant(255).astype(np.uint8))
    return Result(_uniform_error(e, 1.0), _flags(e))


def furnace(preset: str) -> Callable[[Path], Result]:
    """The same radiance from everywhere, over twelve decades and in a saturated colour."""

    def measure(folder: Path) -> Result:
        colours = [(v, v, v) for v in (1e-6, 1e-3, 1.0, 1e3, 1e6)] + [(1.0, 0.0, 0.0), (0, 0, 7)]
        found = [
            (estimate_floats(folder, constant(colour), preset=preset), colour) for colour in colours
        ]
        assert all(not e.lights for e, _ in found)
        error = max(_uniform_error(e, colour) for e, colour in found)
        return Result(error, _flags(*(e for e, _ in found)))

    return measure


def furnace_codes(folder: Path) -> Result:
    """Grey codes: against the response curve at that code."""
    found = [(estimate_codes(folder, constant(c).astype(np.uint8)), c) for c in (2, 20, 128, 240)]
    error = max(_uniform_error(e, LINEAR[c]) for e, c in found)
    return Result(error, _flags(*(e for e, _ in found)))


def colours_codes(folder: Path) -> Result:
    """Red, green, blue and their opposites, near saturation: JPEG's chroma rounds to a code."""
    worst, seen = 0.0, []
    for bits in range(1, 7):
        colour = np.array([230 if bits >> c & 1 else 20 for c in range(3)])
        e = estimate_codes(folder, constant(colour).astype(np.uint8))
        worst = max(worst, _uniform_error(e, LINEAR[colour]))
        seen.append(e)
    return Result(worst, _flags(*seen))


#: Column and row of a 960 x 480 map: middle, seam, poles, off the grid's and the blocks' lines.
SUN_PIXELS = [
    (480, 240), (0, 240), (959, 240), (0, 0), (959, 0), (480, 0), (100, 1), (0, 479), (959, 479),
    (300, 478), (7, 8), (8, 7), (721, 123), (433, 333),
]  # fmt: skip


def sun_floats(preset: str, of: str) -> Callable[[Path], Result]:
    """One pixel 10^5 times its surround, anywhere: where it is, or how strong."""

    def measure(folder: Path) -> Result:
        width, height = SIZE_PX
        worst, seen = 0.0, []
        omega = geometry.equirect_solid_angles(width, height)
        for column, row in SUN_PIXELS:
            radiance = constant(1.0)
            # near the poles a pixel is so small that even this is little light
            strength = 1e5 * omega[height // 2] / omega[row]
            radiance[row, column] += strength
            e = estimate_floats(folder, radiance, preset=preset)
            assert len(e.lights) == 1, (column, row, len(e.lights))
            (light,) = e.lights
            truth = geometry.equirect_direction(column, row, width, height)
            angle_deg = float(geometry.angle_deg(light.direction, truth))
            off = abs(float(luminance(light.irradiance)) / (strength * omega[row]) - 1)
            worst = max(worst, angle_deg if of == "direction" else off)
            seen.append(e)
        return Result(worst, _flags(*seen))

    return measure


def broken_samples(folder: Path) -> Result:
    """NaN and negative samples, also infinite ones, in a smooth map: as if they were not there."""
    height, width = SIZE_PX[1], SIZE_PX[0]
    rows = np.arange(height)[:, None, None]
    clean = constant(1.0) + (np.sin(np.pi * (rows + 0.5) / height)).astype(np.float32)
    dirty = clean.copy()
    random = np.random.default_rng(1)
    for bad in (np.nan, np.nan, -np.inf, -1.0, -1e30):
        y, x = random.integers(0, height, 200), random.integers(0, width, 200)
        dirty[y, x, random.integers(0, 3, 200)] = bad
    e = estimate_floats(folder, dirty)
    return Result(metrics.sh_error(sh.project(clean, 2), e.total().coefficients[:9]), _flags(e))


def all_broken(folder: Path) -> Result:
    """Not one good sample: black, and said so."""
    e = estimate_floats(folder, constant(np.nan))
    return Result(float(np.abs(e.total().coefficients).max()) + len(e.lights), _flags(e))


def exposures(folder: Path) -> Result:
    """The same picture at 1 us … 10 s: radiance times exposure is one number."""
    codes = constant(100).astype(np.uint8)
    codes[200:220, 300:330] = 240
    seen = [estimate_codes(folder, codes, us) for us in (1.0, 30.0, 1e3, 1e5, 1e7)]
    times_s = np.array([1.0, 30.0, 1e3, 1e5, 1e7])[:, None, None] * 1e-6
    products = np.stack([e.total().coefficients for e in seen]) * times_s
    spread = np.abs(products - products[0]).max() / np.abs(products[0]).max()
    return Result(float(spread), _flags(*seen))


def shades(width: int) -> np.ndarray:
    """Codes of a smooth gradient, in any size."""
    x = (np.arange(width)[None, :, None] + 0.5) / width
    y = (np.arange(width // 2)[:, None, None] + 0.5) / (width // 2)
    shade = 120 + 60 * np.cos(2 * np.pi * x) * np.sin(np.pi * y) + 40 * np.cos(np.pi * y)
    return np.repeat(np.rint(shade), 3, axis=2).astype(np.uint8)


def sizes(folder: Path) -> Result:
    """A gradient in 16 x 8 … 7680 x 3840, as JPEG: against linearised pixels (of 1000 at most)."""
    worst, seen = 0.0, []
    for width in (16, 48, 250, 1000, 7680):
        e = estimate_codes(folder, shades(width))
        times = max(960 // width, 1)  # of few pixels each is an area, not a sample
        pixels = LINEAR[shades(min(width, 1000))].repeat(times, axis=0).repeat(times, axis=1)
        truth = sh.project(pixels, 4)
        worst = max(worst, metrics.sh_error(truth, e.total().coefficients))
        seen.append(e)
    return Result(worst, _flags(*seen))


def checkers(preset: str) -> Callable[[Path], Result]:
    """Checkerboards of 1, 2, 4, 8 and 16 pixels, black to near white, on and off the blocks."""

    def measure(folder: Path) -> Result:
        worst, seen = 0.0, []
        for side, shift in ((1, 0), (2, 0), (4, 2), (8, 0), (8, 4), (16, 5)):
            x = (np.arange(SIZE_PX[0])[None, :] + shift) // side
            y = (np.arange(SIZE_PX[1])[:, None] + shift) // side
            codes = np.where((x + y) % 2, 225, 10).astype(np.uint8)
            e = estimate_codes(folder, np.repeat(codes[..., None], 3, axis=2), preset=preset)
            mean = (LINEAR[225] + LINEAR[10]) / 2
            worst = max(worst, abs(float(e.total().coefficients[0, 1]) / (Y0 * mean) - 1))
            seen.append(e)
        return Result(worst, _flags(*seen))

    return measure


def faintest(folder: Path) -> Result:
    """Denormal radiance: any finite answer that is not above it."""
    e = estimate_floats(folder, constant(1e-42))
    return Result(max(float(e.total().coefficients.max()) / (Y0 * 1e-42) - 1, 0.0), _flags(e))


def brightest(folder: Path) -> Result:
    """1e30, and a pixel of 1e35: far beyond any light, still a number."""
    radiance = constant(1e30)
    radiance[100, 200] = 1e35
    e = estimate_floats(folder, radiance)
    truth = sh.project(radiance, 2)
    return Result(metrics.sh_error(truth, e.total().coefficients[:9]), _flags(e))


def _cases() -> Iterator[Case]:
    none = frozenset[str]()
    dark, clipped = frozenset({"NO_LIGHT"}), frozenset({"CLIPPED"})
    sh_l2 = "SH, relative L2"
    yield Case("all black, floats", dark_floats, "largest coefficient", 0.0, dark)
    yield Case("all black, JPEG", dark_codes, "largest coefficient", 0.0, dark | {"UNDEREXPOSED"})
    yield Case("all white, JPEG (full scale is a lower bound)", white_codes, sh_l2, 1e-5, clipped)
    for preset in ("fast", "balanced", "accurate"):
        yield Case(
            f"white furnace, 1e-6 … 1e6, pure red, pure blue; {preset}", furnace(preset), sh_l2,
            1e-5, none,
        )  # fmt: skip
    yield Case("uniform grey, JPEG, codes 2 … 240", furnace_codes, sh_l2, 1e-5, none)
    yield Case("saturated colours, JPEG 4:2:0", colours_codes, sh_l2, 0.015, none)
    for preset in ("balanced", "accurate"):
        yield Case(
            f"one-pixel sun, 14 places with seam and poles; {preset}",
            sun_floats(preset, "direction"), "direction, degrees", 0.005, none,
        )  # fmt: skip
        yield Case(
            f"one-pixel sun, 14 places with seam and poles; {preset}",
            sun_floats(preset, "strength"), "irradiance, relative", 1e-5, none,
        )  # fmt: skip
    broken = frozenset({"INVALID_INPUT"})
    yield Case("NaN, −infinity, negative samples", broken_samples, sh_l2, 1e-4, broken)
    yield Case("nothing but NaN", all_broken, "largest coefficient", 0.0, broken | dark)
    yield Case("exposures 1 µs … 10 s", exposures, "radiance × exposure, relative", 1e-6, none)
    yield Case("16×8 … 7680×3840, JPEG", sizes, sh_l2, 0.01, none)
    for preset in ("balanced", "accurate"):
        yield Case(
            f"checkerboards of 1 … 16 px, JPEG; {preset}", checkers(preset), "mean radiance", 0.02,
            none,
        )  # fmt: skip
    yield Case("denormal radiance 1e-42", faintest, "excess, relative", 0.01, none)
    yield Case("radiance 1e30, one pixel of 1e35", brightest, sh_l2, 2e-4, none)


CASES = tuple(_cases())
