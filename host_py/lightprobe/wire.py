"""The wire: delimited protobuf to typed values and back. The one module that sees generated code.

Nothing received is trusted: a message that is too long, does not parse, or holds numbers that make
no sense raises :class:`WireError`, and the connection it came from is not worth keeping.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, Literal, get_args

import numpy as np
from google.protobuf.message import DecodeError
from lightprobe_proto import lightprobe_pb2 as pb
from numpy.typing import ArrayLike

from lightprobe import drawn
from lightprobe.errors import UsageError
from lightprobe.estimate import (
    Estimate,
    EstimateFlag,
    Fault,
    Frame,
    Health,
    Hello,
    Kind,
    Light,
    LightFlag,
    PolarizationMap,
    Pong,
    Refusal,
    Ring,
    Room,
    SphericalHarmonics,
    StillsAsked,
    SweepStarted,
    Wheel,
)
from lightprobe.geometry import Array
from lightprobe.ranges import broken
from lightprobe.reflection_map import SIZES, ReflectionMap, decode_rgb9e5

PROTOCOL_MAJOR = 1
#: From this minor version on, estimates carry the number of the subscription that they answer.
MINOR_WITH_NUMBERS = 1
#: From this one on, it answers pings and takes poses.
MINOR_WITH_PINGS = 3
#: From this one on, it answers requests for polarization maps and sweeps.
MINOR_WITH_POLARIZATION = 4
#: From this one on, it answers requests for stills.
MINOR_WITH_STILLS = 5
#: Code of a Refusal in place of a Hello: the token is missing or wrong (EACCES).
TOKEN_REFUSED = -13
#: A reflection map of 64 texels has 96 KiB, a polarization map 57, all else less than 2; the rest
#: is room to grow.
MAX_MESSAGE_BYTES = 128 * 1024

Message = (
    Hello
    | Estimate
    | Health
    | Refusal
    | Pong
    | ReflectionMap
    | PolarizationMap
    | SweepStarted
    | StillsAsked
)


_KINDS: dict[int, Kind] = {1: "AMBIENT", 2: "TOTAL"}
_FRAMES: dict[int, Frame] = {0: "PROBE", 1: "WORLD"}


class WireError(Exception):
    """Bytes that are no message of lightprobe.v1."""


class SubscriptionError(UsageError, ValueError):
    """A subscription that no probe could serve; names the field and what it may be."""


class _Default(int):
    """A number that the user has not said: another one where `draws` is said."""


@dataclass(frozen=True)
class Subscription:
    """What a client wants; the newest subscription holds.

    Raises :class:`SubscriptionError` for a value out of range, before anything is sent.
    """

    rate_hz: float = 0.0  # most estimates a second, up to 1000; 0: every one
    sh_order: int = _Default(2)  # highest order wanted, 0…4
    max_lights: int = _Default(4)  # 0…8
    kind: Kind = "AMBIENT"
    tolerance: float = 0.0  # smallest model with a predicted error below this share; 0: the largest
    smoothing: Literal["SMOOTHED", "RAW"] = "SMOOTHED"
    health_period_ms: int = 1000  # 0: no health messages
    #: While nothing changes by more than the tolerance (at least 0.004), estimates come this far
    #: apart, and last so much longer; what is new comes at once. Up to 60000; 0: all come.
    quiet_ms: int = 0
    frame: Frame = "PROBE"  # WORLD: of the app that sends poses, where known; see Estimate.frame
    key_light: bool = False  # one more directional light, KEY, for what the listed lights leave
    area_lights: bool = False  # windows, soft boxes and the like are listed, too, one ellipse each
    leave_out_reflections: bool = False  # do not list mirror images; their light stays in the SH
    #: Texels along an edge of reflection maps: 16, 32 or 64, or what the probe has, if that is
    #: less; 0: none. A probe sends them only if it was started with --reflection-map.
    reflection_map_size: int = _Default(0)
    reflection_map_rate_hz: float = 5.0  # most maps a second, up to 30
    reflection_map_kind: Kind = "TOTAL"  # a mirror shows the lamps
    #: What the app draws, of drawn.THINGS, and the most error of each (0.02: 2 %). Then the probe
    #: chooses the least that suffices; `sh_order` (4 then), `max_lights` (8) and the reflection map
    #: (64, if it may be needed) are upper bounds, and Estimate.drawn is the error to expect.
    draws: Mapping[str, float] | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        """Check every field."""
        if self.draws is not None:
            self._by_what_is_drawn(self.draws)
        self._check_number("rate_hz", 1000, "estimates a second (0: every one)")
        self._check_number("tolerance", 1, "as a share of the mean irradiance: 0.05 is 5 %")
        self._check_whole("sh_order", 4)
        self._check_whole("max_lights", 8)
        self._check_whole("health_period_ms", 2**32 - 1)
        self._check_whole("quiet_ms", 60000)
        self._check_word("kind", get_args(Kind))
        self._check_word("smoothing", ("SMOOTHED", "RAW"))
        self._check_word("frame", get_args(Frame))
        self._check_number("reflection_map_rate_hz", 30, "maps a second (0: 5)")
        self._check_word("reflection_map_kind", get_args(Kind))
        if self.reflection_map_size not in (0, *SIZES):
            raise SubscriptionError(
                f"subscription: reflection_map_size = {self.reflection_map_size!r}: expected 16, "
                "32 or 64, or 0 for none"
            )

    def _by_what_is_drawn(self, draws: Mapping[str, float]) -> None:
        if (wrong := drawn.check(draws)) is not None:
            raise SubscriptionError(f"subscription: {wrong}")
        map_ = drawn.MOST_MAP if drawn.is_mirrored(draws) else 0
        for name, most in (
            ("sh_order", drawn.MOST_ORDER),
            ("max_lights", drawn.MOST_LIGHTS),
            ("reflection_map_size", map_),
        ):
            if isinstance(getattr(self, name), _Default):
                object.__setattr__(self, name, most)

    def _check_number(self, name: str, most: float, unit: str) -> None:
        value = getattr(self, name)
        if not (isinstance(value, Real) and 0 <= float(value) <= most):  # NaN fails too
            raise SubscriptionError(f"subscription: {name} = {value!r}: expected 0…{most} {unit}")

    def _check_whole(self, name: str, most: int) -> None:
        value = getattr(self, name)
        if not (isinstance(value, Integral) and 0 <= int(value) <= most):
            raise SubscriptionError(
                f"subscription: {name} = {value!r}: expected a whole number, 0…{most}"
            )

    def _check_word(self, name: str, known: tuple[str, ...]) -> None:
        value = getattr(self, name)
        if value not in known:
            raise SubscriptionError(
                f"subscription: {name} = {value!r}: expected {' or '.join(known)}"
            )


def delimit(payload: bytes) -> bytes:
    """Put the length before a message, as a base-128 varint."""
    length, prefix = len(payload), bytearray()
    while length > 0x7F:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    return bytes(prefix) + payload


def encode_subscription(subscription: Subscription, number: int = 0) -> bytes:
    """Delimited FromClient message; `number` comes back with every estimate that answers it."""
    message = pb.FromClient()
    wish = message.subscribe
    wish.rate_hz = float(subscription.rate_hz)
    wish.sh_order = int(subscription.sh_order)
    wish.max_lights = int(subscription.max_lights)
    wish.kind = pb.SphericalHarmonics.Kind.Value(subscription.kind)
    wish.tolerance_permille = round(1000 * subscription.tolerance)
    wish.smoothing = pb.Subscription.Smoothing.Value(subscription.smoothing)
    wish.health_period_ms = int(subscription.health_period_ms)
    wish.quiet_ms = int(subscription.quiet_ms)
    wish.key_light = subscription.key_light
    wish.area_lights = subscription.area_lights
    wish.number = number
    wish.leave_out_reflections = bool(subscription.leave_out_reflections)
    wish.frame = pb.Estimate.Frame.Value(subscription.frame)
    if subscription.draws is not None:
        drawn.write(subscription.draws, wish.draws)
    if subscription.reflection_map_size or subscription.draws is not None:
        wish.reflection_map.size = int(subscription.reflection_map_size)
        wish.reflection_map.rate_hz = float(subscription.reflection_map_rate_hz)
        wish.reflection_map.kind = pb.SphericalHarmonics.Kind.Value(
            subscription.reflection_map_kind
        )
    return delimit(message.SerializeToString())


class PoseError(UsageError, ValueError):
    """A head pose that is none; says what it may be."""


def encode_pose(
    orientation: ArrayLike,
    time_ns: int,
    sigma_deg: float | None = None,
    position_m: ArrayLike | None = None,
    position_sigma_m: float | None = None,
) -> bytes:
    """Delimited FromClient message: how the head is turned at a time of the client's clock.

    `orientation`: unit quaternion x, y, z, w that turns the head's frame into the app's world.
    `position_m` (3,): where the head is in that world. Raises :class:`PoseError` for what is none.
    """
    message = pb.FromClient()
    quaternion = np.asarray(orientation, dtype=np.float64)
    if quaternion.shape != (4,) or not abs(float(quaternion @ quaternion) - 1) < 0.02:
        raise PoseError(
            f"pose: orientation = {orientation!r}: expected a unit quaternion x, y, z, w"
        )
    if sigma_deg is not None and not 0 < sigma_deg < np.inf:
        raise PoseError(f"pose: sigma_deg = {sigma_deg!r}: expected degrees above 0, or None")
    message.pose.time_ns = int(time_ns)
    message.pose.orientation.extend(quaternion.tolist())
    if sigma_deg is not None:
        message.pose.sigma_deg = sigma_deg
    if position_m is not None:
        message.pose.position.extend(_position_m(position_m))
    if position_sigma_m is not None:
        if not 0 < position_sigma_m < np.inf:
            raise PoseError(
                f"pose: position_sigma_m = {position_sigma_m!r}: expected metres above 0, or None"
            )
        message.pose.position_sigma_m = position_sigma_m
    return delimit(message.SerializeToString())


def _position_m(position_m: ArrayLike) -> list[float]:
    position = np.asarray(position_m, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise PoseError(f"pose: position_m = {position_m!r}: expected x, y, z in metres, or None")
    return [float(x) for x in position]


def encode_ping(time_ns: int, pong_time_ns: int | None = None) -> bytes:
    """Delimited FromClient message; `pong_time_ns`: when the last answer came, if one has."""
    message = pb.FromClient()
    message.ping.time_ns = time_ns
    if pong_time_ns is not None:
        message.ping.pong_time_ns = pong_time_ns
    return delimit(message.SerializeToString())


def encode_get_polarization_map() -> bytes:
    """Delimited FromClient message: one PolarizationMap is wanted."""
    message = pb.FromClient()
    message.get_polarization_map.SetInParent()
    return delimit(message.SerializeToString())


def encode_start_sweep() -> bytes:
    """Delimited FromClient message: the polarizer is to visit all its angles now."""
    message = pb.FromClient()
    message.start_sweep.SetInParent()
    return delimit(message.SerializeToString())


def encode_take_stills() -> bytes:
    """Delimited FromClient message: cameras for stills are to take a set now."""
    message = pb.FromClient()
    message.take_stills.SetInParent()
    return delimit(message.SerializeToString())


class Decoder:
    """Bytes in, messages out, in whatever pieces they arrive."""

    def __init__(self, max_bytes: int = MAX_MESSAGE_BYTES) -> None:
        """Start empty; a message may be `max_bytes` long."""
        self._buffer = bytearray()
        self._max_bytes = max_bytes

    def feed(self, data: bytes) -> list[Message]:
        """Take bytes; give the messages that are now whole. Kinds newer than us are skipped."""
        decoded = (decode(payload) for payload in self.payloads(data))
        return [message for message in decoded if message is not None]

    def payloads(self, data: bytes) -> Iterator[bytes]:
        """Take bytes; give the messages that are now whole, not decoded, without their length."""
        self._buffer += data
        while (payload := self._take()) is not None:
            yield payload

    def _take(self) -> bytes | None:
        """Remove one whole payload from the buffer; None when there is none yet."""
        length, start = 0, 0
        while True:
            if start == len(self._buffer):
                return None
            byte = self._buffer[start]
            length |= (byte & 0x7F) << 7 * start
            start += 1
            if length > self._max_bytes or start > 4:
                raise WireError(f"message of {length} bytes: at most {self._max_bytes}")
            if byte < 0x80:
                break
        if len(self._buffer) - start < length:
            return None
        payload = bytes(self._buffer[start : start + length])
        del self._buffer[: start + length]
        return payload


def decode(payload: bytes) -> Message | None:
    """One FromProbe message; None when it is of a kind newer than this client."""
    message = pb.FromProbe()
    try:
        message.ParseFromString(payload)
    except DecodeError as error:
        raise WireError(f"no FromProbe message: {error}") from None
    if (sentence := broken(message)) is not None:
        raise WireError(sentence)
    kind = message.WhichOneof("message")
    if kind == "hello":
        return _hello(message.hello)
    if kind == "estimate":
        return _estimate(message.estimate)
    if kind == "health":
        return _health(message.health)
    if kind == "pong":
        pong = message.pong
        return Pong(pong.ping_time_ns, pong.received_unix_ns, pong.sent_unix_ns)
    if kind == "reflection_map":
        return _reflection_map(message.reflection_map)
    if kind == "polarization_map":
        return _polarization_map(message.polarization_map)
    if kind == "sweep_started":
        return SweepStarted(message.sweep_started.done_at)
    if kind == "stills_asked":
        return StillsAsked(message.stills_asked.cameras)
    if kind == "error":
        return Refusal(message.error.code, message.error.text)
    return None


def _hello(m: pb.Hello) -> Hello:
    fields = {name: getattr(m, name) for name in Hello.__dataclass_fields__}
    return Hello(**fields | {"processing": tuple(m.processing)})


def _health(m: pb.Health) -> Health:
    plain = set(Health.__dataclass_fields__) - {"source_state", "faults", "wheel", "ring"}
    return Health(
        source_state=_name(pb.Health.SourceState, m.source_state),
        faults=tuple(Fault(fault.id, fault.text) for fault in m.faults),
        wheel=_wheel(m.wheel) if m.HasField("wheel") else None,
        ring=_ring(m.ring) if m.HasField("ring") else None,
        **{name: getattr(m, name) for name in plain},
    )


def _name(kind: Any, number: int) -> str:
    """Name of an enumeration's value; UNKNOWN for one of the future."""
    return str(kind.Name(number)) if int(number) in kind.values() else "UNKNOWN"


