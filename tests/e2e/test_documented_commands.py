"""The commands of hw/guide.md and docs/builders/bring_up.md run as printed, on a simulated box.

The box is the flashed binary in simavr behind a boot loader; opening its port resets it, its
reference is off by 8 %, its multiplexer has resistance, its LDRs are as different as GL5528 are.
The test is the builder's hand: it sets the light that a command asks for and presses Enter.
"""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from lightprobe.calibrate import ring
from lightprobe.sim.box import Box

ROOT = Path(__file__).resolve().parents[2]
PORT = "/dev/ttyUSB0"  # of the documents
BLOCK = re.compile(r"^```console(?: (\w+))?\n(.*?)^```$", re.M | re.S)
ASKS = re.compile(r"\d/\d: (\S+) lux on all sensors, then Enter $")
PATIENCE_S = 300
SUPPLY_V = 4.68  # what the documents' multimeter shows


@dataclass
class Command:
    """A line after `$`, and the lines that it should say."""

    line: str
    says: list[str] = field(default_factory=list)


def commands(document: str, case: str = "") -> Iterator[Command]:
    """Those of a document, but for blocks of another case."""
    for only, block in BLOCK.findall((ROOT / document).read_text()):
        if only not in ("", case):
            continue
        command = None
        for line in block.splitlines():
            if line.startswith("$ "):
                if command:
                    yield command
                command = Command(line[2:])
            else:
                assert command, line
                command.says.append(line)
        assert command, block
        yield command


def said(expected: list[str], output: str) -> bool:
    """Whether an output is as expected: `…` in a line is anything in it, alone any lines."""
    parts = [
        r"(?:[^\n]*\n)*?"
        if line == "…"
        else r"[^\n]*?".join(map(re.escape, line.split("…"))) + r" *\n"
        for line in expected
    ]
    return re.fullmatch("".join(parts), output) is not None


def run(command: Command, box: Box, folder: Path, environment: dict[str, str]) -> str:
    """Type a command, and do what it asks. Its output with its errors, as a terminal shows both."""
    words = command.line.replace(PORT, str(folder / "mcu"))
    process = subprocess.Popen(
        ["bash", "-c", words], cwd=folder, env=environment, text=True, bufsize=0,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert process.stdin
    assert process.stdout
    output = ""
    while letter := process.stdout.read(1):
        output += letter
        if asked := ASKS.search(output):
            box.set(**{f"ldr{k}_lux": float(asked[1]) for k in range(9)})
            process.stdin.write("\n")
            output += "\n"
    assert process.wait(PATIENCE_S) == 0, f"{command.line}\n{output}"
    return output.replace(str(folder / "mcu"), PORT)


def unlike_others(box: Box, rng: np.random.Generator) -> None:
    """What differs from box to box and is not drawn from its seed."""
    box.set(supply_mv=1000 * SUPPLY_V, bandgap_mv=1015)
    r10 = np.exp(rng.uniform(np.log(8e3), np.log(2e4), 9))
    box.set(**{f"ldr{k}_r10_ohm": float(value) for k, value in enumerate(r10)})
    box.set(**{f"ldr{k}_gamma": float(rng.uniform(0.6, 0.8)) for k in range(9)})
    box.set(**{f"ldr{k}_lux": 300.0 for k in range(9)})


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("document", "case"),
    [
        ("hw/guide.md", ""),
        ("hw/guide.md", "reversed"),
        ("docs/builders/bring_up.md", ""),
    ],
)
def test_the_commands_do_what_the_document_says(document: str, case: str, tmp_path: Path) -> None:
    environment = dict(os.environ)
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    with Box("avr", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as box:
        assert box.get("dtr_resets") == 1
        assert box.get("boot_loader") > 0
        assert all(box.get(f"ldr{k}_mux_ohm") > 50 for k in range(9))
        unlike_others(box, np.random.default_rng(5))
        if case == "reversed":
            box.set(servo_zero_us=2200, servo_gain_us_deg=-7.407)
        done = []
        for command in commands(document, case):
            name, _, value = command.line.removeprefix("export ").partition("=")
            if command.line.startswith("export "):
                environment[name] = value.replace(PORT, str(tmp_path / "mcu"))
                continue
            output = run(command, box, tmp_path, environment)
            assert said(command.says, output), f"{command.line}\n{output}"
            done.append(command.line.split()[1:3])
        for needed in (["mcu", "flash"], ["mcu", "home"], ["calibrate", "ring"]):
            assert needed in done
        is_right(tmp_path / "ring.ini", box)


def is_right(file: Path, box: Box) -> None:
    """The ring file that was written gives back true illuminances, within what it states."""
    found = ring.load(file)
    true = ring.Ring(
        *(
            np.array([box.get(f"ldr{k}_{name}") for k in range(9)])
            for name in ("r10_ohm", "gamma", "mux_ohm")
        )
    )
    for lux in (10.0, 300.0, 10_000.0):
        seen = true.level(np.full(9, lux))
        assert np.all(np.abs(found.lux(seen) / lux - 1) < found.total_sigma_of(seen)), lux


def test_an_output_that_is_not_as_printed_is_found() -> None:
    """The comparison can fail."""
    assert said(["a … c"], "a b c\n")
    assert said(["…", "no faults"], "one\ntwo\nno faults\n")
    assert not said(["…", "no faults"], "one\nWHEEL_STUCK\n")
    assert not said(["a … c"], "a b d\n")
    assert not said(["a"], "a\nb\n")
