"""The plot of `lightprobe calibrate ring --from-camera`."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from lightprobe.calibrate import ring
from lightprobe.calibrate.ring_seats import Found
from lightprobe.calibrate.ring_turning import Samples


def draw(samples: Samples, found: Found, path: Path) -> None:
    """Write one picture: resistance over light with the curves found, and the seats."""
    figure, (curves, seats) = plt.subplots(1, 2, figsize=(11, 4.6), constrained_layout=True)
    every = max(1, len(samples.lux) // 1000)
    for k in range(ring.SENSORS):
        colour = f"C{k}"
        lux, level = samples.lux[::every, 0, k], samples.level[::every, k]
        usable = (level > 0) & (level < ring.FULL_SCALE) & (lux > 0)
        lux, level = lux[usable], level[usable]
        ohm = ring.total_ohm(level, found.ring.divider_ohm)
        curves.loglog(lux, ohm, ".", color=colour, markersize=1.5, alpha=0.4)
        span = np.geomspace(lux.min(), lux.max(), 30)
        model = found.ring.r10_ohm[k] * (span / 10) ** -found.ring.gamma[k]
        curves.loglog(span, model + found.ring.series_ohm[k], color=colour, label=str(k))
        right, up = found.ring.seats_deg[k]
        sigma = found.seat_sigma_deg[k]
        seats.errorbar(right, up, sigma, sigma, color=colour, fmt="o", label=str(k))
    curves.set(
        xlabel="illuminance by the camera (lx)", ylabel="resistance (ohm)", title="light sensors"
    )
    curves.legend(title="sensor", ncols=3)
    seats.axhline(0, color="0.7", linewidth=0.8)
    seats.axvline(0, color="0.7", linewidth=0.8)
    seats.set(xlabel="to the right (degrees)", ylabel="up (degrees)", title="seats")
    for axis in (curves, seats):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
