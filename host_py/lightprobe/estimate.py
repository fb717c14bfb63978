"""What the probe says, typed: arrays are numpy, units are in names, unknown is None (never 0)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from lightprobe import sh as harmonics
from lightprobe.flags import EstimateFlag as EstimateFlag
from lightprobe.flags import LightFlag as LightFlag
from lightprobe.geometry import Array, angles_from_direction, cap_solid_angle_sr

Kind = Literal["AMBIENT", "TOTAL"]
Frame = Literal["PROBE", "WORLD"]

NO_LIGHT_FLAG = LightFlag(0)

#: The flags in words, each with what to do about it where something can be done.
FLAG_WORDS: dict[str, str] = {
    "STALE": "its newest frame is older than the time to live: none came since, or it came late",
    "EXPOSURE_UNKNOWN": "no exposure is known; the light is on the scale of the first estimates",
    "CLIPPED": "some pixels are saturated in every exposure, so light is missing; use shorter "
    "exposures",
    "UNDEREXPOSED": "most of the picture is below the noise; use longer exposures or more gain",
    "BRACKET_INCOMPLETE": "exposures of the bracket are missing, or were taken before the light "
    "changed",
    "PARTIAL_VIEW": "no camera sees part of the sphere; that part is filled, not measured now",
    "MORE_LIGHTS": "more lamps were found than are listed; the others are in the SH",
    "INVALID_INPUT": "NaN, infinite or negative samples were left out",
    "DEGRADED": "the governor lowered the preset to keep its budget",
    "RING_ONLY": "there is no camera, or it sees nothing (COVERED); the estimate comes from the "
    "ring of light sensors alone",
    "EXPOSURE_IGNORED": "the camera did not follow the exposure command",
    "RING_FAULT": "the ring of light sensors, or part of it, cannot be used",
    "WHEEL_FAULT": "the position of the polarizer wheel is not known; its angle is not used",
    "NO_LIGHT": "the scene is black as far as the camera can tell",
    "MOTION": "the frames do not tell how the camera turned: directions may be off",
    "FLICKER": "lamps flicker with the mains; what is reported of them is a mean",
    "COVERED": "something covers part of the lens; what was known of the light there is kept",
    "POLARIZATION_UNKNOWN": "too few angles of the polarizer so far, so reflections are not told "
    "from lamps",
    "FILM_TURNED": "the polarizing film is a quarter turn off; turn it by 90°",
    "RESPONSE": "exposures contradict each other; the log names the cause and the remedy",
    "REFLECTION": "the mirror image of another lamp (glare)",
    "EXTENDED": "an area light, wider than a lamp",
    "RING": "strength or direction from the ring of light sensors",
    "HELD": "not seen in the newest frame; held by the tracker",
}


#: Faults of the health with which everything that both sides know works.
MINOR_FAULTS = frozenset({"mcu-minor-version", "camera-processing"})


def flag_names(flags: IntFlag) -> list[str]:
    """Names of the bits that are set; a bit that this version does not know as BIT_n."""
    names = []
    for bit in range(int(flags).bit_length()):
        if int(flags) >> bit & 1:
            known = type(flags).__members__.values()
            name = next((m.name for m in known if int(m) == 1 << bit), None)
            names.append(name or f"BIT_{bit}")
    return names


@dataclass(frozen=True, eq=False)
class Light:
    """One lamp: a disc of the given angular radius, far away; or an area light, or KEY."""

    id: int  # stable while tracked; 0: KEY
    direction: Array  # (3,) unit vector towards the light, probe frame
    irradiance: Array  # (3,) RGB on a surface that faces it
    angular_radius_deg: float
    direction_sigma_deg: float | None = None
    irradiance_sigma: Array | None = None  # (3,) 1 sigma, in units of `irradiance`
    #: 1 sigma of red, green and blue, root mean square, over the luminance of `irradiance`: of
    #: lamps whose strength the ring of light sensors found; None: not stated.
    colour_sigma: float | None = None
    #: Share, 0…1, of the light (luminance) on a surface facing up, +Y of `Estimate.frame`:
    #: how dark its shadow on a table is. None: no light reaches it, or an older probe.
    shadow_strength: float | None = None
    flags: LightFlag = NO_LIGHT_FLAG
    #: From the probe, triangulated (`lightprobe field`); None: not known.
    distance_m: float | None = None
    distance_sigma: float | None = None  # 1 sigma of it, relative
    #: It is at least so far away, at 3 sigma; None: `distance_m` is known, or nothing is.
    nearest_m: float | None = None
    #: Area lights (EXTENDED): the ellipse with the same extent, from its centre along the longer
    #: and the shorter axis, and a unit vector along the longer one, across `direction`.
    half_angle_deg: tuple[float, float] | None = None
    axis: Array | None = None
    # From several angles of a polarizer; None: not known.
    dolp: float | None = None  # degree of linear polarization, 0…1
    dolp_sigma: float | None = None
    aolp_deg: float | None = None  # angle of it: 0 horizontal, counter-clockwise from inside
    aolp_sigma_deg: float | None = None  # 90: any angle is as likely
    #: Probability, 0…1, that it is another lamp's mirror image: above 0.9 it is one (REFLECTION),
    #: below 0.1 none, in between unsure. Without `dolp` place and strength alone tell.
    reflection: float | None = None

    @property
    def solid_angle_sr(self) -> float:
        """Solid angle of the disc."""
        return float(cap_solid_angle_sr(self.angular_radius_deg))

    @property
    def azimuth_deg(self) -> float:
        """0 forward (−Z), positive to the right."""
        return float(angles_from_direction(self.direction)[0])

    @property
    def elevation_deg(self) -> float:
        """Up is positive."""
        return float(angles_from_direction(self.direction)[1])

    def to_json(self) -> dict[str, Any]:
        """Give the JSON shape of every command's lights."""
        return {
            "id": self.id,
            "direction": _numbers(self.direction),
            "irradiance": _numbers(self.irradiance),
            "angular_radius_deg": _number(self.angular_radius_deg),
            "solid_angle_sr": _number(self.solid_angle_sr),
            "direction_sigma_deg": _number(self.direction_sigma_deg),
            "irradiance_sigma": _numbers(self.irradiance_sigma),
            "colour_sigma": _number(self.colour_sigma),
            "shadow_strength": _number(self.shadow_strength),
            "distance_m": _number(self.distance_m),
            "distance_sigma": _number(self.distance_sigma),
            "nearest_m": _number(self.nearest_m),
            "half_angle_deg": _numbers(self.half_angle_deg),
            "axis": _numbers(self.axis),
            "dolp": _number(self.dolp),
            "dolp_sigma": _number(self.dolp_sigma),
            "aolp_deg": _number(self.aolp_deg),
            "aolp_sigma_deg": _number(self.aolp_sigma_deg),
            "reflection": _number(self.reflection),
            "flags": flag_names(self.flags),
        }


