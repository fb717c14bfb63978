"""The circuit agrees with the firmware that is flashed, and the schematic shows the circuit."""

import inspect
import itertools
import re

import circuit
import pytest
import schematic
from circuit import Part
from dimensions import ROOT
from lightprobe.cli import panel
from matplotlib.transforms import Bbox
from sheet import Sheet

PINS_H = (ROOT / "firmware/board/atmega328p/pins.h").read_text()
FIRMWARE_README = (ROOT / "firmware/README.md").read_text()
CIRCUITS = ("circuit", "circuit_hat", "circuit_panel")
#: Of the comb, with its 74HC14.
WITH_COMB = ("circuit", "circuit_hat")

# Names of pins.h, and the net and the pin that each must lead to.
MEANING = {
    "CAN_INTERRUPT": ("CAN_INTERRUPT", ("CAN", "INT")),
    "CAN_SELECT": ("CAN_SELECT", ("CAN", "CS")),
    "SERVO_PULSE": ("SERVO_PULSE", ("R9", "1")),
    "SPI_MOSI": ("SPI_MOSI", ("CAN", "SI")),
    "SPI_MISO": ("SPI_MISO", ("CAN", "SO")),
    "SPI_SCK": ("SPI_SCK", ("CAN", "SCK")),
    "RING_ADC": ("RING", ("MUX", "SIG")),
    "FEEDBACK_ADC": ("FEEDBACK", ("FEEDBACK", "OUT")),
    "SERVO_POWER": ("SERVO_POWER", ("Q2", "G")),
    "STRAP_ADC": ("STRAP", ("R10", "1")),
}
# Rows of pins on one port: name -> ends in the order of the bits.
ROWS = {
    "INDEX_SHIFT": [("SCHMITT", "1Y"), ("SCHMITT", "2Y")],
    "MUX_SHIFT": [("MUX", f"S{i}") for i in range(4)],
}
# Pins of the Raspberry Pi that stand 3.3 V and no more.
LOGIC_3V3 = re.compile(r"GPIO\d+")


def defines() -> dict[str, str]:
    return dict(re.findall(r"^#define (\w+) (P[BCD]\d|\d)\b", PINS_H, re.M))


def nano_label(value: str) -> str:
    """pins.h names a port pin (PB2) or an ADC channel (0: A0)."""
    if not value.startswith("P"):
        return f"A{value}"
    port, bit = value[1], int(value[2])
    return {"B": f"D{8 + bit}", "C": f"A{bit}", "D": f"D{bit}"}[port]


def test_every_name_of_pins_h_is_wired_and_known_here() -> None:
    assert set(defines()) == set(MEANING) | set(ROWS)


@pytest.mark.parametrize("name", MEANING)
def test_wires_lead_where_the_firmware_expects(name: str) -> None:
    net, end = MEANING[name]
    assert circuit.nano_pins()[nano_label(defines()[name])] == net
    assert end in circuit.load().net(net)


@pytest.mark.parametrize("name", ROWS)
def test_rows_of_pins(name: str) -> None:
    first = int(defines()[name])
    nets = [circuit.nano_pins()[f"D{first + i}"] for i in range(len(ROWS[name]))]
    for net, end in zip(nets, ROWS[name], strict=True):
        assert end in circuit.load().net(net)


def test_i2c_pins_of_the_chip() -> None:
    assert re.search(r"SDA PC4, SCL PC5", PINS_H)
    nets = circuit.nano_pins()
    assert ("SHIFTER", "HV SDA") in circuit.load().net(nets["A4"])
    assert ("SHIFTER", "HV SCL") in circuit.load().net(nets["A5"])


def test_the_firmwares_pin_table_names_the_same_pins() -> None:
    """Both columns of its table, ranges expanded: the pins wired here, and the serial line."""
    rows = re.findall(r"^\| (P[BCD]\S.*?) \| ([DA]\d.*?) \|", FIRMWARE_README, re.M)
    chip = [pin for row, _ in rows for pin in expand(row)]
    nano = [pin for _, row in rows for pin in expand(row)]
    assert [circuit.avr_pin(label) for label in nano] == chip
    assert set(nano) == set(circuit.nano_pins()) | {"D0", "D1"}


def expand(cell: str) -> list[str]:
    """'PD4…PD7' -> PD4, PD5, PD6, PD7; 'PD0, PD1' as they are."""
    if "…" not in cell:
        return cell.split(", ")
    first, last = cell.split("…")
    name = first.rstrip("0123456789")
    return [f"{name}{i}" for i in range(int(first[len(name) :]), int(last[len(name) :]) + 1)]


