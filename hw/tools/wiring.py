# SPDX-License-Identifier: Apache-2.0
"""The pin map of the Arduino Nano, from what the wiring diagram is drawn from."""

from __future__ import annotations

import argparse
import re

import yaml
from dimensions import HW

SUPPLY_PINS = {"5V", "GND", "USB"}


def connections() -> list[tuple[str, str, str, str]]:
    """Every wire: connector, pin, connector, pin."""
    data = yaml.safe_load((HW / "wiring" / "harness.yml").read_text())
    wires = []
    for first, cable, second in data["connections"]:
        one, ones = next(iter(first.items()))
        other, others = next(iter(second.items()))
        used = next(iter(cable.values()))
        if not len(ones) == len(used) == len(others):
            raise ValueError(
                f"harness.yml: {one} - {other}: {len(ones)}, {len(used)} and {len(others)} pins"
            )
        for a, b in zip(ones, others, strict=True):
            for name, pin in ((one, a), (other, b)):
                if pin not in data["connectors"][name]["pinlabels"]:
                    raise ValueError(f"harness.yml: {name} has no pin {pin}")
            wires.append((one, a, other, b))
    return wires


def nano_pins() -> dict[str, tuple[str, str]]:
    """Signal pins of the Nano: label -> (connector, pin) at the wire's other end."""
    found: dict[str, tuple[str, str]] = {}
    for one, a, other, b in connections():
        for here, there in (((one, a), (other, b)), ((other, b), (one, a))):
            if here[0] == "NANO" and here[1] not in SUPPLY_PINS:
                if here[1] in found:
                    raise ValueError(f"harness.yml: two wires on the Nano's {here[1]}")
                found[here[1]] = there
    return found


def avr_pin(label: str) -> str:
    """Name of a Nano pin on the chip: D10 -> PB2, A3 -> PC3."""
    kind, number = re.fullmatch(r"([DA])(\d+)", label).groups()  # type: ignore[union-attr]
    if kind == "A":
        return f"PC{number}"
    return f"PD{number}" if int(number) < 8 else f"PB{int(number) - 8}"


def pin_table() -> str:
    """Markdown."""
    order = sorted(nano_pins().items(), key=lambda item: (item[0][0] == "A", int(item[0][1:])))
    lines = ["| Nano | chip | goes to |", "|---|---|---|"]
    lines += [f"| {label} | {avr_pin(label)} | {name} {pin} |" for label, (name, pin) in order]
    return "\n".join(lines)


def main() -> None:
    """Prints the pin map."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(pin_table())


if __name__ == "__main__":
    main()
