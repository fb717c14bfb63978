"""The simulated camera: the world at a time, through lens and sensor, as bytes of a frame."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.exposure import ExposureLimits, bracket_us, median_luminance
from lightprobe.sim.moved import Canvas
from lightprobe.sim.scene import Layers
from lightprobe.sim.sensor import Codes, Expected, Sensor, SensorModel, encode_jpeg
from lightprobe.sim.world import Rows, State, World

Pixel = TypeVar("Pixel", np.float32, np.int16)
#: Radiance (H, W, 3), and S1, S2 (2, H, W, 3) or None for unpolarized light.
Composed = tuple[NDArray[np.float32], NDArray[np.float32] | None]

FORMATS = ("MJPG", "YUYV", "NV12", "GREY", "RGBF")
#: Noiseless signals kept: a bracket of the scene before and after a lamp is switched.
_CACHED = 12
#: Pictures kept, where any are: of so many exposures and states of the world.
_KEPT_KINDS = 12
#: A hand before the lens: share of the mean light that passes through it, and the width of its rim
#: (1 is a radian).
_HAND_GLOW, _HAND_RIM = np.array([0.03, 0.015, 0.01], np.float32), 0.2
#: Pictures that are looked up, not rolled, are the mean of moments so many pixels apart.
_SMEAR_STEP_PX, _MOST_SMEAR_STEPS = 2, 16


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
        # Equirectangular pictures turn by whole pixels, unless they nod. What is not simply turned
        # is looked up in a map finer than the picture.
        simple = lens.is_whole and not world.behaviour.nod_deg
        self._map_px = size_px if simple else (2 * size_px[0], size_px[0])
        self._rays = None if simple else _Rays(lens, size_px, self._map_px)
        # All of it now: a camera does not pause when the scene changes.
        self._layers = [scene.render(*self._map_px) for scene in world.scenes]
        self.sheet = sheet
        self._hand: NDArray[np.float32] | None = None  # (H, W, 1): share of each pixel covered
        self.white_balance = white_balance
        polarized = not all(layers.unpolarized for layers in self._layers)
        if sheet and polarized and world.behaviour.nod_deg:
            raise UsageError("camera: polarized light cannot be simulated while the camera nods")
        seen = polarized or len(stack_deg) > 0 or (sheet is not None and sheet.index > 1)
        self._polarizer = Polarizer(sheet, lens, size_px) if sheet and seen else None
        self._stack_deg = tuple(stack_deg)
        self._medians: dict[int, float] = {}
        self._composed: tuple[Hashable, Composed] | None = None
        self._canvas = Canvas()  # what moves before the map
        self._walked: tuple[Hashable, Layers] | None = None
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
        turns = rows.offset_deg.any() or rows.nod_offset_deg.any()
        same = not turns and np.all(rows.powers == state.powers)
        return None if same else rows

    def automatic(self, frame: int, count: int = 1) -> list[Shot]:
        """Exposures that the camera would choose by itself: a bracket around the scene's median.

        All are within :attr:`limits`.
        """
        state = self.world.at(self.begin_s(frame))
        if state.act not in self._medians:
            radiance = self._layers[state.act].compose(np.ones(len(state.scene.lamps)))
            self._medians[state.act] = max(self.gain * median_luminance(radiance), 1e-9)
        exposures_us = bracket_us(self._medians[state.act], count)
        scale = min(1.0, self.limits.most_us / exposures_us[0])
        return [Shot(self.limits.nearest(scale * us)) for us in exposures_us]

    @property
    def gain(self) -> float:
        """Share of unpolarized light that reaches the lens, on its axis."""
        if self._polarizer is not None and self._stack_deg:
            grey = np.ones((self.size_px[1], self.size_px[0], 1), np.float32)
            behind = self._polarizer.through_stack(grey, None, self._stack_deg)
            return float(behind[self.size_px[1] // 2, self.size_px[0] // 2, 0])
        return self.sheet.unpolarized_gain if self.sheet else 1.0

    def frame(self, number: int, shot: Shot, wheel_deg: tuple[float, ...] = (0.0,)) -> bytes:
        """Payload of frame `number`; `wheel_deg`: angles of the polarizer while it was exposed."""
        state = self.state(number, shot)
        rows = self._rows(state, shot)
        if self.pixel_format == "RGBF" or state.is_covered:
            radiance = self._turned(self._radiance(state, wheel_deg, rows), state, rows)
            if state.is_covered:
                radiance = self._behind_a_hand(radiance)
            if self.pixel_format == "RGBF":
                return radiance.tobytes()
            codes = self.sensor.capture(radiance, shot.exposure_us, number, shot.gain)
            return encode(codes, self.pixel_format, self.quality, self.chroma)
        key = self._key(state, shot, wheel_deg, rows)
        turn_px = 0 if self._turns_first(state) else self._turn_px(state)
        which = (key, turn_px, number % self._kept) if self._kept and rows is None else None
        picture = self._pictures.get(which)
        if picture is None:
            signal = self._signal(key, state, shot, wheel_deg, rows)
            codes = self.sensor.develop(signal, number, shot.gain, turn_px)
            picture = encode(codes, self.pixel_format, self.quality, self.chroma)
        if which is not None:
            self._keep(which, picture)
        return picture

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
            right = self.lens.look(*self.size_px)[0][..., :1]
            self._hand = np.clip(0.5 + right / _HAND_RIM, 0, 1).astype(np.float32)
        glow = np.float32(radiance.mean()) * _HAND_GLOW
        return np.asarray(radiance + self._hand * (glow - radiance), dtype=np.float32)

    def true_yaw_deg(self, state: State) -> float:
        """Yaw of the picture: equirectangular ones turn by whole pixels."""
        if self._rays is not None:
            return state.yaw_deg
        return round(state.yaw_deg / 360 * self.size_px[0]) * 360 / self.size_px[0]

    def _turn_px(self, state: State) -> int:
        return 0 if self._rays else round(state.yaw_deg / 360 * self.size_px[0])

    def _shift_px(self, state: State, rows: Rows) -> NDArray[np.int64]:
        """Columns (H,) by which each row is turned more than the middle one."""
        turn_px = np.rint((state.yaw_deg + rows.offset_deg) / 360 * self.size_px[0])
        return np.asarray(turn_px.astype(np.int64) - self._turn_px(state))

    def _layers_of(self, state: State) -> Layers:
        """Maps of the scene from where the probe is; while it walks only the last are kept."""
        if not self.world.behaviour.walk_m:
            return self._layers[state.act]
        key = (state.act, state.place_m)
        if self._walked is None or self._walked[0] != key:
            self._walked = (key, state.scene.render(*self._map_px))
        return self._walked[1]

    def _through_film(self, state: State) -> bool:
        """Tell whether a film does more to the picture than to dim it all alike."""
        if self._polarizer is None:
            return False
        ideal = self._polarizer.sheet.index == 1 and not self._stack_deg
        return not (ideal and self._layers_of(state).unpolarized)

    def sees_wheel(self, state: State) -> bool:
        """Tell whether the wheel's angle shapes the picture.

        Where an ideal film sees nothing that is polarized it does not.
        """
        return self._through_film(state) and not self._stack_deg

    def _turns_first(self, state: State) -> bool:
        """Tell whether :meth:`_radiance` is turned already: what the polarizer sees must be."""
        return self._rays is not None or self._through_film(state)

    def _compose(self, state: State, rows: Rows | None) -> Composed:
        """Light of the whole sphere, unturned; the last one of equal rows is kept.

        Rows of equirectangular pictures are those of the map; for others see :class:`_Rays`.
        """
        by_row = rows is not None and self._rays is None
        powers = rows.powers if rows is not None and by_row else state.powers
        key = (state.act, state.place_m, powers.tobytes())
        if self._composed is None or self._composed[0] != key:
            layers, polarized = self._layers_of(state), None
            if self._through_film(state) and not layers.unpolarized:
                polarized = layers.compose_polarized(powers)
            self._composed = (key, (layers.compose(powers), polarized))
        return self._canvas.show(*self._composed[1], state)

    def _smear_px(self, state: State) -> int:
        """Columns of an equirectangular picture over which a point wanders; 1: it does not."""
        return 2 * round(state.smear_deg / 720 * self.size_px[0]) + 1

    def _radiance(
        self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) at the sensor, mean over the exposure; see :meth:`_turns_first`."""
        smear_px = self._smear_px(state)
        if self._rays is None:  # the mean of turned columns is that of columns, turned
            return self._still(state, wheel_deg, rows, smear_px)
        nod_px = abs(state.nod_smear_deg) / 360 * self.size_px[0]
        steps = min(math.ceil(max(smear_px, nod_px) / _SMEAR_STEP_PX), _MOST_SMEAR_STEPS)
        total = np.zeros((self.size_px[1], self.size_px[0], 3), np.float32)
        for k in range(steps):
            part = (k + 0.5) / steps - 0.5
            yaw_deg = state.yaw_deg + part * state.smear_deg
            nod_deg = state.nod_deg + part * state.nod_smear_deg
            moment = replace(state, yaw_deg=yaw_deg, nod_deg=nod_deg)
            total += self._still(moment, wheel_deg, rows)
        return total / np.float32(steps)

    def _still(
        self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None, smear_px: int = 1
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) at one moment; turned when :meth:`_turns_first`.

        `smear_px`: of equirectangular pictures the mean over so many columns, an odd number.
        """
        radiance, polarized = self._compose(state, rows)
        if self._rays is not None:
            radiance, polarized = self._through_lens(radiance, polarized, state, rows)
        else:
            radiance = _smeared(radiance, smear_px)
        if self._rays is None and self._through_film(state):
            turn_px = self._turn_px(state)
            shift_px = np.zeros(1, np.int64) if rows is None else self._shift_px(state, rows)
            radiance = _rolled(radiance, turn_px + shift_px)
            parts = () if polarized is None else polarized
            turned = [_rolled(_smeared(part, smear_px), turn_px + shift_px) for part in parts]
            polarized = np.stack(turned) if turned else None
        if self._polarizer is not None and self._stack_deg:
            return self._polarizer.through_stack(radiance, polarized, self._stack_deg)
        if self._polarizer is not None:
            return self._polarizer.through(radiance, polarized, wheel_deg)
        return radiance if self.sheet is None else np.float32(self.gain) * radiance

    def _through_lens(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        state: State,
        rows: Rows | None,
    ) -> Composed:
        """What the lenses see of a map, each row at its own yaw and with its own lamps."""
        assert self._rays is not None
        rays, still = self._rays, np.zeros(1)
        yaw_deg = state.yaw_deg + (still if rows is None else rows.offset_deg)
        places = rays.turned(state.nod_deg + (still if rows is None else rows.nod_offset_deg))
        seen = places.sample(radiance, yaw_deg)
        parts = None
        if polarized is not None:
            parts = np.stack([places.sample(part, yaw_deg) for part in polarized])
        if rows is None or np.all(rows.powers == state.powers):
            return seen, parts
        layers = self._layers_of(state)
        for k, more in enumerate((rows.powers - state.powers).T):
            alone = (np.arange(len(state.powers)) == k).astype(np.float32)
            by_row = more.astype(np.float32)[:, None, None]
            seen += by_row * places.sample(self._canvas.hide(layers.compose_lamps(alone)), yaw_deg)
            if parts is not None and layers.lamps[k].polarized is not None:
                lamp = layers.compose_polarized(alone) - layers.compose_polarized(0 * alone)
                hidden = [self._canvas.hide(part) for part in lamp]
                parts += by_row * np.stack([places.sample(part, yaw_deg) for part in hidden])
        return seen, parts

    def _turned(
        self, radiance: NDArray[np.float32], state: State, rows: Rows | None
    ) -> NDArray[np.float32]:
        if self._turns_first(state):
            return radiance.astype("<f4")
        shift_px = np.zeros(1, np.int64) if rows is None else self._shift_px(state, rows)
        return _rolled(radiance, self._turn_px(state) + shift_px).astype("<f4")

    def _key(
        self, state: State, shot: Shot, wheel_deg: tuple[float, ...], rows: Rows | None
    ) -> Hashable:
        """All that shapes :meth:`_signal`."""
        turned = self._turns_first(state)
        yaw = self._turn_px(state) if self._rays is None else state.yaw_deg
        return (
            state.act, state.place_m, state.powers.tobytes(), shot, yaw if turned else None,
            state.movers,
            self._smear_px(state), state.nod_deg, state.nod_smear_deg,
            wheel_deg if self._through_film(state) else None,
            None if rows is None else rows.powers.tobytes(),
            rows.offset_deg.tobytes() if turned and rows is not None else None,
            rows.nod_offset_deg.tobytes() if rows is not None else None,
            self.white_balance,
        )  # fmt: skip

    def _signal(
        self,
        key: Hashable,
        state: State,
        shot: Shot,
        wheel_deg: tuple[float, ...],
        rows: Rows | None,
    ) -> Expected:
        """Noiseless signal, from the cache while all that shapes it (`key`) stays the same.

        Where :meth:`_turns_first` is false it still wants the middle row's turn.
        """
        signal = self._signals.get(key)
        if signal is None:
            radiance = self._radiance(state, wheel_deg, rows)
            if self.white_balance != (1.0, 1.0, 1.0):
                radiance = radiance * np.asarray(self.white_balance, np.float32)
            signal = self.sensor.expect(radiance, shot.exposure_us, shot.gain)
            self._signals[key] = signal
            if len(self._signals) > _CACHED:
                self._signals.popitem(last=False)
        self._signals.move_to_end(key)
        return (
            signal
            if self._turns_first(state) or rows is None
            else _rolled(signal, self._shift_px(state, rows))
        )


def _rolled(picture: NDArray[Pixel], shift_px: NDArray[np.int64]) -> NDArray[Pixel]:
    """Roll rows to the right, each by its own number of columns, or all by one (1,)."""
    if len(shift_px) == 1:
        return np.roll(picture, shift_px[0], axis=1)
    rolled = np.empty_like(picture)
    first = np.concatenate([[0], np.flatnonzero(np.diff(shift_px)) + 1, [len(shift_px)]])
    for start, end in pairwise(first):  # neighbours mostly move alike
        rolled[start:end] = np.roll(picture[start:end], shift_px[start], axis=1)
    return rolled


def _smeared(radiance: NDArray[np.float32], smear_px: int) -> NDArray[np.float32]:
    """Mean over `smear_px` columns, an odd number, of an equirectangular map."""
    if smear_px == 1:
        return radiance
    side = smear_px // 2
    padded = cv2.copyMakeBorder(radiance, 0, 0, side, side, cv2.BORDER_WRAP)
    mean = cv2.blur(padded, (smear_px, 1))
    return np.asarray(mean[:, side : side + radiance.shape[1]], dtype=np.float32)


class _Rays:
    """Resamples an equirectangular map to what lenses see."""

    def __init__(self, lens: Camera, size_px: tuple[int, int], map_px: tuple[int, int]) -> None:
        directions, illumination = lens.look(*size_px)
        seen = illumination > 0
        directions = np.where(seen[..., None], directions, [0.0, 0, -1])
        self._directions = np.moveaxis(directions, -1, 0).astype(np.float32)  # (3, H, W)
        self._map_px = map_px
        self._illumination = np.repeat((illumination * seen).astype(np.float32)[..., None], 3, -1)
        self._level = self._places(self._directions)

    def _places(self, directions: NDArray[np.float32]) -> _Places:
        """As :func:`lightprobe.geometry.equirect_pixel` has it, in single precision."""
        (x, up, back), (width_px, height_px) = directions, self._map_px
        longitude, theta = np.arctan2(x, -back), np.arctan2(np.hypot(x, back), up)
        column = longitude * np.float32(width_px / (2 * np.pi)) + np.float32((width_px - 1) / 2)
        row = theta * np.float32(height_px / np.pi) - np.float32(0.5)
        return _Places(column, row, self._illumination, width_px)

    def turned(self, nod_deg: Array) -> _Places:
        """Where the rays end while the camera looks up; `nod_deg`: of each of H rows, or (1,)."""
        if not nod_deg.any():
            return self._level
        x, y, z = self._directions
        nod = np.radians(nod_deg)[:, None]
        cosine, sine = np.cos(nod).astype(np.float32), np.sin(nod).astype(np.float32)
        return self._places(np.stack([x, y * cosine - z * sine, y * sine + z * cosine]))


@dataclass(frozen=True, eq=False)
class _Places:
    """Where rays (H, W) end in an equirectangular map."""

    column: NDArray[np.float32]
    row: NDArray[np.float32]
    illumination: NDArray[np.float32]  # (H, W, 3)
    width_px: int  # of the map

    def sample(self, radiance: NDArray[np.float32], yaw_deg: Array) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind the lenses, roll-off included, of a map turned to the right.

        `yaw_deg`: of each of the H rows, or (1,) of all.
        """
        padded = cv2.copyMakeBorder(radiance, 0, 0, 1, 1, cv2.BORDER_WRAP)
        shift = (yaw_deg[:, None] / 360 * self.width_px) % self.width_px - 1  # -1: padded
        column = self.column - shift.astype(np.float32)
        np.add(column, np.float32(self.width_px), out=column, where=column < 1)
        seen = cv2.remap(
            padded, column, self.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(np.multiply(seen, self.illumination, out=seen), dtype=np.float32)


def encode(codes: Codes, pixel_format: str, quality: int, chroma: str) -> bytes:
    """8-bit RGB (H, W, 3) as the bytes of a camera's format; BT.601, full range."""
    if pixel_format == "MJPG":
        return encode_jpeg(codes, quality, chroma)
    planes = cv2.cvtColor(codes, cv2.COLOR_RGB2YCrCb)
    luma, cr, cb = planes[..., 0], planes[..., 1], planes[..., 2]
    if pixel_format == "GREY":
        return luma.tobytes()
    height, width = luma.shape
    if pixel_format == "YUYV":
        packed = np.empty((height, width, 2), np.uint8)
        packed[..., 0] = luma
        for offset, plane in enumerate((cb, cr)):
            packed[:, offset::2, 1] = cv2.resize(
                plane, (width // 2, height), interpolation=cv2.INTER_AREA
            )
        return packed.tobytes()
    half = (width // 2, height // 2)
    mixed = [cv2.resize(plane, half, interpolation=cv2.INTER_AREA) for plane in (cb, cr)]
    return luma.tobytes() + np.stack(mixed, axis=-1).tobytes()
