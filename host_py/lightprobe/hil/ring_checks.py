"""Checks of the ring's nine light sensors and of the supply."""

from __future__ import annotations

import numpy as np

from lightprobe.geometry import Array
from lightprobe.hil.bench import Bench
from lightprobe.hil.check import CannotTellError, Check, Finding, Group, Source, judged
from lightprobe.mcu import messages as mcu

COUNT = 4  # levels of one count of the converter
_DARK = 3 * COUNT
_BRIGHT = 3900
_NOISE = 2 * COUNT
_NOISE_SHARE = 0.01  # light indoors moves by as much
_SUPPLY_V = (3.9, 5.5)
_SPREAD = 4 * COUNT  # between sensors, below which all look alike
_COVERED_S = 0.6  # an LDR follows within 30 ms; in the dark it is slower
_COVERED = 0.7  # of its level, when a finger lies on it
_PINS = ("S0, PD4 (D4)", "S1, PD5 (D5)", "S2, PD6 (D6)")


def _levels(bench: Bench) -> Array:
    levels = bench.recording().levels
    if len(levels) < 10:
        raise CannotTellError("too few rings came")
    t_us = bench.recording().t_us
    bench.series["ring_t_s"] = ((t_us - t_us[0]) / 1e6).tolist()
    bench.series["ring_levels"] = levels.tolist()
    return levels


def _sensors(numbers: list[int]) -> str:
    return ", ".join(f"sensor {k}" for k in numbers)


def _alive(bench: Bench) -> Finding:
    levels = np.median(_levels(bench), axis=0)
    state = bench.box.message("FaultState")
    opened = [k for k in range(9) if state.number("sensors_open") >> k & 1]
    shorted = [k for k in range(9) if state.number("sensors_shorted") >> k & 1]
    measured = "median levels " + " ".join(f"{x:.0f}" for x in levels)
    if not opened and not shorted and np.all(levels <= _DARK):
        raise CannotTellError("it is dark: switch a lamp on")
    steps = []
    if opened:
        measured += f"; open: {_sensors(opened)}"
        steps.append(f"{_sensors(opened)}: its wires and solder joints, or a finger on it")
    if shorted:
        measured += f"; shorted: {_sensors(shorted)}"
        steps.append(f"{_sensors(shorted)}: solder between its pins, or the sun on it alone")
    return judged(not steps, measured, "; ".join(steps))


def _judged_sensors(bench: Bench) -> list[int]:
    """Give those that are not named by `ring-alive` already."""
    return [k for k in range(9) if k not in bench.recording().dead]


def _range(bench: Bench) -> Finding:
    levels = np.median(_levels(bench), axis=0)
    bright = [k for k in _judged_sensors(bench) if levels[k] >= _BRIGHT]
    measured = f"levels {levels.min():.0f}…{levels.max():.0f} of 4092"
    if bright:
        measured += f"; at their upper end: {_sensors(bright)}"
    step = f"{_sensors(bright)}: less light; if it stays, solder between its pins"
    if len(bright) == 9:
        step = "all nine: less light, or the resistor of 3.3 kΩ at A0 is missing"
    return judged(not bright, measured, step, least=float(levels.min()), most=float(levels.max()))


def noise_of(levels: Array) -> Array:
    """Noise (9,), 1 sigma in levels, from ring to ring: slow changes of the light do not count."""
    return np.asarray(np.std(np.diff(levels, axis=0), axis=0) / np.sqrt(2))


def _noise(bench: Bench) -> Finding:
    levels = _levels(bench)
    noise, middle = noise_of(levels), np.median(levels, axis=0)
    limit = np.maximum(_NOISE, _NOISE_SHARE * middle)
    noisy = [k for k in _judged_sensors(bench) if noise[k] > limit[k]]
    measured = "noise " + " ".join(f"{x:.1f}" for x in noise) + " levels"
    if noisy:
        measured += f"; too much: {_sensors(noisy)}"
    step = f"{_sensors(noisy)}: a loose contact, or its wires beside the servo's"
    if len(noisy) == 9:
        step = "all nine: lamps that flicker (is `mains_hz` right?), else the 74HC4067's supply"
    return judged(not noisy, measured, step, worst=float(noise.max()))


def _select(bench: Bench) -> Finding:
    levels = np.median(_levels(bench), axis=0)
    if np.ptp(levels) < _SPREAD:
        raise CannotTellError("all nine see the same light: let it come from one side")
    stuck = [line for line in range(3) if _pairs_alike(levels, 1 << line)]
    measured = "no select line makes sensors alike in pairs"
    if stuck:
        measured = f"sensors are alike in pairs that differ by {', '.join(f'S{k}' for k in stuck)}"
    step = "; ".join(f"the wire of {_PINS[k]} to the 74HC4067" for k in stuck)
    return judged(not stuck, measured, step)


