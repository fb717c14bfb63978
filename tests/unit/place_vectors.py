"""Golden vectors of light at a place, for all clients: proto/golden/place.json.

`python tests/unit/place_vectors.py` writes them anew.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from lightprobe.estimate import Estimate, EstimateFlag, Light, Room, SphericalHarmonics
from lightprobe.place import light_at
from lightprobe.reflection_map import ReflectionMap

EXPECTED = Path(__file__).resolve().parents[2] / "proto" / "golden" / "place.json"
_FIELDS = ("angular_radius_deg", "direction_sigma_deg", "distance_m", "distance_sigma", "nearest_m")
_LAMPS: tuple[dict[str, Any], ...] = (
    {"direction": [0.6, 0.8, 0.0], "distance_m": 2.0, "distance_sigma": 0.02,
     "direction_sigma_deg": 0.05, "irradiance_sigma": 0.03, "angular_radius_deg": 2.0},
    {"direction": [0.0, 0.6, -0.8], "distance_m": 0.75, "distance_sigma": 0.1,
     "direction_sigma_deg": 0.3, "irradiance_sigma": 0.05, "angular_radius_deg": 12.0},
    {"direction": [0.0, 1.0, 0.0], "distance_m": 1.5, "angular_radius_deg": 0.5},
    {"direction": [-1.0, 0.0, 0.0], "nearest_m": 12.0, "direction_sigma_deg": 0.05,
     "irradiance_sigma": 0.01, "angular_radius_deg": 0.27},
    {"direction": [0.0, 0.28, 0.96], "direction_sigma_deg": 0.05, "irradiance_sigma": 0.01,
     "angular_radius_deg": 1.0},
    {"direction": [0.0, 0.8, -0.6], "distance_m": 3.0, "angular_radius_deg": 15.0,
     "half_angle_deg": [20.0, 10.0], "axis": [1.0, 0.0, 0.0]},
)  # fmt: skip
_PLACES = ([0.5, 0.0, 0.0], [0.0, 0.4, -0.5], [-0.2, -0.4, 0.3], [0.0, 0.0, 0.0])
_LEVEL = {"walls_m": [2.0, 2.5, 1.25, 1.5, 3.5, 1.75], "orientation": [0.0, 0.0, 0.0, 1.0]}
_TILTED = {"walls_m": [1.5, 3.0, 1.0, 2.0, 0.75, 6.0], "orientation": [0.48, 0.0, 0.64, 0.6]}
_ROOMS: tuple[tuple[dict[str, Any], int, list[float]], ...] = (
    (_LEVEL, 2, [0.5, 0.25, -1.0]), (_LEVEL, 4, [0.5, 0.25, -1.0]), (_LEVEL, 0, [0.5, 0.0, 0.0]),
    (_TILTED, 2, [-0.5, 0.25, 0.375]), (_TILTED, 4, [-0.5, 0.25, 0.375]),
    (_TILTED, 4, [4.0, -3.0, 7.0]), (_TILTED, 2, [0.0, 12.0, 0.0]), (_TILTED, 3, [0.0, 0.0, 0.0]),
    (_TILTED, 4, [1e-3, 0.0, 0.0]), (_TILTED, 1, [0.25, -0.5, 0.0]),
)  # fmt: skip
#: Rooms, frames and places of reflection maps of 16 texels, by a probe that is turned.
_MAPS: tuple[tuple[dict[str, Any], str, list[float]], ...] = (
    (_LEVEL, "PROBE", [0.5, 0.25, -1.0]), (_TILTED, "PROBE", [-0.5, 0.25, 0.375]),
    (_TILTED, "WORLD", [-0.5, 0.25, 0.375]), (_TILTED, "WORLD", [4.0, -3.0, 7.0]),
)  # fmt: skip
_SIZE = 16
#: Every so many numbers of a moved map are in a vector.
_STEP = 67


def room_of(values: dict[str, Any]) -> Room:
    """Give the room of a vector."""
    return Room(np.array(values["walls_m"]), np.zeros(6), np.array(values["orientation"]), 0.01)


def ambient(vector: dict[str, Any]) -> Estimate:
    """Give an estimate without lamps in the room of a vector."""
    coefficients = np.array(vector["coefficients"]).reshape(-1, 3)
    sh = SphericalHarmonics("AMBIENT", vector["order"], coefficients)
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), (), sh, None, None, 1, None,
                    relighting_sigma=0.01, room=room_of(vector["room"]))  # fmt: skip


def light_of(values: dict[str, Any]) -> Light:
    """Give the lamp of a vector; its irradiance sigma is a share there."""
    irradiance = np.array(values["irradiance"])
    share = values["irradiance_sigma"]
    return Light(
        1, np.array(values["direction"]), irradiance,
        irradiance_sigma=None if share is None else share * irradiance,
        half_angle_deg=values["half_angle_deg"] and tuple(values["half_angle_deg"]),
        axis=None if values["axis"] is None else np.array(values["axis"]),
        **{name: values[name] for name in _FIELDS},
    )  # fmt: skip


def _values(light: Light) -> dict[str, Any]:
    sigma = light.irradiance_sigma
    return {
        "direction": _rounded(light.direction),
        "irradiance": _rounded(light.irradiance),
        "irradiance_sigma": None if sigma is None else _rounded(sigma[0] / light.irradiance[0]),
        "half_angle_deg": _rounded(light.half_angle_deg),
        "axis": _rounded(light.axis),
        **{name: _rounded(getattr(light, name)) for name in _FIELDS},
    }


def _rounded(values: Any) -> Any:
    """Keep seven digits: what every client's arithmetic gives."""
    if values is None:
        return None
    if np.ndim(values) == 0:
        return float(f"{float(values):.7g}") + 0.0
    return [_rounded(value) for value in values]


