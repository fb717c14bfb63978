"""An estimate as binary glTF: its lamps as directional lights, the rest of it as an environment.

glTF 2.0 (Khronos), chapter "GLB File Format", and two extensions. KHR_lights_punctual: a
directional light shines along its node's −Z, its intensity is illuminance in lux, its colour linear
Rec. 709.
EXT_lights_image_based: SH and images of the ambient light. glTF's axes are the probe's. The whole
estimate is in the scene's `extras.lightprobe`, too.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from lightprobe import __version__
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array
from lightprobe.imaging import image_based_light
from lightprobe.imaging.cube import Faces

_EXTENSION = "KHR_lights_punctual"
_MAGIC, _VERSION, _JSON, _BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942


def glb(estimate: Estimate, ambient: Faces) -> bytes:
    """Give the file's bytes; intensities are relative when the estimate is not calibrated.

    `ambient`: a cube map of what the estimate's SH describe, for reflections.
    """
    scale = estimate.cd_m2_per_unit or 1.0
    scene: dict[str, Any] = {"name": "light", "extras": {"lightprobe": estimate.to_json()}}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"lightprobe {__version__}"},
        "scene": 0,
        "scenes": [scene],
        "extensionsUsed": [],
        "extensions": {},
    }
    if estimate.beside_sh:  # empty arrays are not allowed
        _add_lamps(document, estimate.beside_sh, scale)
    data = _add_environment(document, image_based_light.image_based_light(estimate, ambient, scale))
    text = json.dumps(document, allow_nan=False).encode()
    chunks = _chunk(_JSON, text, b" ") + _chunk(_BIN, data, b"\0")
    return struct.pack("<III", _MAGIC, _VERSION, 12 + len(chunks)) + chunks


def _chunk(kind: int, data: bytes, filler: bytes) -> bytes:
    data += filler * (-len(data) % 4)
    return struct.pack("<II", len(data), kind) + data


def _add_lamps(document: dict[str, Any], lamps: Sequence[Light], scale: float) -> None:
    document["extensionsUsed"].append(_EXTENSION)
    document["extensions"][_EXTENSION] = {"lights": [_light(light, scale) for light in lamps]}
    document["nodes"] = [
        {
            "name": _name(light),
            "rotation": _rotation(light.direction),
            "extensions": {_EXTENSION: {"light": index}},
        }
        for index, light in enumerate(lamps)
    ]
    document["scenes"][0]["nodes"] = list(range(len(lamps)))


def _add_environment(document: dict[str, Any], light: image_based_light.ImageBasedLight) -> bytes:
    """Add the ambient light; gives the buffer with its images."""
    name, data = image_based_light.EXTENSION, b""
    views = []
    for png in light.images:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(png)})
        data += png + b"\0" * (-len(png) % 4)
    images = range(len(light.images))
    document["buffers"] = [{"byteLength": len(data)}]
    document["bufferViews"] = views
    document["images"] = [{"bufferView": index, "mimeType": "image/png"} for index in images]
    document["extensionsUsed"].append(name)
    document["extensions"][name] = {
        "lights": [
            {
                "name": "ambient",
                "intensity": light.intensity,
                "irradianceCoefficients": light.irradiance,
                "specularImageSize": light.size,
                "specularImages": [list(images[at : at + 6]) for at in images[::6]],
            }
        ]
    }
    document["scenes"][0]["extensions"] = {name: {"light": 0}}
    return data


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
