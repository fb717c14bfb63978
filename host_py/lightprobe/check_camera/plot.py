"""The picture of `lightprobe check-camera`."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from lightprobe.calibrate.response_curve import CHANNELS
from lightprobe.check_camera.answers import Verdict
from lightprobe.check_camera.balance import Drift
from lightprobe.check_camera.judge import SceneFindings
from lightprobe.check_camera.pixels import ShiningPixels
from lightprobe.geometry import Array


def draw(
    verdict: Verdict,
    scene: SceneFindings,
    stated: Array,
    rest: Drift | None,
    shining: ShiningPixels | None,
    path: Path,
) -> None:
    """Draw what the answers rest on: regions, response, edges, colours over time, pixels.

    `stated`: linear light (256, 3) of each code that the camera file states.
    """
    figure, axes = plt.subplots(2, 3, figsize=(15, 8), constrained_layout=True)
    _regions(axes[0, 0], scene)
    _curve(axes[0, 1], scene, stated)
    _steps(axes[0, 2], scene)
    _edges(axes[1, 0], scene)
    _balance(axes[1, 1], rest)
    _pixels(axes[1, 2], shining)
    figure.suptitle(f"{verdict.source}: {verdict.words}", fontsize=10, wrap=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _nothing(axis: Axes, title: str) -> None:
    axis.set_title(f"{title}: not measured")
    axis.set_axis_off()


def _regions(axis: Axes, scene: SceneFindings) -> None:
    if scene.regions is None or not np.isfinite(scene.regions.map_codes).any():
        _nothing(axis, "regions")
        return
    shown = axis.imshow(scene.regions.map_codes, cmap="RdBu", vmin=-1.5, vmax=1.5)
    axis.set_title("regions: codes more or less per factor e of exposure")
    axis.figure.colorbar(shown, ax=axis, shrink=0.6)


def _curve(axis: Axes, scene: SceneFindings, stated: Array) -> None:
    axis.plot(stated[:, 1], color="0.6", linestyle="--", label="stated")
    fitted = scene.power.fitted if scene.power else None
    if fitted is not None:
        for c, name in enumerate(CHANNELS):
            axis.plot(fitted.table[:, c], color=f"tab:{name}", label=f"{name}, measured")
    axis.set(title="response", xlabel="code", ylabel="linear light, full scale = 1")
    axis.legend()


def _steps(axis: Axes, scene: SceneFindings) -> None:
    if scene.power is None:
        _nothing(axis, "exposures")
        return
    axis.semilogx(scene.scene.exposures_us, 100 * scene.power.steps, "o")
    axis.axhline(0, color="0.6")
    axis.set(title="exposures", xlabel="commanded (µs)", ylabel="light off by (%)")


def _edges(axis: Axes, scene: SceneFindings) -> None:
    if scene.profile is None:
        _nothing(axis, "edges")
        return
    axis.plot(scene.profile.at_px, scene.profile.level)
    axis.axhline(0, color="0.6")
    axis.axhline(1, color="0.6")
    axis.set(title=f"mean of {scene.profile.edges} edges", xlabel="pixels", ylabel="share of step")


def _balance(axis: Axes, rest: Drift | None) -> None:
    if rest is None:
        _nothing(axis, "white balance at rest")
        return
    for c, name in enumerate(("red", "blue")):
        axis.plot(rest.t_s, 100 * rest.ratios[:, c], color=f"tab:{name}", label=f"{name} / green")
    axis.set(title="white balance at rest", xlabel="seconds", ylabel="change (%)")
    axis.legend()


def _pixels(axis: Axes, shining: ShiningPixels | None) -> None:
    if shining is None:
        _nothing(axis, "pixels")
        return
    axis.imshow(shining.picture, cmap="gray", vmin=0, vmax=64)
    for places, colour, name in (
        (shining.stuck_px, "tab:red", "stuck"), (shining.warm_px, "tab:orange", "warm")
    ):  # fmt: skip
        axis.scatter(
            places[:, 0], places[:, 1], s=40, facecolors="none", edgecolors=colour,
            label=f"{len(places)} {name}",
        )  # fmt: skip
    axis.set_title(f"lens covered, {shining.exposure_us:g} µs")
    axis.legend(loc="lower right")
