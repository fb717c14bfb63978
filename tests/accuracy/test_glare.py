"""Veiling glare that the camera file states: pictures veiled by a sum over all directions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import live
import numpy as np
import pytest
from judge import Figures
from lightprobe import geometry, sh
from lightprobe.estimate import Estimate
from lightprobe.evaluate import offline
from lightprobe.geometry import Array
from lightprobe.imaging.image import write_pfm
from lightprobe.sim.room import Room

pytestmark = pytest.mark.many_frames

#: Small enough for a sum over all pairs of pixels.
SIZE_PX = (120, 60)
WIDTH_DEG = 10.0
#: Full scale of the coded pictures is so much light.
FULL = 8.0


def directions() -> tuple[Array, Array]:
    """Directions (N, 3) and solid angles (N,) of the pixels."""
    width, height = SIZE_PX
    d = geometry.equirect_direction(
        np.arange(width)[None, :], np.arange(height)[:, None], width, height
    )
    sr = np.repeat(geometry.equirect_solid_angles(width, height)[:, None], width, axis=1)
    return np.asarray(d).reshape(-1, 3), sr.ravel()


def scene(seed: int) -> Array:
    """Light (N, 3): walls that are brighter on one side, a dark corner, coloured lamps."""
    rng = np.random.default_rng(seed)
    d, _ = directions()
    towards = rng.standard_normal((5, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    light = 0.4 + 0.3 * (d @ towards[0])[:, None] * np.array([1, 0.8, 0.6])
    light *= np.where(d @ towards[1] > 0.8, 0.05, 1)[:, None]
    for one in towards[2:]:
        away_deg = np.degrees(np.arccos(np.clip(d @ one, -1, 1)))
        light += np.exp(-0.5 * (away_deg / 4) ** 2)[:, None] * rng.uniform(2, 7, 3)
    return np.asarray(light)


def veiled(light: Array, even: float, around: float, halves: bool) -> Array:
    """What a lens shows of light (N, 3), or two of them, ahead and behind, of one half each."""
    d, sr = directions()
    parts = [d[:, 2] <= 0, d[:, 2] > 0] if halves else [np.full(len(d), True)]
    seen = np.empty_like(light)
    for part in parts:
        x, area = light[part], sr[part]
        flux = x * area[:, None]
        angle_deg = np.degrees(np.arccos(np.clip(d[part] @ d[part].T, -1, 1)))
        kernel = (1 + (angle_deg / WIDTH_DEG) ** 2) ** -1.5
        kernel /= kernel.T @ area  # of the light of each pixel all arrives
        spread = kernel @ flux
        seen[part] = (1 - even - around) * x + even * flux.sum(0) / area.sum() + around * spread
    return seen


def camera_file(folder: Path, even: float, around: float) -> str:
    """Path of a camera file that states it."""
    path = folder / "stated.camera"
    path.write_text(
        f"[camera]\nprojection = equirect\n[glare]\neven = {even}\naround = {around}\n"
        f"width_deg = {WIDTH_DEG}\n"
    )
    return str(path)


def estimated(folder: Path, light: Array, stated: tuple[float, float] | None) -> Estimate:
    """Estimate by a picture of floats."""
    path = folder / "x.pfm"
    write_pfm(path, light.reshape(SIZE_PX[1], SIZE_PX[0], 3).astype(np.float32))
    settings = offline.Settings(lights=0, sh_order=4)
    if stated is not None:
        settings = replace(settings, camera=camera_file(folder, *stated))
    return offline.estimate_files([path], settings=settings)[0]


def error(estimate: Estimate, light: Array) -> float:
    """Mean error over a white sphere, of the largest irradiance; by a sum over directions."""
    d, sr = directions()
    normals, weight = d[::7], sr[::7]
    true = np.maximum(normals @ d.T, 0) @ (light * sr[:, None])
    found = sh.irradiance(estimate.sh.coefficients, normals)
    return float(np.average(np.abs(found - true).mean(1), weights=weight) / true.max())


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("seed", "shares", "halves"),
    [(1, (0.1, 0.0), True), (2, (0.0, 0.1), False), (2, (0.1, 0.1), True), (1, (0.1, 0.1), False),
     (1, (0.01, 0.01), True)],
)  # fmt: skip
def test_the_veil_is_taken_off(
    seed: int, shares: tuple[float, float], halves: bool, tmp_path: Path
) -> None:
    """A panorama does not say whether one lens made it, or two: sigma covers both."""
    light = scene(seed)
    seen = veiled(light, *shares, halves)
    clear = error(estimated(tmp_path, light, None), light)
    found = estimated(tmp_path, seen, shares)
    assert error(found, light) < clear + 0.02 * sum(shares)
    assert found.relighting_sigma is not None
    assert error(found, light) < 3 * found.relighting_sigma
    if sum(shares) >= 0.1:
        assert error(found, light) < 0.95 * error(estimated(tmp_path, seen, None), light)


def test_dark_places_contradict_too_large_a_share(tmp_path: Path) -> None:
    """Less is taken off, sigma says so, and so does the log."""
    light, path = scene(1), tmp_path / "x.pfm"
    write_pfm(path, light.reshape(SIZE_PX[1], SIZE_PX[0], 3).astype(np.float32))
    settings = offline.Settings(camera_file(tmp_path, 0.3, 0.0), lights=0, sh_order=4)
    found, log = offline.estimate_files([path], settings=settings)
    assert any("hold less light than the veil" in line for line in log)
    assert found.relighting_sigma is not None
    assert found.relighting_sigma > 0.15
    assert error(found, light) < 0.05


def judged(defects: str, stated: str | None = None, motion: str = "0") -> Figures:
    """Figures of default packets in a room, through the simulator's lens."""
    case = live.case(
        Room(), motion, "reported", size_px=(960, 480), judged_s=0.5,
        defects=defects, stated=stated,
    )  # fmt: skip
    return next(one.figures for one in live.judged(case) if one.subscription == "default")


@pytest.mark.nightly_rows
@pytest.mark.parametrize("motion", ["0", "head"])
def test_a_lens_of_the_simulator_counts_as_a_good_one(motion: str) -> None:
    found, veiled = judged("glare-strong-known", motion=motion), judged("glare-strong", "", motion)
    assert found.error_median < 0.01 < 2 * found.error_median + 0.005 < veiled.error_median
    assert found.relighting.within_3 is not None
    assert found.relighting.within_3 >= 0.98


@pytest.mark.parametrize(
    ("defects", "share"),
    [
        ("glare", 0.005), ("glare", 0.02),
        ("none", 0.01), ("none", 0.1),
        ("glare-strong", 0.05), ("glare-strong", 0.2),
    ],
)  # fmt: skip
def test_what_is_stated_wrongly_is_never_wrong_and_healthy(defects: str, share: float) -> None:
    found = judged(defects, f"[glare]\neven = {share}\naround = {share}\n")
    assert found.wrong_and_healthy == 0
    assert found.error_median < 0.04
    assert found.relighting.within_3 is not None
    assert found.relighting.within_3 >= 0.98
