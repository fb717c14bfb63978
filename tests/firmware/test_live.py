"""Real time: lightprobe.mcu talks to the firmware over a pty, I2C and CAN, as to the box."""

import os
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import pytest
from box import ask, until
from harness import wait_for
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from rig import ELF, HOST, RUNNER

FRAME = struct.Struct("<IB3x8s")
PATIENCE_S = 60.0  # for what takes a few seconds; machines may be busy


@dataclass
class Box:
    """A running firmware with its simulated box, and how to reach both."""

    process: subprocess.Popen[bytes]
    pty: Path
    can: Path
    control: socket.socket

    def command(self, line: str) -> str:
        """Send one command to the box; raise RuntimeError when it answers with an error."""
        return ask(self.control, line)


@pytest.fixture
def boot(tmp_path: Path) -> Iterator[Callable[..., Box]]:
    boxes: list[Box] = []

    def make(target: str, carrier: str = "serial") -> Box:
        folder = tmp_path / str(len(boxes))
        folder.mkdir()
        pty, control_path, bus = folder / "tty", folder / "control", folder / "can"
        options = ["--pty", pty, "--control", control_path]
        if target == "avr":
            command = [RUNNER, ELF, "--real-time", "--carrier", carrier, "--can", bus, *options]
        else:
            command = [HOST, *options]
        process = subprocess.Popen(command)
        for path in (pty, control_path):
            wait_for(path.exists, f"{path} does not appear")
        control = socket.socket(socket.AF_UNIX)
        control.connect(str(control_path))
        boxes.append(Box(process, pty, bus, control))
        return boxes[-1]

    yield make
    for box in boxes:
        box.control.close()
        box.process.terminate()
        box.process.wait()


class BoxI2cBus:
    """The runner as bus master."""

    def __init__(self, box: Box) -> None:
        self.box = box

    def write(self, address: int, data: bytes) -> None:
        acknowledged = int(self.box.command(f"twi write {data.hex()}").split()[0])
        if address != mcu_link.I2C_ADDRESS or acknowledged < len(data):
            raise OSError(121, "no acknowledge")

    def read(self, address: int, count: int) -> bytes:
        return bytes.fromhex(self.box.command(f"twi read {count}").split()[2])

    def close(self) -> None:
        pass


class BoxCanBus(can.BusABC):
    """The runner's socket of CAN frames as a python-can bus."""

    def __init__(self, box: Box) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(box.can))
        super().__init__(channel=str(box.can))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.socket.sendall(
            FRAME.pack(msg.arbitration_id, msg.dlc, bytes(msg.data).ljust(8, b"\0"))
        )

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.socket.settimeout(max(timeout or 0.0, 0.001))
        try:
            data = self.socket.recv(FRAME.size, socket.MSG_WAITALL)
        except TimeoutError:
            return None, False
        identifier, length, payload = FRAME.unpack(data)
        frame = can.Message(arbitration_id=identifier, data=payload[:length], is_extended_id=False)
        return frame, False

    def shutdown(self) -> None:
        super().shutdown()
        self.socket.close()


def connect(box: Box, carrier: str) -> mcu_link.Carrier:
    if carrier == "i2c":
        return mcu_link.I2cCarrier(BoxI2cBus(box))
    if carrier == "can":
        return mcu_link.CanCarrier(BoxCanBus(box))
    return mcu_link.open_carrier(f"serial:{box.pty}")


def settled(token: int) -> Callable[[mcu.Event], bool]:
    return lambda e: (
        isinstance(e, mcu.WheelState) and e.token == token and e.phase is mcu.Phase.SETTLED
    )


