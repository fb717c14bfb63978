"""What a polarizing film on the wheel is like: extinction, transmission, and where its axis stands.

Pictures of one still target behind the film at several angles of the wheel, and one without it. In
a small part of the picture all pixels share one polarization, so that with a film of offset o

    I = t/2 G (S0 + D (S1 cos 2ψ + S2 sin 2ψ)),   G and ψ of the wheel's angle + o

gives t/2 · S0, D · DoLP and AoLP by least squares. A target of known DoLP tells D, and with it the
extinction ratio (1 + D) / (1 − D); one of known AoLP tells o; a picture without the film tells t.
Light that is not polarized, off the lens' axis, tells the refractive index of the film's surfaces:
there G follows the wheel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.calibrate.files import CalibrationError
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera, Lens
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import EDGE_ON_DEG, Polarizer, lens_rotations
from lightprobe.imaging.stokes import Picture, check_angles

#: Light of less modulation (D · DoLP) than this tells no angle.
LEAST_POLARIZED = 0.1
#: The readings must follow one light behind a turning film within this share of it.
MOST_RESIDUAL = 0.02
#: With a larger sigma than this the index is not told: the target is too near the lens' axis.
MOST_INDEX_SIGMA = 0.1
#: Relative 1 sigma of a reading by errors of the camera's response, which no residual shows.
_READING_SIGMA = 0.003
_LEAST_PIXELS = 20
_STEPS = 8
_INDICES = np.linspace(1.0, 2.0, 101)


@dataclass(frozen=True)
class Region:
    """What is looked at: a cap around a direction."""

    azimuth_deg: float = 0.0  # to the right
    elevation_deg: float = 0.0
    radius_deg: float = 4.0

    def pixels(self, lens: Camera, size_px: tuple[int, int]) -> Array:
        """Tell of each pixel (H, W) whether it is inside."""
        centre = geometry.direction_from_angles(self.azimuth_deg, self.elevation_deg)
        directions = lens.look(*size_px)[0]
        return np.asarray(directions @ centre > np.cos(np.radians(self.radius_deg)))


@dataclass(frozen=True)
class Target:
    """What is known of its light; None: not known."""

    dolp: float | None = None
    aolp_deg: float | None = None  # 0: horizontal


@dataclass(frozen=True)
class Found:
    """The result; None: the target does not tell it."""

    modulation: float  # D · DoLP
    modulation_sigma: float
    residual: float  # RMS, relative
    aolp_deg: float  # of the target, if the film's axis stands where the camera file says
    extinction_ratio: float | None
    extinction_is_bound: bool  # it is at least this
    offset_deg: float | None  # -90…90
    offset_sigma_deg: float | None
    transmission: float | None
    transmission_sigma: float | None
    index: float | None = None
    index_sigma: float | None = None

    @property
    def is_turned(self) -> bool:
        """The film has been put in a quarter turn wrong, or nearly."""
        return self.offset_deg is not None and abs(self.offset_deg) > 45

    def values(self) -> dict[str, str]:
        """What goes into the camera file's [polarizer]."""
        given = {
            "transmission": self.transmission, "extinction": self.extinction_ratio,
            "offset_deg": self.offset_deg, "index": self.index,
        }  # fmt: skip
        return {name: f"{value:.5g}" for name, value in given.items() if value is not None}


