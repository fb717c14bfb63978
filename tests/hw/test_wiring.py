"""The wiring agrees with the firmware that is flashed, and the diagram is drawn from it."""

import html
import re

import pytest
import wiring
from dimensions import ROOT

PINS_H = (ROOT / "firmware/board/atmega328p/pins.h").read_text()
FIRMWARE_README = (ROOT / "firmware/README.md").read_text()

# Where each name of pins.h must lead.
MEANING = {
    "CAN_INTERRUPT": ("CAN", "INT"),
    "CAN_SELECT": ("CAN", "CS"),
    "SERVO_PULSE": ("SERVO", "PULSE"),
    "SPI_MOSI": ("CAN", "SI"),
    "SPI_MISO": ("CAN", "SO"),
    "SPI_SCK": ("CAN", "SCK"),
    "RING_ADC": ("MUX", "SIG"),
    "FEEDBACK_ADC": ("FEEDBACK", "OUT"),
    "SERVO_POWER": ("SWITCH", "ON"),
    "STRAP_ADC": ("STRAP", "SEL"),
}
# Rows of pins on one port: name -> ends in the order of the bits.
ROWS = {
    "INDEX_SHIFT": [("SCHMITT", "1Y"), ("SCHMITT", "2Y")],
    "MUX_SHIFT": [("MUX", f"S{i}") for i in range(4)],
}


def defines() -> dict[str, str]:
    return dict(re.findall(r"^#define (\w+) (P[BCD]\d|\d)\b", PINS_H, re.M))


def nano_label(name: str, value: str) -> str:
    """pins.h names a port pin (PB2) or an ADC channel (0: A0)."""
    if not value.startswith("P"):
        return f"A{value}"
    port, bit = value[1], int(value[2])
    return {"B": f"D{8 + bit}", "C": f"A{bit}", "D": f"D{bit}"}[port]


def test_every_name_of_pins_h_is_wired_and_known_here() -> None:
    assert set(defines()) == set(MEANING) | set(ROWS)


@pytest.mark.parametrize("name", MEANING)
def test_wires_lead_where_the_firmware_expects(name: str) -> None:
    assert wiring.nano_pins()[nano_label(name, defines()[name])] == MEANING[name]


@pytest.mark.parametrize("name", ROWS)
def test_rows_of_pins(name: str) -> None:
    first = int(defines()[name])
    assert [wiring.nano_pins()[f"D{first + i}"] for i in range(len(ROWS[name]))] == ROWS[name]


def test_i2c_pins_of_the_chip() -> None:
    assert re.search(r"SDA PC4, SCL PC5", PINS_H)
    assert wiring.nano_pins()["A4"] == ("I2C", "HV SDA")
    assert wiring.nano_pins()["A5"] == ("I2C", "HV SCL")


def test_the_firmwares_pin_table_names_the_same_pins() -> None:
    """Both columns of its table, ranges expanded: the pins wired here, and the serial line."""
    rows = re.findall(r"^\| (P[BCD]\S.*?) \| ([DA]\d.*?) \|", FIRMWARE_README, re.M)
    chip = [pin for row, _ in rows for pin in expand(row)]
    nano = [pin for _, row in rows for pin in expand(row)]
    assert [wiring.avr_pin(label) for label in nano] == chip
    assert set(nano) == set(wiring.nano_pins()) | {"D0", "D1"}


def expand(cell: str) -> list[str]:
    """'PD4…PD7' -> PD4, PD5, PD6, PD7; 'PD0, PD1' as they are."""
    if "…" not in cell:
        return cell.split(", ")
    first, last = cell.split("…")
    name = first.rstrip("0123456789")
    return [f"{name}{i}" for i in range(int(first[len(name) :]), int(last[len(name) :]) + 1)]


def test_ldrs_are_on_the_channels_that_the_convention_numbers() -> None:
    channels = {(one, a): (other, b) for one, a, other, b in wiring.connections() if one == "RING"}
    assert all(channels["RING", f"L{k}"] == ("MUX", f"C{k}") for k in range(9))


def test_the_diagram_shows_every_wire() -> None:
    svg = html.unescape((ROOT / "build/hw/wiring.svg").read_text())
    for one, a, other, b in wiring.connections():
        for name, pin in ((one, a), (other, b)):
            assert re.search(rf">{name}:\d+:{re.escape(pin)}<", svg), (name, pin)