@pytest.mark.parametrize(
    ("target", "carrier"), [("avr", "serial"), ("avr", "i2c"), ("avr", "can"), ("host", "serial")]
)
def test_a_whole_session(boot: Callable[..., Box], target: str, carrier: str) -> None:
    box = boot(target, carrier)
    link = mcu.Mcu(connect(box, carrier))
    hello = link.hello(timeout_s=PATIENCE_S)
    assert hello["board"] == ("ATMEGA328P" if target == "avr" else "HOST")
    link.rates(ring_scans=8, wheel_ms=100)
    until(link, settled(link.home()))
    state = until(link, settled(link.move(90)))
    assert isinstance(state, mcu.WheelState)
    assert float(box.command("get wheel_deg")) == pytest.approx(state.measured_deg, abs=1.8)
    for number in ("supply_mv 5000", "bandgap_mv 1100", "ldr4_mv 3210"):
        box.command(f"set {number}")
    ring = until(link, lambda e: isinstance(e, mcu.Ring) and abs(e.levels[4] - 2627) <= 12)
    assert isinstance(ring, mcu.Ring)
    assert ring.supply_v == pytest.approx(5, rel=0.03)
    params = link.params()
    assert len(params) == 27
    assert link.param(params[9].number, params[9].maximum).value == params[9].maximum
    with pytest.raises(mcu_link.McuError, match="OUT_OF_RANGE"):
        link.param(params[9].number, params[9].maximum + 1)
    with pytest.raises(mcu_link.McuError, match="refused: NOT_HOMED"):
        link.move(45)  # the parameter was of the wheel's geometry
    link.close()


def test_the_hosts_and_the_mcus_clock_can_be_matched(boot: Callable[..., Box]) -> None:
    box = boot("host")
    link = mcu.Mcu(connect(box, "serial"))
    link.hello(timeout_s=PATIENCE_S)
    first = link.clock()
    time.sleep(0.3)
    second = link.clock()
    for reading in (first, second):
        grain_us = 1000  # the process lives in steps of half a millisecond
        around_us = (reading.received_ns - reading.sent_ns) / 1000
        assert around_us >= reading.turnaround_us - grain_us
    assert second.t_rx_us > first.t_rx_us
    link.close()


def test_a_client_may_come_back_and_a_reset_is_seen(boot: Callable[..., Box]) -> None:
    box = boot("avr")
    for _ in range(2):
        link = mcu.Mcu(connect(box, "serial"))
        link.hello(timeout_s=PATIENCE_S)
        link.close()
    link = mcu.Mcu(connect(box, "serial"))
    before = link.hello(timeout_s=PATIENCE_S)
    link.rates(wheel_ms=50)
    box.command("reset external")
    hello = until(link, lambda e: isinstance(e, mcu.Message) and e.name == "Hello")
    assert isinstance(hello, mcu.Message)
    assert hello.number("boot_count") == before.number("boot_count") + 1
    link.close()


def test_faults_come_by_name_and_can_be_cleared(boot: Callable[..., Box]) -> None:
    box = boot("host")
    faults: list[mcu.Fault] = []
    link = mcu.Mcu(connect(box, "serial"))
    link.hello(timeout_s=PATIENCE_S)
    link.rates(wheel_ms=100)
    until(link, settled(link.home()))
    box.command("set stuck 1")
    link.move(135)
    fault = until(link, lambda e: isinstance(e, mcu.Fault))
    assert isinstance(fault, mcu.Fault)
    faults.append(fault)
    assert (fault.name, fault.active) == ("WHEEL_STUCK", True)
    with pytest.raises(mcu_link.McuError, match="IN_FAULT"):
        link.move(45)
    box.command("set stuck 0")
    link.clear_faults()
    until(link, settled(link.home()))
    link.close()


def test_a_silent_device_is_named(tmp_path: Path) -> None:
    master, slave = os.openpty()
    link = mcu.Mcu(mcu_link.SerialCarrier(os.ttyname(slave)))
    with pytest.raises(mcu_link.McuError, match=r"HelloRequest: no answer in 0\.3 s"):
        link.hello(timeout_s=0.3)
    link.close()
    os.close(slave)
    os.close(master)


def test_unknown_carriers_are_refused_by_name() -> None:
    with pytest.raises(mcu_link.McuError, match="use serial:DEVICE"):
        mcu_link.open_carrier("usb:1234")
