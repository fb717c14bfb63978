"""The demo's picture: lamps on the panorama, true and estimated, and an object lit by each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from lightprobe import geometry, sh
from lightprobe.colour import linear_to_srgb, luminance
from lightprobe.estimate import Estimate, flag_names
from lightprobe.evaluate import marks, metrics, relight
from lightprobe.evaluate.marks import Marks
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.motion import turned
from lightprobe.sim.scene import MapTruth

_OBJECT_PX = 256
_INK, _PAPER, _TRUE, _SEEN, _EXTRA = "#e6e6e6", "#16181d", "#ffd34d", "#39d0ff", "#ff7ac6"


@dataclass(frozen=True, eq=False)
class Scenery:
    """What is true at the moment of an estimate."""

    name: str
    radiance: NDArray[np.float32]  # (H, W, 3) unclipped
    lamps: tuple[Lamp, ...] | None  # as the camera is turned; None: known as a map alone
    yaw_deg: float = 0.0  # by which the map is to be turned besides (less than a pixel)


def draw(path: Path, estimate: Estimate, truth: Scenery | None, footer: str) -> dict[str, float]:
    """Write the picture; returns the error figures in it (none without truth)."""
    figure = plt.figure(figsize=(16, 6.5), facecolor=_PAPER)
    grid = figure.add_gridspec(
        2, 3, width_ratios=(2.55, 1, 1), height_ratios=(1, 0.24), left=0.012, right=0.988,
        top=0.905, bottom=0.02, wspace=0.04, hspace=0.03,
    )  # fmt: skip
    axis = figure.add_subplot(grid[0, 0])
    _panorama(axis, estimate, truth)
    marked = _mark(estimate, truth)
    _lamps(axis, estimate, marked)
    figures = _objects(figure, grid, estimate, truth) | marked.figures
    _words(figure.add_subplot(grid[1, 0]), truth, marked)
    _summary(figure.add_subplot(grid[1, 1:]), estimate, figures, marked)
    title = truth.name if truth else "what the packet says (no truth: a real camera)"
    figure.text(0.014, 0.94, f"lightprobe · {title}", color=_INK, fontsize=17, weight="bold")
    figure.text(0.986, 0.945, footer, color=_INK, fontsize=10, ha="right", alpha=0.8)
    path.parent.mkdir(parents=True, exist_ok=True)
    half_done = path.with_suffix(".part.png")
    figure.savefig(half_done, dpi=100, facecolor=_PAPER)
    plt.close(figure)
    half_done.replace(path)
    return figures


def tonemap(radiance: Array, scale: float) -> Array:
    """Display values of linear radiance; highlights roll off instead of clipping."""
    return linear_to_srgb(1 - np.exp(-np.maximum(radiance, 0) * scale))


def _panorama(axis: Axes, estimate: Estimate, truth: Scenery | None) -> None:
    """Show the true map, or the packet's SH where there is none."""
    if truth is not None:
        radiance = np.asarray(truth.radiance, np.float64)
        scale = 0.3 / max(median_luminance(truth.radiance), 1e-12)
    else:
        directions = geometry.equirect_directions(256, 128)
        radiance = sh.radiance(estimate.sh.coefficients, directions)
        scale = 0.5 / max(float(luminance(radiance).mean()), 1e-12)
    axis.imshow(tonemap(radiance, scale), extent=(-180, 180, -90, 90), aspect="auto")
    axis.set_xlim(-180, 180)
    axis.set_ylim(-90, 90)
    axis.axis("off")


def _mark(estimate: Estimate, truth: Scenery | None) -> Marks:
    if truth is None:
        return marks.of_packet(estimate)
    if truth.lamps is None:
        return marks.of_map(estimate, truth.radiance)
    return marks.of_lamps(estimate, truth.lamps)


def _lamps(axis: Axes, estimate: Estimate, marked: Marks) -> None:
    """Lines around what is true, crosses on estimated lamps."""
    if marked.areas is not None and marked.areas.any():
        height, width = marked.areas.shape
        x = (np.arange(width) + 0.5) * 360 / width - 180
        y = 90 - (np.arange(height) + 0.5) * 180 / height
        inside = cv2.GaussianBlur(marked.areas.astype(np.float32), (5, 5), 0)
        axis.contour(x, y, inside, levels=[0.5], colors=[_TRUE], linewidths=1.2)
    for index, light in enumerate(estimate.lights):
        azimuth, elevation = light.azimuth_deg, light.elevation_deg
        colour = _EXTRA if marked.is_extra(index) else _SEEN
        axis.plot(azimuth, elevation, "+", color=colour, markersize=13, markeredgewidth=2)
        _ring(axis, light.direction, light.angular_radius_deg, colour, "-", 1.2)
        left = azimuth > 150
        axis.annotate(
            marked.names[index], (azimuth, elevation), xytext=(-9 if left else 9, 9),
            textcoords="offset points", color=colour, fontsize=12, weight="bold",
            ha="right" if left else "left", path_effects=_outline(),
        )  # fmt: skip
    for lamp in marked.lamps:
        _ring(axis, lamp.direction, max(lamp.radius_deg, 1.5) + 2.5, _TRUE, "-", 2.0)


def _outline() -> list[object]:
    from matplotlib import patheffects

    return [patheffects.withStroke(linewidth=2.5, foreground="black")]


