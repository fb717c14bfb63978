# SPDX-License-Identifier: Apache-2.0
"""Draws the schematics build/hw/schematic*.{svg,png} from hw/circuit*.yml.

Places are chosen here; values, names and connections come from the file: a drawing that connects
other pins than the file does, or leaves a part out, is an error.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import schemdraw
from circuit import Circuit, load
from dimensions import ROOT
from sheet import Point, Sheet, e


def resistor(
    sheet: Sheet,
    ref: str,
    at: Point,
    way: str = "down",
    length: float = 2.0,
    **label: Any,
) -> tuple[Point, Point]:
    """A part with two ends, its first pin at `at`. Returns both ends."""
    kinds = {
        "resistor": e.ResistorIEC,
        "capacitor": e.Capacitor,
        "ldr": e.PhotoresistorIEC,
        "fuse": e.Fuse,
    }
    part = sheet.circuit.parts[ref]
    kind = e.Capacitor2 if part.polar else kinds[part.kind]
    element = getattr(kind().length(length).at(at), way)()
    pins = sheet.part(
        ref,
        element,
        {"1": "start", "2": "end"},
        **{"loc": "bot" if way == "down" else "top", **label},
    )
    if part.polar:
        (x, y), (_, low) = pins["1"], pins["2"]
        sheet.text((x - 0.45, (y + low) / 2 + 0.15), "+", 11)
    return pins["1"], pins["2"]


def decoupling(sheet: Sheet, ref: str, at: Point, rail: str) -> None:
    """A capacitor between a rail and ground."""
    top, bottom = resistor(sheet, ref, at)
    sheet.net(rail, top)
    sheet.net("GND", bottom)


def fork(sheet: Sheet, ref: str, lamp: str, pull_up: str, rail: str, at: Point) -> Point:
    """A slotted sensor with its two resistors, from above. Returns its output."""
    x, y = at
    top, anode = resistor(sheet, lamp, at, loc="top")
    sheet.net("+5V", top)
    sheet.named(sheet.circuit.parts[ref].pins["A"], anode, (0.12, -0.55))
    diode = e.LED().length(2).at(anode).down()
    pins = sheet.part(ref, diode, {"A": "start", "K": "end"}, label=False)
    sheet.net("GND", pins["K"])
    receiver = e.NpnPhoto().theta(0).at((x + 1.6, y - 3)).anchor("base")
    pins = sheet.part(ref, receiver, {"C": "collector", "E": "emitter"}, label=False)
    pull_top, out = resistor(sheet, pull_up, (pins["C"][0], y))
    sheet.net(rail, pull_top)
    sheet.wire(out, pins["C"])
    sheet.named(sheet.circuit.parts[ref].pins["C"], out)
    sheet.net("GND", sheet.wire(pins["E"], (pins["E"][0], y - 4)))
    sheet.frame((x - 0.7, y - 2.05), 3.6, 1.9, ":")
    sheet.text((x - 0.7, y - 5.4), f"{ref}: {sheet.circuit.parts[ref].what}", 11)
    return out


def flags(sheet: Sheet, ref: str, pins: dict[str, Point], side: str, names: list[str]) -> None:
    """Flags with their nets on pins of a chip."""
    for name in names:
        net = sheet.circuit.parts[ref].pins[name]
        at = pins[name]
        if net in sheet.circuit.volts:
            out = (at[0] + (0.4 if side == "right" else -0.4), at[1])
            sheet.net(net, sheet.wire(at, out))
        else:
            sheet.net(net, at, side)


def comb(sheet: Sheet, at: Point) -> None:
    """Both sensors and the 74HC14."""
    x, y = at
    sheet.text((x - 2.4, y + 1.4), "Comb")
    outs = [
        fork(sheet, "FORK_A", "R1", "R3", "+5V", (x, y)),
        fork(sheet, "FORK_B", "R2", "R4", "+5V", (x, y - 8)),
    ]
    pins = schmitt(sheet, (x + 6, y - 2), ["2Y"])
    sheet.wire(outs[0], (x + 4.2, outs[0][1]), (x + 4.2, pins["1A"][1]), pins["1A"])
    sheet.wire(outs[1], (x + 4.2, outs[1][1]), (x + 4.2, pins["2A"][1]), pins["2A"])
    decoupling(sheet, "C1", (x + 12.5, y - 7), "+5V")


def schmitt(sheet: Sheet, at: Point, outputs: list[str]) -> dict[str, Point]:
    """The 74HC14, unused inputs to ground."""
    unused = [
        a for a in ("2A", "3A", "4A", "5A", "6A") if sheet.circuit.parts["SCHMITT"].pins[a] == "GND"
    ]
    used = ["1A", *(["2A"] if "2A" not in unused else [])]
    pins = sheet.chip("SCHMITT", [*used, *unused], ["VCC", "1Y", *outputs, "", "GND"], at)
    flags(sheet, "SCHMITT", pins, "right", ["VCC", "1Y", *outputs, "GND"])
    corner = (pins[unused[0]][0] - 0.4, pins[unused[0]][1])
    for a in unused:
        sheet.wire(pins[a], (corner[0], pins[a][1]))
    sheet.net("GND", sheet.wire(corner, (corner[0], pins[unused[-1]][1])))
    return pins


def nano(sheet: Sheet, at: Point) -> None:
    """The microcontroller, every pin with the name of its net."""
    sheet.text((at[0], at[1] + 1.4), "Microcontroller")
    left = ["5V", "D2", "D3", "D4", "D5", "D6", "D7", "A0", "A2", "D10", "GND"]
    right = ["A3", "A1", "A4", "A5", "", "D8", "D9", "D11", "D12", "D13"]
    pins = sheet.chip("NANO", left, right, at, 5)
    flags(sheet, "NANO", pins, "left", left)
    flags(sheet, "NANO", pins, "right", [pin for pin in right if pin])


def ring(sheet: Sheet, at: Point) -> None:
    """Nine light sensors on the multiplexer."""
    x, y = at
    sheet.text((x - 4, y + 1.4), "Ring (not on a headset)")
    channels = [f"C{k}" for k in range(9)]
    left = ["VCC", "S0", "S1", "S2", "S3", "SIG", "EN", "GND"]
    pins = sheet.chip("MUX", left, channels, at, pitch=1.3)
    flags(sheet, "MUX", pins, "left", ["VCC", "S0", "S1", "S2", "S3"])
    x_sig = x - 3.2
    common = sheet.wire(pins["SIG"], (x_sig, pins["SIG"][1]))
    sheet.net("RING", common, "left")
    _, bottom = resistor(sheet, "R5", common, length=2.6)
    sheet.net("GND", bottom)
    ground = (x - 1, pins["GND"][1])
    sheet.wire(pins["EN"], (x - 1, pins["EN"][1]), ground, pins["GND"])
    sheet.net("GND", ground)
    bus = x + 8.5
    for k, channel in enumerate(channels):
        start = pins[channel]
        # The file's pin 1 is the supply's.
        element = e.PhotoresistorIEC().at((bus, start[1])).left().length(bus - start[0]).flip()
        sheet.part(f"LDR{k}", element, {"1": "start", "2": "end"}, label=False)
        sheet.text(((start[0] + bus) / 2 + 0.7, start[1] + 0.08), f"LDR{k}", 10)
        sheet.named(sheet.circuit.parts["MUX"].pins[channel], start, (0.2, 0.08))
    sheet.net("+5V", (bus, pins["C0"][1]))
    sheet.wire((bus, pins["C0"][1]), (bus, pins["C8"][1]))
    sheet.text(
        (x + 4.6, pins["C8"][1] - 1.2),
        "LDR0…8: " + sheet.circuit.parts["LDR0"].what,
        11,
    )
    decoupling(sheet, "C2", (x + 2, y - 13.2), "+5V")


def switch(sheet: Sheet, at: Point) -> None:
    """The servo with its slow switch."""
    x, y = at
    sheet.text((x, y + 2.2), "Servo's switch: slow on, off without the microcontroller")
    pins = sheet.chip("POWER", [], ["+", "-"], (x, y + 0.5), 3)
    sheet.net("GND", pins["-"])
    fuse = sheet.wire(pins["+"], (x + 5, pins["+"][1]))
    sheet.net("SUPPLY", fuse)
    _, fused = resistor(sheet, "F1", fuse, "right", loc="bot")
    row = fused[1]
    column = x + 8
    sheet.wire(fused, (column, row))
    _, gate_6 = resistor(sheet, "R6", (column, row), length=2.5)
    column_3 = column + 2.4
    sheet.wire((column, row), (column_3, row))
    _, gate_3 = resistor(sheet, "C3", (column_3, row), length=2.5)
    sheet.named("FUSED", (column, row))
    sheet.named("GATE", (column, gate_6[1]), (-0.15, 0.08), "right")
    source_x = column_3 + 3
    fet = e.PFet().reverse().at((source_x, gate_3[1] + 0.75)).anchor("source").theta(0)
    pmos = sheet.part("Q1", fet, {"S": "source", "D": "drain", "G": "gate"}, label=False)
    transistor(sheet, "Q1", (source_x + 0.3, pmos["G"][1]), pmos)
    sheet.wire((column_3, row), (source_x, row), pmos["S"])
    gate_row = gate_3[1]
    sheet.wire(gate_6, (column, gate_row), gate_3, pmos["G"])
    drain_row = gate_row - 3
    sheet.wire(pmos["D"], (source_x, drain_row))
    gate_wire = column_3 + 0.9
    sheet.wire((gate_wire, gate_row), (gate_wire, drain_row))
    resistor(sheet, "C4", (gate_wire, drain_row), "right", source_x - gate_wire, loc="bot")
    _, pulled = resistor(sheet, "R7", (column, gate_row), length=2.5)
    lower = e.NFet().reverse().at((column, pulled[1] - 0.6)).anchor("drain").theta(0)
    nmos = sheet.part("Q2", lower, {"D": "drain", "S": "source", "G": "gate"}, label=False)
    transistor(sheet, "Q2", (column + 0.3, nmos["G"][1]), nmos)
    sheet.wire(pulled, nmos["D"])
    sheet.named("PULLED", pulled, (0.15, 0.02))
    sheet.net("GND", nmos["S"])
    asked = sheet.wire(nmos["G"], (nmos["G"][0] - 1.6, nmos["G"][1]))
    sheet.net("SERVO_POWER", asked, "left")
    _, low = resistor(sheet, "R8", asked, length=2)
    sheet.net("GND", low)
    output = source_x + 3.2
    sheet.wire((source_x, drain_row), (output, drain_row))
    for k, ref in enumerate(("C5", "C6")):
        top = sheet.wire(
            (output + 2.6 * (k - 1) if k else output, drain_row),
            (output + 2.6 * k, drain_row),
        )
        _, bottom = resistor(sheet, ref, top)
        sheet.net("GND", bottom)
    sheet.named("SERVO", (source_x, drain_row), (0.4, 0.1))
    servo = sheet.chip("SERVO", ["PULSE", "V+", "GND"], [], (output + 6.6, drain_row + 1.5), 3)
    sheet.wire((output + 2.6, drain_row), servo["V+"])
    sheet.net("GND", sheet.wire(servo["GND"], (servo["GND"][0] - 0.3, servo["GND"][1])))
    start = (servo["PULSE"][0] - 3, servo["PULSE"][1])
    sheet.net("SERVO_PULSE", start, "left")
    _, pulse = resistor(sheet, "R9", start, "right")
    sheet.named("PULSE", sheet.wire(pulse, servo["PULSE"]), (-0.05, 0.08), "right")


def transistor(sheet: Sheet, ref: str, at: Point, pins: dict[str, Point]) -> None:
    """Its name, to the right of its channel; numbers at its pins."""
    part = sheet.circuit.parts[ref]
    sheet.text(at, f"{ref}\n{part.what}", 11, valign="center")
    for pin, (x, y) in pins.items():
        beside = (x - 0.15, y + 0.1) if pin == "G" else (x + 0.12, y - 0.1)
        sheet.text(beside, str(part.numbers[pin]), 8)


def carriers(sheet: Sheet, at: Point) -> None:
    """What chooses and carries the messages, if it is not the serial line behind the Nano's USB."""
    x, y = at
    sheet.text((x, y + 1.6), "Carrier: serial as drawn; for others")
    sheet.net("STRAP", (x + 1.5, y), "left")
    _, low = resistor(sheet, "R10", sheet.wire((x + 1.5, y), (x + 2, y)))
    sheet.net("GND", low)
    sheet.text((x + 3.6, y - 1.7), "only for CAN; a link\ninstead of R10: I2C", 10)
    names = ["VCC", "CS", "SI", "SO", "SCK", "INT", "GND"]
    pins = sheet.chip("CAN", names, [], (x + 3.4, y - 4), 4)
    flags(sheet, "CAN", pins, "left", names)
    pins = sheet.chip(
        "SHIFTER",
        ["HV", "HV SDA", "HV SCL", "GND"],
        ["LV", "LV SDA", "LV SCL"],
        (x + 12, y - 0.5),
        4.5,
    )
    flags(sheet, "SHIFTER", pins, "left", ["HV", "HV SDA", "HV SCL", "GND"])
    host = sheet.chip("HOST", ["3V3", "GPIO23", "GPIO24", "GND"], [], (x + 20, y - 0.5), 5.5)
    for a, b in (("LV SDA", "GPIO23"), ("LV SCL", "GPIO24"), ("LV", "3V3")):
        sheet.wire(pins[a], host[b])
    sheet.named("HOST_SDA", pins["LV SDA"])
    sheet.named("HOST_SCL", pins["LV SCL"])
    sheet.net("+3V3", pins["LV"])
    sheet.net("GND", host["GND"])
    only = sheet.chip("FEEDBACK", ["OUT"], [], (x + 12, y - 7.5), 4)
    flags(sheet, "FEEDBACK", only, "left", ["OUT"])


