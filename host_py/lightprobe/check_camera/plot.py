"""The picture of `lightprobe check-camera`."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from lightprobe.calibrate.response_curve import CHANNELS
from lightprobe.check_camera.answers import Outcome, Verdict
from lightprobe.check_camera.balance import Drift
from lightprobe.check_camera.glare import Veil
from lightprobe.check_camera.judge import SceneFindings
from lightprobe.check_camera.pixels import ShiningPixels
from lightprobe.geometry import Array


def draw(
    verdict: Verdict,
    scene: SceneFindings,
    stated: Array,
    rest: Drift | None,
    veil: Veil | None,
    shining: ShiningPixels | None,
    path: Path,
) -> None:
    """Draw the answers, and what they rest on.

    `stated`: linear light (256, 3) of each code that the camera file states.
    """
    figure, axes = plt.subplots(2, 4, figsize=(20, 8), constrained_layout=True)
    _regions(axes[0, 0], scene)
    _curve(axes[0, 1], scene, stated)
    _steps(axes[0, 2], scene)
    _answers(axes[0, 3], verdict)
    _edges(axes[1, 0], scene)
    _balance(axes[1, 1], rest)
    _veil(axes[1, 2], veil)
    _pixels(axes[1, 3], shining)
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
    most = max(0.2, 110 * float(np.abs(rest.ratios).max(initial=0.0)))
    axis.set_ylim(-most, most)  # noise alone is no drift
    axis.set(title="white balance at rest", xlabel="seconds", ylabel="change (%)")
    axis.legend()


def _veil(axis: Axes, veil: Veil | None) -> None:
    if veil is None:
        _nothing(axis, "veiling glare")
        return
    off_deg, went, fitted = veil.by_angle[np.isfinite(veil.by_angle).all(axis=1)].T
    axis.plot(off_deg, 100 * went, "o", label="measured")
    axis.plot(off_deg, 100 * fitted, label="veil, fitted")
    axis.axhline(0, color="0.6")
    axis.set(
        title="light that went with the hidden lamp", xlabel="degrees from the lamp",
        ylabel="of the mean light (%)",
    )  # fmt: skip
    axis.legend()


def _answers(axis: Axes, verdict: Verdict) -> None:
    axis.set_axis_off()
    axis.set_title("answers")
    for k, one in enumerate(verdict.answers):
        colour = "tab:red" if one.is_found else "0.5" if one.outcome is not Outcome.FINE else "k"
        y = 1 - (k + 1) / (len(verdict.answers) + 1)
        axis.text(0, y, f"{one.question}: {one.outcome}", color=colour)


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
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2)
