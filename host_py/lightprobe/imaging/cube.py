"""Cube maps for files: an estimate on six faces, faces as a cross, levels blurred for rough metal.

Faces (6, size, size, 3) are those of :mod:`lightprobe.reflection_map`: +X −X +Y −Y +Z −Z as OpenGL
has them, in the probe's axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe import reflection_map
from lightprobe.estimate import Estimate
from lightprobe.imaging.environment import lamp_of, rest_beside, without_negative

Faces = NDArray[np.float32]

#: Where each face lies in the cross, by row and column of faces, and how OpenGL's face is turned to
#: be seen from inside: [::1 or -1] of its rows and columns.
_CROSS = {
    0: (1, 2, 1, -1),  # +X: right
    1: (1, 0, 1, -1),  # −X: left
    2: (0, 1, -1, 1),  # +Y: above
    3: (2, 1, -1, 1),  # −Y: below
    4: (1, 3, 1, -1),  # +Z: behind
    5: (1, 1, 1, -1),  # −Z: in front
}


def cube_map(estimate: Estimate, size: int, *, lamps: bool = True) -> tuple[Faces, list[str]]:
    """Radiance of SH and lamps, in the estimate's units, and notes on it.

    Each lamp is a disc of its angular radius, or a texel's, that gives its irradiance; without
    `lamps` the SH alone.
    """
    directions, solid_angles = reflection_map.directions(size), reflection_map.solid_angles(size)
    if not lamps:
        return without_negative(estimate.sh.coefficients, directions)
    texel_deg = 90 / size
    drawn = np.zeros((*directions.shape[:-1], 3), np.float32)
    for light in estimate.beside_sh:
        lamp = lamp_of(light, texel_deg)
        narrow_deg = min(lamp.half_angle_deg or (lamp.radius_deg,))
        outside_deg = (lamp.place(directions) - 1) * narrow_deg
        share = np.clip(0.5 - outside_deg / texel_deg, 0, 1)  # the rim is a texel wide
        added = share[..., None] * light.irradiance / (share * solid_angles).sum()
        drawn += added.astype(np.float32)
    flux = (drawn * solid_angles[..., None]).reshape(-1, 3)
    rest, notes = rest_beside(estimate, directions.reshape(-1, 3), flux, directions)
    return rest + drawn, notes


def cross(faces: Faces) -> NDArray[np.float32]:
    """Horizontal cross (3 size, 4 size, 3): left, front, right, back in a row, as seen from inside.

    Front is −Z; above and below it are the top and the bottom. The corners are 0.
    """
    size = faces.shape[1]
    picture = np.zeros((3 * size, 4 * size, 3), np.float32)
    for face, (row, column, down, across) in _CROSS.items():
        place = np.s_[row * size : (row + 1) * size, column * size : (column + 1) * size]
        picture[place] = faces[face, ::down, ::across]
    return picture


def ggx_levels(faces: Faces, count: int) -> list[Faces]:
    """Levels for roughness 0 … 1 in even steps, each half the size of the one before.

    Each texel is what a rough mirror shows that is seen straight on: the mean of the radiance with
    the weight D(h) · cos, D: GGX with α = roughness² (Karis: Real Shading in Unreal Engine 4, 2013;
    Walter et al. 2007, (33)). Uniform light stays as it is.
    """
    size = faces.shape[1]
    towards = reflection_map.directions(size).reshape(-1, 3).T.astype(np.float32)
    flux = (faces * reflection_map.solid_angles(size)[..., None]).reshape(-1, 3).astype(np.float32)
    weight = reflection_map.solid_angles(size).reshape(-1, 1).astype(np.float32)
    given = np.hstack([flux, weight])
    levels = [faces]
    for level in range(1, count):
        normals = reflection_map.directions(size >> level).astype(np.float32)
        alpha = (level / (count - 1)) ** 2
        sums = np.stack([_ggx_sums(face.reshape(-1, 3), towards, given, alpha) for face in normals])
        levels.append((sums[..., :3] / sums[..., 3:]).reshape(normals.shape))
    return levels


def _ggx_sums(normals: Faces, towards: Faces, given: Faces, alpha: float) -> Faces:
    """Sums (n, k) of what is given (m, k) along `towards` (3, m), with the weights of a lobe.

    The normals (n, 3) are the directions of the eye and of the mirror image, too.
    """
    share = normals @ towards
    cosine = np.maximum(share, 0)
    # With half vectors of light and normal, (n·h)² = (1 + n·l) / 2.
    share += 1
    share *= (alpha**2 - 1) / 2
    share += 1
    share *= share
    return np.asarray((cosine / share) @ given)
