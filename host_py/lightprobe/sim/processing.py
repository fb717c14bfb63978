"""What a real camera does to its pictures by itself: `simulate --processing`.

In the order of a camera's chain: white balance, noise reduction, stitching and local tone mapping
work on linear light between sensor and response; saturation and sharpening on codes after it; and
the rate control on the file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import UsageError
from lightprobe.imaging.camera import Camera
from lightprobe.sim.faults import Spell, fault
from lightprobe.sim.formats import encode
from lightprobe.sim.pixel_defects import PlacedDefects
from lightprobe.sim.sensor import Codes, Expected, Sensor

if TYPE_CHECKING:
    from lightprobe.sim.camera import Shot

Linear = NDArray[np.float32]
Factors = tuple[float, float, float]

#: Luminance of linear light, and luma of codes (BT.709, BT.601).
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
#: The picture in which tone mapping looks at regions is no wider, and it sees nothing darker.
_TONE_PX, _TONE_FLOOR = 240, 1e-3
#: Stops off the middle at which tone mapping does three quarters of what it does at most.
_TONE_STOPS = 2.0
#: Temporal noise reduction takes a larger difference than so many sigmas of noise for motion.
_MOTION_SIGMAS = 3.0
#: Two lenses are blended within so many degrees of the seam, to each side; what is doubled there
#: is bent back over twice as many more.
_SEAM_DEG = 4.0
_LEAST_QUALITY, _QUALITY_DOWN, _QUALITY_UP = 5, 5, 1
#: Automatic white balance leaves out what is nearly clipped or nearly black.
_BALANCE_LOW, _BALANCE_HIGH = 0.02, 0.9


@dataclass(frozen=True)
class Processing(Spell):
    """Options of `simulate --processing`; by default the camera leaves its pictures alone."""

    _what: ClassVar[str] = "processing"

    exposure_tear: float = fault(
        0.0, "share of the rows that still have the exposure of the frame before", 0, 1
    )
    white_drift: float = fault(
        0.0, "white balance swings: red by so much up, blue down, and back", 0, 0.15
    )
    white_drift_s: float = fault(20.0, "seconds of each swing", 0.1)
    white_adapt: float = fault(
        0.0, "share of a colour cast that automatic white balance removes", 0, 1
    )
    white_adapt_s: float = fault(2.0, "seconds in which it does most of that", 0.01)
    denoise: float = fault(
        0.0, "spatial noise reduction: a bilateral filter over so many sigmas of noise", 0, 100
    )
    denoise_px: int = fault(2, "radius of it", 1, 10)
    denoise_time: float = fault(
        0.0, "temporal noise reduction: share of the last picture where nothing moves", 0, 0.98
    )
    stitch_gain: float = fault(
        0.0, "the lens ahead is so much brighter than the one behind, relative", 0, 0.5
    )
    stitch_deg: float = fault(
        0.0, "near things are doubled by this angle where the lenses meet", 0, 8
    )
    tone_ev: float = fault(
        0.0, "local tone mapping: dark regions are so many stops brighter, bright ones darker", 0, 4
    )
    tone_deg: float = fault(15.0, "size of such regions, 1 sigma", 1, 90)
    tone_aim: float = fault(
        0.0, "share of full scale that regions come nearer to; 0: the picture's own mean", 0, 1
    )
    saturation: float = fault(1.0, "factor on how colourful codes are; 0: grey", 0, 3)
    sharpen: float = fault(0.0, "unsharp mask: share of the difference to a blur", 0, 5)
    sharpen_px: float = fault(1.3, "blur of it, 1 sigma", 0.3, 20)
    jpeg_kb: float = fault(
        0.0, "no picture is larger, in kB of 1000 bytes: its quality falls; 0: any size"
    )
    from_s: float = fault(0.0, "seconds until all this begins")
    to_s: float = fault(0.0, "seconds until it ends; 0: never")

    @property
    def is_none(self) -> bool:
        """Tell whether it never does anything."""
        return self.saturation == 1 and not any((
            self.exposure_tear, self.white_drift, self.white_adapt, self.denoise,
            self.denoise_time, self.stitch_gain, self.stitch_deg, self.tone_ev, self.sharpen,
            self.jpeg_kb,
        ))  # fmt: skip


class Developer:
    """Makes pictures of what a sensor saw, one after the other: it remembers the last."""

    def __init__(
        self,
        processing: Processing,
        sensor: Sensor,
        lens: Camera,
        pixel_format: str,
        quality: int,
        chroma: str,
        pixels: PlacedDefects | None = None,
    ) -> None:
        """Raise UsageError for what such a camera has not; `pixels`: its sensor's defects."""
        p = processing
        if pixel_format == "RGBF" and not p.is_none:
            raise UsageError("processing: RGBF has no sensor: take another --format")
        if pixel_format != "MJPG" and p.jpeg_kb:
            raise UsageError(f"processing: jpeg_kb: {pixel_format} has no quality: take MJPG")
        if not lens.is_whole and (p.stitch_gain or p.stitch_deg):
            raise UsageError(f"processing: {lens.name} is not stitched: take --camera equirect")
        self.processing, self.sensor, self._pixels = processing, sensor, pixels
        self._format, self._quality, self._chroma = pixel_format, quality, chroma
        self._shot: Shot | None = None
        self._last: Linear | None = None  # picture, in sigmas of noise
        self._cast = np.zeros(2)  # logarithm of what red and blue are multiplied by
        self._cast_s: float | None = None  # when that was so
        self._now_quality = quality

    def torn_from(self, shot: Shot, t_s: float) -> tuple[Shot, int] | None:
        """Exposure of the first rows, and how many they are; None: all have that of the frame."""
        last, self._shot = self._shot, shot
        p = self.processing
        if last is None or last == shot or not (p.exposure_tear and p.is_on(t_s)):
            return None
        same_gain = replace(shot, exposure_us=last.exposure_us * last.gain / shot.gain)
        return same_gain, round(p.exposure_tear * self.sensor.size_px[1])

    def picture(self, signal: Expected, frame: int, shot: Shot, turn_px: int, t_s: float) -> bytes:
        """Payload of a frame; arguments as of :meth:`Sensor.develop`, `t_s`: the world's time."""
        pixels, seen_us = self._pixels, shot.exposure_us * shot.gain
        if not self.processing.is_on(t_s):
            self._last, self._now_quality = None, self._quality
            codes = self.sensor.develop(signal, frame, shot.gain, turn_px)
            if pixels is not None:
                codes = pixels.spoil(codes, seen_us, t_s)
            return encode(codes, self._format, self._quality, self._chroma)
        balance = self.balance(t_s)
        linear = self.sensor.linear(signal, frame, shot.gain, turn_px, balance)
        if pixels is not None:
            linear = pixels.spoil_linear(linear, seen_us, t_s)
        self._adapt(linear, balance, t_s)
        codes = self.sensor.respond(self._on_linear(linear, shot.gain))
        return self._encoded(self._on_codes(codes))

    def balance(self, t_s: float) -> Factors:
        """White balance at a time: factors of R, G, B."""
        p = self.processing
        swing = p.white_drift * np.sin(2 * np.pi * t_s / p.white_drift_s)
        red, blue = np.exp(self._cast)
        return float(red * (1 + swing)), 1.0, float(blue * (1 - swing))

    def _adapt(self, linear: Linear, balance: Factors, t_s: float) -> None:
        """Take grey for the mean of all colours, from the next picture on."""
        p = self.processing
        if not p.white_adapt:
            return
        brightest = linear.max(axis=-1)
        counts = (brightest < _BALANCE_HIGH) & (brightest > _BALANCE_LOW)
        since_s = t_s - (t_s if self._cast_s is None else self._cast_s)
        self._cast_s = t_s
        if not counts.any() or since_s <= 0:
            return
        red, green, blue = np.maximum(linear[counts].mean(axis=0) / balance, 1e-6)
        aim = p.white_adapt * np.log([green / red, green / blue])
        self._cast += (1 - np.exp(-since_s / p.white_adapt_s)) * (aim - self._cast)

    def _on_linear(self, linear: Linear, gain: float) -> Linear:
        p = self.processing
        if p.denoise or p.denoise_time:
            linear = self._quiet(linear, gain)
        if p.stitch_gain or p.stitch_deg:
            linear = stitched(linear, p.stitch_gain, p.stitch_deg)
        if p.tone_ev:
            linear = tone_mapped(linear, p.tone_ev, p.tone_deg, p.tone_aim)
        return linear

    def _on_codes(self, codes: Codes) -> Codes:
        p = self.processing
        if p.saturation != 1:
            codes = saturated(codes, p.saturation)
        if p.sharpen:
            codes = sharpened(codes, p.sharpen, p.sharpen_px)
        return codes

    def _quiet(self, linear: Linear, gain: float) -> Linear:
        """Reduce noise, where its sigma is 1 (see :mod:`lightprobe.sim.sensor`)."""
        p, model = self.processing, self.sensor.model
        full_e, read_e = np.float32(model.full_well_e / gain), np.float32(model.read_noise_e)
        v = 2 * np.sqrt(linear * full_e + read_e**2)
        if p.denoise:
            diameter = 2 * p.denoise_px + 1
            v = np.asarray(cv2.bilateralFilter(v, diameter, p.denoise, float(p.denoise_px)))
        if p.denoise_time:
            if self._last is not None:
                change = np.abs(v - self._last).max(axis=-1, keepdims=True)
                share = p.denoise_time * np.exp(-0.5 * (change / _MOTION_SIGMAS) ** 2)
                v = v + share * (self._last - v)
            self._last = v
        quiet = np.clip((v**2 / 4 - read_e**2) / full_e, 0, 1)
        return np.asarray(np.where(linear < 1, quiet, 1), dtype=np.float32)

    def _encoded(self, codes: Codes) -> bytes:
        """Encode; where a size is promised, as well as that allows."""
        most = 1000 * self.processing.jpeg_kb
        if not most:
            return encode(codes, self._format, self._quality, self._chroma)
        quality = min(self._now_quality + _QUALITY_UP, self._quality)
        payload = encode(codes, self._format, quality, self._chroma)
        while len(payload) > most and quality > _LEAST_QUALITY:
            quality = max(quality - _QUALITY_DOWN, _LEAST_QUALITY)
            payload = encode(codes, self._format, quality, self._chroma)
        self._now_quality = quality
        return payload


