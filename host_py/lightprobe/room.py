"""The room as a box: what it makes of the ambient light and of reflections beside the probe.

The formula is in docs/users/conventions.md, "Light at a place".
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from lightprobe import sh as harmonics
from lightprobe.estimate import Room
from lightprobe.geometry import Array, fibonacci_sphere, rotation_matrix

#: Directions in which the light is looked up.
DIRECTIONS = 128
#: A place beyond a wall, or closer to it, is taken to be at this share of the way to it.
WITHIN = 0.95


@cache
def _directions() -> Array:
    """Give a Fibonacci sphere: (DIRECTIONS, 3)."""
    return fibonacci_sphere(DIRECTIONS)


@cache
def _basis(order: int) -> Array:
    """Y_i of the directions: (DIRECTIONS, (order+1)²)."""
    return harmonics.evaluate(order, _directions())


def _turn(room: Room) -> Array:
    """Give the matrix that turns the box's axes into the packet's frame."""
    x, y, z, w = room.orientation
    return rotation_matrix((w, x, y, z))


def _inside(room: Room, offset_m: Array) -> Array:
    """Give the place in the box's axes, within the walls."""
    walls_m = room.walls_m.reshape(3, 2)
    return np.clip(offset_m @ _turn(room), -WITHIN * walls_m[:, 0], WITHIN * walls_m[:, 1])


def seen(room: Room, offset_m: Array, towards: Array) -> Array:
    """Give where the probe sees the points of the walls that a place sees: unit vectors (n, 3).

    `offset_m` (3,) is the place, in metres from the probe; `towards` (n, 3) are where it looks. All
    are in the packet's frame.
    """
    place_m, turn = _inside(room, offset_m), _turn(room)
    rays = towards @ turn  # in the box's axes
    walls_m = np.where(rays > 0, room.walls_m[1::2], -room.walls_m[::2])
    with np.errstate(divide="ignore"):
        ways_m = np.where(rays == 0, np.inf, (walls_m - place_m) / rays).min(axis=1)
    hits_m = place_m + ways_m[:, None] * rays
    return np.asarray(hits_m / np.linalg.norm(hits_m, axis=1, keepdims=True) @ turn.T)


def moved(coefficients: Array, room: Room, offset_m: Array) -> Array:
    """Give the SH ((order+1)², 3) at `offset_m` (3,): metres from the probe, the packet's frame."""
    order = harmonics.order_of(coefficients)
    here = _basis(order)
    there = harmonics.evaluate(order, seen(room, offset_m, _directions()))
    change = (there - here) @ coefficients
    return np.asarray(coefficients + 4 * math.pi / DIRECTIONS * here.T @ change)


def room_at(room: Room, offset_m: Array) -> Room:
    """Give the room as it is from `offset_m` (3,)."""
    place_m = _inside(room, offset_m)
    walls_m = room.walls_m + np.stack([place_m, -place_m], axis=-1).reshape(6)
    return Room(walls_m, room.walls_sigma_m, room.orientation, room.error_per_m)
