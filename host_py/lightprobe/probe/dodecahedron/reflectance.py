"""How much of a distant or near lamp's light a face sends to the camera, relative to white paper.

Paper is taken as Lambert's. A coated one is taken as R. Burley's (Disney 2012): his diffuse lobe,
and a layer of index 1.5 with the facets of GGX (B. Walter et al. 2007).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lightprobe.geometry import Array
from lightprobe.probe.dodecahedron.faces import Reading
from lightprobe.probe.paper import PAPER

#: Reflectance of the layer at normal incidence.
_F0 = 0.04


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of all pictures as arrays; frame of the estimate, lengths in edges."""

    normals: Array  # (N, 3)
    points: Array  # (N, P, 3) on each face, from the solid's centre
    towards_camera: Array  # (N, P, 3) unit
    roughness: float | None = None  # 0.05…1 of a coat; None: matt

    @classmethod
    def of(cls, readings: tuple[Reading, ...], roughness: float | None) -> Faces:
        """Those that were read."""
        points = np.stack([np.vstack([one.place, one.corners]) for one in readings])
        towards = np.stack([one.camera for one in readings])[:, None] - points
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        return cls(np.stack([one.normal for one in readings]), points, towards, roughness)

    def lit(self, direction: Array, nearness: float) -> Array:
        """(N,) irradiance by a lamp that gives 1 to a face before it in the solid's centre.

        `direction`: (3,) unit, towards the lamp. `nearness`: 1 / its distance, 0: far. The median
        over the points of a face, as the pictures have it; for a coat, what white paper would need
        to look the same.
        """
        towards = direction - self.points * nearness  # of a length that is relative to the lamp's
        length = np.linalg.norm(towards, axis=-1)
        light = towards / np.maximum(length, 1e-6)[..., None]
        cosine = np.maximum(np.einsum("npa,na->np", light, self.normals), 0)
        level = cosine / np.maximum(length, 1e-3) ** 2
        if self.roughness is not None:
            level = level * self._coated(light, cosine)
        return np.asarray(np.median(level, axis=1))

    def _coated(self, light: Array, cosine: Array) -> Array:
        """(N, P) radiance by a coat, of that by white paper."""
        rough = float(self.roughness or 0.0)
        view, camera = self.towards_camera, self._cosine
        half = light + view
        half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
        meets = np.einsum("npa,npa->np", half, light)
        bright = 2 * rough * meets**2 - 0.5
        diffuse = (1 + bright * (1 - cosine) ** 5) * (1 + bright * (1 - camera) ** 5)
        alpha2 = max(rough, 0.03) ** 4
        tip = np.einsum("npa,na->np", half, self.normals)
        facets = alpha2 / (np.pi * (tip**2 * (alpha2 - 1) + 1) ** 2)
        fresnel = _F0 + (1 - _F0) * (1 - np.clip(meets, 0, 1)) ** 5
        seen = [2 * c / (c + np.sqrt(alpha2 + (1 - alpha2) * c**2)) for c in (cosine, camera)]
        mirrored = facets * fresnel * seen[0] * seen[1] / np.maximum(4 * cosine * camera, 1e-4)
        return np.asarray(diffuse + np.pi / PAPER * mirrored)

    @cached_property
    def _cosine(self) -> Array:
        cosine = np.einsum("npa,na->np", self.towards_camera, self.normals)
        return np.asarray(np.clip(cosine, 0.02, 1))

    @cached_property
    def even(self) -> Array:
        """(N,) the same for light of irradiance 1 from everywhere.

        What the coat mirrors of it: B. Karis' fit (Unreal Engine for mobile, 2014).
        """
        if self.roughness is None:
            return np.ones(len(self.normals))
        rough, cosine = self.roughness, np.median(self._cosine, axis=1)
        r = [c0 * rough + c1 for c0, c1 in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04),
                                            (0.022, -0.04))]  # fmt: skip
        fit = np.minimum(r[0] ** 2, 2 ** (-9.28 * cosine)) * r[0] + r[1]
        mirrored = _F0 * (-1.04 * fit + r[2]) + 1.04 * fit + r[3]
        return np.asarray(1 + (rough - 0.5) * (1 - cosine) ** 5 + mirrored / PAPER)
