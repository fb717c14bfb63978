"""Messages at and beyond the ends of every line of proto/ranges.toml, for the tests of all clients.

Each case is one field of one good message changed; a message that is not to be taken has the
sentence that refuses it. `range_cases.py` prints them all as JSON.
"""

import json
import math
import struct
from dataclasses import dataclass

from google.protobuf.descriptor import FieldDescriptor
from lightprobe_proto import lightprobe_pb2 as pb
from lightprobe_proto.ranges import UNIT_TOLERANCE, factor, load

RANGES = load()
NAN, INF = math.nan, math.inf
MOST_FLOAT = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
LEAST_FLOAT = 2.0**-126
#: Of a message that others hold, the paths to it from FromProbe; lists: the first one in them.
PLACES = {
    "Light": ("estimate.lights", "estimate.key"),
    "SphericalHarmonics": ("estimate.sh",),
    "Estimate": ("estimate",),
    "Drawn": ("estimate.drawn", "reflection_map.drawn"),
    "Room": ("estimate.room",),
    "ReflectionMap": ("reflection_map",),
    "PolarizationMap": ("polarization_map",),
    "Wheel": ("health.wheel",),
    "Ring": ("health.ring",),
    "Health": ("health",),
}


@dataclass(frozen=True)
class Case:
    """A FromProbe message, without its length, and what a client says of it."""

    name: str
    data: bytes
    refusal: str | None  # None: it is to be taken


def good(kind):
    """A message of this kind that every client takes, with every field of the table in it."""
    message = pb.FromProbe()
    if kind == "estimate":
        lamp = {"id": 1, "direction": [0.6, 0, -0.8], "irradiance": [3, 2, 1], "flags": 4,
                "angular_radius_deg": 5, "half_angle_deg": [7, 5], "axis": [0, 1, 0],
                "aolp_deg": 30, "dolp_percent": 20, "distance_m": 3}  # fmt: skip
        sh = pb.SphericalHarmonics(kind=1, order=1, coefficients=[1, 1, 1] + 9 * [-0.25])
        room = {"walls_m": [2, 2.5, 1.2, 1.4, 3, 1], "walls_sigma_m": 6 * [0.1],
                "orientation": [0, 0.6, 0, 0.8], "error_permille_per_m": 9}  # fmt: skip
        message.estimate.MergeFrom(
            pb.Estimate(
                ttl_ms=500,
                sh=sh,
                lights=[pb.Light(**lamp)],
                key=pb.Light(**lamp),
                orientation=[0, 0, 0.6, 0.8],
                position=[1, 1.5, -2],
                room=pb.Room(**room),
                drawn=pb.Drawn(diffuse_permille=20, glossy_permille=0),
                cd_m2_per_unit=100,
            )
        )
    elif kind == "health":
        message.health.MergeFrom(
            pb.Health(wheel=pb.Wheel(measured_deg=45), ring=pb.Ring(illuminance_lux=9 * [80]))
        )
    elif kind == "reflection_map":
        message.reflection_map.MergeFrom(
            pb.ReflectionMap(
                kind=2,
                size=16,
                scale=1,
                orientation=[0, 0, 0, 1],
                drawn=pb.Drawn(mirrors_permille=109),
            )
        )
    else:
        message.polarization_map.MergeFrom(pb.PolarizationMap(width=2, height=1, s0_unit=1))
    for name, fields in RANGES.items():
        for place in PLACES[name]:
            if place.split(".")[0] == kind:
                fill_bytes(at(message, place), fields)
    return message


def at(message, place):
    """The part of a FromProbe at a path; of a list, its first."""
    for step in place.split("."):
        message = getattr(message, step)
        if not hasattr(message, "DESCRIPTOR"):
            message = message[0]
    return message


def count_of(part, factors):
    """What a count of the table is for this message."""
    split = (factor(one) for one in factors)
    return math.prod(plus + (getattr(part, of) if of else 0) for plus, of in split)


