"""Pictures of balls beside a board, traced ray by ray: shares no code with the estimator.

World: the board lies in the plane y = 0, +X to its right, −Z up on the paper; millimetres. The ball
stands on the board. Light comes from a panorama infinitely far away, and from the board.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SQUARE_MM = 25.0
COLUMNS, ROWS = 11, 8
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def panorama_directions(width):
    """(width / 2, width, 3), and solid angles of the rows."""
    height = width // 2
    theta = np.pi * (np.arange(height) + 0.5) / height
    azimuth = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    sine = np.sin(theta)[:, None]
    directions = np.stack(
        [sine * np.sin(azimuth), np.cos(theta)[:, None] + 0 * azimuth, -sine * np.cos(azimuth)], -1
    )
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return directions, (edges[:-1] - edges[1:]) * 2 * np.pi / width


def lookup(panorama, directions):
    """Bilinear radiance (N, 3) of directions (N, 3)."""
    height, width = panorama.shape[:2]
    x = (np.arctan2(directions[:, 0], -directions[:, 2]) / (2 * np.pi) + 0.5) * width - 0.5
    y = np.arccos(np.clip(directions[:, 1], -1, 1)) / np.pi * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    left, right = x0 % width, (x0 + 1) % width
    top, bottom = np.clip(y0, 0, height - 1), np.clip(y0 + 1, 0, height - 1)
    upper = panorama[top, left] * (1 - fx) + panorama[top, right] * fx
    lower = panorama[bottom, left] * (1 - fx) + panorama[bottom, right] * fx
    return upper * (1 - fy) + lower * fy


def fresnel(surface, cosine):
    """Unpolarized reflectance: of a dielectric of index 1.5, and of chromium, in real numbers."""
    if surface == "black":
        inside = np.sqrt(1 - (1 - cosine**2) / 1.5**2)
        s = (cosine - 1.5 * inside) / (cosine + 1.5 * inside)
        p = (1.5 * cosine - inside) / (1.5 * cosine + inside)
        return (s * s + p * p) / 2
    n, k = 3.18, 3.31  # the exact formula with a and b of a metal (Siegel and Howell)
    sine2 = 1 - cosine**2
    t = n * n - k * k - sine2
    a2b2 = np.sqrt(t * t + 4 * n * n * k * k)
    a = np.sqrt((a2b2 + t) / 2)
    s = (a2b2 - 2 * a * cosine + cosine**2) / (a2b2 + 2 * a * cosine + cosine**2)
    top = a2b2 * cosine**2 - 2 * a * cosine * sine2 + sine2**2
    return s * (1 + top / (a2b2 * cosine**2 + 2 * a * cosine * sine2 + sine2**2)) / 2


@dataclass
class Scene:
    """A ball on a board in a room."""

    panorama: np.ndarray  # (H, 2H, 3) radiance
    board: np.ndarray  # grey picture of it, 0…255, columns to the right
    radius_mm: float = 30.0
    surface: str = "chrome"  # black, or white: diffuse
    ball_mm: tuple[float, float] = (137.0, 60.0)  # x, z of its foot; the board is 0…275, 0…200

    def __post_init__(self):
        directions, row_sr = panorama_directions(self.panorama.shape[1])
        up = np.maximum(directions[..., 1], 0)
        light = np.einsum("hwc,hw,h->c", self.panorama, up, row_sr)
        self.paper = 0.8 * light / np.pi  # radiance of white paper
        self.centre = np.array([self.ball_mm[0], self.radius_mm, self.ball_mm[1]])
        self.around = self.panorama_at_ball(1024)
        if self.surface == "white":
            self.shaded = self._irradiance_map()

    def far(self, origins, directions):
        """Radiance (N, 3) along rays (N, 3) that do not meet the ball."""
        radiance = lookup(self.panorama, directions)
        down = np.where(directions[:, 1] < -1e-9, directions[:, 1], -1)
        t = -origins[:, 1] / down
        at = origins + t[:, None] * directions
        x, z = at[:, 0] / SQUARE_MM, at[:, 2] / SQUARE_MM
        on = (directions[:, 1] < -1e-9) & (t > 0)
        on &= (x > -1) & (x < COLUMNS + 1) & (z > -1) & (z < ROWS + 1)
        per_square = self.board.shape[1] / COLUMNS
        column, row = np.floor(x * per_square).astype(int), np.floor(z * per_square).astype(int)
        printed = on & (column >= 0) & (row >= 0)
        printed &= (column < self.board.shape[1]) & (row < self.board.shape[0])
        grey = np.ones(len(x))
        grey[printed] = 0.04 + 0.96 * self.board[row[printed], column[printed]] / 255
        radiance[on] = grey[on, None] * self.paper
        return radiance

    def panorama_at_ball(self, width):
        """What a probe without a size sees in the place of the ball's centre."""
        directions = panorama_directions(width)[0].reshape(-1, 3)
        seen = self.far(np.broadcast_to(self.centre, directions.shape), directions)
        return seen.reshape(width // 2, width, 3)

    def irradiance(self, normals):
        """Irradiance (N, 3) in the place of the ball's centre: the truth."""
        directions, row_sr = panorama_directions(self.around.shape[1])
        flux = (self.around * row_sr[:, None, None]).reshape(-1, 3)
        flat = directions.reshape(-1, 3)
        return np.concatenate(
            [np.maximum(part @ flat.T, 0) @ flux for part in np.array_split(normals, 40)]
        )

    def _irradiance_map(self):
        directions = panorama_directions(96)[0]
        return self.irradiance(directions.reshape(-1, 3)).reshape(48, 96, 3)

    def radiance(self, eye, rays):
        """Radiance (N, 3) that the camera at `eye` (3,) gets along rays (N, 3)."""
        to = eye - self.centre
        b = rays @ to
        under = b * b - (to @ to - self.radius_mm**2)
        hit = (under > 0) & (b < 0)
        result = np.empty_like(rays)
        if (~hit).any():
            result[~hit] = self.far(np.broadcast_to(eye, rays[~hit].shape), rays[~hit])
        if hit.any():
            points = eye + (-b[hit] - np.sqrt(under[hit]))[:, None] * rays[hit]
            normals = (points - self.centre) / self.radius_mm
            if self.surface == "white":
                result[hit] = 0.85 / np.pi * lookup(self.shaded, normals)
            else:
                cosine = -np.sum(rays[hit] * normals, axis=1)
                mirrored = rays[hit] + 2 * cosine[:, None] * normals
                share = fresnel(self.surface, np.clip(cosine, 0, 1))
                result[hit] = share[:, None] * self.far(points, unit(mirrored))
        return result


@dataclass
class Camera:
    """A pinhole; the first pixel's centre is at (0.5, 0.5). Looks near the ball."""

    width: int
    height: int
    focal_px: float
    eye: np.ndarray
    axes: np.ndarray  # (3, 3): rows right, up, back in the world

    @staticmethod
    def before(scene, diameter_px, seed, width=1280, height=960):
        """One that sees the ball with that diameter, from a random side and not in the middle."""
        random = np.random.default_rng(seed)
        focal_px = 0.9 * width
        azimuth, elevation = random.uniform(-0.5, 0.5), random.uniform(0.45, 0.8)
        distance = scene.radius_mm * 2 * focal_px / diameter_px
        away = np.array([
            np.sin(azimuth) * np.cos(elevation), np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ])  # fmt: skip
        eye = scene.centre + distance * away
        aim = scene.centre + random.uniform(-0.1, 0.1, 3) * distance
        back = unit(eye - aim)
        right = unit(np.cross([0.0, 1, 0], back))
        return Camera(width, height, focal_px, eye, np.stack([right, np.cross(back, right), back]))

    @property
    def intrinsics(self):
        """As --intrinsics takes them: OpenCV's pixels."""
        return f"{self.focal_px},{self.focal_px},{self.width / 2 - 0.5},{self.height / 2 - 0.5}"

    def rays(self, x, y):
        flat = np.stack(
            [(x - self.width / 2), -(y - self.height / 2), np.full(x.shape, -self.focal_px)], -1
        )
        return unit(flat.reshape(-1, 3)) @ self.axes

    def place(self, point):
        at = self.axes @ (np.asarray(point) - self.eye)
        scale = self.focal_px / -at[2]
        return self.width / 2 + at[0] * scale, self.height / 2 - at[1] * scale

    def _part(self, scene, left, top, right, bottom, samples):
        x = left + (np.arange((right - left) * samples) + 0.5) / samples
        y = top + (np.arange((bottom - top) * samples) + 0.5) / samples
        picture = np.empty((bottom - top, right - left, 3))
        for row in range(bottom - top):
            grid = np.meshgrid(x, y[row * samples : (row + 1) * samples])
            seen = scene.radiance(self.eye, self.rays(*grid))
            picture[row] = seen.reshape(samples, right - left, samples, 3).mean(axis=(0, 2))
        return picture

    def render(self, scene, samples=8):
        """Radiance (H, W, 3); around the ball with samples² rays a pixel, else with four."""
        picture = self._part(scene, 0, 0, self.width, self.height, 2)
        x, y = self.place(scene.centre)
        size = 1.3 * scene.radius_mm * self.focal_px / np.linalg.norm(self.eye - scene.centre)
        left, top = max(int(x - size), 0), max(int(y - size), 0)
        right, bottom = min(int(x + size), self.width), min(int(y + size), self.height)
        picture[top:bottom, left:right] = self._part(scene, left, top, right, bottom, samples)
        return picture


def expose(picture, scale, random):
    """Codes (H, W, 3) of an sRGB camera with photon and read noise; `scale`: radiance to full."""
    e = picture * scale
    e = e + random.normal(size=e.shape) * np.sqrt(np.maximum(e, 0) / 20000 + (2 / 4095) ** 2)
    e = np.clip(e, 0, 1)
    return np.round(
        255 * np.where(e <= 0.0031308, 12.92 * e, 1.055 * e ** (1 / 2.4) - 0.055)
    ).astype(np.uint8)


def room(seed, width=1024, lamps=(1, 3)):
    """A room of coloured walls with shelves and discs as lamps: panorama, directions of lamps."""
    random = np.random.default_rng(seed)
    directions = panorama_directions(width)[0]
    half = np.array([random.uniform(2, 4), random.uniform(1.2, 1.6), random.uniform(2, 4)])
    t = half / np.maximum(np.abs(directions), 1e-9)
    axis = t.argmin(axis=-1)
    wall = 2 * axis + (np.take_along_axis(directions, axis[..., None], -1)[..., 0] > 0)
    colours = random.uniform(0.1, 0.6, (6, 3))
    hit = directions * np.take_along_axis(t, axis[..., None], -1)
    picture = colours[wall]
    for _ in range(40):  # shelves, doors, pictures
        face, shade = random.integers(6), random.uniform(0.05, 1.0, 3)
        middle, size = random.uniform(-1, 1, 3) * half, random.uniform(0.1, 0.8, 3)
        inside = np.abs(hit - middle) < size
        inside[..., face // 2] = True
        picture = np.where(((wall == face) & inside.all(-1))[..., None], shade, picture)
    places = []
    for _ in range(random.integers(lamps[0], lamps[1] + 1)):
        while True:
            azimuth, elevation = random.uniform(-np.pi, np.pi), random.uniform(0.15, 1.3)
            place = np.array([
                np.sin(azimuth) * np.cos(elevation), np.sin(elevation),
                -np.cos(azimuth) * np.cos(elevation),
            ])  # fmt: skip
            if all(place @ other < 0.7 for other in places):
                break
        places.append(place)
        radius = np.radians(random.uniform(1.5, 4))
        tint = 1 + random.uniform(-0.1, 0.1, 3)
        glow = random.uniform(1.5, 4) / (np.pi * radius**2) * tint
        edge = np.clip((np.cos(radius) - directions @ place) / -(np.sin(radius) * 2e-3), -0.5, 0.5)
        picture = picture + (edge[..., None] + 0.5) * glow
    return picture, places


def fibonacci(count):
    """Normals (count, 3) evenly over the sphere."""
    i = np.arange(count) + 0.5
    y = 1 - 2 * i / count
    turn, ring = i * 2.399963229, np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(turn), y, ring * np.sin(turn)], axis=1)
