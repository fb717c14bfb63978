"""Pictures of a paper dodecahedron, traced ray by ray: shares no code with the estimator.

World and camera as in ball_scene.py. The solid is folded here from the two sheets as they are
printed: sheet 1 has the upper face in its middle, whose top on the paper is towards −Z; sheet 2 the
lower one, whose top is towards +Z.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from ball_scene import Scene, unit

FACES = 12
#: Of an edge: from a face's centre to its edges, and from the solid's centre to its faces.
APOTHEM = np.sqrt(1 / 4 + 1 / (2 * np.sqrt(5)))
INRADIUS = np.sqrt(5 / 8 + 11 / (8 * np.sqrt(5)))
PX_PER_MM = 10.0
ALBEDO, F0 = 0.8, 0.04


def pages(net, edge_mm):
    """Grey pictures 0…1 of the two sheets, as a printer gets them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    found = []
    for index in range(2):
        canvas = FigureCanvasAgg(net.figure(index, edge_mm))
        canvas.figure.set_dpi(25.4 * PX_PER_MM)
        canvas.draw()
        found.append(np.asarray(canvas.buffer_rgba())[..., :3].mean(axis=-1) / 255)
    return found


@dataclass(frozen=True)
class Folded:
    """A face: on which sheet it is, and how points of it get there; in edges."""

    sheet: int
    normal: np.ndarray
    origin: np.ndarray  # the point of the solid that is at `at` on the sheet
    at: np.ndarray  # (2,) from the sheet's middle, right and up
    right: np.ndarray  # (3,) that goes right on the sheet
    up: np.ndarray


def fold():
    """All faces; the estimator's numbers are not known here."""
    found = []
    for sheet, side in ((0, 1.0), (1, -1.0)):
        # On the sheet: x right, y up. In the world: +X, and −Z of the upper face, +Z of the lower.
        def world(x, y, side=side):
            return np.array([x, 0.0, -side * y])

        top = np.array([0, side, 0.0])
        found.append(Folded(sheet, top, INRADIUS * top, np.zeros(2), world(1, 0), world(0, 1)))
        for k in range(5):
            turn = np.radians(90 + 36 + 72 * k)
            outward, along = world(np.cos(turn), np.sin(turn)), world(-np.sin(turn), np.cos(turn))
            normal = (side * np.array([0, 1.0, 0]) + 2 * outward) / np.sqrt(5)
            hinge = INRADIUS * top + APOTHEM * outward
            down = unit(INRADIUS * normal - hinge)
            # Flat again: `down` lies along the outward line of the sheet, `along` across it.
            right = np.cos(turn) * down - np.sin(turn) * along
            up = np.sin(turn) * down + np.cos(turn) * along
            at = APOTHEM * np.array([np.cos(turn), np.sin(turn)])
            found.append(Folded(sheet, normal, hinge, at, right, up))
    return found


def facets(cosine, alpha):
    """GGX."""
    return alpha**2 / (np.pi * (cosine**2 * (alpha**2 - 1) + 1) ** 2)


def base(n_l, n_v, l_h, roughness):
    """Of the matt part, as a share of that of white paper, by cosines (Burley 2012)."""
    fd90 = 0.5 + 2 * roughness * l_h**2
    return (1 + (fd90 - 1) * (1 - n_l) ** 5) * (1 + (fd90 - 1) * (1 - n_v) ** 5)


def coat(n_l, n_v, n_h, l_h, roughness):
    """Of the glossy part, likewise: GGX, index 1.5."""
    alpha = roughness**2

    def shadowed(c):
        return 2 / (1 + np.sqrt(1 + alpha**2 * (1 - c**2) / c**2))

    fresnel = F0 + (1 - F0) * (1 - l_h) ** 5
    seen = facets(n_h, alpha) * fresnel * shadowed(n_l) * shadowed(n_v)
    return seen / (4 * n_l * n_v) * np.pi / ALBEDO


def cosines_of(normal, light, view):
    """Those of light, view and half vector to the normal, and of light to the half vector."""
    half = unit(light + view)
    found = [np.clip(np.sum(normal * v, axis=-1), 1e-4, 1) for v in (light, view, half)]
    return *found, np.clip(np.sum(light * half, axis=-1), 0, 1)


def brdf(normal, light, view, roughness):
    """Of a coated sheet, as a share of that of white paper, by directions (N, 3)."""
    n_l, n_v, n_h, l_h = cosines_of(normal, light, view)
    return base(n_l, n_v, l_h, roughness) + coat(n_l, n_v, n_h, l_h, roughness)


def even_share(roughness, steps=64):
    """Cosines of view, and what a coated sheet shows there under even light, of white paper."""
    u, turn = np.meshgrid((np.arange(steps) + 0.5) / steps, (np.arange(steps) + 0.5) / steps)
    u, turn = u.ravel(), 2 * np.pi * turn.ravel()
    up, alpha = np.array([0, 0, 1.0]), roughness**2

    def around(c):
        sine = np.sqrt(1 - c**2)
        return np.stack([sine * np.cos(turn), sine * np.sin(turn), c], axis=1)

    cosines, shares = np.linspace(0.05, 1, 24), []
    for c in cosines:
        view = np.array([np.sqrt(1 - c * c), 0, c])
        n_l, n_v, _, l_h = cosines_of(up, around(np.sqrt(u)), view)  # by the cosine's density
        matt = base(n_l, n_v, l_h, roughness).mean()
        half = around(np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u)))  # by the facets' density
        v_h = np.clip(half @ view, 1e-4, 1)
        light = 2 * v_h[:, None] * half - view
        n_l, n_v, n_h, l_h = cosines_of(up, light, view)
        density = facets(n_h, alpha) * n_h / (4 * v_h)
        glossy = coat(n_l, n_v, n_h, l_h, roughness) * n_l / np.pi / density
        shares.append(matt + np.where(light[:, 2] > 1e-4, glossy, 0).mean())
    return cosines, np.array(shares)


