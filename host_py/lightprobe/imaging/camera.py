"""Cameras: where a pixel looks. Equirectangular, or lenses or a mirror ball by a file.

The file is INI; its numbers refer to the size it states, and any other frame size is scaled:

    [camera]   version = 1, name, projection = equirect | fisheye | pinhole | ball,
               width_px, height_px
               mask               of an equirectangular picture, as a lens'
               stuck_pixels       file of rows x y beside it: pixels that shine by themselves
    [lens.0]   cx_px, cy_px       image centre; the first pixel's centre is at (0.5, 0.5)
               fx_px, fy_px       focal lengths; r = f·(θ + k1·θ³ + k2·θ⁵ + k3·θ⁷ + k4·θ⁹)
               k1 … k4            (Kannala and Brandt 2006); default 0
               max_theta_deg      half the field of view
               rotation_wxyz      quaternion from the lens' frame (x right, y up, −z forward)
                                  to the probe's; default 1, 0, 0, 0
               rolloff            a1, a2, a3: relative illumination 1 + a1·θ² + a2·θ⁴ + a3·θ⁶
               mask               PGM beside the file; 0 where the lens sees nothing useful
               distortion         k1, k2, p1, p2, k3 of projection = pinhole, as OpenCV has them
    [lens.1]   …
    [ball]     centre, radius, …  of projection = ball (imaging/ball.py)
    [polarizer] transmission, extinction, offset_deg: the film on the wheel (imaging/film.py)
    [glare]    even, around, width_deg: light that the lens spreads over its picture
    [crop]     full_width_px, full_height_px, left_px, top_px: equirect, the part of the sphere
    [response] table              file of 256 rows r g b: linear light of each code, scaled so
                                  that the last row of green is 1; default sRGB
               processing         what the camera did to its pictures meanwhile; for the daemon
"""

from __future__ import annotations

import configparser
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.colour import srgb_table
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array, equirect_direction, rotation_matrix
from lightprobe.imaging.ball import Ball, Pinhole
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.metadata import WHOLE, Crop, crop_of

VERSION = 1  # of the format
_THETA_STEPS = 4096
#: What rounding may take from the angle of a picture's corner.
_ROUNDING_RAD = 1e-6
#: A pixel whose ray is seen so far beside it has none: as in daemon/vision/ball/pinhole.c.
_FOLDS_PX = 0.1


class CameraError(LightprobeError):
    """A camera file that cannot be used; names file, section and key."""