@dataclass(frozen=True, eq=False)
class SphericalHarmonics:
    """SH of incident radiance (see :mod:`lightprobe.sh`)."""

    kind: Kind  # AMBIENT: add the lights; TOTAL: they are in it
    order: int
    coefficients: Array  # ((order+1)², 3)


@dataclass(frozen=True, eq=False)
class Room:
    """The room around the probe as a box: what the ambient light is like beside the probe."""

    walls_m: Array  # (6,) from the probe to the walls at −x +x −y +y −z +z of the box's own axes
    walls_sigma_m: Array  # (6,)
    orientation: Array  # (4,) x, y, z, w: turns the box's axes into `Estimate.frame`
    #: 1 sigma of the ambient light moved by it, for each metre from the probe; relative to the mean
    #: irradiance.
    error_per_m: float

    @property
    def size_m(self) -> Array:
        """(3,) along its own axes."""
        return np.asarray(self.walls_m[::2] + self.walls_m[1::2])

    def to_json(self) -> dict[str, Any]:
        """Give the JSON shape of an estimate's room."""
        return {
            "walls_m": _numbers(self.walls_m),
            "walls_sigma_m": _numbers(self.walls_sigma_m),
            "orientation": _numbers(self.orientation),
            "error_per_m": _number(self.error_per_m),
        }


