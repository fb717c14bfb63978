"""An estimate as binary glTF: its lamps as directional lights.

glTF 2.0 (Khronos), chapter "GLB File Format", and the extension KHR_lights_punctual: a directional
light shines along its node's −Z, its intensity is illuminance in lux, its colour linear Rec. 709.
glTF's axes are the probe's. The rest of the light has no place in glTF's core: the whole estimate,
SH included, is in the scene's `extras.lightprobe`.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from lightprobe import __version__
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array

_EXTENSION = "KHR_lights_punctual"
_MAGIC, _VERSION, _JSON = 0x46546C67, 2, 0x4E4F534A


def glb(estimate: Estimate) -> bytes:
    """Give the file's bytes; intensities are relative when the estimate is not calibrated."""
    scale = estimate.cd_m2_per_unit or 1.0
    scene: dict[str, Any] = {"name": "light", "extras": {"lightprobe": estimate.to_json()}}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"lightprobe {__version__}"},
        "scene": 0,
        "scenes": [scene],
    }
    listed = estimate.lights if estimate.key is None else (*estimate.lights, estimate.key)
    if listed:  # empty arrays are not allowed
        lights = [_light(light, scale) for light in listed]
        document |= {
            "extensionsUsed": [_EXTENSION],
            "extensions": {_EXTENSION: {"lights": lights}},
            "nodes": [
                {
                    "name": _name(light),
                    "rotation": _rotation(light.direction),
                    "extensions": {_EXTENSION: {"light": index}},
                }
                for index, light in enumerate(listed)
            ],
        }
        scene["nodes"] = list(range(len(lights)))
    text = json.dumps(document, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<II", len(text), _JSON) + text
    return struct.pack("<III", _MAGIC, _VERSION, 12 + len(chunk)) + chunk


def _name(light: Light) -> str:
    return f"lamp {light.id}" if light.id else "key"


def _light(light: Light, scale: float) -> dict[str, Any]:
    intensity = float(np.max(light.irradiance))
    colour = light.irradiance / intensity if intensity > 0 else np.ones(3)
    return {
        "type": "directional",
        "name": _name(light),
        "color": [float(np.clip(value, 0, 1)) for value in colour],
        "intensity": max(intensity, 0.0) * scale,
    }


def _rotation(towards: Array) -> list[float]:
    """Quaternion (x, y, z, w) that turns +Z towards the light, so that −Z is its way of travel."""
    x, y, z = (float(value) for value in towards)
    quaternion = np.array([-y, x, 0.0, 1 + z])
    length = float(np.linalg.norm(quaternion))
    if length < 1e-12:  # straight ahead: half a turn, about any axis across
        return [1.0, 0.0, 0.0, 0.0]
    return [float(value) for value in quaternion / length]