def fit(
    pictures: Sequence[Picture],
    wheel_deg: Sequence[float],
    lens: Camera,
    target: Target,
    region: Region,
    without: Picture | None = None,
    index: float | None = None,
) -> Found:
    """Find out about the film; raises CalibrationError that says what to do instead.

    `without`: a picture of the same target, nothing before the lens; `index`: of the film; None: as
    the target tells, or the camera file says.
    """
    check_angles(wheel_deg, len(pictures))
    if len(pictures) < 4:
        raise CalibrationError(
            f"calibrate: polarizer: {len(pictures)} pictures: four angles at least, so that it "
            "shows whether the light changed meanwhile: 0,45,90,135, and 0 once more"
        )
    inside = _inside(lens, region, pictures)
    seen = np.array([_light(picture, inside, f"picture {k + 1}")
                     for k, picture in enumerate(pictures)])  # fmt: skip
    known = lens.sheet.index if index is None else index
    model = _Model(lens, inside, seen, np.asarray(wheel_deg, np.float64), known)
    offset_deg = lens.sheet.offset_deg
    by_target: tuple[float | None, float | None] = (None, None)
    if target.dolp == 0 and index is None:
        by_target = model.find_index(offset_deg)
    if target.aolp_deg is not None:
        offset_deg = model.offset(target.aolp_deg)
    light = model.solve(offset_deg)
    if light.residual > MOST_RESIDUAL:
        raise CalibrationError(
            f"calibrate: polarizer: the pictures follow no light behind a turning film: they are "
            f"{100 * light.residual:.0f} % off: is the exposure fixed, the target still, the "
            "angles in the order of the pictures, off the axis the film's index right?"
        )
    if (target.aolp_deg is not None or target.dolp) and light.modulation < LEAST_POLARIZED:
        raise CalibrationError(
            f"calibrate: polarizer: only {100 * light.modulation:.1f} % of the light at "
            f"{region.azimuth_deg:g}, {region.elevation_deg:g} is polarized: choose an LCD screen, "
            "or a reflection about 35° below the horizon in something smooth that lies flat"
        )
    ratio, is_bound = _extinction(light, target)
    clear = None if without is None else _light(without, inside, "the picture without the film")
    transmission = None if clear is None else float(2 * light.passed / clear.sum())
    return Found(
        light.modulation, light.modulation_sigma, light.residual, light.aolp_deg,
        ratio, is_bound,
        None if target.aolp_deg is None else (offset_deg + 90) % 180 - 90,
        None if target.aolp_deg is None else light.aolp_sigma_deg,
        transmission,
        None if transmission is None else transmission * _READING_SIGMA * 2,
        *by_target,
    )  # fmt: skip


def _inside(lens: Camera, region: Region, pictures: Sequence[Picture]) -> Array:
    height, width, _ = pictures[0].light.shape
    inside = region.pixels(lens, (width, height))
    if inside.sum() < _LEAST_PIXELS:
        raise CalibrationError(
            f"calibrate: polarizer: {int(inside.sum())} pixels within {region.radius_deg:g}° of "
            f"{region.azimuth_deg:g}, {region.elevation_deg:g}: choose a larger --radius"
        )
    centre = geometry.direction_from_angles(region.azimuth_deg, region.elevation_deg)
    cosine = max(abs(float(turn @ [0.0, 0.0, -1.0] @ centre)) for turn in lens_rotations(lens))
    if cosine < np.cos(np.radians(EDGE_ON_DEG)):
        raise CalibrationError(
            f"calibrate: polarizer: the film is seen edge-on at {region.azimuth_deg:g}, "
            f"{region.elevation_deg:g}: choose a target within {EDGE_ON_DEG:g}° of the lens' axis"
        )
    return inside


def _light(picture: Picture, inside: Array, name: str) -> Array:
    """Luminance of the pixels inside (n,)."""
    light = luminance(picture.light[inside].astype(np.float64))
    if not np.isfinite(light).all():
        raise CalibrationError(
            f"calibrate: polarizer: {name} clips at the target: choose a shorter exposure, the "
            "same for all of them"
        )
    return np.asarray(light)


@dataclass(frozen=True)
class _Light:
    """What passes a film of D = 1: t/2 · S0, and how it is polarized."""

    passed: float
    modulation: float
    modulation_sigma: float
    aolp_deg: float
    aolp_sigma_deg: float
    residual: float