@dataclass(frozen=True, eq=False)
class Estimate:
    """One packet: the light at the probe."""

    sequence: int
    boot_id: int
    capture_time_unix_ns: int  # mid-exposure of the newest frame used
    send_delay_us: int  # send time = capture time + this
    ttl_ms: int  # older than this after capture: fade to your default
    flags: EstimateFlag
    lights: tuple[Light, ...]  # strongest first
    sh: SphericalHarmonics
    predicted_error: float | None  # left out by the chosen model, relative to mean irradiance
    exposure_us: float | None  # longest used
    exposure_count: int
    cd_m2_per_unit: float | None  # None: not calibrated
    wheel_deg: float | None = None  # of the polarizer in the newest frame; None: none, or unknown
    wheel_sigma_deg: float | None = None
    relighting_sigma: float | None = None  # of the irradiance as measured, relative to its mean
    cd_m2_per_unit_sigma: float | None = None  # relative, 1 sigma
    subscription: int = 0  # number of the subscription that it answers; 0: the defaults
    frame: Frame = "PROBE"  # WORLD: directions and SH are in the world of the app that sends poses
    orientation: Array | None = None  # (4,) x, y, z, w: turns the probe frame into one that stays
    orientation_sigma_deg: float | None = None
    position_m: Array | None = None  # (3,) where the probe was, in the app's world
    #: One directional light for what the listed lights leave; None: it was not asked for.
    key: Light | None = None
    #: 1 sigma of the scale of light against that of the first estimates, relative; None: exposures
    #: are known, and the scale is full scale at one second.
    scale_sigma: float | None = None
    room: Room | None = None  # None: nothing is known of the ambient light beside the probe
    #: Error to expect of what the subscription draws (drawn.THINGS), 1 sigma; None: it did not say.
    drawn: dict[str, float] | None = None

    @property
    def send_time_unix_ns(self) -> int:
        """When the probe sent it, by the probe's clock."""
        return self.capture_time_unix_ns + 1000 * self.send_delay_us

    @property
    def beside_sh(self) -> tuple[Light, ...]:
        """What is to be added to the SH: the lights and KEY; of a TOTAL nothing, it is in it."""
        if self.sh.kind == "TOTAL":
            return ()
        return self.lights if self.key is None else (*self.lights, self.key)

    def total(self) -> SphericalHarmonics:
        """SH with the lights put in (TOTAL), each as the point that was taken out of AMBIENT."""
        coefficients = self.sh.coefficients.copy()
        for light in self.beside_sh:
            shape = harmonics.lamp(light.direction, self.sh.order)
            coefficients += shape[:, None] * light.irradiance
        return replace(self.sh, kind="TOTAL", coefficients=coefficients)

    def irradiance(self, normals: ArrayLike) -> Array:
        """Irradiance (…, 3) on surfaces with the given normals (…, 3): SH and lights together."""
        n = np.asarray(normals, dtype=np.float64)
        total = harmonics.irradiance(self.sh.coefficients, n)
        for light in self.beside_sh:
            total += np.maximum(n @ light.direction, 0)[..., None] * light.irradiance
        return total

    def at(self, position_m: ArrayLike) -> Estimate:
        """Give the light at a place beside the probe; see :func:`lightprobe.place.estimate_at`."""
        from lightprobe.place import estimate_at

        return estimate_at(self, position_m)

    def to_json(self) -> dict[str, Any]:
        """Give the one JSON shape of an estimate; unknown values are null."""
        return {
            "sequence": self.sequence,
            "subscription": self.subscription,
            "boot_id": self.boot_id,
            "capture_time_unix_ns": self.capture_time_unix_ns,
            "send_delay_us": self.send_delay_us,
            "ttl_ms": self.ttl_ms,
            "lights": [light.to_json() for light in self.lights],
            "key": None if self.key is None else self.key.to_json(),
            "sh": {
                "order": self.sh.order,
                "kind": self.sh.kind,
                "coefficients": [_numbers(row) for row in self.sh.coefficients],
            },
            "scale": {
                "cd_m2_per_unit": _number(self.cd_m2_per_unit),
                "cd_m2_per_unit_sigma": _number(self.cd_m2_per_unit_sigma),
                "calibrated": self.cd_m2_per_unit is not None,
                "sigma": _number(self.scale_sigma),
            },
            "exposure": {"exposure_us": _number(self.exposure_us), "count": self.exposure_count},
            "model": {
                "sh_order": self.sh.order,
                "lights": len(self.lights),
                "predicted_error": _number(self.predicted_error),
                "relighting_sigma": _number(self.relighting_sigma),
            }
            | ({} if self.drawn is None else {"drawn": self.drawn}),
            "wheel": {
                "angle_deg": _number(self.wheel_deg),
                "sigma_deg": _number(self.wheel_sigma_deg),
            },
            "frame": self.frame,
            "orientation": {
                "xyzw": _numbers(self.orientation),
                "sigma_deg": _number(self.orientation_sigma_deg),
                "position_m": _numbers(self.position_m),
            },
            "room": None if self.room is None else self.room.to_json(),
            "flags": flag_names(self.flags),
        }


