"""A mirror ball that an ordinary camera sees: the light of which direction each pixel shows.

Camera frame: +X right, +Y up, −Z along the optical axis, its origin the centre of the lens. A ray
at the angle α from the line to the ball's centre meets the ball at the incidence i,
sin i = D sin α / R. Its light comes from the angle 2i − α off the reverse of that line. The daemon
computes the same (daemon/vision/ball/ball.c).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lightprobe.geometry import Array

#: Complex refractive index (n, k) of surfaces in green light: chromium (Johnson and Christy 1974);
#: silver (the same, 1972), of glass balls that are silvered inside; black lacquer or glass.
SURFACES = {"chrome": (3.18, 3.31), "silver": (0.06, 3.59), "black": (1.5, 0.0)}

#: When OpenCV's inverse of the distortion ends, as the daemon's does: by default a pixel is left.
_UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-13)


@dataclass(frozen=True)
class Pinhole:
    """A camera with OpenCV's distortion; pixels, the first one's centre at (0.5, 0.5)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()  # k1, k2, p1, p2[, k3]

    @property
    def matrix(self) -> Array:
        """OpenCV's camera matrix (3, 3), of pixels whose first has its centre at (0.5, 0.5)."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])

    def rays(self, places_px: Array) -> Array:
        """Unit rays (N, 3) of places (N, 2) in the picture, camera frame."""
        distortion = np.asarray(self.distortion or (0.0,) * 4)
        points = np.asarray(places_px, np.float64).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, distortion, criteria=_UNTIL)
        flat = np.asarray(found).reshape(-1, 2)
        rays = np.stack([flat[:, 0], -flat[:, 1], -np.ones(len(flat))], axis=1)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def places(self, rays: Array) -> Array:
        """Places (N, 2) in the picture of rays (N, 3) ahead, camera frame."""
        opencv = np.asarray(rays, np.float64).reshape(-1, 3) * [1, -1, -1]
        distortion = np.asarray(self.distortion or (0.0,) * 4)
        places, _ = cv2.projectPoints(opencv, np.zeros(3), np.zeros(3), self.matrix, distortion)
        return np.asarray(places, np.float64).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball as `[ball]` of a camera file states it."""

    pinhole: Pinhole
    centre: Array  # (3,) camera frame
    radius: float  # in the unit of the centre
    index: float = SURFACES["chrome"][0]
    extinction: float = SURFACES["chrome"][1]
    rim_px: float = 1.5
    outline_sigma_px: float = 0.5
    rotation_sigma_deg: float = 0.0

    @property
    def axis(self) -> Array:
        """(3,) unit vector from the lens towards the centre."""
        return np.asarray(self.centre / np.linalg.norm(self.centre))

    @property
    def ratio(self) -> float:
        """Radius over distance of the centre from the lens."""
        return self.radius / float(np.linalg.norm(self.centre))

    @property
    def radius_px(self) -> float:
        """Radius of the outline in the picture, about: along its short axis."""
        focal_px = np.sqrt(self.pinhole.fx_px * self.pinhole.fy_px)
        return float(focal_px * np.arcsin(self.ratio) / -self.axis[2])

    @property
    def is_possible(self) -> bool:
        """Tell whether it is before the lens, and larger than its rim."""
        return bool(
            np.all(np.isfinite(self.centre)) and self.centre[2] < 0
            and 0 < self.radius < np.linalg.norm(self.centre) and self.radius_px > self.rim_px >= 0
        )  # fmt: skip

    def incidence(self, rays: Array) -> tuple[Array, Array]:
        """Incidence and angle from the axis (N,) in rad of rays (N, 3); NaN: beside, or the rim."""
        alpha = np.arccos(np.clip(rays @ self.axis, -1, 1))
        per_px = np.arcsin(self.ratio) / self.radius_px
        used = alpha <= np.arcsin(self.ratio) - self.rim_px * per_px
        sine = np.where(used, np.sin(alpha) / self.ratio, np.nan)
        return np.asarray(np.arcsin(sine)), alpha

    def look(self, places_px: Array) -> tuple[Array, Array]:
        """Directions (N, 3), camera frame, and reflectances (N,) at places (N, 2).

        NaN and 0 where the picture shows no ball, or its rim.
        """
        rays = self.pinhole.rays(places_px)
        incidence, alpha = self.incidence(rays)
        across = rays - (rays @ self.axis)[:, None] * self.axis
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-15)
        theta = (2 * incidence - alpha)[:, None]
        directions = -np.cos(theta) * self.axis + np.sin(theta) * across
        seen = np.isfinite(incidence)
        mirrored = np.zeros(len(incidence))
        mirrored[seen] = reflectance(self.index, self.extinction, np.cos(incidence[seen]))
        return directions, mirrored


def reflectance(index: float, extinction: float, cosine: Array) -> Array:
    """Share of unpolarized light that a surface mirrors, by Fresnel's equations."""
    n: complex = index - 1j * extinction
    inside = np.sqrt(n * n - (1 - cosine**2))
    s = np.abs((cosine - inside) / (cosine + inside))
    p = np.abs((n * n * cosine - inside) / (n * n * cosine + inside))
    return np.asarray((s**2 + p**2) / 2)