def _ring(
    axis: Axes, direction: Array, radius_deg: float, colour: str, line: str, wide: float
) -> None:
    """Circle on the sphere, drawn on the panorama and cut at its seam."""
    d = geometry.normalize(direction)
    side = geometry.normalize(np.cross(d, [0, 1.0, 0] if abs(d[1]) < 0.9 else [1.0, 0, 0]))
    turn = np.linspace(0, 2 * np.pi, 181)[:, None]
    around = np.cos(turn) * side + np.sin(turn) * np.cross(d, side)
    reach = np.radians(radius_deg)
    azimuth, elevation = geometry.angles_from_direction(np.cos(reach) * d + np.sin(reach) * around)
    azimuth[1:][np.abs(np.diff(azimuth)) > 180] = np.nan
    axis.plot(azimuth, elevation, line, color="black", linewidth=wide + 1.6, alpha=0.5)
    axis.plot(azimuth, elevation, line, color=colour, linewidth=wide)


def _objects(
    figure: Figure, grid: object, estimate: Estimate, truth: Scenery | None
) -> dict[str, float]:
    """Draw the object lit by truth and by packet; gives the relighting and SH errors."""
    packet = relight.draw(relight.Lighting.of_estimate(estimate), _OBJECT_PX)
    if truth is None:
        scale = _brightness(packet)
        _object(figure.add_subplot(grid[0, 1:]), packet, scale, "lit by the packet")  # type: ignore[index]
        return {}
    true = relight.draw(relight.Lighting.of_map(truth.radiance), _OBJECT_PX)
    scale = _brightness(true)
    _object(figure.add_subplot(grid[0, 1]), true, scale, "lit by the truth")  # type: ignore[index]
    _object(figure.add_subplot(grid[0, 2]), packet, scale, "lit by the packet")  # type: ignore[index]
    exact = MapTruth(truth.radiance, turned(truth.yaw_deg))
    normals = geometry.sphere_normals()
    mae, rmse = metrics.relighting(exact.irradiance(normals), estimate.irradiance(normals))
    error = metrics.sh_error(exact.total, estimate.total().coefficients)
    found = {"relighting_mae": mae, "relighting_rmse": rmse, "sh_error": error}
    stated = metrics.stated_error(estimate)
    return found if stated is None else found | {"stated_error": stated}


def _brightness(picture: Array) -> float:
    """Scale that puts the brightest of what is drawn near, not at, white."""
    brightest = float(luminance(picture[..., :3]).max())
    return 1.1 / brightest if brightest > 0 else 1.0


def _object(axis: Axes, picture: Array, scale: float, title: str) -> None:
    shown = np.dstack([tonemap(picture[..., :3], scale), picture[..., 3]])
    axis.imshow(shown, interpolation="bicubic")
    axis.set_title(title, color=_INK, fontsize=12)
    axis.axis("off")


def _words(axis: Axes, truth: Scenery | None, marked: Marks) -> None:
    """Legend, and one line per lamp or area."""
    axis.axis("off")
    axis.set_xlim(0, 1)
    axis.set_ylim(0, 1)
    entries = [("+", _SEEN, "estimated, with its size")]
    what = "bright area" if truth is not None and truth.lamps is None else "lamp"
    if truth is not None:
        entries.insert(0, ("o", _TRUE, f"true {what}"))
    if any(map(marked.is_extra, range(len(marked.names)))):
        entries.append(("+", _EXTRA, f"extra: no true {what} there"))
    handles = [
        Line2D([], [], marker=marker, color=colour, linestyle="", markersize=12,
               fillstyle="none", mew=2, label=label)
        for marker, colour, label in entries
    ]  # fmt: skip
    axis.legend(handles=handles, loc="upper left", frameon=False, labelcolor=_INK, fontsize=11,
                borderaxespad=0.1)  # fmt: skip
    for k, row in enumerate(marked.rows[:8]):
        axis.text(0.31 + 0.36 * (k // 4), 0.92 - 0.2 * (k % 4), row, color=_INK, fontsize=9.5,
                  va="top", family="monospace")  # fmt: skip


def _summary(axis: Axes, estimate: Estimate, figures: dict[str, float], marked: Marks) -> None:
    """Figures of the whole, and what the packet says of itself."""
    axis.axis("off")
    words = []
    if "relighting_mae" in figures:
        words.append(f"relighting error: mean {100 * figures['relighting_mae']:.2f} % of the "
                     f"brightest, RMS {100 * figures['relighting_rmse']:.2f} %")  # fmt: skip
        words.append(f"SH error (order {estimate.sh.order}, TOTAL): "
                     f"{100 * figures['sh_error']:.2f} %")  # fmt: skip
    if marked.summary:
        words.append(marked.summary)
    stated = metrics.stated_error(estimate)
    number = len(estimate.lights)
    model = f"packet: order {estimate.sh.order}, {number} lamp{'s' if number != 1 else ''}"
    words.append(model + (f", states an error of {100 * stated:.1f} % (RMS)" if stated else ""))
    flags = flag_names(estimate.flags)
    if flags:
        words.append("flags: " + ", ".join(flags).lower())
    axis.text(0.04, 0.98, "\n".join(words), color=_INK, fontsize=10.5, va="top",
              linespacing=1.45)  # fmt: skip
