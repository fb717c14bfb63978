"""The plot of `lightprobe calibrate response`."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from lightprobe.calibrate.response_curve import CHANNELS, PatchCodes, Response, residuals
from lightprobe.colour import srgb_table


def draw(patches: PatchCodes, response: Response, path: Path) -> None:
    """Write one picture: the curves, and what remains of every observation, by code."""
    figure, (curves, rest) = plt.subplots(1, 2, figsize=(11, 4.4), constrained_layout=True)
    codes = np.arange(256)
    curves.plot(codes, srgb_table(), color="0.6", linestyle="--", label="sRGB, for comparison")
    for c, name in enumerate(CHANNELS):
        curves.plot(codes, response.table[:, c], color=f"tab:{name}", label=name)
        at, error = residuals(patches, response, c)
        rest.plot(at, error, ".", color=f"tab:{name}", markersize=1.5, alpha=0.4)
    curves.set(xlabel="code", ylabel="linear light, full scale = 1", title="response")
    curves.legend()
    rest.set(xlabel="code", ylabel="residual (codes)", title="residual of the fit", ylim=(-4, 4))
    for axis in (curves, rest):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