def _wheel(m: pb.Wheel) -> Wheel:
    def known(name: str) -> float | None:
        return float(getattr(m, name)) if m.HasField(name) else None

    return Wheel(
        phase=_name(pb.Wheel.Phase, m.phase),
        commanded_deg=known("commanded_deg"),
        measured_deg=known("measured_deg"),
        sigma_deg=known("sigma_deg"),
        moves=m.moves,
        frames_stamped=m.frames_stamped,
        frames_moving=m.frames_moving,
        frames_unknown=m.frames_unknown,
        clock_sigma_us=known("clock_sigma_us"),
        reconnects=m.reconnects,
        sweeps=m.sweeps,
    )


def _polarization_map(m: pb.PolarizationMap) -> PolarizationMap:
    cells = np.frombuffer(m.cells, "<f2").reshape(m.height, m.width, 4).astype(np.float64)
    if np.isinf(cells).any() or (cells[..., 0] < 0).any():
        raise WireError("polarization map: infinite numbers, or negative light")
    s0, q, u, sigma = np.moveaxis(cells, -1, 0)
    return PolarizationMap(m.capture_time_unix_ns, m.s0_unit * s0, q, u, sigma, m.sweeps)


def _ring(m: pb.Ring) -> Ring:
    lux = tuple(float(value) if np.isfinite(value) else None for value in m.illuminance_lux)
    return Ring(lux, m.samples_per_s, m.samples, m.samples_lost)