def fill_bytes(part, fields, but=""):
    """Bring lists that other fields count to their length."""
    for field, allowed in fields.items():
        if field != but and allowed.bytes:
            setattr(part, field, bytes(count_of(part, allowed.bytes)))
        if field != but and len(allowed.count) > 1:
            getattr(part, field)[:] = count_of(part, allowed.count) * [0.5]


def ends(allowed, whole):
    """Numbers inside and outside of a range: at its ends and beyond, float or whole."""
    if allowed.one_of:
        return list(allowed.one_of), sorted({max(allowed.one_of) + 1, 7} - set(allowed.one_of))
    inside, outside = [], [] if whole else [INF, -INF]
    if not whole:
        (inside if allowed.nan else outside).append(NAN)
    if allowed.above is not None:
        inside, outside = [LEAST_FLOAT], [*outside, allowed.above, -1.0]
    elif allowed.least is not None:
        inside.append(allowed.least)
        outside += [] if whole and not allowed.least else [allowed.least - (1 if whole else 1e-3)]
    elif not whole:
        inside.append(-MOST_FLOAT)
    inside.append(MOST_FLOAT if allowed.most is None else allowed.most)
    if allowed.most is not None:
        outside.append(allowed.most + (1 if whole else 1e-3))
    return inside, outside


def lists(allowed, part, now):
    """Lists inside and outside of a range, from the one that is there."""
    if allowed.unit:
        inside = [
            [x * by for x in now] for by in (1 - 0.9 * UNIT_TOLERANCE, 1 + 0.9 * UNIT_TOLERANCE)
        ]
        outside = [
            [x * by for x in now] for by in (1 - 2 * UNIT_TOLERANCE, -1 - 2 * UNIT_TOLERANCE)
        ]
        outside += [[0.0 for _ in now]] + [[*now[:-1], x] for x in (NAN, INF)]
    else:
        numbers, wrong = ends(allowed, whole=False)
        inside = [[*now[:-1], x] for x in numbers]
        outside = [[*now[:k], x, *now[k + 1 :]] for x in wrong for k in (0, len(now) - 1)]
    (inside if allowed.absent else outside).append([])
    return inside, [*outside, now[:-1], [*now, now[0]]]


def change(part, field, allowed, value):
    """Give a field another value."""
    if allowed.required:
        part.ClearField(field)
    elif allowed.count:
        getattr(part, field)[:] = value
    else:
        setattr(part, field, value)
    if not allowed.count and not allowed.bytes:
        fill_bytes(part, RANGES[part.DESCRIPTOR.name], field)


def values(allowed, part, field):
    """Values inside and outside of a field's range."""
    if allowed.required:
        return [], [None]
    now = getattr(part, field)
    if allowed.bytes:
        return [], [b"", now[:-1], now + b"x"]
    if allowed.count:
        return lists(allowed, part, list(now))
    floats = (FieldDescriptor.TYPE_FLOAT,)
    return ends(allowed, part.DESCRIPTOR.fields_by_name[field].type not in floats)


def cases():
    """Every field of the table, in every place, with every such value."""
    found = []
    for name, fields in RANGES.items():
        for place in PLACES[name]:
            kind = place.split(".")[0]
            for field, allowed in fields.items():
                inside, outside = values(allowed, at(good(kind), place), field)
                for number, value in enumerate([*inside, *outside]):
                    message = good(kind)
                    change(at(message, place), field, allowed, value)
                    refusal = None if number < len(inside) else allowed.refusal
                    shown = f"{len(value)} bytes" if isinstance(value, bytes) else f"{value}"
                    title = f"{place}.{field} = {shown if len(shown) < 60 else shown[:57] + '...'}"
                    found.append(Case(title, message.SerializeToString(), refusal))
    return found


if __name__ == "__main__":
    print(json.dumps([[one.name, one.data.hex(), one.refusal] for one in cases()]))
