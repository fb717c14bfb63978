# SPDX-License-Identifier: Apache-2.0
"""The servo's switch, calculated by ngspice from the parts of hw/circuit.yml.

Around it: a supply of 5.1 V behind wires (resistance and inductance below), a servo with a
capacitor inside, idle or stalled, and the Nano's pin A2, which drives the switch or is not there
(the Nano off, or in its boot loader). The fuse is its resistance: what it does when it gets warm
is not calculated.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from circuit import Circuit, load

Array = npt.NDArray[np.float64]

SUPPLY_V = 5.1
WIRE_OHM = 0.1  # supply, plugs and half a metre of 0.5 mm2, both ways
WIRE_H = 0.6e-6
PIN_V = 4.35  # of the Nano, on a USB port behind its diode
SERVO_F = 100e-6  # inside a servo
SERVO_F_OHM = 0.1
IDLE_OHM = 500.0
STALL_OHM = 6.2  # 0.8 A: MG90S class
NETS = {"SUPPLY", "FUSED", "GATE", "PULLED", "SERVO", "SERVO_POWER", "GND"}
START_S, END_S = 0.02, 0.5
STEP_S = 20e-6


@dataclass(frozen=True)
class Case:
    """What happens at START_S. `pin`: "on", "off" (from on), or "open"; `plugged`: the supply."""

    what: str
    pin: str
    load_ohm: float
    plugged: bool = False


CASES = (
    Case("servo switched on", "on", IDLE_OHM),
    Case("switched on, and it stalls at once", "on", STALL_OHM),
    Case("switched off while it stalls", "off", STALL_OHM),
    Case("supply plugged in, Nano off", "open", IDLE_OHM, plugged=True),
)


@dataclass(frozen=True)
class Course:
    """What ngspice found: times in s, volts, ampere from the supply."""

    t_s: Array
    supply_v: Array
    servo_v: Array
    supply_a: Array
    switch_w: Array  # heat in Q1

    def after(self) -> npt.NDArray[np.bool_]:
        """From when it happens on."""
        return self.t_s >= START_S

    def peak_a(self) -> float:
        """Highest current from the supply."""
        return float(self.supply_a[self.after()].max())

    def lowest_v(self) -> float:
        """Of the supply where the servo's wires begin, once it was up."""
        return float(self.supply_v[self.t_s > START_S + 1e-4].min())

    def peak_w(self) -> float:
        """Most heat in Q1."""
        return float(self.switch_w[self.after()].max())

    def heat_j(self) -> float:
        """In Q1, until half a second after."""
        return float(np.trapezoid(self.switch_w[self.after()], self.t_s[self.after()]))

    def settled_s(self) -> float:
        """Until the servo's voltage is within 5 % of a step of where it ends."""
        v = self.servo_v[self.after()]
        away = np.flatnonzero(np.abs(v - v[-1]) > 0.05 * max(abs(v[0] - v[-1]), 1.0))
        return float(self.t_s[self.after()][away[-1]] - START_S) if len(away) else 0.0


def netlist(circuit: Circuit, case: Case, corner: int, trace: Path) -> str:
    """For ngspice: the parts on the switch's nets, and what is around them.

    corner: which threshold its transistors have: 0 lowest, 1 typical, 2 highest.
    """
    lines = [case.what]
    for ref, part in circuit.parts.items():
        if part.option or not set(part.pins.values()) <= NETS:
            continue
        nets = ["0" if net == "GND" else net for net in part.pins.values()]
        if part.kind == "resistor":
            lines.append(f"{ref} {' '.join(nets)} {part.number()}")
        elif part.kind == "fuse":
            lines.append(f"R{ref} {' '.join(nets)} {part.ohm}")
        elif part.kind == "capacitor":
            lines += [
                f"R{ref} {nets[0]} {ref}_in {max(part.ohm, 1e-3)}",
                f"{ref} {ref}_in {nets[1]} {part.number()}",
            ]
        elif part.spice:
            drain, gate, source = (part.pins[pin].replace("GND", "0") for pin in "DGS")
            lines += [
                f"M{ref} {drain} {gate} {source} {ref}",
                f".model {ref} {part.spice[:-1]} Vto={part.vto[corner]})",
            ]
    supply = (
        f"PWL(0 0 {START_S} 0 {START_S + 1e-6} {SUPPLY_V})" if case.plugged else f"DC {SUPPLY_V}"
    )
    before, after = {"on": (0.0, PIN_V), "off": (PIN_V, 0.0), "open": (0.0, 0.0)}[case.pin]
    if case.pin != "open":
        lines.append(
            f"Vpin SERVO_POWER 0 PWL(0 {before} {START_S} {before} {START_S + 1e-6} {after})"
        )
    return "\n".join(
        [
            *lines,
            f"Vsupply source 0 {supply}",
            f"Rwire source wire {WIRE_OHM}",
            f"Lwire wire SUPPLY {WIRE_H}",
            f"Rservo SERVO 0 {case.load_ohm}",
            f"Rinside SERVO inside {SERVO_F_OHM}",
            f"Cinside inside 0 {SERVO_F}",
            ".control",
            f"tran {STEP_S} {START_S + END_S} 0 {STEP_S}",
            f"wrdata {trace} v(SUPPLY) v(FUSED) v(SERVO) i(Vsupply)",
            "quit",
            ".endc",
            ".end\n",
        ]
    )


def run(case: Case, circuit: Circuit, corner: int = 1) -> Course:
    """Let ngspice calculate a case; RuntimeError with its words when it cannot."""
    with tempfile.TemporaryDirectory() as folder:
        source, trace = Path(folder) / "switch.cir", Path(folder) / "trace.txt"
        source.write_text(netlist(circuit, case, corner, trace))
        done = subprocess.run(
            ["ngspice", "-b", source], capture_output=True, text=True, check=False
        )
        if not trace.exists():
            raise RuntimeError(f"ngspice: {case.what}: {done.stdout}{done.stderr}")
        t, supply, _, fused, _, servo, _, current = np.loadtxt(trace).T
    # Q1 carries the supply's current, but for what the gate's resistors take.
    return Course(t, supply, servo, -current, (fused - servo) * -current)


def table() -> str:
    """Markdown: the worst of all corners."""
    circuit = load()
    lines = [
        "| what happens | most from the supply, A | supply falls to, V | servo ends at, V "
        "| heat in Q1, W at most | mJ | settled after, ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        courses = [run(case, circuit, corner) for corner in range(3)]
        worst = (
            f"{max(c.peak_a() for c in courses):.2f}",
            f"{min(c.lowest_v() for c in courses):.2f}",
            f"{max(abs(c.servo_v[-1]) for c in courses):.2f}",
            f"{max(c.peak_w() for c in courses):.1f}",
            f"{1000 * max(c.heat_j() for c in courses):.0f}",
            f"{1000 * max(c.settled_s() for c in courses):.0f}",
        )
        lines.append(f"| {case.what} | {' | '.join(worst)} |")
    return "\n".join(lines)


def changed(circuit: Circuit, without: Iterable[str] = (), **values: str) -> Circuit:
    """The circuit with other values, or without some parts."""
    parts = {ref: part for ref, part in circuit.parts.items() if ref not in set(without)}
    for ref, value in values.items():
        parts[ref] = type(parts[ref])(**{**parts[ref].__dict__, "value": value})
    return Circuit(parts, circuit.volts)


def main() -> None:
    """Prints the table."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    print(table())


if __name__ == "__main__":
    main()