def _estimate(m: pb.Estimate) -> Estimate:
    return Estimate(
        sequence=m.sequence,
        boot_id=m.boot_id,
        capture_time_unix_ns=m.capture_time_unix_ns,
        send_delay_us=m.send_delay_us,
        ttl_ms=m.ttl_ms,
        flags=EstimateFlag(m.flags),
        lights=tuple(_light(light) for light in m.lights),
        sh=_sh(m.sh),
        predicted_error=(
            m.predicted_error_permille / 1000 if m.HasField("predicted_error_permille") else None
        ),
        exposure_us=float(m.exposure_us) if m.HasField("exposure_us") else None,
        exposure_count=m.exposure_count,
        cd_m2_per_unit=m.cd_m2_per_unit if m.HasField("cd_m2_per_unit") else None,
        wheel_deg=m.wheel_deg if m.HasField("wheel_deg") else None,
        wheel_sigma_deg=m.wheel_sigma_deg if m.HasField("wheel_sigma_deg") else None,
        relighting_sigma=(
            m.relighting_sigma_permille / 1000 if m.HasField("relighting_sigma_permille") else None
        ),
        cd_m2_per_unit_sigma=(
            m.cd_m2_per_unit_sigma_permille / 1000
            if m.HasField("cd_m2_per_unit_sigma_permille")
            else None
        ),
        subscription=m.subscription,
        frame=_FRAMES[m.frame],
        orientation=_unit(m.orientation) if m.orientation else None,
        position_m=np.array(m.position) if m.position else None,
        orientation_sigma_deg=(
            m.orientation_sigma_deg if m.HasField("orientation_sigma_deg") else None
        ),
        drawn=drawn.read(m.drawn) if m.HasField("drawn") else None,
        key=_light(m.key) if m.HasField("key") else None,
        scale_sigma=(m.scale_sigma_permille / 1000 if m.HasField("scale_sigma_permille") else None),
        room=_room(m.room) if m.HasField("room") else None,
    )


