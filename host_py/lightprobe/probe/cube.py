"""Light as the texels of a cube, and the non-negative light of few edges that explains samples.

Six faces of 8×8 texels are 384 lights. They are found from linear equations: the least squares of
what is seen, no light below zero, and as few steps between neighbours as that allows (total
variation; Rudin, Osher, Fatemi 1992), by the alternating direction method of multipliers (Boyd et
al. 2011).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from lightprobe.geometry import Array

#: Texels along an edge of the cube.
SIDE = 8
#: Directions that a texel's light comes from, along its edge.
PARTS = 2
#: Steps of the solver: with these the light differs from that of ten times as many by far less
#: than its sigma.
_STEPS = 80
_RELAX = 1.6
#: In the covariance, a step between neighbours costs as one of so many times the mean light: lamps
#: are steps, wherever they are.
_NO_STEP = 10.0


@functools.cache
def texels(side: int = SIDE) -> tuple[Array, Array]:
    """Directions (6 · side², 3), unit, and solid angles (6 · side²,) in sr of the texels.

    Texels of a face follow each other; the second half of all is opposite to the first.
    """
    edges = np.linspace(-1, 1, side + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    s, t = (part.ravel() for part in np.meshgrid(middle, middle, indexing="ij"))
    one = np.ones_like(s)
    half = np.concatenate([
        np.stack(face, axis=1) for face in ((one, s, t), (s, one, t), (s, t, one))
    ])  # fmt: skip

    def corner(x: Array, y: Array) -> Array:  # of a face, from its middle (exact)
        return np.asarray(np.arctan2(x * y, np.sqrt(x * x + y * y + 1)))

    x, y = np.meshgrid(edges, edges, indexing="ij")
    at = corner(x, y)
    face = (at[1:, 1:] - at[:-1, 1:] - at[1:, :-1] + at[:-1, :-1]).ravel()
    both = np.concatenate([half, -half])
    return both / np.linalg.norm(both, axis=1, keepdims=True), np.tile(face, 6)


def nearest(directions: Array, side: int = SIDE) -> Array:
    """Index (N,) of the texel that holds each direction (N, 3)."""
    axis = np.argmax(np.abs(directions), axis=1)
    rows = np.arange(len(directions))
    ahead = directions[rows, axis]
    others = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    # The second half is the first, mirrored in the middle.
    s, t = (directions[rows, others[:, k]] / ahead for k in (0, 1))
    i, j = (np.clip(((v + 1) / 2 * side).astype(int), 0, side - 1) for v in (s, t))
    return np.asarray((axis + 3 * (ahead < 0)) * side * side + i * side + j)


@functools.cache
def neighbours() -> Array:
    """Pairs (E, 2) of texels that share an edge and are both above the horizon, or both below."""
    directions, _ = texels()
    step = 1.0 / SIDE
    axis = np.argmax(np.abs(directions), axis=1)
    on_cube = directions / np.abs(directions[np.arange(len(axis)), axis])[:, None]
    pairs = set()
    for way in np.eye(3):
        for sign in (-1, 1):
            moved = on_cube + sign * 2 * step * way
            beyond = np.abs(moved @ way) > 1  # round the cube's edge: as far down its other side
            off_axis = np.abs(on_cube @ way) < 1 - 1e-9
            inward = np.zeros_like(moved)
            inward[np.arange(len(axis)), axis] = np.sign(on_cube[np.arange(len(axis)), axis])
            moved[beyond] -= step * inward[beyond]
            moved[beyond] -= sign * step * way  # onto the other face
            other = nearest(moved)
            for i in np.flatnonzero(off_axis & (other != np.arange(len(other)))):
                pairs.add((min(i, other[i]), max(i, other[i])))
    found = np.array(sorted(pairs))
    up = directions[:, 1] > 0
    return np.asarray(found[up[found[:, 0]] == up[found[:, 1]]])


@dataclass(frozen=True, eq=False)
class Prior:
    """What is taken of the light before anything is seen; light 1 is about its mean."""

    steps: float  # cost of a step of 1 between neighbours
    expected: Array  # (L, 3) light of each texel where nothing else tells
    precision: Array  # (L,) 1 / variance of that


def _differences() -> Array:
    """(E, L): the step of each pair of neighbours."""
    pairs = neighbours()
    rows = np.zeros((len(pairs), 6 * SIDE * SIDE))
    rows[np.arange(len(pairs)), pairs[:, 0]] = 1
    rows[np.arange(len(pairs)), pairs[:, 1]] = -1
    return rows


def solve(gram: Array, right: Array, prior: Prior, begin: Array | None = None) -> Array:
    """Light (L, 3) that is nowhere negative, of the least cost.

    `gram` (L, L) and `right` (L, 3): of the equations A x = y, each divided by its sigma, AᵀA and
    Aᵀy. The steps of the three channels count together, so that edges are where they are in all.
    The cost is ½|Ax − y|² + steps · Σ|x_i − x_j| + ½ Σ precision (x − expected)².
    """
    rows = csr_array(_differences())
    light = prior.expected if begin is None else begin
    penalty = max(float(np.median(np.diag(gram))), 1.0) * 0.3
    penalty_steps, back = penalty, csr_array(rows.T)
    matrix = gram + np.diag(prior.precision + penalty) + penalty_steps * (back @ rows).toarray()
    inverse = cho_solve(cho_factor(matrix), np.eye(len(matrix)))
    fixed = right + prior.precision[:, None] * prior.expected
    above, steps = np.maximum(light, 0), rows @ light
    above_off, steps_off = np.zeros_like(above), np.zeros_like(steps)
    for _ in range(_STEPS):
        light = inverse @ (fixed + penalty * (above - above_off)
                           + penalty_steps * (back @ (steps - steps_off)))  # fmt: skip
        near = _RELAX * light + (1 - _RELAX) * above
        above = np.maximum(near + above_off, 0)
        above_off += near - above
        near = _RELAX * (rows @ light) + (1 - _RELAX) * steps
        size = np.linalg.norm(near + steps_off, axis=1, keepdims=True)
        shrunk = 1 - prior.steps / penalty_steps / np.maximum(size, 1e-30)
        steps = np.maximum(shrunk, 0) * (near + steps_off)
        steps_off += near - steps
    return np.asarray(above)


def covariance(gram: Array, light: Array, prior: Prior) -> Array:
    """Covariance (L, L) of the mean of the channels of light (L, 3) that `solve` found.

    The cost of a step is taken as the parabola that touches it where the light is. That no light is
    negative makes it smaller still, and is left out.
    """
    rows = _differences()
    size = np.linalg.norm(rows @ light, axis=1)
    curve = prior.steps / np.maximum(size, _NO_STEP * max(float(light.mean()), 1e-12))
    return np.asarray(np.linalg.inv(
        gram + np.diag(prior.precision) + (rows.T * curve) @ rows
    ))  # fmt: skip
