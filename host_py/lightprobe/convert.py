"""From the probe's convention to that of engines and AR systems, and back.

Every conversion of order-2 SH is a 9×9 matrix: new axes, the basis' signs, and whether the engine
wants the cosine lobe or the shader's constants multiplied in. So an :class:`Adapter` is a matrix
and a memory layout, and its inverse needs no code of its own. `ADAPTERS` is the table of
docs/users/conventions.md, which says where each engine states what it wants.

>>> unity = ADAPTERS["unity"]
>>> unity.coefficients(estimate.sh.coefficients)   # SphericalHarmonicsL2: 27 floats, planar
>>> lamp = unity.directional_light(estimate.lights[0])
>>> lamp.direction, lamp.colour, lamp.intensity    # as Unity's Light wants them
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.colour import linear_to_srgb
from lightprobe.estimate import Light
from lightprobe.geometry import Array
from lightprobe.sh import bands, cosine_lobe

COUNT = 9
#: Constants K of the basis polynomials, as shaders write them: Y6 = K6·(3z² − 1).
BASIS_CONSTANTS: Array = np.sqrt(np.array([1, 3, 3, 3, 15, 15, 1.25, 15, 3.75]) / (4 * np.pi))
#: A/π of each coefficient: with it the SH are those of E/π, the light that a white surface returns.
LAMBERT_SCALE: Array = np.array([cosine_lobe(int(degree)) for degree in bands(2)]) / np.pi
#: K·A/π: what engines multiply in so that their shader needs only the polynomials; yields E/π.
SHADER_SCALE: Array = BASIS_CONSTANTS * LAMBERT_SCALE
_HALF_SQRT3 = 0.75**0.5


@dataclass(frozen=True, eq=False)
class EngineLight:
    """A directional light as an engine wants it."""

    direction: Array  # (3,) unit vector in the engine's axes; which way: Adapter.light_points
    colour: Array  # (3,) its largest channel is 1; encoded as Adapter.colour_encoding says
    intensity: float  # in the engine's unit


@dataclass(frozen=True)
class Adapter:
    """One target convention. Arrays are in the probe's convention unless said otherwise."""

    name: str
    summary: str
    matrix: Array  # (9, 9): target coefficients = matrix @ ours, per channel
    axes: Array  # (3, 3): target vector = axes @ ours
    layout: Literal["coefficient-major", "planar"]  # r0 g0 b0 r1 … or R9 G9 B9
    #: Target's directional light = light_scale · irradiance at normal incidence: 1 where a shader
    #: divides by π, 1/π where it does not.
    light_scale: float
    #: Which way the target's directional light points: towards the light, or as the light travels;
    #: None: its documentation does not say.
    light_points: Literal["towards", "travel"] | None
    #: How the target reads a light's colour: linear, or sRGB that it linearises (its "gamma").
    colour_encoding: Literal["linear", "srgb"]

    def coefficients(self, ours: ArrayLike) -> Array:
        """Target's 27 floats, in its memory layout, from ours of shape (≥ 9, 3); order 2 is kept.

        Fewer than nine coefficients (order 0 or 1) count as zero above their order.
        """
        full = np.zeros((COUNT, 3))
        given = np.asarray(ours, dtype=np.float64)
        if (
            given.ndim != 2
            or given.shape[1] != 3
            or given.shape[0] not in (1, 4, 9, 16, 25, 36, 49, 64, 81)
        ):
            raise ValueError(f"convert: {self.name}: shape {given.shape}: expected ((order+1)², 3)")
        full[: min(COUNT, len(given))] = given[:COUNT]
        target = self.matrix @ full
        return (target if self.layout == "coefficient-major" else target.T).ravel()

    def from_coefficients(self, target: ArrayLike) -> Array:
        """Ours (9, 3) from the target's 27 floats; the inverse of :meth:`coefficients`."""
        flat = np.asarray(target, dtype=np.float64)
        if flat.size != 3 * COUNT:
            raise ValueError(f"convert: {self.name}: {flat.size} numbers: expected 27")
        planar = self.layout == "planar"
        table = flat.reshape(3, COUNT).T if planar else flat.reshape(COUNT, 3)
        return np.asarray(np.linalg.solve(self.matrix, table))

    def direction(self, ours: ArrayLike) -> Array:
        """Turn direction(s) towards the light (…, 3) into the target's axes."""
        return np.asarray(ours, dtype=np.float64) @ self.axes.T

    def from_direction(self, target: ArrayLike) -> Array:
        """Direction(s) of the target's in our axes; the inverse of :meth:`direction`."""
        return np.asarray(target, dtype=np.float64) @ self.axes

    def light(self, irradiance: ArrayLike) -> Array:
        """Colour times intensity (3,) of the target's directional light."""
        return np.asarray(irradiance, dtype=np.float64) * self.light_scale

    def directional_light(self, light: Light) -> EngineLight:
        """Give a lamp as the target's directional light: direction, colour, intensity.

        Colour times intensity is :meth:`light`, once the target has linearised the colour. A lamp
        without light is white, of intensity 0. ValueError when the target's way is not known.
        """
        if self.light_points is None:
            raise ValueError(f"convert: {self.name}: does not say which way its light points")
        towards = self.direction(light.direction)
        rgb = np.maximum(self.light(light.irradiance), 0)
        intensity = float(rgb.max())
        colour = rgb / intensity if intensity > 0 else np.ones(3)
        return EngineLight(
            direction=towards if self.light_points == "towards" else -towards,
            colour=linear_to_srgb(colour) if self.colour_encoding == "srgb" else colour,
            intensity=intensity,
        )

    def from_light(self, colour: ArrayLike) -> Array:
        """Irradiance (3,) of the target's directional light; the inverse of :meth:`light`."""
        return np.asarray(colour, dtype=np.float64) / self.light_scale


