# SPDX-License-Identifier: Apache-2.0
"""The daemon and the microcontroller's firmware over every carrier, through the kernel's drivers.

The emulated machine is slow: ten rings a second, and nothing here depends on how fast it is.
"""

import math
import socket
from contextlib import contextmanager
from pathlib import Path

import pytest
from box import CAN_FRAME, CanBridge, Firmware, MailboxBridge, SerialBridge
from gadget import Gadget
from lightprobe_proto import lightprobe_pb2 as pb
from machine import modprobe, run, wait_for

from daemon import Daemon

CAN_ERR_BUSOFF = 0x20000040
Phase = pb.Wheel.Phase


@contextmanager
def probe(carrier: str, bridge, **options):
    """A daemon on a carrier, the firmware behind a bridge; nothing is known of a camera."""
    name = carrier.split(":")[0]
    firmware = Firmware(f"{name}{id(options)}")
    bridging = bridge(firmware.line)
    uri = f"mcu:{carrier}?ring_scans=80"
    daemon = Daemon("sim:/run/no-camera", f"--rotator={uri}", f"--ring={uri}")
    try:
        yield daemon, firmware
    finally:
        log = daemon.stop()
        bridging.stop()
        firmware.stop()
        assert "WHEEL" not in log, log


def is_settled(health: pb.Health) -> bool:
    """Homed, at 0, and its angle known."""
    return health.wheel.phase == Phase.SETTLED and abs(health.wheel.measured_deg) < 2


def check_session(daemon: Daemon, firmware: Firmware) -> None:
    """Homed; the ring reads what its pins are; clocks are matched."""
    health = daemon.wait_health("settled", is_settled)
    assert abs(float(firmware.command("get wheel_deg"))) < 3 * health.wheel.sigma_deg
    assert health.wheel.HasField("clock_sigma_us")

    def lux(health: pb.Health) -> float:
        return health.ring.illuminance_lux[4] if health.ring.samples else math.nan

    before = daemon.wait_health("a ring", lambda h: lux(h) > 0)
    firmware.set(ldr4_mv=4000)
    daemon.wait_health("brighter", lambda h: lux(h) > 3 * lux(before))


def fault(name: str):
    """Condition: this fault is among those of now."""
    return lambda health: name in {f.id for f in health.faults}


def is_well(health: pb.Health) -> bool:
    """Nothing is wrong but the camera."""
    return is_settled(health) and {f.id for f in health.faults} == {"source-waiting"}


def recovered(health: pb.Health) -> bool:
    """Everything works again, after a new start."""
    return is_well(health) and health.wheel.reconnects > 0


@pytest.fixture(scope="module")
def acm():
    """A serial gadget: the daemon's end is ttyACM0."""
    modprobe("usb_f_acm")
    modprobe("cdc-acm")
    gadget = Gadget("mcu", "acm.usb0", 0x0104)
    gadget.plug()
    wait_for("ttyACM0", Path("/dev/ttyACM0").exists)
    yield gadget
    gadget.unplug()


@pytest.fixture(scope="module")
def ftdi():
    """Two FTDI adapters of QEMU's, joined by a null-modem cable."""
    for module in ("xhci-pci", "ftdi_sio"):
        modprobe(module)
    ends = [Path("/dev/ttyUSB0"), Path("/dev/ttyUSB1")]
    wait_for("two FTDI adapters", lambda: all(end.exists() for end in ends))
    return ends


@pytest.fixture(scope="module")
def mailbox():
    """Device of an I2C bus with the mailbox on it."""
    modprobe("i2c-dev")
    modprobe("i2c_mailbox")
    for adapter in Path("/sys/class/i2c-adapter").iterdir():
        if (adapter / "name").read_text().strip() == "lightprobe mailbox":
            return f"/dev/{adapter.name}"
    raise AssertionError("no adapter appeared")


def test_usb_serial_and_its_cable(acm):
    def bridge(line):
        return SerialBridge(line, Path("/dev/ttyGS0"))

    with probe("serial:/dev/ttyACM0", bridge) as (daemon, firmware):
        check_session(daemon, firmware)
        acm.unplug()
        health = daemon.wait_health("unplugged", fault("mcu-waiting"))
        assert health.wheel.phase == Phase.ABSENT
        acm.plug()
        daemon.wait_health("plugged in again", recovered, timeout_s=120)


def test_ftdi(ftdi):
    with probe(f"serial:{ftdi[0]}", lambda line: SerialBridge(line, ftdi[1])) as probed:
        check_session(*probed)


def test_virtual_can_goes_down_and_off(vcan):
    with probe(f"can:{vcan}", lambda line: CanBridge(line, vcan)) as (daemon, firmware):
        check_session(daemon, firmware)
        run("ip", "link", "set", vcan, "down")
        health = daemon.wait_health("down", fault("mcu-waiting"))
        assert any("ip link set" in f.text for f in health.faults)
        run("ip", "link", "set", vcan, "up")
        daemon.wait_health("up again", recovered, timeout_s=120)
        # The controller's message that it is off; nothing else is heard meanwhile.
        firmware.set(line_cut=1)
        daemon.wait_health("silent", fault("mcu-silent"))
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
            bus.bind((vcan,))
            bus.send(CAN_FRAME.pack(CAN_ERR_BUSOFF, 8, bytes(8)))
        daemon.wait_health("off", fault("can-bus-off"))
        firmware.set(line_cut=0)
        daemon.wait_health("on again", recovered, timeout_s=120)


def test_can_with_bit_timing(kvaser):
    with probe(f"can:{kvaser[0]}", lambda line: CanBridge(line, kvaser[1])) as probed:
        check_session(*probed)


def test_i2c_without_an_answer_and_with_the_clock_held(mailbox):
    parameters = Path("/sys/module/i2c_mailbox/parameters")
    with probe(f"i2c:{mailbox}", MailboxBridge) as (daemon, firmware):
        check_session(daemon, firmware)
        (parameters / "nack").write_text("1")
        health = daemon.wait_health("no acknowledge", fault("i2c-nack"))
        assert any("address, power" in f.text for f in health.faults)
        (parameters / "nack").write_text("0")
        daemon.wait_health("back", is_well, timeout_s=120)
        (parameters / "error").write_text("110")
        health = daemon.wait_health("held", fault("i2c-nack"))
        assert any("SDA or SCL" in f.text for f in health.faults)
        (parameters / "error").write_text("0")
        daemon.wait_health("free", is_well, timeout_s=120)
