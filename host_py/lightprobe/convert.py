"""From the probe's convention to that of engines and AR systems, and back.

Every conversion of order-2 SH is a 9×9 matrix: new axes, the basis' signs, and whether the engine
wants the shader's constants multiplied in. So an :class:`Adapter` is a matrix and a memory layout,
and its inverse needs no code of its own. `ADAPTERS` is the table of docs/conventions.md.

>>> unity = ADAPTERS["unity"]
>>> unity.coefficients(estimate.sh.coefficients)   # SphericalHarmonicsL2: 27 floats, planar
>>> unity.direction(light.direction), unity.light(light.irradiance)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.geometry import Array
from lightprobe.sh import bands, cosine_lobe

COUNT = 9
#: Constants K of the basis polynomials, as shaders write them: Y6 = K6·(3z² − 1).
BASIS_CONSTANTS: Array = np.sqrt(np.array([1, 3, 3, 3, 15, 15, 1.25, 15, 3.75]) / (4 * np.pi))
#: K·A/π: what engines multiply in so that their shader needs only the polynomials; yields E/π.
SHADER_SCALE: Array = (
    BASIS_CONSTANTS * np.array([cosine_lobe(int(degree)) for degree in bands(2)]) / np.pi
)
_HALF_SQRT3 = 0.75**0.5


@dataclass(frozen=True)
class Adapter:
    """One target convention. Arrays are in the probe's convention unless said otherwise."""

    name: str
    summary: str
    matrix: Array  # (9, 9): target coefficients = matrix @ ours, per channel
    axes: Array  # (3, 3): target vector = axes @ ours
    layout: Literal["coefficient-major", "planar"]  # r0 g0 b0 r1 … or R9 G9 B9
    light_scale: float  # target's directional light = light_scale · irradiance at normal incidence

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
            raise ValueError(f"convert: {self.name}: shape {given.shape}: want ((order+1)², 3)")
        full[: min(COUNT, len(given))] = given[:COUNT]
        target = self.matrix @ full
        return (target if self.layout == "coefficient-major" else target.T).ravel()

    def from_coefficients(self, target: ArrayLike) -> Array:
        """Ours (9, 3) from the target's 27 floats; the inverse of :meth:`coefficients`."""
        flat = np.asarray(target, dtype=np.float64)
        if flat.size != 3 * COUNT:
            raise ValueError(f"convert: {self.name}: {flat.size} numbers: want 27")
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

    def from_light(self, colour: ArrayLike) -> Array:
        """Irradiance (3,) of the target's directional light; the inverse of :meth:`light`."""
        return np.asarray(colour, dtype=np.float64) / self.light_scale


def threejs_light(irradiance: ArrayLike) -> tuple[Array, float]:
    """(colour, intensity) as three.js' XREstimatedLight splits it: colour within 0…1."""
    rgb = np.asarray(irradiance, dtype=np.float64)
    intensity = max(1.0, float(rgb.max()))
    return rgb / intensity, intensity


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
_SHADER = np.diag(SHADER_SCALE)
_UNITY = _negating(2, 5, 7) @ _SHADER
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
_TABLE: list[Adapter] = [
    Adapter("webxr", "WebXR XRLightEstimate", _SAME, _OUR_AXES, _C, 1.0),
    Adapter("threejs", "three.js LightProbe", _SAME, _OUR_AXES, _C, 1.0),
    Adapter("filament-radiance", "Filament radiance()", _SIGNED, _OUR_AXES, _C, 1.0),
    Adapter("filament-irradiance", "Filament irradiance()", _SHADER, _OUR_AXES, _C, 1.0),
    Adapter("unity", "Unity SphericalHarmonicsL2", _UNITY, _FLIP_Z, _P, 1 / np.pi),
    Adapter("unreal", "Unreal FSHVectorRGB3", _UNREAL, _UNREAL_AXES, _P, 1.0),
    Adapter("z-up", "Z-up right-handed (Blender)", _Z_UP, _Z_UP_AXES, _C, 1.0),
    Adapter("arcore-positive", "ARCore, read as positive basis", _SAME, _OUR_AXES, _C, 1.0),
    Adapter("arcore-signed", "ARCore, read as signed basis", _SIGNED, _OUR_AXES, _C, 1.0),
    Adapter("arkit", "ARKit, planar R9 G9 B9", _SAME, _OUR_AXES, _P, 1.0),
]

#: Every known target by name.
ADAPTERS: dict[str, Adapter] = {adapter.name: adapter for adapter in _TABLE}


def adapter(name: str) -> Adapter:
    """Adapter by name; KeyError lists the known ones."""
    try:
        return ADAPTERS[name]
    except KeyError:
        raise KeyError(f"convert: no target {name!r}: known are {', '.join(ADAPTERS)}") from None
