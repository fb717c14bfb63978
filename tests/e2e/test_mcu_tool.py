"""`lightprobe mcu` as a user types it, against the firmware; `flash` through the real avrdude."""

import json
import os
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from lightprobe.calibrate import ring
from lightprobe.sim.box import Box

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
FIRMWARE = Path(__file__).resolve().parents[2] / "build" / "firmware"


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Box]:
    """The firmware, at serial:<tmp_path>/mcu."""
    with Box("host", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as running:
        yield running


def mcu(folder: Path, *words: str, status: int = 0) -> str:
    """Output of a command; its errors when it ends with another status than 0."""
    environment = {**os.environ, "LIGHTPROBE_MCU": f"mcu:serial:{folder / 'mcu'}"}
    done = subprocess.run(
        [LIGHTPROBE, "mcu", *words], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr if status else done.stdout


@pytest.mark.usefixtures("box")
def test_info(tmp_path: Path) -> None:
    told = json.loads(mcu(tmp_path, "info", "--json"))
    assert told["Hello"]["board"] == "HOST"
    assert told["Capabilities"]["ring_sensors"] == 9
    assert told["WheelState"]["phase"] == "UNKNOWN"
    assert told["WheelState"]["measured_deg"] is None
    assert told["faults"] == []
    words = mcu(tmp_path, "info")
    assert "on HOST" in words
    assert "angle unknown" in words
    assert "no faults" in words


def test_home_move_release(tmp_path: Path, box: Box) -> None:
    assert "NOT_HOMED (detail 0): `lightprobe mcu home` first" in mcu(
        tmp_path, "move", "90", status=1
    )
    assert "SETTLED at 0.00°" in mcu(tmp_path, "home")
    state = json.loads(mcu(tmp_path, "move", "90", "--slew-deg-s", "120", "--json"))
    assert state["phase"] == "SETTLED"
    assert abs(box.get("wheel_deg") - state["measured_deg"]) <= 3 * state["sigma_deg"]
    assert state["measured_deg"] == pytest.approx(90, abs=1)
    assert box.get("powered") == 1
    mcu(tmp_path, "release")
    assert box.get("powered") == 0
    assert "OUT_OF_RANGE" in mcu(tmp_path, "move", "200", status=1)
    assert "less than or equal to 327" in mcu(tmp_path, "move", "400", status=2)


def test_a_stuck_wheel_is_named_with_the_next_step(tmp_path: Path, box: Box) -> None:
    mcu(tmp_path, "home")
    box.set(stuck=1)
    words = mcu(tmp_path, "move", "135", status=1)
    assert "wheel: FAULT: WHEEL_STUCK: the wheel does not turn" in words
    assert "mcu clear" in words
    assert "WHEEL_STUCK" in mcu(tmp_path, "info")
    box.set(stuck=0)
    assert mcu(tmp_path, "clear").strip() == "none"
    mcu(tmp_path, "home")


def test_ring(tmp_path: Path, box: Box) -> None:
    lux = [5, 10, 50, 100, 200, 500, 1000, 2000, 5000]
    box.set(**{f"ldr{k}_lux": value for k, value in enumerate(lux)})
    mcu(tmp_path, "ring", "--seconds", "1")  # the LDRs have followed
    told = json.loads(mcu(tmp_path, "ring", "--json"))
    assert told["lux"] == pytest.approx(lux, rel=0.03)
    assert told["dead"] == [False] * 9
    assert told["supply_v"] == pytest.approx(5, abs=0.1)
    file = tmp_path / "ring.ini"
    file.write_text(ring.Ring(gamma=ring.Ring().gamma - 0.1).text())
    other = json.loads(mcu(tmp_path, "ring", "--json", "--calibration", str(file)))
    assert other["lux"][0] == pytest.approx(10 * (5 / 10) ** (0.7 / 0.6), rel=0.05)
    assert "sensor" in mcu(tmp_path, "ring")
    box.set(ldr3_forced=0)
    mcu(tmp_path, "ring", "--seconds", "1")
    assert json.loads(mcu(tmp_path, "ring", "--json"))["lux"][3] is None


def test_params(tmp_path: Path, box: Box) -> None:
    everything = json.loads(mcu(tmp_path, "params", "--json"))
    assert len(everything) == 27
    assert "mains_hz = 50  (50…60)" in mcu(tmp_path, "params")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    assert json.loads(mcu(tmp_path, "params", "set", "lag_ms", "40", "--json"))[0]["value"] == 40
    mcu(tmp_path, "params", "reload")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    mcu(tmp_path, "params", "set", "lag_ms", "45", "--save")
    box.set(reset=1)
    assert "lag_ms = 45" in mcu(tmp_path, "params", "get", "lag_ms")
    mcu(tmp_path, "params", "defaults")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    assert "want 0…500" in mcu(tmp_path, "params", "set", "lag_ms", "900", status=2)
    assert "known are servo_zero_us" in mcu(tmp_path, "params", "get", "colour", status=2)


def test_watch(tmp_path: Path, box: Box) -> None:
    lines = mcu(tmp_path, "watch", "--json", "--seconds", "2", "--rate", "20").splitlines()
    kinds = [json.loads(line)["message"] for line in lines]
    assert kinds.count("Ring") >= 10
    assert "WheelState" in kinds
    assert "ring " in mcu(tmp_path, "watch", "--seconds", "1")


@pytest.mark.parametrize(
    ("port", "words", "status"),
    [
        ("serial:/dev/ttyNONE", "open: No such file or directory: is it plugged in?", 1),
        ("i2c:/dev/i2c-99", "open: No such file or directory: is it plugged in?", 1),
        ("can:can99", r"mcu: can:can99: open: ", 1),
        ("usb:1", "unknown carrier; use serial:DEVICE", 1),
        ("serial:/dev/tty0?speed=9", "speed=9: want baud=NUMBER", 1),
        ("can:can0?baud=9", "baud=9: want no option", 1),
    ],
)
def test_ports_that_are_not_there(tmp_path: Path, port: str, words: str, status: int) -> None:
    assert words in mcu(tmp_path, "info", "--port", port, status=status)


def test_a_port_in_use_and_a_device_that_is_silent(tmp_path: Path, box: Box) -> None:
    import serial

    with serial.Serial(str(tmp_path / "mcu"), exclusive=True):
        assert "is lightprobed or another program using it?" in mcu(tmp_path, "info", status=1)
    box.set(line_cut=1)
    assert "HelloRequest: no answer in 4 s" in mcu(tmp_path, "info", status=1)


# ---------------------------------------------------------------- flash


class BootLoader(threading.Thread):
    """Optiboot's side of STK500 version 1 (Atmel AVR061) on a pty, with a page memory."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.master, self.slave = os.openpty()
        for end in (self.master, self.slave):
            tty.setraw(end)
        self.flash = bytearray(b"\xff" * 32768)
        self.address = 0

    @property
    def path(self) -> str:
        return os.ttyname(self.slave)

    def take(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += os.read(self.master, count - len(data))
        return data

    def run(self) -> None:
        while True:
            command = self.take(1)
            answer = b""
            if command in (b"0", b"P", b"Q"):  # sync, enter and leave
                pass
            elif command == b"A":
                answer = bytes([4 if self.take(1)[0] in (0x81, 0x82) else 3])
            elif command == b"B":
                self.take(20)
            elif command == b"E":
                self.take(5)
            elif command == b"V":
                self.take(4)
                answer = b"\0"
            elif command == b"U":
                self.address = 2 * int.from_bytes(self.take(2), "little")
            elif command == b"u":
                answer = bytes([0x1E, 0x95, 0x0F])
            elif command in (b"d", b"t"):
                count = int.from_bytes(self.take(2), "big")
                assert self.take(1) == b"F"
                if command == b"d":
                    self.flash[self.address : self.address + count] = self.take(count)
                else:
                    answer = bytes(self.flash[self.address : self.address + count])
            else:
                continue
            assert self.take(1) == b" "
            os.write(self.master, b"\x14" + answer + b"\x10")


def binary(path: Path) -> bytes:
    """An Intel HEX file without gaps as bytes."""
    data = bytearray()
    for line in path.read_text().split():
        record = bytes.fromhex(line[1:])
        if record[3] == 0:
            assert int.from_bytes(record[1:3], "big") == len(data)
            data += record[4:-1]
    return bytes(data)


def test_flash(tmp_path: Path) -> None:
    """What avrdude writes is the firmware, byte for byte."""
    loader = BootLoader()
    loader.start()
    mcu(tmp_path, "flash", "--port", f"serial:{loader.path}", "--no-verify")
    expected = binary(FIRMWARE / "lightprobe-mcu.hex")
    assert 10_000 < len(expected) <= 16_384
    assert loader.flash[: len(expected)] == expected


def test_flash_says_what_is_wrong(tmp_path: Path) -> None:
    assert "on the serial line" in mcu(tmp_path, "flash", "--port", "can:can0", status=2)
    words = mcu(tmp_path, "flash", "--hex", str(tmp_path / "none.hex"), status=2)
    assert "build it with `make firmware`" in words
    words = mcu(tmp_path, "flash", "--port", "serial:/dev/ttyNONE", status=1)
    assert "avrdude ended with status" in words