def test_ldrs_are_on_the_channels_that_the_convention_numbers() -> None:
    box = circuit.load()
    for k in range(9):
        ldr = box.parts[f"LDR{k}"]
        assert ldr.pins["1"] == "+5V"
        assert sorted(box.net(ldr.pins["2"])) == [(f"LDR{k}", "2"), ("MUX", f"C{k}")]


def test_the_ring_is_read_through_what_the_firmware_computes_with() -> None:
    divider = circuit.load().parts["R5"]
    assert set(divider.pins.values()) == {"RING", "GND"}
    assert f"{divider.number() / 1000:g} kΩ to ground" in FIRMWARE_README


@pytest.mark.parametrize("name", CIRCUITS)
def test_the_schematic_shows_the_circuit(name: str) -> None:
    """Every part and no other connection: draw() says where not."""
    sheet = schematic.draw(name)
    assert {ref for _, ref, _ in sheet.pins} == set(circuit.load(name).parts)


@pytest.mark.parametrize("name", CIRCUITS)
def test_no_text_of_the_schematic_covers_another_or_a_wire(name: str) -> None:
    sheet = schematic.draw(name)
    boxes = text_boxes(sheet)
    assert len(boxes) >= 2 * len(sheet.circuit.parts)
    for (one, a), (other, b) in itertools.combinations(boxes, 2):
        assert not a.overlaps(b), (one, other)
    for text, box in boxes:
        for start, end in sheet.wires:
            wire = Bbox([start, end]).padded(0.01)
            assert not box.overlaps(wire), (text, start, end)


def text_boxes(sheet: Sheet) -> list[tuple[str, Bbox]]:
    """Every text and the box around it, in the sheet's units."""
    axes = sheet.drawing.draw(show=False).ax
    back = axes.transData.inverted()
    renderer = axes.figure.canvas.get_renderer()
    return [
        (text.get_text(), text.get_window_extent(renderer).transformed(back))
        for text in axes.texts
        if text.get_text()
    ]


@pytest.mark.parametrize("name", CIRCUITS)
def test_pins_have_the_numbers_of_their_packages(name: str) -> None:
    parts = circuit.load(name).parts
    gates = {
        "1": (1, 2),
        "2": (3, 4),
        "3": (5, 6),
        "4": (9, 8),
        "5": (11, 10),
        "6": (13, 12),
    }
    dip = {
        f"{gate}{way}": n for gate, pair in gates.items() for way, n in zip("AY", pair, strict=True)
    }
    dip |= {"GND": 7, "VCC": 14}
    if "SCHMITT" in parts:
        assert all(dip[pin] == n for pin, n in parts["SCHMITT"].numbers.items())
    header = {"3V3": {1, 17}, "5V": {2, 4}, "GND": {6, 9, 14, 20, 25, 30, 34, 39}}
    header |= {"GPIO17": {11}, "GPIO22": {15}, "GPIO23": {16}, "GPIO24": {18}, "GPIO27": {13}}
    assert all(n in header[pin] for pin, n in parts["HOST"].numbers.items())
    for ref in ("Q1", "Q2"):
        if ref in parts:
            assert parts[ref].numbers == {"G": 1, "S": 2, "D": 3}


def test_a_wrong_schematic_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check can fail: the same drawing for a circuit with one wire elsewhere."""
    changed = circuit.load()
    changed.parts["R6"].pins["2"] = "PULLED"
    monkeypatch.setattr(schematic, "load", lambda name: changed)
    with pytest.raises(ValueError, match=r"R6"):
        schematic.draw("circuit")


def high_volt(box: circuit.Circuit, net: str) -> float:
    """Highest voltage that parts bring to a net: outputs of chips, pull-ups."""
    found = [0.0]
    for ref, pin in box.net(net):
        part = box.parts[ref]
        if part.kind == "chip" and re.fullmatch(r"\dY", pin):
            found.append(box.volts[part.pins["VCC"]])
        elif part.kind == "chip" and ref == "NANO":
            found.append(box.volts[part.pins["5V"]])
        elif ref == "SHIFTER":
            found.append(box.volts[part.pins["LV" if pin.startswith("LV") else "HV"]])
        elif part.kind == "resistor":
            found += [box.volts.get(other, 0.0) for other in part.pins.values() if other != net]
    return max(found)


@pytest.mark.parametrize("name", WITH_COMB)
def test_no_more_than_3v3_comes_to_the_computers_pins(name: str) -> None:
    box = circuit.load(name)
    pins = [pin for pin in box.parts["HOST"].pins if LOGIC_3V3.fullmatch(pin)]
    assert pins
    for pin in pins:
        assert 3 < high_volt(box, box.parts["HOST"].pins[pin]) <= 3.3, pin


def config_pins(page: str) -> set[str]:
    """Pins of the computer's header that lines for config.txt give to a device."""
    pins = set()
    for line in re.findall(r"`(dt(?:overlay|param)=[^`]*)`", page):
        pins |= {f"GPIO{n}" for n in re.findall(r"(?:gpio\w*|interrupt|int_pin)=(\d+)", line)}
        if re.search(r"\bspi", line):
            pins |= {f"GPIO{n}" for n in (8, 9, 10, 11)}
    return pins