def box(circuit: Circuit) -> Sheet:
    """The sheet of circuit.yml."""
    sheet = Sheet(circuit, schemdraw.Drawing(show=False))
    comb(sheet, (0, 0))
    nano(sheet, (19, 0))
    ring(sheet, (34, 0))
    switch(sheet, (0, -19))
    carriers(sheet, (27.5, -18))
    return sheet


def hat(circuit: Circuit) -> Sheet:
    """The sheet of circuit_hat.yml."""
    sheet = Sheet(circuit, schemdraw.Drawing(show=False))
    sheet.text((-2.4, 1.4), "Servo hat: the comb's sensor on 3.3 V")
    out = fork(sheet, "FORK_A", "R1", "R3", "+3V3", (0, 0))
    pins = schmitt(sheet, (6, -2), [])
    sheet.wire(out, (5, out[1]), (5, pins["1A"][1]), pins["1A"])
    decoupling(sheet, "C1", (13, -7), "+3V3")
    names = ["5V", "3V3", "GPIO17", "GND"]
    host = sheet.chip("HOST", names, [], (17, -1), 5.5)
    flags(sheet, "HOST", host, "left", names)
    return sheet


def panel(circuit: Circuit) -> Sheet:
    """The sheet of circuit_panel.yml."""
    sheet = Sheet(circuit, schemdraw.Drawing(show=False))
    sheet.text((0, 1.2), "LED and button")
    host = sheet.chip("HOST", [], ["GPIO27", "", "GPIO22", "GND"], (0, 0), 5.5, 1.5)
    sheet.net("GND", host["GND"])
    for row, (pin, ref, line, net) in enumerate(
        (("GPIO27", "R1", "LED_DRIVE", "LED_A"), ("GPIO22", "R2", "BUTTON_LINE", "BUTTON"))
    ):
        start = sheet.wire(host[pin], (host[pin][0] + 3, host[pin][1]))
        sheet.named(line, host[pin])
        _, end = resistor(sheet, ref, start, "right")
        far = sheet.wire(end, (end[0] + 1.8, end[1]))
        sheet.named(net, end)
        element = (e.Button if row else e.LED)().length(2).at(far).right()
        ends = {"1": "start", "2": "end"} if row else {"A": "start", "K": "end"}
        pins = sheet.part(("LED", "BUTTON")[row], element, ends, loc="top", ofst=(0, 0.35))
        sheet.net("GND", pins["2" if row else "K"])
    return sheet


SHEETS = {
    "circuit": (box, "schematic"),
    "circuit_hat": (hat, "schematic_hat"),
    "circuit_panel": (panel, "schematic_panel"),
}


def draw(name: str) -> Sheet:
    """A circuit's sheet; ValueError when it does not show what the file says."""
    circuit = load(name)
    sheet = SHEETS[name][0](circuit)
    wanted = {(frozenset(circuit.net(net)), frozenset({net})) for net in circuit.nets()}
    drawn = set(sheet.connected())
    if wrong := [(sorted(names), sorted(pins)) for pins, names in drawn ^ wanted]:
        raise ValueError(f"{name}: drawing and file differ at {sorted(wrong)}")
    return sheet


def main() -> None:
    """Writes them into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build" / "hw")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    schemdraw.config(lw=1.3, font="DejaVu Sans")
    for name, (_, file) in SHEETS.items():
        try:
            draw(name).save(folder / f"{file}.svg", folder / f"{file}.png")
        except ValueError as error:
            sys.exit(str(error))


if __name__ == "__main__":
    main()
