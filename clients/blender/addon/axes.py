"""From the probe's axes to Blender's.

Probe: right-handed, +X right, +Y up, −Z forward. Blender: right-handed, +Z up. X = x, Y = −z, Z = y
(docs/users/conventions.md, row `z-up`): what lies ahead of the probe lies in Blender's +Y.
"""

from __future__ import annotations

import numpy as np
from lightprobe.convert import ADAPTERS
from lightprobe.geometry import Array, rotation_matrix
from numpy.typing import ArrayLike

#: (3, 3): Blender's vector = AXES @ the probe's. Orthogonal, so its transpose is its inverse.
AXES: Array = ADAPTERS["z-up"].axes


def to_blender(vectors: ArrayLike) -> Array:
    """Vectors (…, 3) of the probe's axes in Blender's."""
    return np.asarray(np.asarray(vectors, dtype=np.float64) @ AXES.T)


def to_probe(vectors: ArrayLike) -> Array:
    """Vectors (…, 3) of Blender's axes in the probe's."""
    return np.asarray(np.asarray(vectors, dtype=np.float64) @ AXES)


def blender_turn(orientation_xyzw: ArrayLike | None) -> Array:
    """Matrix (3, 3) of the same turn for vectors in Blender's axes."""
    return np.asarray(AXES @ turn(orientation_xyzw) @ AXES.T)


def turn(orientation_xyzw: ArrayLike | None) -> Array:
    """Matrix (3, 3) that turns the probe frame into the frame that does not move.

    `orientation_xyzw`: of an estimate or a reflection map; None: no turn.
    """
    if orientation_xyzw is None:
        return np.eye(3)
    x, y, z, w = np.asarray(orientation_xyzw, dtype=np.float64)
    return rotation_matrix([w, x, y, z])
