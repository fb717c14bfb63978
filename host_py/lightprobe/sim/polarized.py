"""Scenes with polarized light: a polished floor, a clear sky, and polarized panoramas from files.

Stokes parameters are in each pixel's own frame (see :class:`lightprobe.sim.scene.Layers`), so that
horizontal polarization is S1 > 0 everywhere. DoLP = √(S1² + S2²) / S0, AoLP = ½ atan2(S2, S1).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging import image
from lightprobe.imaging.polarizer import pixel_frame
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import (
    Layer,
    Layers,
    MapTruth,
    PanoramaScene,
    Scene,
    disc_layer,
    lit_lamps,
    resize,
)

_TRUTH_PX = (1024, 512)


def fresnel_amplitudes(cosine: ArrayLike, refractive_index: float) -> tuple[Array, Array]:
    """What a dielectric leaves of fields across and in the plane of incidence; negative: turned.

    Fresnel's equations (Born and Wolf, Principles of Optics, 1.5.2), from air. `cosine`: of the
    angle of incidence.
    """
    c = np.asarray(cosine, dtype=np.float64)
    inside = np.sqrt(1 - (1 - c**2) / refractive_index**2)
    n = refractive_index
    across = (c - n * inside) / (c + n * inside)
    along = (n * c - inside) / (n * c + inside)
    return np.asarray(across), np.asarray(along)


def fresnel(incidence_deg: ArrayLike, refractive_index: float) -> tuple[Array, Array]:
    """Reflectances of a dielectric for light polarized across and in the plane of incidence."""
    cosine = np.cos(np.radians(np.asarray(incidence_deg, dtype=np.float64)))
    across, along = fresnel_amplitudes(cosine, refractive_index)
    return across**2, along**2


# ---------------------------------------------------------------- a polished floor


@dataclass(frozen=True, eq=False)
class PolishedFloor:
    """A scene whose lower half is varnished: it mirrors the upper half, as far away as that is.

    What is mirrored is polarized horizontally, by Fresnel: wholly at Brewster's angle (34° below
    the horizon for n = 1.5). Reflections of lamps are no lamps of the truth.
    """

    scene: Scene
    refractive_index: float = 1.5

    @property
    def name(self) -> str:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return f"polished-{self.scene.name}"

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return self.scene.lamps

    def scaled(self, factor: float) -> PolishedFloor:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return PolishedFloor(self.scene.scaled(factor), self.refractive_index)

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        layers = self.scene.render(width_px, height_px)
        base, polarized = self._varnish(layers.base, layers.polarized)
        return Layers(base, tuple(self._mirrored(layer, base) for layer in layers.lamps), polarized)

    def _mirrored(self, layer: Layer, like: NDArray[np.float32]) -> Layer:
        """Give a lamp's layer with its reflection."""
        full, own = np.zeros_like(like), np.zeros((2, *like.shape), np.float32)
        full.reshape(-1, 3)[layer.index] = layer.values
        if layer.polarized is not None:
            own.reshape(2, -1, 3)[:, layer.index] = layer.polarized
        full, polarized = self._varnish(full, own)
        flat, stokes = full.reshape(-1, 3), polarized.reshape(2, -1, 3)
        if isinstance(layer.index, slice):
            return Layer(layer.index, flat, stokes)
        index = np.flatnonzero(flat.any(axis=1))
        return Layer(index, flat[index], stokes[:, index])

    def _varnish(
        self, radiance: NDArray[np.float32], own: NDArray[np.float32] | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Add to a map what its lower half mirrors: radiance (H, W, 3) and S1, S2 (2, H, W, 3).

        `own`: S1, S2 without the varnish. What is horizontal is across the plane of incidence, for
        the light that arrives as for that which leaves; the Mueller matrix of a mirror has S2 times
        the product of the amplitudes (Goldstein, Polarized Light, ch. 8).
        """
        height = len(radiance)
        half = height // 2
        sine = np.sin(np.pi * (np.arange(half) + 0.5) / height)
        r = fresnel_amplitudes(sine, self.refractive_index)
        across, along, both = (part[:, None, None] for part in (r[0] ** 2, r[1] ** 2, r[0] * r[1]))
        below = slice(height - half, height)
        full = radiance.copy()
        polarized = np.zeros((2, *radiance.shape), np.float32) if own is None else own.copy()
        # row by row below the horizon: its mirror image
        s0, s1, s2 = (
            part[half - 1 :: -1][:half]
            for part in (radiance, *(np.zeros_like(polarized) if own is None else own))
        )
        full[below] += (across + along) / 2 * s0 + (across - along) / 2 * s1
        polarized[0, below] += (across - along) / 2 * s0 + (across + along) / 2 * s1
        polarized[1, below] += both * s2
        return full, polarized

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map; the lamps are the scene's own."""
        return map_truth(self, powers, rotation)


# ---------------------------------------------------------------- a clear sky


@dataclass(frozen=True, eq=False)
class Sky:
    """A clear sky over grey ground: a sun, and single Rayleigh scattering.

    Radiance ∝ 1 + cos² γ, DoLP = most · sin² γ / (1 + cos² γ), γ from the sun; the electric field
    is across the plane of sun and view (Coulson, Polarization and Intensity of Light in the
    Atmosphere, 1988). No horizon glow, no neutral points.
    """

    sun_elevation_deg: float = 35.0
    sun_azimuth_deg: float = 20.0
    most_polarized: float = 0.75  # DoLP at 90° from the sun, in clear air
    brightness: float = 1.0

    _SKY = np.array([0.6, 0.95, 1.5])
    _SUN = np.array([26.0, 24.0, 20.0])  # irradiance on a surface that faces it
    _GROUND = 0.25  # reflectance
    _SUN_RADIUS_DEG = 0.27

    @property
    def name(self) -> str:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return f"sky-{self.sun_elevation_deg:g}"

    @property
    def sun(self) -> Array:
        """Direction (3,) towards the sun."""
        return geometry.direction_from_angles(self.sun_azimuth_deg, self.sun_elevation_deg)

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return (Lamp(self.sun, self._SUN_RADIUS_DEG, self.brightness * self._SUN),)

    def scaled(self, factor: float) -> Sky:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return Sky(
            self.sun_elevation_deg, self.sun_azimuth_deg, self.most_polarized,
            factor * self.brightness,
        )  # fmt: skip

    def stokes(self, directions: Array) -> Array:
        """S0, S1, S2 (…, 3, 3 colours) of the sky without the sun, in directions (…, 3)."""
        cosine = np.asarray(directions @ self.sun)
        radiance = self.brightness * (1 + cosine**2)[..., None] * self._SKY
        degree = self.most_polarized * (1 - cosine**2) / (1 + cosine**2)
        field = np.cross(directions, self.sun)
        right, up = pixel_frame(directions)
        x, y = (field * right).sum(axis=-1), (field * up).sum(axis=-1)
        square = np.maximum(x**2 + y**2, 1e-12)
        turned = np.stack([(x**2 - y**2) / square, 2 * x * y / square], axis=-1)
        linear = (degree[..., None] * turned)[..., None] * radiance[..., None, :]
        return np.concatenate([radiance[..., None, :], linear], axis=-2)

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        directions = geometry.equirect_directions(width_px, height_px)
        stokes = np.moveaxis(self.stokes(directions), -2, 0)
        ground = directions[..., 1] < 0
        # Lit by the mean of the sky and by the sun; the ground depolarizes.
        lit = np.pi * 4 / 3 * self._SKY + max(float(self.sun[1]), 0) * self._SUN
        stokes[:, ground] = 0
        stokes[0, ground] = self.brightness * self._GROUND / np.pi * lit
        maps = np.ascontiguousarray(stokes, np.float32)
        sun = disc_layer(self.lamps[0], width_px, height_px)
        return Layers(maps[0], (sun,), maps[1:])

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map; the sun in closed form."""
        return map_truth(self, powers, rotation)


# ---------------------------------------------------------------- files


@dataclass(frozen=True, eq=False)
class StokesPanorama:
    """A polarized panorama from a file: NumPy's .npz with S (H, 2H, 4, 3), S3 unused."""

    panorama: PanoramaScene
    polarized: NDArray[np.float32]  # (2, H, 2H, 3)

    @classmethod
    def load(cls, path: str | Path) -> StokesPanorama:
        """Read a file; raises :class:`lightprobe.imaging.image.ImageError`."""
        try:
            with np.load(path) as archive:
                stokes = np.asarray(archive["S"], dtype=np.float32)
        except (OSError, ValueError, KeyError) as error:
            raise image.ImageError(f"image: {path}: not an .npz with an array S: {error}") from None
        if stokes.ndim != 4 or stokes.shape[1:] != (2 * stokes.shape[0], 4, 3):
            raise image.ImageError(f"image: {path}: S is {stokes.shape}: expected (H, 2H, 4, 3)")
        if not np.all(np.isfinite(stokes)):
            raise image.ImageError(
                f"image: {path}: contains NaN or infinite samples, so there is no exact truth"
            )
        radiance, s1, s2 = (np.ascontiguousarray(stokes[:, :, k]) for k in range(3))
        return cls(PanoramaScene.of(Path(path).stem, radiance), np.stack([s1, s2]))

    @property
    def name(self) -> str:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return self.panorama.name

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return self.panorama.lamps

    def scaled(self, factor: float) -> StokesPanorama:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return StokesPanorama(self.panorama.scaled(factor), np.float32(factor) * self.polarized)

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        layers = self.panorama.render(width_px, height_px)
        if self.polarized.shape[1:3] == (height_px, width_px):
            return Layers(layers.base, layers.lamps, self.polarized)
        parts = [resize(part, width_px, height_px) for part in self.polarized]
        return Layers(layers.base, layers.lamps, np.stack(parts))

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return self.panorama.truth(powers, rotation)


def map_truth(scene: Scene, powers: ArrayLike, rotation: ArrayLike) -> MapTruth:
    """Sum over a scene's map; its lamps are its own."""
    radiance = scene.render(*_TRUTH_PX).compose(powers)
    return MapTruth(radiance, rotation, lit_lamps(scene.lamps, powers, rotation))
