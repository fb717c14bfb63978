# SPDX-License-Identifier: Apache-2.0
"""The circuit of hw/circuit*.yml: parts, pins, nets; the Nano's pin table; the small parts."""

from __future__ import annotations

import argparse
import re
from collections import Counter
from dataclasses import dataclass, field

import yaml
from dimensions import HW

KINDS = (
    "resistor",
    "capacitor",
    "fuse",
    "ldr",
    "fork",
    "led",
    "button",
    "nmos",
    "pmos",
    "chip",
    "connector",
)
LETTERS = {"": 1.0, "k": 1e3, "M": 1e6, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12}
UNITS = {"resistor": "Ω", "capacitor": "F", "fuse": "A"}
SUPPLY_PINS = {"5V", "GND"}


@dataclass
class Part:
    """One part. Pins: name -> net. `ohm`: of a fuse, or in series with a capacitor."""

    ref: str
    kind: str
    pins: dict[str, str]
    what: str = ""
    value: str = ""
    tolerance: str = ""
    polar: bool = False
    option: str = ""
    spice: str = ""
    vto: tuple[float, ...] = ()
    numbers: dict[str, int] = field(default_factory=dict)
    ohm: float = 0.0
    wire_mm2: float = 0.14

    def number(self) -> float:
        """The value in its unit: 470k -> 470000; ValueError when it is none."""
        found = re.fullmatch(r"(\d+(?:\.\d+)?)([kMmunp]?)", self.value)
        if not found:
            raise ValueError(f"{self.ref}: value {self.value!r}")
        return float(found[1]) * LETTERS[found[2]]

    def label(self) -> str:
        """What a drawing writes beside it."""
        if self.kind not in UNITS:
            return self.what
        letter = self.value[-1] if self.value[-1] in LETTERS else ""
        digits = self.value.removesuffix(letter)
        shown = f"{digits} {letter.replace('u', 'µ')}{UNITS[self.kind]}"
        return " ".join(filter(None, (shown, self.tolerance, self.what)))


@dataclass
class Circuit:
    """All parts by name, and the nets of a fixed voltage."""

    parts: dict[str, Part]
    volts: dict[str, float] = field(default_factory=dict)

    def net(self, name: str) -> list[tuple[str, str]]:
        """Every (part, pin) on a net."""
        return [
            (r, pin) for r, part in self.parts.items() for pin, n in part.pins.items() if n == name
        ]

    def nets(self) -> set[str]:
        """Names of all nets."""
        return {net for part in self.parts.values() for net in part.pins.values()}


def load(name: str = "circuit") -> Circuit:
    """A circuit file of hw/; ValueError names the part that cannot be."""
    path = HW / f"{name}.yml"
    data = yaml.safe_load(path.read_text())
    parts = {}
    for ref, fields in data["parts"].items():
        pins = {str(pin): net for pin, net in fields.pop("pins").items()}
        part = Part(ref=ref, pins=pins, **fields)
        if part.kind not in KINDS:
            raise ValueError(f"{path.name}: {ref}: kind {part.kind!r}")
        if part.kind in UNITS:
            part.number()
        if part.numbers and set(part.numbers) != set(pins):
            raise ValueError(f"{path.name}: {ref}: numbers are not those of its pins")
        parts[ref] = part
    circuit = Circuit(parts, data["nets"])
    for net in circuit.nets():
        ends = circuit.net(net)
        if len(ends) < 2:
            raise ValueError(f"{path.name}: {ends[0][0]}: nothing else is on the net {net}")
    return circuit


def nano_pins() -> dict[str, str]:
    """Signal pins of the Nano: label -> net."""
    pins = load().parts["NANO"].pins
    return {label: net for label, net in pins.items() if label not in SUPPLY_PINS}


def avr_pin(label: str) -> str:
    """Name of a Nano pin on the chip: D10 -> PB2, A3 -> PC3."""
    kind, number = re.fullmatch(r"([DA])(\d+)", label).groups()  # type: ignore[union-attr]
    if kind == "A":
        return f"PC{number}"
    return f"PD{number}" if int(number) < 8 else f"PB{int(number) - 8}"


def pin_table() -> str:
    """Markdown: the Nano's pins and what is on their nets."""
    circuit = load()
    lines = ["| Nano | chip | net | goes to |", "|---|---|---|---|"]
    for label, net in nano_pins().items():
        others = [f"{ref} {pin}" for ref, pin in circuit.net(net) if ref != "NANO"]
        lines.append(f"| {label} | {avr_pin(label)} | {net} | {', '.join(others)} |")
    return "\n".join(lines)


def small_parts() -> str:
    """All resistors, capacitors and fuses of the usual box, for the bill."""
    found: Counter[str] = Counter()
    kinds: dict[str, str] = {}
    for part in load().parts.values():
        if part.kind in UNITS and not part.option:
            found[part.label()] += 1
            kinds[part.label()] = part.kind
    groups = []
    for kind in UNITS:
        items = [
            f"{n} × {label}" if n > 1 else label
            for label, n in found.items()
            if kinds[label] == kind
        ]
        groups.append(f"{kind}s {', '.join(items)}" if len(items) > 1 else f"{kind} {items[0]}")
    return "; ".join(groups)


def main() -> None:
    """Prints the pin table and the small parts."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(pin_table())
    print()
    print(small_parts())


if __name__ == "__main__":
    main()