def fill_room(m: pb.Room, room: Room) -> None:
    """Write a room into a message."""
    m.walls_m.extend(room.walls_m.tolist())
    m.walls_sigma_m.extend(room.walls_sigma_m.tolist())
    m.orientation.extend(room.orientation.tolist())
    m.error_permille_per_m = math.ceil(1000 * room.error_per_m)


def _room(m: pb.Room) -> Room:
    return Room(
        walls_m=np.array(m.walls_m, dtype=np.float64),
        walls_sigma_m=np.array(m.walls_sigma_m, dtype=np.float64),
        orientation=_unit(m.orientation),
        error_per_m=m.error_permille_per_m / 1000,
    )


def _reflection_map(m: pb.ReflectionMap) -> ReflectionMap:
    return ReflectionMap(
        sequence=m.sequence,
        boot_id=m.boot_id,
        capture_time_unix_ns=m.capture_time_unix_ns,
        subscription=m.subscription,
        kind=_KINDS[m.kind],
        radiance=decode_rgb9e5(m.texels, m.scale).reshape(6, m.size, m.size, 3),
        orientation=_unit(m.orientation) if m.orientation else None,
        drawn=drawn.read(m.drawn) if m.HasField("drawn") else None,
    )


def _unit(values: object) -> Array:
    """Of a vector whose length is nearly 1, the one whose length is."""
    vector = np.array(values, dtype=np.float64)
    return vector / float(np.linalg.norm(vector))