def stitched(linear: Linear, gain: float, doubled_deg: float) -> Linear:
    """Panorama (H, W, 3) of two lenses, ahead and behind, that differ by a gain and in place.

    Near things are seen `doubled_deg` apart where the lenses meet. What is clipped stays so.
    """
    width = linear.shape[1]
    longitude_deg = ((np.arange(width) + 0.5) / width - 0.5) * 360
    ahead = np.clip((90 + _SEAM_DEG - np.abs(longitude_deg)) / (2 * _SEAM_DEG), 0, 1)
    factor = (1 + gain * (ahead - 0.5)).astype(np.float32)[:, None]
    seen = linear
    if doubled_deg:
        # The lens ahead sees what is near farther back, and the one behind farther ahead.
        off_deg = np.abs(np.abs(longitude_deg) - 90)
        bent = np.clip((3 * _SEAM_DEG - off_deg) / (2 * _SEAM_DEG), 0, 1)
        outward_px = doubled_deg / 2 / 360 * width * bent * np.sign(longitude_deg)
        share = ahead.astype(np.float32)[:, None]
        seen = share * _columns(linear, -outward_px)
        seen += (1 - share) * _columns(linear, outward_px)
    return np.asarray(np.where(seen < 1, seen * factor, 1), dtype=np.float32)