def _pairs_alike(levels: Array, bit: int) -> bool:
    pairs = [(k, k | bit) for k in range(8) if not k & bit]
    return all(abs(levels[a] - levels[b]) <= COUNT for a, b in pairs)


def _supply(bench: Bench) -> Finding:
    volts = bench.recording().supplies_v
    if not len(volts):
        raise CannotTellError("the box has not measured it")
    low, high = _SUPPLY_V
    middle = float(np.median(volts))
    latched = "SUPPLY_LOW" in bench.box.latched()
    span = f"{volts.min():.2f}…{volts.max():.2f} V"
    measured = f"{middle:.2f} V (exact to 10 % until it is calibrated), {span}"
    if latched:
        measured += "; SUPPLY_LOW is latched"
    step = (
        "too low: a shorter or thicker USB cable, another port; check with a multimeter between "
        "5V and GND" if latched or middle < low else "too high: measure between 5V and GND at once"
    )  # fmt: skip
    return judged(not latched and low <= middle <= high, measured, step, supply_v=middle)


# ---------------------------------------------------------------- with the user's finger


def _order(bench: Bench) -> Finding:
    bench.cover(-1)
    before = _now(bench)
    if np.all(before <= _DARK):
        raise CannotTellError("it is dark: switch a lamp on")
    wrong, steps = [], []
    for k in range(9):
        bench.cover(k)
        share = _now(bench) / np.maximum(before, 1)
        least = int(np.argmin(share))
        if share[k] <= _COVERED and least == k:
            continue
        if share[least] <= _COVERED:
            wrong.append(f"sensor {k} covered, sensor {least} went dark")
            steps.append(f"the wires of sensor {k} and sensor {least} are exchanged")
        else:
            wrong.append(f"sensor {k} covered, none went dark")
            steps.append(f"sensor {k}: its wires; it does not see light")
    measured = "; ".join(wrong) or "each went dark when it was covered, and no other"
    return judged(not wrong, measured, "; ".join(steps))


def _now(bench: Bench) -> Array:
    """Levels at present, once the sensors have followed."""
    box = bench.box
    box.rates(ring_scans=8)
    rings = [one for one in box.listen(_COVERED_S + 0.2) if isinstance(one, mcu.Ring)]
    box.rates()
    late = [ring.levels for ring in rings[-10:]]
    if not late:
        raise CannotTellError("no ring came")
    return np.asarray(np.median(np.array(late, dtype=np.float64), axis=0))


_RING = ("versions",)
CHECKS = (
    Check(
        "ring-alive", "Is every light sensor connected?",
        "none reads nothing beside others that see 10 lx; none at 160 Ω beside 1000 lx",
        Source("firmware/README.md", "An LDR counts as *open* when it reads nothing"), _alive,
        needs=_RING, faults=("LDR_OPEN", "LDR_SHORTED"),
    ),
    Check(
        "ring-range", "Is every light sensor below its upper end?", f"level below {_BRIGHT}",
        Source("firmware/README.md", "a level of 3900 or more, 160 Ω"), _range, needs=_RING,
    ),
    Check(
        "ring-noise", "Does every light sensor read steadily?",
        f"1 sigma up to {_NOISE} levels (2 counts), or {100 * _NOISE_SHARE:g} % of the level",
        Source("firmware/README.md", "Levels are sums, scaled so that the supply is 4092."), _noise,
        needs=_RING,
    ),
    Check(
        "ring-select", "Do the select lines of the 74HC4067 work?",
        f"not all pairs of sensors within {COUNT} levels (1 count)",
        Source("firmware/README.md", "S0…S3 of the 74HC4067"), _select, needs=_RING,
    ),
    Check(
        "supply", "Is the supply as it should be?",
        f"{_SUPPLY_V[0]:g}…{_SUPPLY_V[1]:g} V",
        Source("firmware/README.md", "`SUPPLY_LOW` is reported below 3.9 V"), _supply,
        needs=_RING, faults=("SUPPLY_LOW",),
    ),
)  # fmt: skip
COVERED = (
    Check(
        "ring-order", "Does each light sensor go dark when it is covered, and no other?",
        f"its level falls to {100 * _COVERED:g} % or less, and most of all",
        Source("hw/guide.md", "covered by a finger, must become *dark* here"), _order,
        Group.COVER, needs=("versions", "ring-alive", "ring-select"),
    ),
)  # fmt: skip