def _light(m: pb.Light) -> Light:
    irradiance = np.array(m.irradiance, dtype=np.float64)
    sigma = m.irradiance_sigma_permille / 1000 if m.HasField("irradiance_sigma_permille") else None
    return Light(
        id=m.id,
        direction=_unit(m.direction),
        irradiance=irradiance,
        angular_radius_deg=m.angular_radius_deg,
        direction_sigma_deg=m.direction_sigma_deg if m.HasField("direction_sigma_deg") else None,
        irradiance_sigma=None if sigma is None else sigma * irradiance,
        colour_sigma=(
            m.colour_sigma_permille / 1000 if m.HasField("colour_sigma_permille") else None
        ),
        shadow_strength=(
            m.shadow_strength_permille / 1000 if m.HasField("shadow_strength_permille") else None
        ),
        flags=LightFlag(m.flags),
        distance_m=m.distance_m if m.HasField("distance_m") else None,
        distance_sigma=(
            m.distance_sigma_permille / 1000 if m.HasField("distance_sigma_permille") else None
        ),
        nearest_m=m.nearest_m if m.HasField("nearest_m") else None,
        half_angle_deg=(m.half_angle_deg[0], m.half_angle_deg[1]) if m.half_angle_deg else None,
        axis=_unit(m.axis) if m.axis else None,
        dolp=m.dolp_percent / 100 if m.HasField("dolp_percent") else None,
        dolp_sigma=(m.dolp_sigma_permille / 1000 if m.HasField("dolp_sigma_permille") else None),
        aolp_deg=m.aolp_deg if m.HasField("aolp_deg") else None,
        aolp_sigma_deg=m.aolp_sigma_deg if m.HasField("aolp_sigma_deg") else None,
        reflection=m.reflection_percent / 100 if m.HasField("reflection_percent") else None,
    )


def _sh(m: pb.SphericalHarmonics) -> SphericalHarmonics:
    coefficients = np.array(m.coefficients, dtype=np.float64).reshape(-1, 3)
    return SphericalHarmonics(_KINDS[m.kind], m.order, coefficients)
