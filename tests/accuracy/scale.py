"""Light that is relative: packets on the best common scale, and how far each is off it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from judge import Light, Packet
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array

#: Share of the normals that are the dim ones.
DIM = 0.25
#: Packets state it in thousandths, and light itself is found within so much.
LEAST_SIGMA = 0.001


@dataclass(frozen=True)
class Scale:
    """Figures of the scale that all packets of a run should have in common."""

    off_worst: float  # largest distance of a packet's own best scale from the common one, relative
    sigma: float | None  # stated in the last packet; None: none was
    within_1: float | None  # share of the packets less than 1 sigma off the first
    within_3: float | None


def on_one_scale(
    light_at: Callable[[Packet], Light], packets: Sequence[Packet]
) -> tuple[list[Packet], Scale]:
    """Bring packets to the common scale that suits them best: the median of their own."""
    own = [_log_scales(light_at(packet), packet) for packet in packets]
    common = float(np.median([best for best, _ in own])) if own else 0.0
    logs = np.array([dim for _, dim in own])
    brought = [
        replace(packet, estimate=_scaled(packet.estimate, float(np.exp(common))))
        for packet in packets
    ]
    stated = [packet.estimate.scale_sigma for packet in packets]
    sigmas_off = np.array([
        abs(log - logs[0]) / max(sigma, LEAST_SIGMA)
        for log, sigma in zip(logs, stated, strict=True)
        if sigma is not None
    ])  # fmt: skip
    return brought, Scale(
        float(np.exp(np.abs(logs - np.median(logs)).max())) - 1 if own else float("nan"),
        stated[-1] if stated else None,
        *(float(np.mean(sigmas_off <= k)) if len(sigmas_off) else None for k in (1, 3)),
    )


def _log_scales(light: Light, packet: Packet) -> tuple[float, float]:
    """Logarithms of factors that bring a packet to the truth.

    By least squares over all normals; and the median over those that get least light, whom what
    clips hardly reaches.
    """
    found: Array = np.maximum(
        luminance(packet.estimate.irradiance(light.normals @ packet.turn.T)), 1e-30
    )
    true = luminance(light.irradiance)
    dim = true <= np.quantile(true, DIM)
    best = np.log(max(true @ found, 1e-30) / (found @ found))
    return float(best), float(np.median(np.log(true[dim] / found[dim])))


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    sh = replace(estimate.sh, coefficients=factor * estimate.sh.coefficients)
    lights = tuple(
        replace(
            light,
            irradiance=factor * light.irradiance,
            irradiance_sigma=None
            if light.irradiance_sigma is None
            else factor * light.irradiance_sigma,
        )
        for light in estimate.lights
    )
    return replace(estimate, sh=sh, lights=lights)
