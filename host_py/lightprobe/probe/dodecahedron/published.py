"""Two published ways from a dodecahedron to the direction of its light, to compare with.

Both are as their authors describe them, with their gaps filled as stated. Neither has a sigma.
"""

from __future__ import annotations

import numpy as np

from lightprobe.geometry import Array

#: Faces that are equally bright, and a mean that is nearly black: the thesis gives no numbers.
EQUAL, NEARLY_BLACK = 0.02, 0.05


def straughn(normals: Array, luminance: Array) -> Array:
    """Direction (3,) of the light by Straughn's average.

    `normals`: (N, 3) of the faces that are seen, any frame. `luminance`: (N,) of each. Normals of
    faces in shadow are reversed, and all are averaged. When a face is in shadow is not published:
    here, below the middle of the darkest and the brightest.
    Source: Straughn's dodecahedron marker, as S. Biswas' thesis of 2020 describes it (chapter 2.5).
    """
    lit = luminance > (luminance.max() + luminance.min()) / 2
    return _unit(np.where(lit[:, None], normals, -normals).sum(axis=0), normals[luminance.argmax()])


def thesis(normals: Array, luminance: Array, full: float = 1.0) -> Array:
    """Direction (3,) of the light by the three rules of S. Biswas' thesis of 2020 (3.3).

    `normals`: (N, 3); `luminance`: (N,); `full`: luminance of the picture's white.
    1. Several faces are equally bright: the mean of their normals. 2. One is the brightest: the
    normal of its brightest part. 3. Their mean is nearly black: the brightest's normal, reversed.
    How equal and how black is not published: EQUAL and NEARLY_BLACK.

    A slip of the thesis: the parts of rule 2, five triangles at the corners and a circle in the
    middle, lie in the plane of the face. So they all have the face's normal, and which of them is
    the brightest changes nothing.
    """
    brightest = normals[luminance.argmax()]
    if luminance.mean() < NEARLY_BLACK * full:
        return np.asarray(-brightest)
    equal = luminance >= (1 - EQUAL) * luminance.max()
    return _unit(normals[equal].sum(axis=0), brightest)


def _unit(vector: Array, instead: Array) -> Array:
    """Its direction; `instead` when it has none."""
    length = float(np.linalg.norm(vector))
    return np.asarray(vector / length if length > 1e-9 else instead)