@dataclass
class SolidScene(Scene):
    """A dodecahedron over a board, or before a plain wall.

    `turn`: (3, 3) solid → world. `lamps`: near ones: place (3,) in mm and irradiance (3,) of a
    surface that faces it in the solid's centre. `roughness`: of a coat, under `lamps` and even
    light alone. `folds`: 1 sigma of how far each face is turned, in degrees.
    """

    net: list = None  # two grey pictures
    edge_mm: float = 30.0
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    height_mm: float | None = None  # of the centre; None: it lies on a face
    lamps: list = field(default_factory=list)
    roughness: float | None = None
    folds: float = 0.0
    seed: int = 0
    has_board: bool = True
    even: np.ndarray | None = None  # irradiance by light from everywhere, instead of the panorama
    shadow: tuple | None = None  # normal in the world, and mm: beyond that plane no lamp shines

    def __post_init__(self):
        self.faces = fold()
        self.radius_mm = INRADIUS * self.edge_mm
        if self.even is None:
            super().__post_init__()
        else:
            self.paper = self.even / np.pi * ALBEDO
            self.centre = np.array([self.ball_mm[0], self.radius_mm, self.ball_mm[1]])
        if self.height_mm is not None:
            self.centre[1] = self.height_mm
        if self.even is None:
            self.around = self.panorama_at_ball(1024)
        random = np.random.default_rng(self.seed)
        self.normals = np.stack([face.normal for face in self.faces]) @ self.turn.T
        self.shading = unit(self.normals + np.radians(self.folds) * random.normal(size=(FACES, 3)))
        far = self.irradiance(self.shading)
        self.far_irradiance = far
        self.share = None if self.roughness is None else even_share(self.roughness)

    def irradiance(self, normals):
        """Irradiance (N, 3) in the place of the solid's centre: the truth."""
        if self.even is None:
            light = super().irradiance(normals)
        else:
            light = np.tile(self.even, (len(normals), 1))
        for place, strength in self.lamps:
            light = light + np.maximum(normals @ unit(place - self.centre), 0)[:, None] * strength
        return light

    def far(self, origins, directions):
        """Without a board, a plain wall."""
        if self.has_board:
            return super().far(origins, directions)
        return np.full(directions.shape, 0.35 * self.paper.mean())

    def radiance(self, eye, rays):
        """Radiance (N, 3) that the camera at `eye` (3,) gets along rays (N, 3)."""
        origin = (eye - self.centre) @ self.turn / self.edge_mm
        along = rays @ self.turn
        normals = np.stack([face.normal for face in self.faces])
        down = along @ normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (INRADIUS - normals @ origin) / down
        enters = np.where(down < 0, t, -np.inf)
        leaves = np.where(down > 0, t, np.inf).min(axis=1)
        number = enters.argmax(axis=1)
        first = enters.max(axis=1)
        hit = (first < leaves) & (first > 0)
        result = np.empty_like(rays)
        if (~hit).any():
            result[~hit] = self.far(np.broadcast_to(eye, rays[~hit].shape), rays[~hit])
        points = origin + first[:, None] * along
        for k in np.unique(number[hit]):
            mine = hit & (number == k)
            result[mine] = self._seen(self.faces[k], k, points[mine], -rays[mine])
        return result

    def _seen(self, face, number, points, views):
        x, y = (face.at[i] + (points - face.origin) @ axis
                for i, axis in enumerate((face.right, face.up)))  # fmt: skip
        sheet = self.net[face.sheet]
        column = sheet.shape[1] / 2 + x * self.edge_mm * PX_PER_MM - 0.5
        row = sheet.shape[0] / 2 - y * self.edge_mm * PX_PER_MM - 0.5
        c, r = np.round(column).astype(int), np.round(row).astype(int)
        printed = 0.05 + 0.95 * sheet[r, c]
        world = points @ self.turn.T * self.edge_mm
        normal = self.shading[number]
        far = self.far_irradiance[number].copy()
        for place, strength in self.lamps:
            far -= max(normal @ unit(place - self.centre), 0) * strength
        light = np.tile(far, (len(points), 1))
        if self.share is not None:
            light *= np.interp(np.clip(views @ normal, 0, 1), *self.share)[:, None]
        for place, strength in self.lamps:
            to = place - self.centre - world
            distance = np.linalg.norm(to, axis=1)
            way = to / distance[:, None]
            relative = (np.linalg.norm(place - self.centre) / distance) ** 2
            level = np.maximum(way @ normal, 0) * relative
            if self.roughness is not None:
                level = level * np.where(level > 0, brdf(normal, way, views, self.roughness), 0)
            if self.shadow is not None:
                level = level * (world @ self.shadow[0] < self.shadow[1])
            light += level[:, None] * strength
        return printed[:, None] * ALBEDO / np.pi * light


def lying(face, yaw_rad):
    """(3, 3) solid → world, so that a face lies on the table."""
    down = fold()[face].normal
    to = np.array([0, -1.0, 0])
    axis = np.cross(down, to)
    size = np.linalg.norm(axis)
    turn = np.eye(3) if down @ to > 0 else np.diag([1.0, -1, -1])
    if size > 1e-9:
        turn = about(axis / size, np.arctan2(size, down @ to))
    return about(np.array([0, 1.0, 0]), yaw_rad) @ turn


def about(axis, angle_rad):
    """(3, 3) a turn about an axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
