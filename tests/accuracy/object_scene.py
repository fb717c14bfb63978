"""Pictures of balls and boxes on a board, traced ray by ray: shares no code with the estimator.

World and camera as in ball_scene.py. Light comes from a panorama infinitely far away, from the
board with the shadows on it, and from the things themselves, once. The estimator gets a mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh
from ball_scene import COLUMNS, ROWS, SQUARE_MM, fibonacci, lookup, panorama_directions, unit
from rod_scene import bilinear
from scipy.spatial import cKDTree

_PAIRS = 4_000_000


@dataclass
class Ball:
    """A sphere."""

    centre: np.ndarray
    radius: float

    def hit(self, origins, rays):
        """How far along the rays (N, 3) it is first met (N,); infinite: never."""
        to = origins - self.centre
        b = np.sum(to * rays, axis=-1)
        under = b * b - (np.sum(to * to, axis=-1) - self.radius**2)
        root = np.sqrt(np.maximum(under, 0))
        t = np.where(-b - root > 1e-3, -b - root, -b + root)
        # From a point of its own surface outward it is not met.
        own = np.abs(np.sum(to * to, axis=-1) - self.radius**2) < 1e-3 * self.radius**2
        return np.where((under > 0) & (t > 1e-3) & ~(own & (b > 0)), t, np.inf)

    def hides(self, points, rays):
        """(N, D): whether it is on the way from points (N, 3), on it or beside, along rays."""
        to = points - self.centre
        b = (to @ rays.T).astype(np.float32)
        beyond = np.sum(to * to, axis=1) - self.radius**2
        own = np.abs(beyond) < 1e-3 * self.radius**2
        limit = np.where(own, 0, np.maximum(beyond, 0)).astype(np.float32)[:, None]
        return (b < -1e-3) & (b * b > limit)

    def normals(self, points):
        """At points (N, 3) of it."""
        return (points - self.centre) / self.radius

    def points(self, count):
        """So many points over its surface."""
        return self.centre + self.radius * fibonacci(count)

    def mesh(self, detail=4):
        """Triangles, millimetres."""
        ball = trimesh.creation.icosphere(detail, self.radius)
        ball.apply_translation(self.centre)
        return ball


@dataclass
class Box:
    """A box that is turned about the upright axis."""

    centre: np.ndarray
    half: np.ndarray
    turn: float = 0.0

    def __post_init__(self):
        c, s = np.cos(self.turn), np.sin(self.turn)
        self.axes = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # columns: its axes

    def hit(self, origins, rays):
        """How far along the rays (N, 3) it is first met (N,); infinite: never."""
        o, d = (origins - self.centre) @ self.axes, rays @ self.axes
        d = np.where(np.abs(d) < 1e-12, 1e-12, d)
        a, b = (-self.half - o) / d, (self.half - o) / d
        near, far = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        return np.where((near < far - 1e-6) & (near > 1e-3), near, np.inf)

    def hides(self, points, rays):
        """(N, D): whether it is on the way from points (N, 3), on it or beside, along rays."""
        o = ((points - self.centre) @ self.axes).astype(np.float32)
        inverse = rays @ self.axes
        inverse = (1 / np.where(np.abs(inverse) < 1e-9, 1e-9, inverse)).astype(np.float32)
        near, far = np.float32(1e-2), np.float32(np.inf)
        for k in range(3):
            a = np.multiply.outer(-self.half[k].astype(np.float32) - o[:, k], inverse[:, k])
            b = np.multiply.outer(self.half[k].astype(np.float32) - o[:, k], inverse[:, k])
            near, far = np.maximum(near, np.minimum(a, b)), np.minimum(far, np.maximum(a, b))
        return near < far - 1e-3

    def normals(self, points):
        """At points (N, 3) of it."""
        local = (points - self.centre) @ self.axes / self.half
        axis = np.abs(local).argmax(axis=1)
        rows = np.arange(len(points))
        found = np.zeros_like(points)
        found[rows, axis] = np.sign(local[rows, axis])
        return found @ self.axes.T

    def points(self, count):
        """So many points over its surface."""
        grid = np.random.default_rng(0).uniform(-1, 1, (count, 3))
        rows = np.arange(count)
        grid[rows, rows % 3] = np.where(rows // 3 % 2, 1.0, -1.0)
        return self.centre + grid * self.half @ self.axes.T

    def mesh(self, detail=4):
        """Triangles, millimetres."""
        box = trimesh.creation.box(2 * self.half)
        box.unmerge_vertices()
        turned = np.eye(4)
        turned[:3, :3], turned[:3, 3] = self.axes, self.centre
        return box.apply_transform(turned)


def still_life(seed, foot=(130.0, 100.0)):
    """A ball, a box and a smaller ball beside each other about a foot: things, in millimetres."""
    random = np.random.default_rng(seed)
    x, z = foot
    angle = random.uniform(0, 2 * np.pi)
    away = [np.array([np.cos(angle + k * 2.1), 0, np.sin(angle + k * 2.1)]) for k in range(3)]
    ball, small = random.uniform(16, 20), random.uniform(8, 11)
    half = np.array([random.uniform(8, 11), random.uniform(14, 20), random.uniform(8, 11)])
    at = np.array([x, 0, z])
    return [
        Ball(at + 18 * away[0] + [0, ball, 0], ball),
        Box(at + 20 * away[1] + [0, half[1], 0], half, random.uniform(0, np.pi)),
        Ball(at + 20 * away[2] + [0, small, 0], small),
    ]


@dataclass
class ObjectScene:
    """Matt things on a board in a room."""

    panorama: np.ndarray  # (H, 2H, 3) radiance
    board: np.ndarray  # grey picture of it, 0…255
    things: list
    albedo: tuple = (0.8, 0.8, 0.8)
    bounces: bool = True  # light that the things throw on the paper and on each other
    texture: float = 0.0  # depth of stripes of the things' albedo
    step_mm: float = 2.0  # between the places of the board whose light is counted
    gathered: int = 400  # directions over the sphere for light by way of board and things
    centre: np.ndarray = field(init=False)

    def __post_init__(self):
        lows, highs = zip(*((t.mesh(1).bounds) for t in self.things), strict=True)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        self.centre, self.radius_mm = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self._sources()
        x = np.arange(-SQUARE_MM, (COLUMNS + 1) * SQUARE_MM, self.step_mm) + self.step_mm / 2
        z = np.arange(-SQUARE_MM, (ROWS + 1) * SQUARE_MM, self.step_mm) + self.step_mm / 2
        gx, gz = np.meshgrid(x, z)
        self.grid = np.stack([gx.ravel(), 0 * gx.ravel(), gz.ravel()], axis=1)
        up = np.tile([0.0, 1, 0], (len(self.grid), 1))
        self.shape = len(z), len(x)
        self._glow(np.zeros((0, 3)), np.zeros((0, 3)))
        light = self._direct(self.grid, up)
        self._paper(light)
        self.even = self.paper[:1, :1].reshape(1, 3)  # far from the things
        if self.bounces:
            points = np.concatenate([t.points(400) for t in self.things])
            normals = np.concatenate([t.normals(t.points(400)) for t in self.things])
            self._glow(points, np.array(self.albedo) / np.pi * self.irradiance_at(points, normals))
            self._paper(light + self._from_things(self.grid, up, upward=True))

    def _sources(self):
        """Directions and flux (N, 3) of the light above: lamps finely, the rest in blocks."""
        directions, row_sr = panorama_directions(self.panorama.shape[1])
        flux = self.panorama * row_sr[:, None, None]
        bright = self.panorama.mean(axis=-1)
        lamps = (directions[..., 1] > 0) & (bright > 8 * np.median(bright))
        rest = np.where(lamps[..., None], 0, flux)
        height, width = rest.shape[:2]
        side = max(1, width // 64)
        rows = height // 2 // side
        rest = rest[: height // 2].reshape(rows, side, width // side, side, 3).sum(axis=(1, 3))
        middles = directions[side // 2 : height // 2 : side, side // 2 :: side].reshape(-1, 3)
        self.rays = np.concatenate([directions[lamps], middles])
        self.flux = np.concatenate([flux[lamps], rest.reshape(-1, 3)])

    def _hidden(self, points, rays):
        """(N, D): whether a thing is on the way from points (N, 3) along rays (D, 3)."""
        found = np.zeros((len(points), len(rays)), bool)
        for thing in self.things:
            found |= thing.hides(points, rays)
        return found

    def _direct(self, points, normals):
        """Irradiance (N, 3) by the panorama above the table."""
        made = np.empty((len(points), 3))
        step = max(1, _PAIRS // len(self.rays))
        for part in np.split(np.arange(len(points)), range(step, len(points), step)):
            cosine = np.maximum(normals[part] @ self.rays.T, 0)
            made[part] = (cosine * ~self._hidden(points[part], self.rays)) @ self.flux
        return made

    def _glow(self, points, radiance):
        self.tree, self.shine = (cKDTree(points) if len(points) else None), radiance

    def _paper(self, irradiance):
        self.paper = 0.8 / np.pi * irradiance.reshape(*self.shape, 3)

    def _from_things(self, points, normals, upward):
        """Irradiance (N, 3) by light that things throw there."""
        made = np.zeros((len(points), 3))
        if self.tree is None:
            return made
        near = np.flatnonzero(np.linalg.norm(points - self.centre, axis=1) < 4 * self.radius_mm)
        rays = fibonacci(self.gathered)
        rays = rays[rays[:, 1] > 0] if upward else rays
        for ray in rays:
            cosine = normals[near] @ ray
            rows = near[cosine > 0]
            t, shine = self._met(points[rows] + 1e-2 * normals[rows], ray)
            hit = np.isfinite(t)
            made[rows[hit]] += (cosine[cosine > 0][hit] * 4 * np.pi / self.gathered)[
                :, None
            ] * shine[hit]
        return made

    def _met(self, origins, ray):
        """How far things are along one ray, and their radiance there (N, 3)."""
        t = np.min([thing.hit(origins, ray) for thing in self.things], axis=0)
        shine = np.zeros((len(origins), 3))
        hit = np.isfinite(t)
        if hit.any() and self.tree is not None:
            shine[hit] = self.shine[self.tree.query(origins[hit] + t[hit, None] * ray)[1]]
        return t, shine

    def _from_below(self, points, normals):
        """Irradiance (N, 3) by board and table."""
        made = np.zeros((len(points), 3))
        rays = fibonacci(self.gathered)
        for ray in rays[rays[:, 1] < 0]:
            cosine = np.maximum(normals @ ray, 0)
            rows = np.flatnonzero(cosine > 0)
            t, _ = self._met(points[rows] + 1e-2 * normals[rows], ray)
            free = rows[~np.isfinite(t)]
            seen = self.far(points[free], np.broadcast_to(ray, (len(free), 3)), smooth=True)
            made[free] += (cosine[free] * 4 * np.pi / self.gathered)[:, None] * seen
        return made

    def irradiance_at(self, points, normals):
        """Irradiance (N, 3) of places with normals (N, 3) on things."""
        made = self._direct(points, normals) + self._from_below(points, normals)
        return made + self._from_things(points, normals, upward=False)

    def far(self, origins, directions, smooth=False, empty=False):
        """Radiance (N, 3) along rays (N, 3) that meet no thing.

        `smooth`: the board is even grey; `empty`: without shadows.
        """
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
        if smooth:
            grey[printed] = 0.04 / 0.8 + (1 - 0.04 / 0.8) * self.board.mean() / 255
        else:
            shade = self.board[row[printed], column[printed]] / 255
            grey[printed] = 0.04 / 0.8 + (1 - 0.04 / 0.8) * shade
        at_cell = [(v[on] + 1) * SQUARE_MM / self.step_mm - 0.5 for v in (z, x)]
        light = self.even if empty else bilinear(self.paper, *at_cell)
        radiance[on] = grey[:, None] * light
        return radiance

    def first(self, eye, rays):
        """Places (N, 3) and normals where rays (N, 3) from the eye first meet things; NaN."""
        origins = np.broadcast_to(eye, rays.shape)
        all_t = np.stack([thing.hit(origins, rays) for thing in self.things])
        t, which = all_t.min(axis=0), all_t.argmin(axis=0)
        points = eye + np.where(np.isfinite(t), t, np.nan)[:, None] * rays
        normals = np.full_like(points, np.nan)
        for k, thing in enumerate(self.things):
            mine = np.isfinite(t) & (which == k)
            if mine.any():
                normals[mine] = thing.normals(points[mine])
        return points, normals

    def reflectance(self, points):
        """(N, 3): of things at points."""
        stripes = 1 - self.texture * (np.sin(points.sum(axis=1) * 0.8) > 0)
        return np.array(self.albedo) * stripes[:, None]

    def picture(self, camera):
        """Radiance (H, W, 3): the board with four rays a pixel, things with one."""
        found = np.empty((camera.height, camera.width, 3))
        x = (np.arange(camera.width * 2) + 0.5) / 2
        for top in range(0, camera.height, 24):
            rows = min(24, camera.height - top)
            grid = np.meshgrid(x, top + (np.arange(rows * 2) + 0.5) / 2)
            rays = camera.rays(*grid)
            seen = self.far(np.broadcast_to(camera.eye, rays.shape), rays)
            part = seen.reshape(rows, 2, camera.width, 2, 3)
            found[top : top + rows] = part.mean(axis=(1, 3))
        grid = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        points, normals = self.first(camera.eye, camera.rays(*grid))
        thing = np.isfinite(points[:, 0])
        light = self.irradiance_at(points[thing], normals[thing])
        flat = found.reshape(-1, 3)
        flat[thing] = self.reflectance(points[thing]) / np.pi * light
        return found, thing.reshape(found.shape[:2])

    def shown(self, camera, x, y):
        """Radiance (N, 3) in the middles of pixels at x, y (N,)."""
        rays = camera.rays(x, y)
        found = self.far(np.broadcast_to(camera.eye, rays.shape), rays)
        points, normals = self.first(camera.eye, rays)
        thing = np.isfinite(points[:, 0])
        light = self.irradiance_at(points[thing], normals[thing])
        found[thing] = self.reflectance(points[thing]) / np.pi * light
        return found

    def around(self, width=256):
        """What a probe without a size sees in the middle of the things, were they not there."""
        directions = panorama_directions(width)[0].reshape(-1, 3)
        seen = self.far(
            np.broadcast_to(self.centre, directions.shape), directions, smooth=True, empty=True
        )
        return seen.reshape(width // 2, width, 3)

    def irradiance(self, normals):
        """Irradiance (N, 3) in the middle of the things: the truth."""
        around = self.around()
        directions, row_sr = panorama_directions(around.shape[1])
        flux = (around * row_sr[:, None, None]).reshape(-1, 3)
        return np.maximum(normals @ directions.reshape(-1, 3).T, 0) @ flux

    def mesh(self, detail=3):
        """The things as one mesh, metres, its origin under their middle."""
        whole = trimesh.util.concatenate([thing.mesh(detail) for thing in self.things])
        whole.apply_translation(-self.centre * [1, 0, 1])
        whole.apply_scale(1e-3)
        return whole


def area_lights(random, count, sr, width=256):
    """A panorama of `count` square lights of so many sr each above, and .03 of even light."""
    directions = panorama_directions(width)[0]
    picture = np.full((*directions.shape[:2], 3), 0.03)
    side = np.sqrt(sr)  # about; made exact below
    for _ in range(count):
        toward = random.normal(size=3)
        toward[1] = abs(toward[1]) + 0.15
        toward = unit(toward)
        across = unit(np.cross(toward, random.normal(size=3)))
        other = np.cross(toward, across)
        ahead = directions @ toward
        u, v = (np.abs(directions @ axis) / np.maximum(ahead, 1e-9) for axis in (across, other))
        low, high = 0.0, 50.0
        for _ in range(50):  # half the side of the square of that solid angle
            side = (low + high) / 2
            s2 = side * side
            low, high = (side, high) if 4 * np.arcsin(s2 / (1 + s2)) < sr else (low, side)
        lit = (ahead > 0) & (u < side) & (v < side)
        picture[lit] += random.uniform(0.5, 1.5) if count > 1 else 1.0
    return picture