def _negating(*indices: int) -> Array:
    signs = np.ones(COUNT)
    signs[list(indices)] = -1
    return np.diag(signs)


def _rows(*rows: dict[int, float]) -> Array:
    matrix = np.zeros((COUNT, COUNT))
    for index, row in enumerate(rows):
        for column, factor in row.items():
            matrix[index, column] = factor
    return matrix


_SAME = np.eye(COUNT)
_SIGNED = _negating(1, 3, 5, 7)  # the Condon–Shortley sign
_MIRRORED = _negating(2, 5, 7)  # z → −z
_SHADER = np.diag(SHADER_SCALE)
_LAMBERT = np.diag(LAMBERT_SCALE)
_OUR_AXES = np.eye(3)
_FLIP_Z = np.diag([1.0, 1.0, -1.0])
# X = −z, Y = x, Z = y; Unreal's basis has the Condon–Shortley sign.
_UNREAL_AXES = np.array([[0, 0, -1.0], [1, 0, 0], [0, 1, 0]])
_UNREAL = _rows(
    {0: 1}, {3: -1}, {1: 1}, {2: 1}, {7: -1}, {4: -1},
    {6: -0.5, 8: -_HALF_SQRT3}, {5: 1}, {6: _HALF_SQRT3, 8: -0.5},
)  # fmt: skip
# X = x, Y = −z, Z = y.
_Z_UP_AXES = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_Z_UP = _rows(
    {0: 1}, {2: -1}, {1: 1}, {3: 1}, {7: -1}, {5: -1},
    {6: -0.5, 8: -_HALF_SQRT3}, {4: 1}, {6: -_HALF_SQRT3, 8: 0.5},
)  # fmt: skip

_C: Final = "coefficient-major"
_P: Final = "planar"
_TO: Final = "towards"
_TRAVEL: Final = "travel"
_LINEAR: Final = "linear"
_SRGB: Final = "srgb"
_PI = np.pi
_TABLE: list[Adapter] = [
    Adapter("webxr", "WebXR XRLightEstimate", _SAME, _OUR_AXES, _C, 1.0, _TO, _LINEAR),
    Adapter("threejs", "three.js LightProbe", _SAME, _OUR_AXES, _C, 1.0, _TO, _LINEAR),
    Adapter("filament-radiance", "Filament radiance(), intensity(1)",
            _SIGNED, _OUR_AXES, _C, 1.0, _TRAVEL, _LINEAR),
    Adapter("filament-irradiance", "Filament irradiance(), intensity(1)",
            _SHADER, _OUR_AXES, _C, 1.0, _TRAVEL, _LINEAR),
    Adapter("unity", "Unity SphericalHarmonicsL2; built-in pipeline and URP",
            _MIRRORED @ _SHADER, _FLIP_Z, _P, 1 / _PI, _TRAVEL, _SRGB),
    Adapter("unity-hdrp", "Unity SphericalHarmonicsL2; HDRP, intensity in lux",
            _MIRRORED @ _SHADER, _FLIP_Z, _P, 1.0, _TRAVEL, _SRGB),
    Adapter("unreal", "Unreal FSHVectorRGB3, intensity in lux",
            _UNREAL, _UNREAL_AXES, _P, 1.0, _TRAVEL, _SRGB),
    Adapter("godot", "Godot 4 lightmap probe; light energy",
            _SAME / _PI, _OUR_AXES, _C, 1 / _PI, _TRAVEL, _SRGB),
    Adapter("babylon", "Babylon.js SphericalHarmonics, left-handed scene",
            _SIGNED @ _MIRRORED @ _LAMBERT, _FLIP_Z, _C, 1.0, _TRAVEL, _LINEAR),
    Adapter("z-up", "Z-up right-handed (Blender)", _Z_UP, _Z_UP_AXES, _C, 1.0, _TRAVEL, _LINEAR),
    Adapter("arcore", "ARCore LightEstimate", _SIGNED, _OUR_AXES, _C, 1.0, _TO, _LINEAR),
    Adapter("arcore-positive", "ARCore, as Google's old Unity SDK reads it",
            _SAME, _OUR_AXES, _C, 1.0, _TO, _LINEAR),
    Adapter("arkit", "ARKit, planar R9 G9 B9", _SAME, _OUR_AXES, _P, 1.0, None, _LINEAR),
]  # fmt: skip

#: Every known target by name.
ADAPTERS: dict[str, Adapter] = {adapter.name: adapter for adapter in _TABLE}


def adapter(name: str) -> Adapter:
    """Adapter by name; KeyError lists the known ones."""
    try:
        return ADAPTERS[name]
    except KeyError:
        raise KeyError(f"convert: no target {name!r}: known are {', '.join(ADAPTERS)}") from None