def vectors() -> dict[str, list[dict[str, Any]]]:
    """Give all vectors, by what they are of."""
    return {"lamps": lamps(), "rooms": rooms(), "maps": maps()}


def rooms() -> list[dict[str, Any]]:
    """Give ambient light moved through rooms, and the rooms as they are from there."""
    rng = np.random.default_rng(4)
    found = []
    for room, order, place in _ROOMS:
        light = np.round(rng.normal(size=((order + 1) ** 2, 3)), 3)
        light[0] += 3
        vector = {"room": room, "order": order, "coefficients": light.reshape(-1).tolist(),
                  "position_m": place}  # fmt: skip
        moved = ambient(vector).at(place)
        there = {"coefficients": _rounded(moved.sh.coefficients.reshape(-1)),
                 "walls_m": _rounded(moved.room.walls_m)}  # fmt: skip
        found.append(vector | {"there": there})
    return found


def speckled() -> ReflectionMap:
    """Give a map where no texel is like the next: number i of its radiance is 7919 i % 1009."""
    radiance = np.float32(7919 * np.arange(6 * _SIZE * _SIZE * 3) % 1009)
    faces = radiance.reshape(6, _SIZE, _SIZE, 3)
    return ReflectionMap(1, 1, 0, 1, "AMBIENT", faces, np.array([0.1, -0.7, 0.1, 0.7]))


def maps() -> list[dict[str, Any]]:
    """Give that map moved through rooms, every _STEP-th number of it."""
    found = []
    for room, frame, place in _MAPS:
        moved = speckled().at(room_of(room), place, frame)  # type: ignore[arg-type]
        there = _rounded(moved.radiance.reshape(-1)[::_STEP])
        found.append({"room": room, "frame": frame, "position_m": place, "there": there})
    return found


def lamps() -> list[dict[str, Any]]:
    """Give every lamp as seen from every place."""
    absent = dict.fromkeys((*_FIELDS, "irradiance_sigma", "half_angle_deg", "axis"))
    found = []
    for lamp in _LAMPS:
        values = absent | {"irradiance": [3.0, 2.0, 1.0]} | lamp
        for place in _PLACES:
            moved = light_at(light_of(values), place)
            found.append({"light": values, "position_m": place, "there": _values(moved)})
    return found


if __name__ == "__main__":
    parts = (
        f'"{name}": [\n' + ",\n".join(json.dumps(vector) for vector in found) + "\n]"
        for name, found in vectors().items()
    )
    EXPECTED.write_text("{" + ",\n".join(parts) + "}\n")