@dataclass(frozen=True, eq=False)
class Lens:
    """One fisheye lens; pixels of the size that the camera states."""

    centre_px: tuple[float, float]
    focal_px: tuple[float, float]
    k: tuple[float, float, float, float]
    max_theta_deg: float
    rotation_wxyz: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    rolloff: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mask: NDArray[np.uint8] | None = None

    def radius(self, theta: ArrayLike) -> Array:
        """Image radius in focal lengths at angle theta (rad) off the axis."""
        t = np.asarray(theta, dtype=np.float64)
        odd = (t ** (2 * power + 3) * k for power, k in enumerate(self.k))
        return np.asarray(t + sum(odd, np.zeros_like(t)))

    def illumination(self, theta: ArrayLike) -> Array:
        """Relative illumination at angle theta (rad) off the axis; 1 on it, never below 0."""
        square = np.asarray(theta, dtype=np.float64) ** 2
        a1, a2, a3 = self.rolloff
        return np.maximum(1 + square * (a1 + square * (a2 + square * a3)), 0)

    def offset(self, x_px: Array, y_px: Array) -> tuple[Array, Array, Array]:
        """Right, down and radial distance from the image centre, in focal lengths."""
        a = (x_px - self.centre_px[0]) / self.focal_px[0]
        b = (y_px - self.centre_px[1]) / self.focal_px[1]
        return a, b, np.hypot(a, b)

    def place(self, directions: Array) -> tuple[Array, Array]:
        """Where directions (…, 3) of the probe frame are in the picture, in px; see :meth:`sees`.

        The inverse of :meth:`look`, but beyond `max_theta_deg`, too.
        """
        x, y, z = np.moveaxis(directions @ rotation_matrix(self.rotation_wxyz), -1, 0)
        sine = np.hypot(x, y)
        scale = self.radius(np.arctan2(sine, -z)) / np.where(sine > 0, sine, 1)
        return (
            np.asarray(self.centre_px[0] + self.focal_px[0] * scale * x),
            np.asarray(self.centre_px[1] - self.focal_px[1] * scale * y),
        )

    def sees(self, directions: Array) -> NDArray[np.bool_]:
        """Tell of directions (…, 3) of the probe frame whether the lens reaches that far."""
        ahead = -(directions @ rotation_matrix(self.rotation_wxyz)[:, 2])
        return np.asarray(ahead >= np.cos(np.radians(self.max_theta_deg)))

    def scaled(self, x: float, y: float) -> Lens:
        """Give the same lens for pictures that are so many times as wide and high; no mask."""
        return replace(
            self,
            centre_px=(x * self.centre_px[0], y * self.centre_px[1]),
            focal_px=(x * self.focal_px[0], y * self.focal_px[1]),
            mask=None,
        )

    def look(self, x_px: Array, y_px: Array) -> tuple[Array, Array]:
        """Give (direction (…, 3) in the probe frame, theta in rad); NaN where nothing is seen."""
        a, b, radius = self.offset(x_px, y_px)
        steps = np.linspace(0, np.radians(self.max_theta_deg), _THETA_STEPS)
        theta = np.interp(radius, self.radius(steps), steps, right=np.nan)
        scale = np.sin(theta) / np.where(radius > 0, radius, 1)
        direction = np.stack([a * scale, -b * scale, -np.cos(theta)], axis=-1)
        return direction @ rotation_matrix(self.rotation_wxyz).T, theta


@dataclass(frozen=True, eq=False)
class PinholeLens(Lens):
    """The lens of an ordinary camera, by OpenCV's model; `k` is not used."""

    distortion: tuple[float, ...] = ()  # k1, k2, p1, p2[, k3]

    @property
    def _pinhole(self) -> Pinhole:
        return Pinhole(*self.focal_px, *self.centre_px, self.distortion)

    def radius(self, theta: ArrayLike) -> Array:
        """See :class:`Lens`; without the distortion."""
        return np.asarray(np.tan(np.asarray(theta, dtype=np.float64)))

    def place(self, directions: Array) -> tuple[Array, Array]:
        """See :class:`Lens`; NaN behind the camera."""
        rays = directions @ rotation_matrix(self.rotation_wxyz)
        ahead = rays[..., 2] < 0
        places = self._pinhole.places(np.where(ahead[..., None], rays, [0, 0, -1]))
        places = np.where(ahead[..., None], places.reshape(*rays.shape[:-1], 2), np.nan)
        return places[..., 0], places[..., 1]

    def look(self, x_px: Array, y_px: Array) -> tuple[Array, Array]:
        """See :class:`Lens`."""
        rays = self._pinhole.rays(np.stack([x_px, y_px], axis=-1))
        theta = np.arccos(np.clip(-rays[:, 2], -1, 1)).reshape(np.shape(x_px))
        theta[theta > np.radians(self.max_theta_deg) + _ROUNDING_RAD] = np.nan
        turned = rays @ rotation_matrix(self.rotation_wxyz).T
        directions = turned.reshape(*theta.shape, 3)
        directions[np.isnan(theta)] = np.nan
        return directions, theta

    def most_deg(self, width_px: float, height_px: float) -> float:
        """Largest angle from the axis in a picture of this size; 0: its distortion folds there."""
        x, y = np.meshgrid(np.linspace(0, width_px, 33), np.linspace(0, height_px, 33))
        places = np.stack([x, y], axis=-1).reshape(-1, 2)
        rays = self._pinhole.rays(places)
        off_px = np.linalg.norm(self._pinhole.places(rays) - places, axis=1)
        if not np.all(off_px < _FOLDS_PX):
            return 0.0
        return float(np.degrees(np.arccos(-rays[:, 2]).max()))


