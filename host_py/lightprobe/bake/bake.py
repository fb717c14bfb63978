"""Irradiance of a mesh's vertices with the mesh's own shadows: precomputed transfer of light.

Of vertex v with normal n the irradiance is E(v) = ∫ L(ω) V(v, ω) max(0, n·ω) dω, where V is 1 for
directions that the mesh does not hide. The light L of a packet is Σ c_i Y_i(ω) and lamps. So
E(v) = n · (Σ c_i T_i(v) + Σ E_k d_k V(v, d_k)) with T_i(v) = ∫ V ω Y_i(ω) dω over n·ω > 0: the
vector irradiance, of which T is prepared once (Sloan et al. 2002, for vectors). Light that the mesh
reflects onto itself is left out.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import sh
from lightprobe.bake import visibility
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array, disc_points

#: SH of a packet that a bake can take.
MAX_ORDER = 4
#: Directions around a lamp's between which its visibility is interpolated.
_NEIGHBOURS = 4
#: Points that stand for a lamp that is larger than the directions are apart.
_LARGE = 8
#: A vertex faces inward whose back sees more of the sky than its front, by this factor and share.
_INWARD = (1.3, 0.02)
_FIELDS = ("vertices", "normals", "triangles", "directions", "seen", "vectors", "inward")

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Bake:
    """A mesh that is ready to be lit. Its frame is that of the estimates, its unit the metre."""

    vertices: Array  # (n, 3)
    normals: Array  # (n, 3) unit vectors; 0: of no triangle
    triangles: NDArray[np.int64]  # (m, 3)
    directions: Array  # (N, 3) evenly over the sphere
    seen: NDArray[np.bool_]  # (N, n) before the surface and not hidden
    vectors: Single  # (coefficients, 3, n) T of each coefficient
    inward: NDArray[np.bool_]  # (n,) vertices whose triangles seem to face inward

    @classmethod
    def of_mesh(
        cls,
        vertices: ArrayLike,
        normals: ArrayLike,
        triangles: ArrayLike,
        direction_count: int = 1024,
        progress: Callable[[int, int], None] | None = None,
    ) -> Bake:
        """Prepare a mesh; takes some seconds for 10 000 vertices.

        `direction_count` is even; more give finer shadows, for more memory (a byte per vertex and
        direction) and time.
        """
        v, n = np.asarray(vertices, np.float64), np.asarray(normals, np.float64)
        t = np.asarray(triangles, np.int64)
        ω = visibility.directions(direction_count)
        cosine = ω @ n.T
        unhidden = visibility.visible(v, t, ω[: len(ω) // 2], progress)
        seen = unhidden & (cosine > 0)
        front = np.maximum(cosine, 0, where=unhidden, out=np.zeros_like(cosine)).mean(axis=0)
        back = np.maximum(-cosine, 0, where=unhidden, out=np.zeros_like(cosine)).mean(axis=0)
        inward = back > _INWARD[0] * front + _INWARD[1] / 4  # 1/4: mean of a sky that is all seen
        basis = sh.evaluate(MAX_ORDER, ω) * (4 * np.pi / len(ω))
        vectors = np.empty((basis.shape[1], 3, len(v)), np.float32)
        light = seen.astype(np.float32)
        for axis in range(3):
            vectors[:, axis] = (basis * ω[:, axis, None]).T.astype(np.float32) @ light
        return cls(v, n, t, ω, seen, vectors, inward)

    def vector_irradiance(self, estimate: Estimate) -> Array:
        """Vector irradiance (n, 3 channels, 3 axes); times the normal it is the irradiance."""
        c = estimate.sh.coefficients
        found: Array = np.einsum("ikn,ic->nck", self.vectors[: len(c)], c)
        for light in estimate.beside_sh:
            came = np.multiply.outer(self._sees(light), light.irradiance)
            found += came[..., None] * light.direction
        return found

    def irradiance(self, estimate: Estimate) -> Array:
        """Irradiance (n, 3) of the vertices; times albedo/π it is their radiance. Never below 0."""
        c = estimate.sh.coefficients.astype(np.float32)
        found = np.maximum(self._transfer()[:, : len(c)] @ c, 0)
        for light in estimate.beside_sh:
            cosine = np.maximum(self._single_normals() @ light.direction.astype(np.float32), 0)
            falls = cosine * self._sees(light)
            found += np.multiply.outer(falls, light.irradiance.astype(np.float32))
        return np.asarray(found, np.float64)

    def encode(self) -> bytes:
        """Give a .npz file."""
        packed = {name: getattr(self, name) for name in _FIELDS}
        packed["seen"] = np.packbits(self.seen, axis=0)
        out = io.BytesIO()
        np.savez(out, allow_pickle=False, **packed)
        return out.getvalue()

    @classmethod
    def load(cls, file: Path) -> Bake:
        """Read a file of what `encode` gives; raises UsageError."""
        try:
            with np.load(file, allow_pickle=False) as saved:
                fields = {name: saved[name] for name in _FIELDS}
            count = len(fields["directions"])
            fields["seen"] = np.unpackbits(fields["seen"], axis=0, count=count).astype(np.bool_)
            bake = cls(**fields)
            if bake.seen.shape != (count, len(bake.normals)) or bake.vectors.shape != (
                sh.count(MAX_ORDER), 3, len(bake.vertices),
            ):  # fmt: skip
                raise ValueError("sizes that do not fit each other")
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise UsageError(f"bake: {file}: not a baked mesh: {error}: bake it again") from error
        return bake

    def _sees(self, light: Light) -> Single:
        """Share (n,) of a light that the mesh does not hide from the vertices.

        Between the prepared directions it is interpolated; those behind a vertex's surface tell
        nothing of it.
        """
        cosine = self.directions @ self._points(light).T
        order = np.argpartition(-cosine, _NEIGHBOURS, axis=0)[: _NEIGHBOURS + 1]
        near = np.take_along_axis(cosine, order, axis=0)
        weights = np.zeros(len(self.directions), np.float32)
        np.add.at(weights, order, near - near.min(axis=0) + 1e-9)
        used = np.flatnonzero(weights)
        towards = self.directions[used].astype(np.float32)
        known = (self._single_normals() @ towards.T > 0) @ weights[used]
        sees = weights[used] @ self.seen[used]
        shares: Single = np.divide(sees, known, out=np.zeros_like(known), where=known > 0)
        return shares

    def _points(self, light: Light) -> Array:
        """Directions (k, 3) that stand for a light's disc."""
        apart_deg = np.degrees(np.sqrt(4 * np.pi / len(self.directions)))
        if light.angular_radius_deg < apart_deg:
            return np.asarray(light.direction, np.float64)[None]
        return disc_points(light.direction, light.angular_radius_deg, _LARGE)

    def _single_normals(self) -> Single:
        return self._cached("_normals32", lambda: self.normals.astype(np.float32))

    def _transfer(self) -> Single:
        """Transfer (n, coefficients) from radiance to irradiance."""
        return self._cached(
            "_transfer32",
            lambda: np.ascontiguousarray(np.einsum("ikn,nk->ni", self.vectors, self.normals)),
        )

    def _cached(self, name: str, make: Callable[[], NDArray[np.generic]]) -> Single:
        if name not in self.__dict__:
            object.__setattr__(self, name, make().astype(np.float32))
        found: Single = self.__dict__[name]
        return found
