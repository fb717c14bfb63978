"""The plot of `lightprobe evaluate`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from lightprobe.evaluate.evaluation import Case
from lightprobe.evaluate.metrics import Score

_RESEARCH_DEG = 1.567  # published RMSE of 360° incident light (Alhakamy and Tuceryan 2019/20)
_LEAST = 1e-6  # what is smaller is drawn here: the axes are logarithmic

_PANELS: tuple[tuple[str, Callable[[Score], list[float]]], ...] = (
    ("relighting MAE (of the brightest)", lambda s: [s.relighting_mae]),
    ("SH error, TOTAL (relative L2)", lambda s: [s.sh_error]),
    ("direction error (°)", lambda s: [match.angle_deg for match in s.matches]),
)


def draw(cases: list[Case], path: Path) -> None:
    """Write one picture: errors of every scene by input, a colour per settings, medians barred."""
    settings = list(dict.fromkeys(case.settings for case in cases))
    inputs = list(dict.fromkeys(case.input for case in cases))
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.8), constrained_layout=True)
    for axis, (title, values) in zip(axes, _PANELS, strict=True):
        for row, setting in enumerate(settings):
            for column, name in enumerate(inputs):
                chosen = [c for c in cases if (c.settings, c.input) == (setting, name)]
                width = 0.8 / len(settings)
                centre = column + (row + 0.5) * width - 0.4
                points = [v for c in chosen if c.score for v in values(c.score)]
                _strip(axis, centre, width, points, f"C{row}")
        axis.set_title(title)
        axis.set_yscale("log")
        axis.set_xlim(-0.5, len(inputs) - 0.5)
        axis.set_xticks(range(len(inputs)), inputs)
        axis.set_xlabel("input: float map, or so many 8-bit exposures")
        axis.grid(axis="y", alpha=0.3)
    axes[2].axhline(_RESEARCH_DEG, color="0.5", linestyle=":")
    handles = [
        Line2D([], [], marker="o", linestyle="", color=f"C{row}", label=setting)
        for row, setting in enumerate(settings)
    ]
    handles.append(Line2D([], [], color="0.5", linestyle=":", label="published research, RMSE"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _strip(axis: Axes, centre: float, width: float, values: list[float], colour: str) -> None:
    """Dots of one group in order, and a bar at their median."""
    if not values:
        return
    spread = (np.arange(len(values)) + 0.5) / len(values) - 0.5
    heights = np.maximum(sorted(values), _LEAST)
    axis.plot(centre + 0.8 * width * spread, heights, ".", color=colour, alpha=0.6)
    axis.hlines(np.median(heights), centre - width / 2, centre + width / 2, color="black")