def _columns(picture: Linear, shift_px: NDArray[np.float64]) -> Linear:
    """Look up each column of a panorama so many columns (W,) farther to the right."""
    width = picture.shape[1]
    place = np.arange(width) + shift_px
    left = np.floor(place).astype(int)
    part = (place - left).astype(np.float32)[:, None]
    found = picture[:, left % width] * (1 - part) + picture[:, (left + 1) % width] * part
    return np.asarray(found, dtype=np.float32)


def tone_mapped(linear: Linear, most_ev: float, region_deg: float, aim: float = 0.0) -> Linear:
    """Change the exposure of regions (H, W, 3) towards an aim; black and white stay.

    `aim`: share of full scale; 0: the mean of the picture's logarithms. Dark parts of a region that
    is `_TONE_STOPS` darker get 0.76 of `most_ev`.
    """
    height, width, _ = linear.shape
    scale = min(1.0, _TONE_PX / width)
    small = (max(round(width * scale), 1), max(round(height * scale), 1))
    base = np.log2(np.maximum(linear @ _LUMINANCE, _TONE_FLOOR))
    base = cv2.resize(base, small, interpolation=cv2.INTER_AREA)
    sigma_px = region_deg / 360 * small[0]
    side = min(int(np.ceil(3 * sigma_px)), small[0] - 1)
    padded = cv2.copyMakeBorder(base, 0, 0, side, side, cv2.BORDER_WRAP)
    blurred = cv2.GaussianBlur(padded, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    wide = cv2.resize(blurred[:, side : side + small[0]], (width, height))
    middle = np.log2(aim) if aim else base.mean()
    stops = most_ev * np.tanh((middle - wide) / _TONE_STOPS)
    factor = np.exp2(stops).astype(np.float32)[..., None]
    return np.asarray(factor * linear / (1 + (factor - 1) * linear), dtype=np.float32)


def sharpened(codes: Codes, amount: float, radius_px: float) -> Codes:
    """Unsharp mask of luma (H, W, 3); colours keep their differences."""
    luma = codes.astype(np.float32) @ _LUMA
    more = amount * (luma - cv2.GaussianBlur(luma, (0, 0), radius_px))
    return _as_codes(codes + more[..., None])


def saturated(codes: Codes, factor: float) -> Codes:
    """Colours (H, W, 3) so much farther from grey of their luma."""
    luma = (codes.astype(np.float32) @ _LUMA)[..., None]
    return _as_codes(luma + factor * (codes - luma))


def _as_codes(values: NDArray[Any]) -> Codes:
    return np.asarray(np.rint(np.clip(values, 0, 255)), dtype=np.uint8)
