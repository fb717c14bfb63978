"""What a picture file says of itself: Exif, XMP, and Google's photo sphere metadata in it.

The daemon reads the same from JPEGs (drivers/source/photo.c).
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from PIL import Image

from lightprobe.imaging import colour_space
from lightprobe.imaging.colour_space import Space

_ORIENTATION, _EXIF_IFD = 0x0112, 0x8769
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827
#: APEX: exponents of 2.
_SHUTTER_SPEED, _APERTURE = 0x9201, 0x9202
#: Above what _ISO can say: recommended exposure index, ISO speed, standard output sensitivity.
_WIDE_ISO, _ISO_BEYOND = (0x8832, 0x8833, 0x8831), 65535
_BASE_ISO = 100
#: Crops that leave out less than this of the sphere's sides leave out nothing.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Crop:
    """The part of an equirectangular picture of the whole sphere, in fractions of it."""

    left: float
    top: float
    width: float
    height: float


#: All of the sphere.
WHOLE = Crop(0, 0, 1, 1)


@dataclass(frozen=True)
class Metadata:
    """None: the file does not say."""

    exposure_us: float | None = None  # times ISO / 100
    f_number: float | None = None
    orientation: int = 1  # 1: as it is stored
    crop: Crop | None = None
    fault: str = ""  # why the part of the sphere cannot be used
    #: Of its colours; as it should be: sRGB.
    space: Space = Space()  # noqa: RUF009 - frozen


def read(path: Path) -> Metadata:
    """Read what the file says; nothing of a file that Pillow cannot read, or that is no file."""
    if not path.is_file():  # a pipe would be waited for
        return Metadata()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged metadata
            with open(path, "rb") as file, Image.open(path) as picture:
                return replace(_read(picture), space=colour_space.read(file, picture))
    except (OSError, SyntaxError, ValueError, TypeError, KeyError, Image.DecompressionBombError):
        return Metadata()


def _read(picture: Image.Image) -> Metadata:
    exif = picture.getexif()
    xmp = picture.info.get("xmp", b"")
    xmp = xmp.decode(errors="replace") if isinstance(xmp, bytes) else str(xmp)
    camera = _of_exif(exif.get_ifd(_EXIF_IFD))
    if camera.exposure_us is None:  # Exif counts more
        camera = _of_xmp(xmp)
    orientation = int(
        _number(exif.get(_ORIENTATION)) or _number(_text(xmp, "tiff:Orientation")) or 1
    )
    crop, fault = _crop(xmp)
    return replace(
        camera,
        orientation=orientation if 1 <= orientation <= 8 else 1,
        crop=crop,
        fault=fault,
    )


def _of_exif(exif: Mapping[int, Any]) -> Metadata:
    iso = _number(_first(exif.get(_ISO)))
    if iso is None or iso == _ISO_BEYOND:
        iso = next(filter(None, (_number(_first(exif.get(tag))) for tag in _WIDE_ISO)), iso)
    return _exposed(
        _number(exif.get(_EXPOSURE_TIME)) or _apex(exif.get(_SHUTTER_SPEED), -1),
        _number(exif.get(_F_NUMBER)) or _apex(exif.get(_APERTURE), 0.5),
        iso,
    )


def _of_xmp(xmp: str) -> Metadata:
    def fraction(name: str) -> float | None:
        above, _, below = _text(xmp, name).partition("/")
        try:
            return float(above) / float(below or 1)
        except (ValueError, ZeroDivisionError):
            return None

    iso = _text(xmp, "exif:ISOSpeedRatings") or _text(xmp, "exifEX:PhotographicSensitivity")
    return _exposed(
        _number(fraction("exif:ExposureTime")) or _apex(fraction("exif:ShutterSpeedValue"), -1),
        _number(fraction("exif:FNumber")) or _apex(fraction("exif:ApertureValue"), 0.5),
        _number(iso),
    )


def _exposed(exposure_s: float | None, f_number: float | None, iso: float | None) -> Metadata:
    if exposure_s is None:
        return Metadata()
    return Metadata(1e6 * exposure_s * (iso or _BASE_ISO) / _BASE_ISO, f_number)


def _first(value: object) -> object:
    return value[0] if isinstance(value, tuple) and value else value


def _apex(value: object, factor: float) -> float | None:
    """Give 2 to the value's power times `factor`, or None."""
    try:
        return _number(2 ** (factor * float(value)))  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None


def _text(xmp: str, name: str) -> str:
    """Give the value of an XMP property, of a list its first item; empty: it is not there."""
    found = re.search(rf"""{name}[\s=>"']+(?:<[^/>]*>\s*)*([^\s<>"']+)""", xmp)
    return found[1] if found else ""


def exposures_us(pictures: list[Metadata]) -> list[float]:
    """Exposures of one bracket, relative to the first picture's aperture; empty: not all say."""
    known = [picture.exposure_us for picture in pictures if picture.exposure_us]
    if len(known) != len(pictures):
        return []
    first = next((picture.f_number for picture in pictures if picture.f_number), None)
    return [
        exposure * (first / picture.f_number) ** 2 if first and picture.f_number else exposure
        for exposure, picture in zip(known, pictures, strict=True)
    ]


def _number(value: object) -> float | None:
    """Give a number above 0, or None."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None


def crop_of(
    left: float, top: float, width: float, height: float, full_width: float, full_height: float
) -> Crop | None:
    """Give a part of a whole picture of full_width x full_height; None: it makes no sense.

    It may reach across the seam.
    """
    most = 1 + _ROUNDING
    across = 0 <= left < full_width and 1 <= width <= most * full_width
    if not (across and top >= 0 and height >= 1 and top + height <= most * full_height):
        return None
    return Crop(left / full_width, top / full_height, width / full_width, height / full_height)


def _crop(xmp: str) -> tuple[Crop | None, str]:
    if "/photos/1.0/panorama/" not in xmp:
        return None, ""
    projection = re.search(r""":ProjectionType[\s=>"']+(\w+)""", xmp)
    if projection and projection[1] != "equirectangular":
        return None, f"GPano: projection {projection[1]}: expected equirectangular"
    names = ("CroppedAreaLeft", "CroppedAreaTop", "CroppedAreaImageWidth", "CroppedAreaImageHeight",
             "FullPanoWidth", "FullPanoHeight")  # fmt: skip
    found = [re.search(rf""":{name}Pixels[\s=>"']+(-?[\d.]+)""", xmp) for name in names]
    if not found[4] and not found[5]:
        return None, ""
    crop = crop_of(*(float(match[1]) if match else math.nan for match in found))
    return crop, "" if crop else "GPano: the part of the sphere that it names makes no sense"