def test_every_pin_that_the_page_gives_to_a_device_is_drawn() -> None:
    """So that the voltage on it has been looked at: above."""
    page = (ROOT / "hw/README.md").read_text()
    drawn = {pin for name in CIRCUITS for pin in circuit.load(name).parts["HOST"].pins}
    assert {"GPIO23", "GPIO24"} <= config_pins(page) <= drawn


def test_the_panel_is_where_its_command_looks_and_shares_no_pin() -> None:
    words = inspect.signature(panel.command).parameters
    pins = circuit.load("circuit_panel").parts["HOST"].pins
    assert pins[words["led"].default] == "LED_DRIVE"
    assert pins[words["button"].default] == "BUTTON_LINE"
    others = {pin for name in WITH_COMB for pin in circuit.load(name).parts["HOST"].pins}
    assert not {pin for pin in pins if LOGIC_3V3.fullmatch(pin)} & others


def test_the_panels_led_is_seen_and_no_pin_gives_more_than_it_may() -> None:
    """At 3.3 V: an LED of 1.7 to 2.3 V; a button that is pressed while its line is driven high."""
    box = circuit.load("circuit_panel")
    assert set(box.volts.values()) == {0}, "no supply but what the pins give"
    ohm = box.parts["R1"].number()
    assert 0.5e-3 < (3.2 - 2.3) / ohm < (3.4 - 1.7) / ohm < 4e-3
    assert 3.4 / box.parts["R2"].number() < 8e-3
    # Pressed, against the computer's own pull-up of 33 kΩ at least: low is below 0.8 V.
    assert 3.4 * box.parts["R2"].number() / (33e3 + box.parts["R2"].number()) < 0.4


def test_what_a_config_line_would_give_away_is_seen() -> None:
    drawn = {pin for name in CIRCUITS for pin in circuit.load(name).parts["HOST"].pins}
    mcp2515 = "`dtparam=spi=on` and `dtoverlay=mcp2515,spi0-0,oscillator=8000000,interrupt=25`"
    assert config_pins(mcp2515) - drawn == {"GPIO8", "GPIO9", "GPIO10", "GPIO11", "GPIO25"}


def test_the_combs_sensors_saturate() -> None:
    """TCST2202: at 20 mA at least 1 mA (5 %), 0.4 V at most at 0.5 mA; its lamp drops 1.1…1.6 V."""
    for name in WITH_COMB:
        box = circuit.load(name)
        for ref in (r for r in box.parts if r.startswith("FORK")):
            lamp, out = box.parts[ref].pins["A"], box.parts[ref].pins["C"]
            series, pull_up = (resistor(box, net) for net in (lamp, out))
            least_a = 0.05 * (4.6 - 1.6) / series.number()
            needed_a = box.volts[pull_up.pins["1"]] / pull_up.number()
            assert needed_a <= 5e-4
            assert least_a > 1.2 * needed_a
            assert (5.2 - 1.1) / series.number() < 0.03  # of 60 mA


def resistor(box: circuit.Circuit, net: str) -> Part:
    (found,) = (box.parts[ref] for ref, _ in box.net(net) if box.parts[ref].kind == "resistor")
    return found


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{kind: valve, pins: {1: A, 2: B}}", r"T1: kind"),
        ("{kind: resistor, value: 4k7, pins: {1: A, 2: B}}", r"T1: value"),
        ("{kind: resistor, value: 4.7k, pins: {1: A, 2: LOST}}", r"T1: nothing else"),
    ],
)
def test_what_cannot_be_is_named(
    text: str, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    other = "{kind: resistor, value: '1', pins: {1: A, 2: B}}"
    (tmp_path / "circuit.yml").write_text(
        f"nets: {{}}\nparts:\n  R1: {other}\n  R2: {other}\n  T1: {text}\n"
    )
    monkeypatch.setattr("circuit.HW", tmp_path)
    with pytest.raises(ValueError, match=said):
        circuit.load()