@dataclass(frozen=True)
class _Pixels:
    """The part of a camera that looks at the target, as a picture of one row."""

    directions: Array  # (n, 3)
    owners: NDArray[np.intp]  # (n,)
    lenses: tuple[Lens, ...]

    def look(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Directions (1, n, 3), and their illumination."""
        return self.directions[None], np.ones((height_px, width_px))

    def owner(self, _width_px: int, _height_px: int) -> NDArray[np.intp]:
        """Which lens looks there (1, n)."""
        return self.owners[None]


class _Model:
    """The readings, and least squares for an assumed offset."""

    def __init__(
        self, lens: Camera, inside: Array, seen: Array, wheel_deg: Array, index: float
    ) -> None:
        """`seen`: (angles, pixels)."""
        height, width = inside.shape
        self._pixels = _Pixels(
            lens.look(width, height)[0][inside], lens.owner(width, height)[inside], lens.lenses
        )
        self._wheel_deg, self._sums, self._seen = wheel_deg, seen.sum(axis=1), seen.mean(axis=0)
        self._index = index
        self._take(index)

    def _take(self, index: float) -> None:
        size_px = len(self._seen), 1
        self._polarizer = Polarizer(Sheet(1.0, 1e12, index=index), self._pixels, size_px)

    def _design(self, offset_deg: float) -> Array:
        """G, G cos 2ψ, G sin 2ψ (angles, 3) of the target as a whole."""
        films = []
        for angle in self._wheel_deg + offset_deg:
            gain, axis = self._polarizer.gain(angle)[0], self._polarizer.axis(angle)
            films.append([gain, gain * axis[0][0], gain * axis[1][0]])
        design = np.array(films, np.float64)
        light = self._seen / design[:, 0].mean(axis=0)
        return np.asarray(design @ (light / light.sum()))

    def find_index(self, offset_deg: float) -> tuple[float | None, float | None]:
        """Index and its sigma by light that is not polarized; None: it does not tell. Take it."""
        gains = []
        for index in _INDICES:
            self._take(float(index))
            gains.append(self._design(offset_deg)[:, 0])
        gain = np.array(gains)  # (indices, angles)
        off = self._sums / gain
        off = off / off.mean(axis=1, keepdims=True) - 1
        squares = (off**2).sum(axis=1)
        best = int(np.clip(np.argmin(squares), 1, len(_INDICES) - 2))
        step = _INDICES[1] - _INDICES[0]
        low, middle, high = squares[best - 1 : best + 2]
        bend = max(low - 2 * middle + high, 1e-30)
        index = float(np.clip(_INDICES[best] + step * (low - high) / (2 * bend), 1, 2))
        spare = max(len(self._sums) - 2, 1)
        reading = np.hypot(np.sqrt(max(squares.min(), 0) / spare), _READING_SIGMA)
        sigma = float(reading * np.sqrt(2 / bend) * step)
        told = sigma <= MOST_INDEX_SIGMA
        self._take(index if told else self._index)
        return (index, sigma) if told else (None, None)

    def solve(self, offset_deg: float) -> _Light:
        design = self._design(offset_deg)
        (passed, s1, s2), *_ = np.linalg.lstsq(design, self._sums, rcond=None)
        off = self._sums - design @ [passed, s1, s2]
        residual = float(np.sqrt(np.mean(off**2)) / passed)
        spare = max(len(design) - 3, 1)
        sigma = np.hypot(np.sqrt((off**2).sum() / spare) / passed, _READING_SIGMA)
        share_sigma = float(sigma * np.sqrt(2 / len(design)))
        modulation = float(np.hypot(s1, s2) / passed)
        return _Light(
            float(passed), modulation, share_sigma,
            float(np.degrees(np.arctan2(s2, s1)) / 2 % 180),
            float(np.degrees(share_sigma / (2 * max(modulation, 1e-6)))), residual,
        )  # fmt: skip

    def offset(self, aolp_deg: float) -> float:
        """Offset with which the target is polarized as it is known to be."""
        offset_deg = 0.0
        # Seen from behind, as in the rear half of a panorama, the axis turns the other way.
        turned = self._off(aolp_deg, 1.0) - self._off(aolp_deg, -1.0)
        forward = (turned + 90) % 180 < 90
        for _ in range(_STEPS):  # off the axis the angles do not simply add
            off = self._off(aolp_deg, offset_deg)
            offset_deg += off if forward else -off
        return offset_deg

    def _off(self, aolp_deg: float, offset_deg: float) -> float:
        """How far the target's angle is off with an offset, -90…90."""
        return (aolp_deg - self.solve(offset_deg).aolp_deg + 90) % 180 - 90


def _extinction(light: _Light, target: Target) -> tuple[float | None, bool]:
    """Extinction ratio by the target's DoLP; where noise hides it, the least that it is."""
    if not target.dolp:
        return None, False
    leak = 1 - light.modulation / target.dolp
    least = max(leak, light.modulation_sigma)
    return float(min((2 - least) / least, 1e6)), leak < 2 * light.modulation_sigma