@dataclass(frozen=True)
class Hello:
    """First message on every connection."""

    protocol_major: int
    protocol_minor: int
    software: str
    boot_id: int
    source: str
    max_sh_order: int
    max_lights: int
    smoothing_time_constant_ms: int
    clock: str
    has_wheel: bool
    has_ring: bool
    preset: str
    name: str = ""  # of the probe; "": it speaks a protocol older than 1.2
    insecure_lan: bool = False  # anyone on the network can read it, unencrypted
    #: What tells it: none, visual, sim (its frames, recorded or simulated), client, sensor; "":
    #: older than 1.3.
    orientation: str = ""
    max_reflection_map_size: int = 0  # 0: it sends no reflection maps
    polarization_map: bool = False  # any client may ask for one, which is a coarse picture
    #: What its cameras do to their pictures that changes the light in them, as far as they tell:
    #: "sharpness", "gamma", … (docs/users/cameras.md).
    processing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong now: object, stage, next step."""

    id: str
    text: str


@dataclass(frozen=True)
class Wheel:
    """The polarizer wheel, as its device reports it."""

    phase: str  # UNKNOWN HOMING MOVING SETTLED FAULT ABSENT
    commanded_deg: float | None
    measured_deg: float | None
    sigma_deg: float | None
    moves: int
    frames_stamped: int  # exposed at a known angle
    frames_moving: int  # left out: exposed while it turned
    frames_unknown: int  # used without an angle
    clock_sigma_us: float | None  # of the microcontroller's clock on the probe's
    reconnects: int
    sweeps: int = 0  # rounds of all angles of the polarizer that are over


@dataclass(frozen=True)
class Ring:
    """The ring of light sensors."""

    illuminance_lux: tuple[float | None, ...]  # nine; None: this sensor is not usable
    samples_per_s: float
    samples: int
    samples_lost: int


@dataclass(frozen=True)
class Health:
    """Counters of the daemon since its start."""

    uptime_ms: int
    source_state: str  # UNKNOWN DOWN WAITING STREAMING STALLED ENDED
    frames_received: int
    frames_dropped: int
    frames_rejected: int
    source_reconnects: int
    estimates: int
    estimates_per_s: float
    latency_p50_us: int  # frame arrival to packet sent
    latency_p99_us: int
    clients: int
    packets_sent: int
    packets_superseded: int
    requests_rejected: int
    cpu_percent: float
    rss_kib: int
    preset: str
    faults: tuple[Fault, ...]
    wheel: Wheel | None = None  # None: no wheel
    ring: Ring | None = None  # None: no ring
    polarization_maps_sent: int = 0  # pictures that have left the probe
    places_left_out: int = 0  # of the pictures, that shine by themselves: stuck pixels


@dataclass(frozen=True)
class Pong:
    """The answer to a ping: when we sent it, and when it was there and answered."""

    ping_time_ns: int  # of our clock
    received_unix_ns: int  # of the probe's
    sent_unix_ns: int


@dataclass(frozen=True, eq=False)
class PolarizationMap:
    """How the light is polarized: a coarse equirectangular picture, probe frame, row 0 up.

    Cell (r, c) of H rows and W columns looks along d = (sin t sin l, cos t, −sin t cos l),
    t = π (r + ½) / H, l = 2π ((c + ½) / W − ½). All arrays (H, W), of luminance; NaN: not known.
    """

    capture_time_unix_ns: int  # of the newest frame in it
    s0: Array  # radiance without the film
    q: Array  # S1 / S0 in the frame of each direction: x = d × up, y = x × d
    u: Array  # S2 / S0
    sigma: Array  # 1 sigma of q and u
    sweeps: int  # Wheel.sweeps at that time


@dataclass(frozen=True)
class SweepStarted:
    """The polarizer visits all its angles."""

    done_at: int  # it is over when Wheel.sweeps has reached this


@dataclass(frozen=True)
class StillsAsked:
    """Cameras for stills take a set now."""

    cameras: int  # so many


@dataclass(frozen=True)
class Refusal:
    """The probe refused a request."""

    code: int  # negative errno
    text: str


def _number(value: float | None) -> float | None:
    """Shorten to a float32's digits, so that JSON shows what was sent; None stays."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.8g}")


def _numbers(values: ArrayLike | None) -> list[float | None] | None:
    return None if values is None else [_number(float(v)) for v in np.asarray(values)]
