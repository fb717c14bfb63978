"""Pictures of an upright rod on a board, traced ray by ray: shares no code with the estimator.

World and camera as in ball_scene.py. The rod is a cylinder with a flat end. What of the light the
rod hides from a point of the board is counted over many directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from ball_scene import COLUMNS, ROWS, SQUARE_MM, Scene, lookup, panorama_directions

_STEP_MM = 1.0


def hides(points, directions, radius_mm, height_mm):
    """(N, D): whether the rod, which stands in the origin, is on the way from points (N, 2) of
    the plane y = 0 along directions (D, 3) that point up."""
    across = np.linalg.norm(directions[:, [0, 2]], axis=1)
    unit = directions[:, [0, 2]] / np.maximum(across, 1e-12)[:, None]
    along = -points @ unit.T  # how far to the point of the way that is nearest to the axis
    off2 = (points**2).sum(axis=1)[:, None] - along**2
    half2 = radius_mm**2 - off2
    # Where it meets the side first, or the end from below: the way is in the cylinder there.
    first = np.maximum(along - np.sqrt(np.maximum(half2, 0)), 0)
    leaves = along + np.sqrt(np.maximum(half2, 0))
    climbs = first * (directions[:, 1] / np.maximum(across, 1e-12))
    return (half2 > 0) & (leaves > 0) & (climbs < height_mm)


def bilinear(picture, row, column):
    """Values (N, 3) between the pixels of a picture; pixel (0, 0) is at 0, 0."""
    row = np.clip(row, 0, picture.shape[0] - 1.001)
    column = np.clip(column, 0, picture.shape[1] - 1.001)
    r, c = row.astype(int), column.astype(int)
    fr, fc = (row - r)[:, None], (column - c)[:, None]
    above = picture[r, c] * (1 - fc) + picture[r, c + 1] * fc
    below = picture[r + 1, c] * (1 - fc) + picture[r + 1, c + 1] * fc
    return above * (1 - fr) + below * fr


@dataclass
class RodScene(Scene):
    """A rod on a board in a room; `ball_mm` is its foot."""

    height_mm: float = 60.0
    grey: float = 0.3
    noise: float = 0.0  # of the paper's reflectance, 1 sigma
    seed: int = 0
    radius_mm: float = 4.0
    lean: tuple[float, float] = (0.0, 0.0)  # how far its axis goes right and down, by height

    def __post_init__(self):
        self.centre = np.array([self.ball_mm[0], self.height_mm, self.ball_mm[1]])  # of its end
        self.shear = np.array(self.lean)
        directions, row_sr = panorama_directions(self.panorama.shape[1])
        flux = self.panorama * row_sr[:, None, None]
        up = directions[..., 1] > 0
        lamps = up & (self.panorama.mean(axis=-1) > 20 * np.median(self.panorama))
        self.paper = self._paper(directions, flux, up, lamps)
        self.around = self.panorama_at_ball(1024)

    def _paper(self, directions, flux, up, lamps):
        """Radiance (rows, columns, 3) of white paper over the board, with the rod's shadows."""
        x = np.arange(-SQUARE_MM, (COLUMNS + 1) * SQUARE_MM, _STEP_MM) + _STEP_MM / 2
        z = np.arange(-SQUARE_MM, (ROWS + 1) * SQUARE_MM, _STEP_MM) + _STEP_MM / 2
        grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2) - np.array(self.ball_mm)
        rays, light = directions[lamps], flux[lamps] * directions[lamps][:, 1:2]
        # The rest of the sky in cells of 16 × 16 pixels.
        rest = np.where(lamps[..., None], 0, flux * np.maximum(directions[..., 1:2], 0))
        height, width = rest.shape[:2]
        cells = rest[: height // 2].reshape(height // 32, 16, width // 16, 16, 3).sum(axis=(1, 3))
        middles = directions[8 : height // 2 : 16, 8::16]
        rays = np.concatenate([rays, middles.reshape(-1, 3)])
        light = np.concatenate([light, cells.reshape(-1, 3)])
        total = light.sum(axis=0)
        # Seen along its own axis, a rod that leans stands upright.
        rays = rays.copy()
        rays[:, [0, 2]] -= rays[:, 1:2] * self.shear
        paper = np.empty((len(grid), 3))
        for part in np.array_split(np.arange(len(grid)), max(1, len(grid) // 2000)):
            hidden = hides(grid[part], rays, self.radius_mm, self.height_mm)
            paper[part] = total - hidden.astype(np.float32) @ light.astype(np.float32)
        random = np.random.default_rng(self.seed)
        paper *= 1 + self.noise * random.normal(size=(len(grid), 1))
        return 0.8 / np.pi * paper.reshape(len(z), len(x), 3)

    def far(self, origins, directions):
        """Radiance (N, 3) along rays (N, 3) that do not meet the rod."""
        radiance = lookup(self.panorama, directions)
        down = np.where(directions[:, 1] < -1e-9, directions[:, 1], -1)
        at = origins - (origins[:, 1] / down)[:, None] * directions
        x, z = at[:, 0] / SQUARE_MM, at[:, 2] / SQUARE_MM
        on = (directions[:, 1] < -1e-9) & (x > -1) & (x < COLUMNS + 1) & (z > -1) & (z < ROWS + 1)
        per_square = self.board.shape[1] / COLUMNS
        column, row = (np.floor(v[on] * per_square).astype(int) for v in (x, z))
        printed = (column >= 0) & (row >= 0)
        printed &= (column < self.board.shape[1]) & (row < self.board.shape[0])
        grey = np.ones(on.sum())
        grey[printed] = 0.04 + 0.96 * self.board[row[printed], column[printed]] / 255
        at_cell = [(v[on] + 1) * SQUARE_MM / _STEP_MM - 0.5 for v in (z, x)]
        radiance[on] = grey[:, None] * bilinear(self.paper, *at_cell)
        return radiance

    def radiance(self, eye, rays):
        """Radiance (N, 3) that the camera at `eye` (3,) gets along rays (N, 3)."""
        result = self.far(np.broadcast_to(eye, rays.shape), rays)
        flat = rays[:, [0, 2]] - rays[:, 1:2] * self.shear
        to = eye[[0, 2]] - np.array(self.ball_mm) - eye[1] * self.shear
        a, b = (flat**2).sum(axis=1), flat @ to
        under = b * b - a * (to @ to - self.radius_mm**2)
        t = (-b - np.sqrt(np.maximum(under, 0))) / np.maximum(a, 1e-12)
        y = eye[1] + t * rays[:, 1]
        side = (under > 0) & (t > 0) & (y > 0) & (y < self.height_mm)
        top_t = (self.height_mm - eye[1]) / np.where(rays[:, 1] < 0, rays[:, 1], -1)
        top = (rays[:, 1] < 0) & (
            np.sum((to + top_t[:, None] * flat) ** 2, axis=1) < self.radius_mm**2
        )
        result[side | top] = self.grey * self.paper.mean(axis=(0, 1))
        return result