@dataclass(frozen=True)
class Glare:
    """Veiling glare: shares of all light of a lens' picture.

    `even` is spread evenly over the picture, `around` around where it comes from, by
    (1 + (angle / `width_deg`)²)^-1.5.
    """

    even: float = 0.0
    around: float = 0.0
    width_deg: float = 10.0

    @property
    def is_possible(self) -> bool:
        """Tell whether a camera file may state it."""
        return 0 <= self.even <= 0.4 and 0 <= self.around <= 0.4 and 1 <= self.width_deg <= 90


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera: a projection and a response."""

    name: str
    width_px: int
    height_px: int
    lenses: tuple[Lens, ...] = ()  # none: equirectangular
    response: Array | None = None  # (256, 3) linear light of each code; None: sRGB
    sheet: Sheet = field(default_factory=Sheet)  # of the polarizer on the wheel
    glare: Glare = field(default_factory=Glare)
    #: Of an equirectangular picture; None: the file does not say.
    crop: Crop | None = None
    mask: NDArray[np.uint8] | None = None  # of an equirectangular picture; 0: not seen
    ball: Ball | None = None  # whose mirror images the pixels are; lenses[0] has rotation and mask
    stuck_px: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))  # x, y of each

    @property
    def is_equirect(self) -> bool:
        """True for an equirectangular picture."""
        return not self.lenses

    @property
    def is_whole(self) -> bool:
        """True for an equirectangular picture of all of the sphere."""
        return self.is_equirect and self.crop in (None, WHOLE) and self.mask is None

    def response_table(self) -> Array:
        """Linear light (256, 3) of the codes, full scale = 1."""
        return np.repeat(srgb_table()[:, None], 3, 1) if self.response is None else self.response

    def look(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Directions (H, W, 3) of a frame's pixels and relative illumination (H, W).

        Where nothing is seen the illumination is 0 and the direction NaN.
        """
        if self.is_equirect:
            crop = self.crop or WHOLE
            full_width, full_height = width_px / crop.width, height_px / crop.height
            columns = np.arange(width_px)[None, :] + crop.left * full_width
            rows = np.arange(height_px)[:, None] + crop.top * full_height
            directions = equirect_direction(columns, rows, full_width, full_height)
            illumination = np.ones((height_px, width_px))
            if self.mask is not None:
                illumination[_of_size(self.mask, width_px, height_px) == 0] = 0
                directions[illumination == 0] = np.nan
            return directions, illumination
        if self.ball:
            return self._look_at_ball(self.ball, width_px, height_px)
        x, y = self._stated_px(width_px, height_px)
        owner = self.owner(width_px, height_px)
        directions = np.full((height_px, width_px, 3), np.nan)
        illumination = np.zeros((height_px, width_px))
        for number, lens in enumerate(self.lenses):
            direction, theta = lens.look(x, y)
            seen = np.isfinite(theta) & (owner == number)
            if lens.mask is not None:
                seen &= _of_size(lens.mask, width_px, height_px) > 0
            directions[seen] = direction[seen]
            illumination[seen] = lens.illumination(theta[seen])
        return directions, illumination

    def _look_at_ball(self, ball: Ball, width_px: int, height_px: int) -> tuple[Array, Array]:
        x, y = self._stated_px(width_px, height_px)
        directions, illumination = ball.look(np.stack([x, y], axis=-1).reshape(-1, 2))
        lens = self.lenses[0]
        if lens.mask is not None:
            illumination[_of_size(lens.mask, width_px, height_px).ravel() == 0] = 0
        directions[illumination == 0] = np.nan
        turned = directions @ rotation_matrix(lens.rotation_wxyz).T
        return turned.reshape(height_px, width_px, 3), illumination.reshape(height_px, width_px)

    def owner(self, width_px: int, height_px: int) -> NDArray[np.intp]:
        """Index (H, W) of the lens that a frame's pixels belong to: the nearest; 0 without any."""
        if self.is_equirect:
            return np.zeros((height_px, width_px), np.intp)
        x, y = self._stated_px(width_px, height_px)
        return np.asarray(np.argmin([lens.offset(x, y)[2] for lens in self.lenses], axis=0))

    def _stated_px(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Where a frame's pixels (H, W) are in a picture of the size that the camera states."""
        x = (np.arange(width_px)[None, :] + 0.5) * self.width_px / width_px
        y = (np.arange(height_px)[:, None] + 0.5) * self.height_px / height_px
        x, y = np.broadcast_arrays(x, y)
        return x, y


def _of_size(mask: NDArray[np.uint8], width_px: int, height_px: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(mask, (width_px, height_px), interpolation=cv2.INTER_NEAREST))


def equirect(width_px: int = 1920, height_px: int = 960) -> Camera:
    """Give the camera whose frames are panoramas already."""
    return Camera("equirect", width_px, height_px)


def load(name: str) -> Camera:
    """`equirect`, or the path of a camera file; raises :class:`CameraError`."""
    if name == "equirect":
        return equirect()
    path = Path(name)
    config = configparser.ConfigParser(inline_comment_prefixes=(";", "#"))
    try:
        with open(path) as file:
            config.read_file(file)
    except OSError as error:
        raise CameraError(f"camera: {path}: open: {error.strerror}") from None
    except (configparser.Error, UnicodeDecodeError) as error:
        words = " ".join(str(error).split())
        raise CameraError(f"camera: {path}: parse: {words}") from None
    return _camera(_Section(path, config))


class _Section:
    """Values of a section; what is missing or wrong is named by file, section and key."""

    def __init__(self, path: Path, config: configparser.ConfigParser, name: str = "camera") -> None:
        self.path, self.config, self.name = path, config, name
        if not config.has_section(name):
            raise CameraError(f"camera: {path}: section [{name}] is missing")

    def text(self, key: str, default: str | None = None) -> str:
        value = self.config.get(self.name, key, fallback=default)
        if value is None:
            raise CameraError(f"camera: {self.path}: [{self.name}] {key} is missing")
        return value

    def numbers(self, key: str, count: int, default: str | None = None) -> tuple[float, ...]:
        text = self.text(key, default)
        try:
            values = tuple(float(word) for word in text.replace(",", " ").split())
        except ValueError:
            values = ()
        if len(values) != count or not np.all(np.isfinite(values)):
            wanted = "a number" if count == 1 else f"{count} numbers"
            raise CameraError(
                f"camera: {self.path}: [{self.name}] {key} = {text}: expected {wanted}"
            )
        return values

    def number(self, key: str, default: str | None = None) -> float:
        return self.numbers(key, 1, default)[0]


def _camera(section: _Section) -> Camera:
    version = section.text("version", str(VERSION))
    if version != str(VERSION):
        raise CameraError(
            f"camera: {section.path}: [camera] version = {version}: this lightprobe reads {VERSION}"
        )
    projection = section.text("projection")
    if projection not in ("equirect", "fisheye", "pinhole", "ball"):
        raise CameraError(
            f"camera: {section.path}: [camera] projection = {projection}: "
            "expected equirect, fisheye, pinhole or ball"
        )
    config = section.config
    names = sorted(n for n in config.sections() if n.startswith("lens."))
    is_one = projection in ("pinhole", "ball")
    if (projection != "equirect") != bool(names) or (is_one and len(names) != 1):
        raise CameraError(
            f"camera: {section.path}: {projection} with {len(names)} [lens.N] sections"
        )
    # Panoramas of any size are seen alike.
    width_px, height_px = ("1920", "960") if projection == "equirect" else (None, None)
    ball = _ball(section) if projection == "ball" else None
    return Camera(
        name=section.text("name", section.path.stem),
        width_px=int(section.number("width_px", width_px)),
        height_px=int(section.number("height_px", height_px)),
        lenses=_lenses(section, names, projection),
        ball=ball,
        response=_response(section) if config.has_option("response", "table") else None,
        sheet=_sheet(section) if config.has_section("polarizer") else Sheet(),
        glare=_glare(section) if config.has_section("glare") else Glare(),
        crop=_crop(section) if config.has_section("crop") else None,
        mask=_mask(section) if projection == "equirect" else None,
        stuck_px=_stuck_pixels(section),
    )


def _crop(camera: _Section) -> Crop:
    section = _Section(camera.path, camera.config, "crop")
    crop = crop_of(
        section.number("left_px", "0"), section.number("top_px", "0"),
        camera.number("width_px"), camera.number("height_px"),
        section.number("full_width_px"), section.number("full_height_px"),
    )  # fmt: skip
    if crop is None:
        raise CameraError(
            f"camera: {section.path}: [crop] expected full_width_px and full_height_px, within "
            "which width_px × height_px of [camera] lie at left_px, top_px"
        )
    return crop


def _ball(camera: _Section) -> Ball:
    lens, section = (_Section(camera.path, camera.config, name) for name in ("lens.0", "ball"))
    words = section.text("distortion", "").replace(",", " ").split()
    usual = Ball(Pinhole(1, 1, 0, 0), np.array([0.0, 0, -2]), 1)
    ball = Ball(
        Pinhole(
            lens.number("fx_px"), lens.number("fy_px"), lens.number("cx_px"), lens.number("cy_px"),
            section.numbers("distortion", len(words)) + (0.0,) * (5 - len(words)) if words else (),
        ),
        np.array(section.numbers("centre", 3)),
        section.number("radius"),
        section.number("index", str(usual.index)),
        section.number("extinction", str(usual.extinction)),
        section.number("rim_px", str(usual.rim_px)),
        section.number("outline_sigma_px", str(usual.outline_sigma_px)),
        section.number("rotation_sigma_deg", "0"),
    )  # fmt: skip
    if not ball.is_possible or len(words) > 5:
        raise CameraError(
            f"camera: {section.path}: [ball] expected centre = X, Y, Z before the lens (+X right, "
            "+Y up, -Z ahead) and radius, outside of the lens and larger than rim_px, and "
            "distortion = k1, k2, p1, p2, k3"
        )
    return ball


def _sheet(camera: _Section) -> Sheet:
    section, usual = _Section(camera.path, camera.config, "polarizer"), Sheet()
    sheet = Sheet(
        section.number("transmission", str(usual.transmission)),
        section.number("extinction", str(usual.extinction_ratio)),
        section.number("offset_deg", "0"),
        section.number("index", str(usual.index)),
    )
    if not sheet.is_possible:
        raise CameraError(
            f"camera: {section.path}: [polarizer] expected transmission 0.01…1, extinction 1…1e9, "
            "offset_deg -180…180, index 1…2"
        )
    return sheet


def _glare(camera: _Section) -> Glare:
    section, usual = _Section(camera.path, camera.config, "glare"), Glare()
    glare = Glare(
        section.number("even", "0"),
        section.number("around", "0"),
        section.number("width_deg", str(usual.width_deg)),
    )
    if not glare.is_possible:
        raise CameraError(
            f"camera: {section.path}: [glare] expected even 0…0.4, around 0…0.4, width_deg 1…90"
        )
    return glare


def _lenses(camera: _Section, names: list[str], projection: str) -> tuple[Lens, ...]:
    sections = [_Section(camera.path, camera.config, name) for name in names]
    if projection == "pinhole":
        return (_pinhole_lens(camera, sections[0]),)
    return tuple(_lens(section, projection == "ball") for section in sections)


def _pinhole_lens(camera: _Section, section: _Section) -> PinholeLens:
    where = f"camera: {section.path}: [{section.name}]"
    words = section.text("distortion", "").replace(",", " ").split()
    if len(words) > 5 or any(section.number(f"k{i}", "0") for i in (1, 2, 3, 4)):
        raise CameraError(
            f"{where} of projection = pinhole: expected distortion = k1, k2, p1, p2, k3, "
            "and no k1 to k4, which are of a fisheye"
        )
    plain = _lens(section, sees_ball=True)
    lens = PinholeLens(
        plain.centre_px, plain.focal_px, plain.k, 90, plain.rotation_wxyz, plain.rolloff,
        plain.mask,
        section.numbers("distortion", len(words)) + (0.0,) * (5 - len(words)) if words else (),
    )  # fmt: skip
    most_deg = lens.most_deg(camera.number("width_px"), camera.number("height_px"))
    if not most_deg:
        raise CameraError(f"{where} with this distortion two places of the picture look alike")
    return replace(lens, max_theta_deg=min(most_deg, plain.max_theta_deg))


def _lens(section: _Section, sees_ball: bool) -> Lens:
    k = tuple(section.number(f"k{i}", "0") for i in (1, 2, 3, 4))
    rolloff = section.numbers("rolloff", 3, "0, 0, 0")
    lens = Lens(
        centre_px=(section.number("cx_px"), section.number("cy_px")),
        focal_px=(section.number("fx_px"), section.number("fy_px")),
        k=(k[0], k[1], k[2], k[3]),
        max_theta_deg=section.number("max_theta_deg", "180" if sees_ball else None),
        rotation_wxyz=section.numbers("rotation_wxyz", 4, "1, 0, 0, 0"),
        rolloff=(rolloff[0], rolloff[1], rolloff[2]),
        mask=_mask(section),
    )
    where = f"camera: {section.path}: [{section.name}]"
    if not 0 < lens.max_theta_deg <= 180 or min(lens.focal_px) <= 0 or not any(lens.rotation_wxyz):
        raise CameraError(f"{where} expected 0 < max_theta_deg ≤ 180, fx_px, fy_px > 0, a rotation")
    steps = np.linspace(0, np.radians(lens.max_theta_deg), _THETA_STEPS)
    if np.any(np.diff(lens.radius(steps)) <= 0):
        raise CameraError(f"{where} k1…k4: the radius stops growing before {lens.max_theta_deg}°")
    return lens


def _mask(section: _Section) -> NDArray[np.uint8] | None:
    name = section.text("mask", "")
    if not name:
        return None
    path = section.path.parent / name
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if mask is None:
        raise CameraError(
            f"camera: {section.path}: [{section.name}] mask {path}: not a readable PGM"
        )
    return np.asarray(mask, dtype=np.uint8)


def _stuck_pixels(section: _Section) -> Array:
    name = section.text("stuck_pixels", "")
    if not name:
        return np.empty((0, 2))
    path, size = (
        section.path.parent / name,
        (section.number("width_px"), section.number("height_px")),
    )
    try:
        rows = np.loadtxt(path, dtype=np.float64, ndmin=2).reshape(-1, 2)
    except (OSError, ValueError) as error:
        raise CameraError(f"camera: {path}: stuck pixels: {error}") from None
    if np.any(rows < 0) or np.any(rows >= size):
        raise CameraError(f"camera: {path}: expected rows x y within width_px × height_px")
    return rows


def _response(section: _Section) -> Array:
    return read_table(section.path.parent / section.config.get("response", "table"))


def read_table(path: Path) -> Array:
    """Read a response table (256, 3), the last row of green = 1; raises :class:`CameraError`."""
    try:
        table = np.loadtxt(path, dtype=np.float64)
    except (OSError, ValueError) as error:
        raise CameraError(f"camera: {path}: response table: {error}") from None
    if table.shape != (256, 3) or np.any(np.diff(table, axis=0) < 0):
        raise CameraError(f"camera: {path}: expected 256 rows r g b whose values never decrease")
    if table[255, 1] <= 0:
        raise CameraError(
            f"camera: {path}: the last value of green is the scale, and must be above 0"
        )
    return np.asarray(table / table[255, 1])
