"""How much of each of many lights an object leaves to places on it and around it: shadow maps.

A shadow map (Williams 1978) is a picture of the object as a light sees it that holds depths; a
place is in shadow where the map is nearer to the light. Between four texels of the map the answer
is interpolated (percentage-closer filtering, Reeves et al. 1987). The map is made of points strewn
over the object, so its time does not depend on how many triangles there are. The exact answer,
lightprobe.bake.visibility, takes twenty times as long: too long for hundreds of lights at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, cross, normalize

#: Points strewn over the object, and texels of a map across it.
POINTS, TEXELS = 20_000, 64
#: A place is in shadow when the map is nearer to the light by more texels than this, over the
#: cosine of the light on the place: else it is the place itself.
_BIAS, _LEAST_COSINE = 1.5, 0.15

Single = NDArray[np.float32]


def strewn(
    vertices: Array, triangles: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], Array]:
    """Triangles (count,) and barycentric coordinates (count, 3) of points evenly over a surface.

    `vertices` (n, 3), `triangles` (m, 3). The points are the same at each call.
    """
    corners = vertices[triangles]
    area = np.linalg.norm(
        cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    along = np.cumsum(area)
    at = (np.arange(count) + 0.5) / count * along[-1]
    which = np.minimum(np.searchsorted(along, at), len(area) - 1)
    # Additive recurrence with the plastic number's powers (Roberts 2018): even in two dimensions.
    number = np.arange(1, count + 1)[:, None]
    s, t = ((0.5 + number * [0.7548776662466927, 0.5698402909980532]) % 1).T
    over = s + t > 1
    s, t = np.where(over, 1 - s, s), np.where(over, 1 - t, t)
    return np.asarray(which, np.int64), np.stack([1 - s - t, s, t], axis=1)


def seen(
    surface: Array, places: Array, normals: Array, directions: Array, beside: NDArray[np.bool_]
) -> Single:
    """Share (directions, places), 0 … 1, of each light that reaches each place.

    `surface` (M, 3): points strewn over the object; `places` (N, 3), `normals` (N, 3) unit;
    `directions` (D, 3) unit, towards the lights; `beside` (N,): places that are not of the object,
    so any part of it before them hides. Lights behind a place's surface count as
    seen. Units of length are whatever the places have.
    """
    middle = (surface.min(axis=0) + surface.max(axis=0)) / 2
    reach = float(np.linalg.norm(surface - middle, axis=1).max()) * 1.001
    texel = 2 * reach / TEXELS
    strewn_at = ((surface - middle) / texel).astype(np.float32)
    asked_at = ((places - middle) / texel).astype(np.float32)
    cosine = (directions @ normals.T).astype(np.float32)
    found = np.ones((len(directions), len(places)), np.float32)
    for k, direction in enumerate(directions):
        side = normalize(cross(direction, np.eye(3)[np.argmin(np.abs(direction))]))
        axes = np.stack([side, cross(direction, side), direction], axis=1).astype(np.float32)
        lit = np.flatnonzero(cosine[k] > 0)
        bias = _BIAS / np.maximum(cosine[k, lit], _LEAST_COSINE)
        bias[beside[lit]] = 0
        near, hidden = _hidden(strewn_at @ axes, asked_at[lit] @ axes, bias)
        found[k, lit[near]] -= hidden
    return found


def _hidden(surface: Single, asked: Single, bias: Single) -> tuple[NDArray[np.int64], Single]:
    """Which places are near the object in one light's map, and how much of it they lose.

    In texels, the light along axis 2.
    """
    width, half = TEXELS + 4, TEXELS / 2 + 2
    cell = (surface[:, :2] + half).astype(np.int32)
    depths = np.full(width * width, -np.inf, np.float32)
    np.maximum.at(depths, cell[:, 0] * width + cell[:, 1], surface[:, 2])
    at = asked[:, :2] + np.float32(half - 0.5)
    x, y = at[:, 0], at[:, 1]
    near = np.flatnonzero((x >= 0) & (x < width - 1) & (y >= 0) & (y < width - 1))
    x, y = x[near], y[near]
    row, column = x.astype(np.int32), y.astype(np.int32)
    u, v = x - row, y - column
    limit = asked[near, 2] + bias[near]
    index = row * width + column
    first = (1 - v) * (depths[index] > limit) + v * (depths[index + 1] > limit)
    index += width
    second = (1 - v) * (depths[index] > limit) + v * (depths[index + 1] > limit)
    return near, np.asarray(first + u * (second - first), np.float32)
