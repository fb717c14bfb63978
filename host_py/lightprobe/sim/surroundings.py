"""What stands around the simulated camera: a polarizer set by hand, or the whole box."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lightprobe.errors import UsageError
from lightprobe.sim import faults, ldr
from lightprobe.sim.box import Box
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.ldr import Ldrs
from lightprobe.sim.world import Behaviour, State


class FixedPolarizer:
    """A polarizer that somebody has set to an angle."""

    def __init__(self, angle_deg: float) -> None:
        """`angle_deg`: of its transmission axis."""
        self._angle_deg = angle_deg

    def wheel_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        return (self._angle_deg,)

    def misbehave(self, query: str) -> str:
        """See :class:`lightprobe.sim.link.Surroundings`; there is nothing that could."""
        return query

    def truth(self, state: State) -> dict[str, Any]:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        return {}


class WheelAndRing:
    """The box: its wheel turns the polarizer, its ring stands in the scene's light."""

    def __init__(self, box: Box, light: RingLight) -> None:
        """Take both over."""
        self._box, self._light = box, light

    def wheel_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        return self._box.angles_deg(from_ns, to_ns)

    def misbehave(self, query: str) -> str:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        camera, numbers = faults.split(query, self._box.names)
        faults.Faults().merged(camera)  # all of it or nothing
        self._box.set(**numbers)
        return camera

    def truth(self, state: State) -> dict[str, Any]:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        return {"ring_lux": [round(float(value), 4) for value in self._light.lux(state)]}


def draw_ring(spread: float, seed: int) -> tuple[Ldrs, dict[str, float]]:
    """Give nine LDRs, and what the box has to know of them and of where it stands.

    `spread` 1: as parts from one bag differ, built in as people do; 0: all nominal. The box draws
    its multiplexer and its ADC by itself.
    """
    if not 0 <= spread <= 2:
        raise UsageError(f"simulate: --ring-spread {spread:g}: expected 0…2")
    rng = np.random.default_rng([seed, 0x1D4])
    parts = Ldrs.draw(rng, spread)
    temperature_c = ldr.REFERENCE_C + spread * (ldr.indoors_c(rng) - ldr.REFERENCE_C)
    numbers = {"temperature_c": temperature_c, "ldr_memory": spread * ldr.PER_DECADE}
    for k in range(9):
        numbers[f"ldr{k}_r10_ohm"] = float(parts.r10_ohm[k])
        numbers[f"ldr{k}_gamma"] = float(parts.gamma[k])
    return parts, numbers


def flicker_share(behaviour: Behaviour, light: RingLight, state: State) -> float:
    """Share of the ring's light that flickers, the mean over the sensors."""
    flicker = behaviour.flicker
    if not flicker.is_on:
        return 0.0
    depths = np.resize(flicker.depths, len(state.powers))
    dark = light.lux(replace(state, powers=0 * state.powers))
    flickering = light.lux(replace(state, powers=depths * state.powers)) - dark
    return float(np.mean(flickering / np.maximum(light.lux(state), 1e-9)))
