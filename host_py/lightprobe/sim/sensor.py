"""A camera's sensor: radiance × exposure → electrons → noise → saturation → ADC → 8-bit codes.

Fast enough for video because photon and read noise are added where they are one and the same: in
the variance-stabilised domain v = 2·√(S + σ²) (Anscombe 1948; S electrons, σ read noise) the noise
of every pixel has sigma 1, whatever its brightness. So the noise is a stored field at a random
offset, and everything after it (saturation, ADC, response) is one table look-up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.colour import srgb_table
from lightprobe.geometry import Array

Value = TypeVar("Value", np.uint8, np.float32)
Codes = NDArray[np.uint8]
Expected = NDArray[np.int16]

#: Steps of the int16 domain per sigma of noise: fine enough that rounding adds no noise.
_STEPS_PER_SIGMA = 64
#: The noise field is this much larger than a frame; offsets are drawn from it.
_MARGIN_PX = 256
#: Headroom above full scale, in electrons' share, that is kept before saturation cuts it off.
_HEADROOM = 1.2
#: Rows of a picture that are computed at a time: what is at work stays in the cache.
_ROWS = 32
#: What a sensor may be: more electrons do not fit into the int16 domain.
FULL_WELL_E, READ_NOISE_E = (100.0, 50000.0), (0.0, 50.0)
CHROMA = ("420", "422", "444")


@dataclass(frozen=True)
class SensorModel:
    """What the silicon does. Radiance 1.0 fills the well in one second at gain 1."""

    full_well_e: float = 12000.0
    read_noise_e: float = 3.0
    adc_bits: int = 12


class Sensor:
    """Frames of one sensor; the same seed and frame number give the same noise."""

    def __init__(
        self,
        width_px: int,
        height_px: int,
        model: SensorModel | None = None,
        response: Array | None = None,
        seed: int = 0,
    ) -> None:
        """`response`: linear light (256, 3) of each code; None: sRGB."""
        self.model = model or SensorModel()
        self.size_px = (width_px, height_px)
        self._response = np.repeat(srgb_table()[:, None], 3, 1) if response is None else response
        self.seed = seed
        self._noise = _noise_field(width_px, height_px, seed)
        self._tables: dict[float, NDArray[np.uint8]] = {}
        self._response_codes: NDArray[np.uint8] | None = None

    def expect(
        self, radiance: NDArray[np.float32], exposure_us: float, gain: float = 1.0
    ) -> Expected:
        """Give the noiseless signal (H, W, 3) in the stabilised domain; reuse it while it lasts."""
        model = self.model
        full_e = model.full_well_e / gain
        expected = np.empty(radiance.shape, np.int16)
        for top in range(0, len(radiance), _ROWS):
            rows = slice(top, top + _ROWS)
            electrons = radiance[rows] * np.float32(1e-6 * exposure_us * model.full_well_e)
            np.minimum(electrons, np.float32(_HEADROOM * full_e), out=electrons)
            electrons += np.float32(model.read_noise_e**2)
            np.sqrt(electrons, out=electrons)
            electrons *= np.float32(2 * _STEPS_PER_SIGMA)
            expected[rows] = np.rint(electrons, out=electrons)
        return expected

    def develop(self, expected: Expected, frame: int, gain: float = 1.0, turn_px: int = 0) -> Codes:
        """One noisy 8-bit RGB frame (H, W, 3); `turn_px` rolls the picture to the right."""
        return self._look_up(expected, frame, turn_px, self._table(gain))

    def linear(
        self,
        expected: Expected,
        frame: int,
        gain: float = 1.0,
        turn_px: int = 0,
        balance: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> NDArray[np.float32]:
        """Give the same frame before the response: linear light (H, W, 3), full scale = 1.

        `balance`: factors of R, G, B, before full scale cuts off. :meth:`respond` goes on.
        """
        table = np.stack([self._linear_table(gain, factor) for factor in balance], axis=-1)
        return self._look_up(expected, frame, turn_px, table.astype(np.float32)[None])

    def respond(self, linear: NDArray[np.float32]) -> Codes:
        """Codes (H, W, 3) of linear light, full scale = 1."""
        if self._response_codes is None:
            steps = np.linspace(0, 1, 65536)
            self._response_codes = self._codes(steps)[None]
        levels = np.rint(np.clip(linear, 0, 1) * np.float32(65535)).astype(np.uint16)
        return np.asarray(cv2.LUT(levels, self._response_codes), dtype=np.uint8)

    def _look_up(
        self, expected: Expected, frame: int, turn_px: int, table: NDArray[Value]
    ) -> NDArray[Value]:
        """Add a frame's noise and look the sum up in a table (1, 65536, 1 or 3)."""
        height, width, _ = expected.shape
        y, x = np.random.default_rng([self.seed, frame]).integers(0, _MARGIN_PX, 2)
        noise = self._noise[y : y + height, x : x + width]
        turn_px %= width
        cut = width - turn_px  # columns up to here go to the right part
        codes = np.empty(expected.shape, table.dtype)
        channels = table.shape[-1]
        for top in range(0, height, _ROWS):
            signal, random = expected[top : top + _ROWS], noise[top : top + _ROWS]
            noisy = np.empty_like(signal)
            cv2.add(signal[:, :cut], random[:, turn_px:], dst=noisy[:, turn_px:])
            if turn_px:
                cv2.add(signal[:, cut:], random[:, :turn_px], dst=noisy[:, :turn_px])
            flat = (len(signal), -1, channels)
            cv2.LUT(
                noisy.view(np.uint16).reshape(flat), table,
                dst=codes[top : top + _ROWS].reshape(flat),
            )  # fmt: skip
        return codes

    def capture(
        self, radiance: NDArray[np.float32], exposure_us: float, frame: int = 0, gain: float = 1.0
    ) -> Codes:
        """Expose and develop at once."""
        return self.develop(self.expect(radiance, exposure_us, gain), frame, gain)

    def _table(self, gain: float) -> NDArray[np.uint8]:
        """Codes (1, 65536, 3) of the stabilised domain: saturation, ADC, response.

        (1, 65536, 1) where all colours have the same response: a picture is looked up sooner.
        """
        if gain not in self._tables:
            self._tables[gain] = self._codes(self._linear_table(gain))[None]
        return self._tables[gain]

    def _linear_table(self, gain: float, factor: float = 1.0) -> Array:
        """Linear light (65536,) of the stabilised domain: white balance, saturation, ADC."""
        model = self.model
        v = np.arange(65536, dtype=np.uint16).view(np.int16) / _STEPS_PER_SIGMA
        # E[(v + n)²]/4 = S + σ² + ¼ for noise of sigma 1; below v = 0 there is no signal.
        electrons = np.maximum(v, 0) ** 2 / 4 - model.read_noise_e**2 - 0.25
        levels = 2**model.adc_bits - 1
        linear = np.clip(electrons * gain * factor / model.full_well_e, 0, 1)
        return np.asarray(np.rint(linear * levels) / levels)

    def _codes(self, linear: Array) -> Codes:
        """Codes (N, 3) of linear light (N,); (N, 1) where all colours respond alike."""
        response = self._response
        kinds = range(1 if np.all(response == response[:, :1]) else 3)
        codes = [np.interp(linear, response[:, c], np.arange(256)) for c in kinds]
        return np.rint(np.stack(codes, axis=-1)).astype(np.uint8)


@lru_cache(maxsize=3)
def _noise_field(width_px: int, height_px: int, seed: int) -> Expected:
    """Noise of a sensor, larger than its frames; the last ones are kept, as they take long."""
    shape = (height_px + _MARGIN_PX, width_px + _MARGIN_PX, 3)
    field = np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)
    noise = np.rint(field * _STEPS_PER_SIGMA).astype(np.int16)
    noise.setflags(write=False)
    return noise


def encode_jpeg(codes: Codes, quality: int = 85, chroma: str = "420") -> bytes:
    """JPEG as a UVC camera sends it; `chroma` 420, 422 or 444."""
    sampling = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{chroma}")
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(codes, cv2.COLOR_RGB2BGR), options)
    assert done  # 8-bit RGB of any size that a sensor has
    return data.tobytes()
