"""The simulated camera: the world at a time, through lens and sensor, as bytes of a frame."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.sim.exposure import ExposureLimits, bracket_us, median_luminance
from lightprobe.sim.formats import encode
from lightprobe.sim.lens_defects import DefectiveLens, LensDefects
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Developer, Processing
from lightprobe.sim.rays import rolled
from lightprobe.sim.sensor import Expected, Sensor, SensorModel
from lightprobe.sim.view import View
from lightprobe.sim.world import Rows, State, World

#: Noiseless signals kept: a bracket of the scene before and after a lamp is switched.
_CACHED = 12
#: Pictures kept, where any are: of so many exposures and states of the world.
_KEPT_KINDS = 12
#: A hand before the lens: share of the mean light that passes through it, and the width of its rim
#: (1 is a radian).
_HAND_GLOW, _HAND_RIM = np.array([0.03, 0.015, 0.01], np.float32), 0.2


@dataclass(frozen=True)
class Shot:
    """How one frame is to be exposed."""

    exposure_us: float
    gain: float = 1.0


def check_row_time(row_time_us: float, size_px: tuple[int, int], rate_hz: float) -> None:
    """Raise UsageError when a frame's last row would begin after the next frame's first."""
    most_us = 1e6 / rate_hz / size_px[1]
    if not 0 <= row_time_us <= most_us:
        raise UsageError(
            f"camera: {row_time_us:g} µs for each of {size_px[1]} rows at {rate_hz:g} frames per "
            f"second: expected 0…{most_us:.3g} µs"
        )


class SimulatedCamera:
    """Frames of a world; frame n shows the world until (n + 1) / rate seconds, always the same."""

    def __init__(
        self,
        world: World,
        lens: Camera,
        size_px: tuple[int, int],
        *,
        rate_hz: float = 30.0,
        pixel_format: str = "MJPG",
        quality: int = 85,
        chroma: str = "420",
        seed: int = 0,
        model: SensorModel | None = None,
        sheet: Sheet | None = None,
        stack_deg: Sequence[float] = (),
        response: Array | None = None,
        limits: ExposureLimits | None = None,
        row_time_us: float = 0.0,
        phase_s: float = 0.0,
        white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0),
        kept: int = 0,
        processing: Processing | None = None,
        lens_defects: LensDefects | None = None,
        pixels: PixelDefects | None = None,
    ) -> None:
        """`size_px` (width, height), both even for YUYV and NV12; `sheet`: of a polarizer;
        `stack_deg`: several of them one behind the other, the outermost first, instead of a wheel.

        `response`: linear light (256, 3) of each code; None: as the camera file of the lens says.
        `limits`: of exposures at any frame rate; None: those of :class:`ExposureLimits`.
        `row_time_us`: by which each row's exposure begins later than that of the row above.
        `phase_s`: by which each frame is read later than at (n + 1) / rate.
        `white_balance`: factors of R, G, B; 1: as D65 lights a white wall.
        `kept`: while nothing changes, so many pictures come again and again, noise and all, and are
        drawn and encoded only once: for rates that this machine is too slow for; 0: all are new.
        `processing`: what the camera does to its pictures; then none are kept.
        `lens_defects`: what its lens does.
        `pixels`: of its sensor, that are not as the others; not of RGBF.
        """
        self.world, self.lens, self.size_px = world, lens, size_px
        self.rate_hz, self.pixel_format = rate_hz, pixel_format
        self.limits = (limits or ExposureLimits()).at(rate_hz)
        self.row_time_us, self.phase_s = row_time_us, phase_s
        check_row_time(row_time_us, size_px, rate_hz)
        # From the start of the middle row's exposure to that of each row's.
        rows = np.arange(size_px[1], dtype=np.float64)
        self._rows_s = 1e-6 * row_time_us * (rows - rows.mean())
        self.quality, self.chroma = quality, chroma
        self.sensor = Sensor(
            *size_px, model, lens.response_table() if response is None else response, seed
        )
        self.sheet = sheet
        self._hand: NDArray[np.float32] | None = None  # (H, W, 1): share of each pixel covered
        self.white_balance = white_balance
        well_e = self.sensor.model.full_well_e
        table = lens.response_table() if response is None else response
        self._pixels = pixels.at(size_px, well_e, table) if pixels else None
        self._developer: Developer | None = None
        if processing is not None and not processing.is_none:
            self._developer = Developer(
                processing, self.sensor, lens, pixel_format, quality, chroma, self._pixels
            )
        self._lens_defects: DefectiveLens | None = None
        if lens_defects is not None and not lens_defects.is_perfect:
            self._lens_defects = DefectiveLens(lens_defects, lens, size_px, seed)
        self._view = View(
            world, lens, size_px, sheet, stack_deg, seen_turned=self._lens_defects is not None
        )
        self._medians: dict[int, float] = {}
        self._signals: OrderedDict[Hashable, Expected] = OrderedDict()
        self._kept, self._pictures = kept, OrderedDict[Hashable, bytes]()

    def state(self, frame: int, shot: Shot) -> State:
        """State of the world while the middle row of frame `frame` is exposed."""
        start_s = self.start_s(frame, shot) - float(self._rows_s[0])
        return self.world.at(start_s, 1e-6 * shot.exposure_us)

    def begin_s(self, frame: int) -> float:
        """Seconds from the world's start to when its exposure is chosen and may begin."""
        return frame / self.rate_hz + self.phase_s

    def read_s(self, frame: int) -> float:
        """Seconds from the world's start to when the first row has been exposed and is read.

        Sensors read regularly, and begin to expose as much before as the exposure asks for.
        """
        return self.begin_s(frame + 1)

    def start_s(self, frame: int, shot: Shot) -> float:
        """Seconds from the world's start to that of the first row's exposure."""
        return self.read_s(frame) - 1e-6 * shot.exposure_us

    def _rows(self, state: State, shot: Shot) -> Rows | None:
        """What each row saw; None: all the same as the middle one."""
        if not self.row_time_us:
            return None
        rows = self.world.rows(state, self._rows_s, 1e-6 * shot.exposure_us)
        same = not rows.turns and np.all(rows.powers == state.powers)
        return None if same else rows

    def automatic(self, frame: int, count: int = 1) -> list[Shot]:
        """Exposures that the camera would choose by itself: a bracket around the scene's median.

        All are within :attr:`limits`.
        """
        state = self.world.at(self.begin_s(frame))
        if state.act not in self._medians:
            median = self.gain * median_luminance(self._view.lit(state))
            self._medians[state.act] = max(median, 1e-9)
        exposures_us = bracket_us(self._medians[state.act], count)
        scale = min(1.0, self.limits.most_us / exposures_us[0])
        return [Shot(self.limits.nearest(scale * us)) for us in exposures_us]

    @property
    def gain(self) -> float:
        """Share of unpolarized light that reaches the lens, on its axis."""
        return self._view.gain

    def frame(self, number: int, shot: Shot, wheel_deg: tuple[float, ...] = (0.0,)) -> bytes:
        """Payload of frame `number`; `wheel_deg`: angles of the polarizer while it was exposed."""
        state = self.state(number, shot)
        rows = self._rows(state, shot)
        if self.pixel_format == "RGBF" or state.is_covered:
            radiance = self._view.turned(self._view.radiance(state, wheel_deg, rows), state, rows)
            if state.is_covered:
                radiance = self._behind_a_hand(radiance)
            radiance = self._through_defects(radiance, state)
            if self.pixel_format == "RGBF":
                return radiance.tobytes()
            signal = self.sensor.expect(self._balanced(radiance), shot.exposure_us, shot.gain)
            return self._developed(signal, number, shot, 0, state)
        key = self._key(state, shot, wheel_deg, rows)
        turn_px = self._view.turn_px(state)
        keeps = self._kept and rows is None and self._developer is None and not self._pixels
        which = (key, turn_px, number % self._kept) if keeps else None
        picture = self._pictures.get(which)
        if picture is None:
            signal = self._signal(key, state, shot, wheel_deg, rows)
            torn = self._developer.torn_from(shot, state.t_s) if self._developer else None
            if torn is not None:
                first, count = torn
                first_key = self._key(state, first, wheel_deg, rows)
                above = self._signal(first_key, state, first, wheel_deg, rows)
                signal = np.concatenate([above[:count], signal[count:]])
            picture = self._developed(signal, number, shot, turn_px, state)
        if which is not None:
            self._keep(which, picture)
        return picture

    def _developed(
        self, signal: Expected, number: int, shot: Shot, turn_px: int, state: State
    ) -> bytes:
        if self._developer is not None:
            return self._developer.picture(signal, number, shot, turn_px, state.t_s)
        codes = self.sensor.develop(signal, number, shot.gain, turn_px)
        if self._pixels is not None:
            seen_us = shot.exposure_us * shot.gain
            codes = self._pixels.spoil(codes, seen_us, self.start_s(number, shot))
        return encode(codes, self.pixel_format, self.quality, self.chroma)

    def _through_defects(self, radiance: NDArray[np.float32], state: State) -> NDArray[np.float32]:
        """What reaches the sensor of a turned picture (H, W, 3)."""
        if self._lens_defects is None or not self._lens_defects.defects.is_on(state.t_s):
            return radiance
        return self._lens_defects.through(radiance)

    def _keep(self, which: Hashable, picture: bytes) -> None:
        self._pictures[which] = picture
        self._pictures.move_to_end(which)
        if len(self._pictures) > _KEPT_KINDS * self._kept:
            self._pictures.popitem(last=False)

    def _behind_a_hand(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Radiance (H, W, 3) when a hand covers what looks to the right.

        So near the lens its rim is soft, and it glows red by the light that passes through it.
        """
        if self._hand is None:
            right = np.nan_to_num(self.lens.look(*self.size_px)[0][..., :1])  # NaN: sees nothing
            self._hand = np.clip(0.5 + right / _HAND_RIM, 0, 1).astype(np.float32)
        glow = np.float32(radiance.mean()) * _HAND_GLOW
        return np.asarray(radiance + self._hand * (glow - radiance), dtype=np.float32)

    def true_rotation(self, state: State) -> Array:
        """Rotation of the picture, camera to scene: what only turns does so by whole pixels."""
        return self._view.true_rotation(state)

    def sees_wheel(self, state: State) -> bool:
        """Tell whether the wheel's angle shapes the picture.

        Where an ideal film sees nothing that is polarized it does not.
        """
        return self._view.sees_wheel(state)

    def _balanced(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        if self.white_balance == (1.0, 1.0, 1.0):
            return radiance
        return radiance * np.asarray(self.white_balance, np.float32)

    def _key(
        self, state: State, shot: Shot, wheel_deg: tuple[float, ...], rows: Rows | None
    ) -> Hashable:
        """All that shapes :meth:`_signal`."""
        defects = self._lens_defects
        is_on = defects is not None and defects.defects.is_on(state.t_s)
        return (self._view.key(state, wheel_deg, rows), shot, self.white_balance, is_on)

    def _signal(
        self,
        key: Hashable,
        state: State,
        shot: Shot,
        wheel_deg: tuple[float, ...],
        rows: Rows | None,
    ) -> Expected:
        """Noiseless signal, from the cache while all that shapes it (`key`) stays the same.

        Where :meth:`View.turns_first` is false it still wants the middle row's turn.
        """
        signal = self._signals.get(key)
        if signal is None:
            radiance = self._through_defects(self._view.radiance(state, wheel_deg, rows), state)
            radiance = self._balanced(radiance)
            signal = self.sensor.expect(radiance, shot.exposure_us, shot.gain)
            self._signals[key] = signal
            if len(self._signals) > _CACHED:
                self._signals.popitem(last=False)
        self._signals.move_to_end(key)
        return (
            signal
            if self._view.turns_first(state) or rows is None
            else rolled(signal, self._view.shift_px(state, rows))
        )
