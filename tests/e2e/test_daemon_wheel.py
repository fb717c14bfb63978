"""The real daemon, the firmware in its box, and what is true of the box: angles, faults, light."""

from __future__ import annotations

import json
import math
import os
import random
import subprocess
import sys
import time
import tty
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import serial
from box import Box, monotonic_ns
from harness import Camera, Client, Daemon, camera, jpeg, run, streaming, wait_for
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.sim.clock import START_NS, UNIX_NS, SimulatedClock
from lightprobe_proto import lightprobe_pb2 as pb

pytestmark = pytest.mark.many_frames

RING_FAULT, WHEEL_FAULT = 2048, 4096
EXPOSURE_US = 10_000.0
RATE_HZ = 30
STEP_US = 1000  # of simulated time
PICTURE = jpeg()
Phase = pb.Wheel.Phase


@dataclass
class Probe:
    """Everything that runs, and a client that gets estimates and health."""

    box: Box
    cam: Camera
    daemon: Daemon
    client: Client
    clock: SimulatedClock | None = None  # None: in real time
    stamped: int = 0
    worst_sigmas: float = 0.0
    behind_us: deque[float] = field(default_factory=lambda: deque(maxlen=4))
    frames: int = 0

    @property
    def now_s(self) -> float:
        """Time, real or simulated."""
        return time.monotonic() if self.clock is None else self.clock.now_ns() / 1e9

    def messages(self) -> list[Any]:
        """What comes next: in simulated time, within the next millisecond."""
        if self.clock is None:
            return [self.client.next()]
        self.box.run(STEP_US)
        now_ns = self.clock.now_ns() + 1000 * STEP_US
        self.clock.advance(now_ns)
        self.box.flush()
        if now_ns >= START_NS + self.frames * 1e9 / RATE_HZ:
            self.frames += 1
            start_ns = now_ns - round(1e3 * EXPOSURE_US)
            self.cam.send(PICTURE, exposure_us=EXPOSURE_US, t_start_ns=start_ns)
        self.clock.advance(now_ns)
        return [getattr(m, m.WhichOneof("message")) for m in self.client.take()]

    def wait(self, seconds: float) -> None:
        """Let time pass; all estimates are checked."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            for message in self.messages():
                if isinstance(message, pb.Estimate):
                    self.check(message)

    def box_ns(self, estimate: pb.Estimate) -> int:
        """When an estimate's frame was captured, by the clock that the box's angles go by."""
        if self.clock is None:
            return monotonic_ns(estimate.capture_time_unix_ns)
        return estimate.capture_time_unix_ns - UNIX_NS - START_NS

    def check(self, estimate: pb.Estimate) -> None:
        """No angle is further from the truth than three of its sigmas, all exposure long.

        A box that is behind the clock does everything so much later than `angles` says: the
        exposure was then somewhere in the time that it was behind.
        """
        self.behind_us.append(float(self.box.command("get behind_us")))
        self.box.set(behind_us=0)
        if not estimate.HasField("wheel_deg"):
            return
        exposure_ns = int(EXPOSURE_US * 1000)
        span_ns = exposure_ns + int(max(self.behind_us) * 1000)
        end_ns = self.box_ns(estimate) + exposure_ns // 2
        try:
            angles = self.box.angles(end_ns - span_ns, end_ns, 64)
        except RuntimeError:  # not yet, or forgotten: this machine was busy
            return
        window = max(2, math.ceil(64 * exposure_ns / span_ns))
        offs = [abs(angle - estimate.wheel_deg) for angle in angles]
        off = min(max(offs[at : at + window]) for at in range(64 - window + 1))
        sigmas = off / estimate.wheel_sigma_deg
        self.stamped += 1
        self.worst_sigmas = max(self.worst_sigmas, sigmas)
        assert sigmas <= 3, f"said {estimate.wheel_deg}, was {angles}"

    def until(self, condition, kind: str = "estimate", limit_s: float = 60):
        """The first message of a kind that fulfils a condition; all estimates are checked."""
        end_s = self.now_s + limit_s
        message, found = None, None
        while self.now_s < end_s:
            for message in self.messages():
                if isinstance(message, pb.Estimate):
                    self.check(message)
                if type(message).__name__.lower() == kind and not found and condition(message):
                    found = message
            if found:
                return found
        raise AssertionError(f"no such {kind} in {limit_s} s; the last message: {message}")

    def phase(self, phase: int) -> pb.Health:
        """Wait for a phase of the wheel."""
        return self.until(lambda h: h.wheel.phase == phase, "health")

    def fault(self, name: str, there: bool = True) -> pb.Health:
        """Wait for a fault, or its end."""
        return self.until(lambda h: (name in {f.id for f in h.faults}) == there, "health")

    def stamp(self, near_deg: float) -> pb.Estimate:
        """Wait for an estimate with this angle."""
        return self.until(lambda e: e.HasField("wheel_deg") and abs(e.wheel_deg - near_deg) < 3)


@contextmanager
def probe(target: str = "host", *options: str, ring: bool = True) -> Iterator[Probe]:
    """Daemon and box in simulated time: no load changes what happens."""
    with Box(target, lock_step=True) as box, camera() as cam:
        uri = f"mcu:serial:{box.tty}"
        arguments = [f"--source=sim:{cam.path}", f"--rotator={uri}", "--brackets=0"]
        arguments += [f"--ring={uri}"] if ring else []
        arguments += [f"--simulated-time={box.folder / 'time'}"]
        clock = SimulatedClock(box.folder / "time")
        with Daemon(*arguments, *options) as daemon:
            clock.advance(START_NS)
            cam.accept()
            with daemon.client(health_period_ms=100, sh_order=0, max_lights=0) as client:
                try:
                    yield Probe(box, cam, daemon, client, clock)
                finally:
                    clock.close()


@contextmanager
def probe_in_real_time(target: str = "host", *options: str, ring: bool = True) -> Iterator[Probe]:
    """For what has a clock of its own, as another program that uses the box."""
    with Box(target) as box, camera() as cam:
        uri = f"mcu:serial:{box.tty}"
        arguments = [f"--source=sim:{cam.path}", f"--rotator={uri}", "--brackets=0"]
        arguments += [f"--ring={uri}"] if ring else []
        with Daemon(*arguments, *options) as daemon:
            cam.accept()
            with (
                daemon.client(health_period_ms=100, sh_order=0, max_lights=0) as client,
                streaming(cam, jpeg(), exposure_us=EXPOSURE_US),
            ):
                yield Probe(box, cam, daemon, client)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("target", ["host", "avr"])
def test_frames_carry_the_wheels_true_angle(target):
    with probe(target, "--wheel-angles=0,45,90", "--wheel-dwell-ms=300") as p:
        hello = p.until(lambda h: True, "hello")
        assert hello.has_wheel
        assert hello.has_ring
        for angle in (0, 45, 90, 0, 45):
            p.stamp(angle)
        health = p.until(lambda h: h.wheel.moves >= 5, "health")
        assert health.wheel.frames_stamped > 5
        assert health.wheel.frames_moving > 5
        assert health.wheel.clock_sigma_us < 100_000
        assert not health.faults
        assert p.stamped > 3
        print(f"{p.stamped} angles checked, the worst {p.worst_sigmas:.2f} sigma off")


def test_the_ring_follows_the_light():
    with probe() as p:
        p.box.set(adc_offset_lsb=0, **{f"ldr{k}_mv": 1000 + 300 * k for k in range(9)})

        def as_set(health: pb.Health) -> bool:
            lux = health.ring.illuminance_lux
            ohm = [3300 * (5000 / (1000 + 300 * k) - 1) - 85 for k in range(9)]  # multiplexer
            wanted = [10 * (14000 / r) ** (1 / 0.7) for r in ohm]
            return all(abs(a / b - 1) < 0.03 for a, b in zip(lux, wanted, strict=True))

        p.until(as_set, "health")
        health = p.until(lambda h: h.ring.samples > 200, "health")
        assert len(health.ring.illuminance_lux) == 9


def test_an_open_sensor_is_named_and_flagged():
    with probe() as p:
        p.stamp(0)
        p.box.set(ldr3_forced=0)
        health = p.fault("LDR_OPEN")
        assert "LDR_OPEN" in health.faults[0].text
        estimate = p.until(lambda e: e.flags & RING_FAULT)
        assert not estimate.flags & WHEEL_FAULT
        health = p.until(lambda h: str(h.ring.illuminance_lux[3]) == "nan", "health")
        assert health.ring.illuminance_lux[2] > 0
        p.box.set(ldr3_forced=-1)
        p.until(lambda e: not e.flags & RING_FAULT)
        p.fault("LDR_OPEN")  # until somebody has seen it


def test_what_nobody_has_seen_stays():
    """A fault that a person must know of survives the daemon, which clears others meanwhile."""
    with probe_in_real_time("host", "--wheel-angles=0,120", "--wheel-dwell-ms=200") as p:
        p.box.command("eeprom " + "55" * 300)  # both copies
        p.box.command("reset")
        p.fault("PARAMS_LOST")
        p.stamp(120)
        p.box.set(stuck=1)
        p.fault("WHEEL_STUCK")
        p.box.set(stuck=0)
        p.fault("WHEEL_STUCK", there=False)  # cleared, and homed
        health = p.fault("PARAMS_LOST")
        assert "calibrate and save again" in health.faults[0].text
        p.daemon.stop()
        words = tool(p.box, "info")
        assert "PARAMS_LOST: the stored parameters are damaged" in words
        assert tool(p.box, "clear").strip() == "none"


def tool(box: Box, *words: str, status: int = 0) -> str:
    """`lightprobe mcu` on the box's port: what it prints, or its error."""
    lightprobe = Path(sys.executable).parent / "lightprobe"
    done = subprocess.run(
        [lightprobe, "mcu", *words, "--port", f"serial:{box.tty}"],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout if status == 0 else done.stderr


def test_daemon_and_tool_do_not_share_a_port():
    with probe_in_real_time("host", "--wheel-angles=0,45", "--wheel-dwell-ms=200") as p:
        p.stamp(0)
        lost = p.until(lambda h: h.ring.samples > 100, "health").ring.samples_lost
        words = tool(p.box, "info", status=1)
        assert "open: in use: is lightprobed or another program using it?" in words
        p.stamp(45)
        health = p.until(lambda h: h.ring.samples > 300, "health")
        assert health.ring.samples_lost == lost
    with (
        Box() as box,
        serial.Serial(str(box.tty), exclusive=True),
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", f"--rotator=mcu:serial:{box.tty}") as daemon,
    ):
        daemon.wait_log("is another program using it? lightprobe mcu, or another lightprobed")


def test_a_jam_is_tried_three_times_under_its_first_name():
    """And then the servo is left alone: a finger may be in the gear."""
    with probe("host", "--wheel-angles=0,120", "--wheel-dwell-ms=200", ring=False) as p:
        p.stamp(120)
        p.box.set(stuck=1)
        p.fault("WHEEL_STUCK")

        def still_jammed(health: pb.Health) -> bool:
            wheel = [f for f in health.faults if f.id.startswith(("WHEEL", "INDEX"))]
            assert [f.id for f in wheel] == ["WHEEL_STUCK"]
            return "three attempts failed" in wheel[0].text

        health = p.until(still_jammed, "health")
        assert health.wheel.phase == Phase.FAULT
        assert p.box.command("get powered") == "0"
        p.box.set(stuck=0)
        p.wait(2)
        assert p.box.command("get powered") == "0"
        p.box.set(line_unplugged=1)
        p.fault("mcu-waiting")
        p.box.set(line_unplugged=0)  # a person's hand: the Nano starts anew
        p.stamp(120)
        p.until(lambda h: not h.faults, "health")


FAULTS = {
    "stuck": ({"stuck": 1}, {"stuck": 0}, {"WHEEL_STUCK"}),
    "slow": ({"slow": 0.2}, {"slow": 1}, {"WHEEL_SLOW"}),
    "slipping": ({"slip_deg": 30}, {"slip_deg": 0}, {"WHEEL_SLIP"}),
    "acknowledged faster than physics": (
        {"stuck": 1, "lie_deg": 60},
        {"stuck": 0, "lie_deg": 0},
        {"WHEEL_TOO_FAST"},
    ),
    "index noise": ({"index_glitches": 4000}, {"index_glitches": 0}, {"INDEX_NOISE"}),
    "supply low": ({"supply_mv": 3400}, {"supply_mv": 4700}, {"SUPPLY_LOW"}),
}


@pytest.mark.nightly_rows
@pytest.mark.parametrize("name", FAULTS)
def test_a_wheel_that_lies_is_caught_and_comes_back(name):
    make, mend, names = FAULTS[name]
    with probe("host", "--wheel-angles=0,120", "--wheel-dwell-ms=200") as p:
        p.stamp(0)
        p.box.set(**make)
        health = p.until(lambda h: {f.id for f in h.faults} & names, "health")
        assert health.wheel.phase in (Phase.FAULT, Phase.UNKNOWN, Phase.HOMING)
        assert not health.wheel.HasField("measured_deg")
        p.until(lambda e: e.flags & WHEEL_FAULT and not e.HasField("wheel_deg"))
        p.box.set(**mend)
        p.stamp(120)  # without restart
        for fault in names:
            p.fault(fault, there=False)
        p.until(lambda e: not e.flags & WHEEL_FAULT)


@pytest.mark.nightly_rows
@pytest.mark.parametrize(("sensor", "level"), [("a", 0), ("b", 1), ("ab", 0), ("ab", 1)])
def test_index_never_or_always_seen(sensor, level):
    with probe("host", "--wheel-angles=0,120", "--wheel-dwell-ms=200") as p:
        p.stamp(0)
        p.box.set(**{f"index_{s}_forced": level for s in sensor})
        name = "INDEX_PATTERN" if len(sensor) == 1 else ("INDEX_NEVER", "INDEX_ALWAYS")[level]
        # A move may blame the wheel, and that name stays; the homing after it tells.
        p.until(lambda h: any(name in f.text for f in h.faults), "health")
        p.box.set(index_a_forced=-1, index_b_forced=-1)
        p.stamp(120)


def test_reset_in_the_middle_of_a_move():
    with probe("host", "--wheel-angles=0,180", "--wheel-dwell-ms=100") as p:
        p.stamp(0)
        p.until(lambda h: h.wheel.phase == Phase.MOVING, "health")
        p.box.command("reset")
        # Seen as one, and nothing is believed of the wheel before it has been homed again.
        p.until(lambda h: h.wheel.reconnects >= 1 and h.wheel.phase == Phase.HOMING, "health")
        p.stamp(180)
        assert "was reset" in p.daemon.log()


def test_cable_pulled_and_plugged_in_again():
    with probe() as p:
        p.stamp(0)
        p.box.set(line_unplugged=1)
        health = p.fault("mcu-waiting")
        assert health.wheel.phase == Phase.ABSENT
        assert any("is it plugged in?" in f.text for f in health.faults)
        p.fault("ring-silent")
        p.until(lambda e: e.flags & WHEEL_FAULT and e.flags & RING_FAULT)
        p.box.set(line_unplugged=0)
        p.stamp(0)
        p.until(lambda h: not h.faults and h.wheel.reconnects >= 1, "health")


def test_silence_on_the_line():
    with probe() as p:
        p.stamp(0)
        p.box.set(line_cut=1)
        p.fault("mcu-silent")
        p.until(lambda e: e.flags & WHEEL_FAULT and not e.HasField("wheel_deg"))
        p.box.set(line_cut=0)
        p.stamp(0)
        p.fault("mcu-silent", there=False)


def test_one_byte_in_a_hundred_is_changed():
    with probe("host", "--wheel-angles=0,45", "--wheel-dwell-ms=200") as p:
        p.box.set(line_noise=0.01)
        before = p.until(lambda h: h.ring.samples > 0, "health")
        for angle in (0, 45, 0, 45):
            p.stamp(angle)
        after = p.until(lambda h: h.ring.samples > before.ring.samples + 500, "health")
        assert after.ring.samples_lost > 0
        assert not {f.id for f in after.faults} - {"mcu-silent"}


def test_absent_at_the_start_and_then_there():
    with camera() as cam, Box() as box:
        box.set(line_unplugged=1)
        wait_for(lambda: not box.tty.exists(), "the line is still there")
        with Daemon(f"--source=sim:{cam.path}", f"--rotator=mcu:serial:{box.tty}") as daemon:
            cam.accept()
            daemon.wait_log("is it plugged in?")
            with daemon.client(health_period_ms=100) as client, streaming(cam, jpeg()):
                estimate = client.until(lambda e: e.flags & WHEEL_FAULT)
                assert not estimate.HasField("wheel_deg")
                box.set(line_unplugged=0)
                client.until(lambda e: e.HasField("wheel_deg"))
                client.until(lambda e: not e.flags & WHEEL_FAULT)


def test_an_angle_out_of_range_is_named():
    with probe("host", "--wheel-angles=0") as p:
        p.stamp(0)
    with Box() as box, camera() as cam:
        options = [f"--rotator=mcu:serial:{box.tty}", "--wheel-angles=181"]
        with pytest.raises(AssertionError, match="181"):
            Daemon(f"--source=sim:{cam.path}", *options).__enter__()


@contextmanager
def scripted_mcu() -> Iterator[tuple[int, str]]:
    """A serial line: the microcontroller's end, and the daemon's path."""
    device, line = os.openpty()
    tty.setraw(line)
    try:
        yield device, os.ttyname(line)
    finally:
        os.close(line)
        os.close(device)


def say_hello(device: int, major: int, minor: int) -> None:
    """Answer the greeting as firmware of this protocol."""
    assert os.read(device, 100)  # the greeting
    hello = mcu.encode(
        "Hello", protocol_major=major, protocol_minor=minor, firmware_major=3, firmware_minor=1,
        firmware_patch=4, reset_cause="POWER_ON", board="ATMEGA328P", boot_count=7,
    )  # fmt: skip
    os.write(device, mcu_link.serial_frame(*hello))


@pytest.mark.parametrize(
    ("major", "says"),
    [(0, "the firmware is older: lightprobe mcu flash"), (2, "the firmware is newer")],
)
def test_firmware_of_another_protocol_is_named(major, says):
    with (
        scripted_mcu() as (device, path),
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", f"--rotator=mcu:serial:{path}") as daemon,
    ):
        cam.accept()
        say_hello(device, major, 0)
        with daemon.client(health_period_ms=100) as client, streaming(cam, jpeg()):
            health = client.until(lambda h: h.faults, "health")
            assert health.faults[0].id == "mcu-version"
            assert says in health.faults[0].text
            assert f"3.1.4 speaks protocol {major}.0" in health.faults[0].text
            client.until(lambda e: e.flags & WHEEL_FAULT)


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("minor", "says"),
    [
        (mcu.PROTOCOL_MINOR - 1, "the firmware is older: lightprobe mcu flash"),
        (mcu.PROTOCOL_MINOR + 1, "the firmware is newer: install a newer lightprobe"),
    ],
)
def test_firmware_of_another_minor_version_works_and_is_named(minor, says):
    def told(health: pb.Health) -> bool:
        return "mcu-minor-version" in {fault.id for fault in health.faults}

    with (
        scripted_mcu() as (device, path),
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", f"--rotator=mcu:serial:{path}") as daemon,
    ):
        cam.accept()
        say_hello(device, 1, minor)
        received = mcu_link.SerialDecoder()
        rates, _ = mcu.encode("Rates", ring_scans=0, wheel_ms=0, counters_ms=0)
        while rates not in {number for number, _ in received.feed(os.read(device, 100))}:
            pass  # refused firmware would be asked no more
        with daemon.client(health_period_ms=100) as client, streaming(cam, jpeg()):
            health = client.until(told, "health")
            (fault,) = [f for f in health.faults if f.id == "mcu-minor-version"]
            assert f"3.1.4 speaks protocol 1.{minor}" in fault.text
            assert fault.text.endswith(says)
            command = [Path(sys.executable).parent / "lightprobe", "doctor", "--json"]
            done = subprocess.run(
                [*command, f"unix:{daemon.socket}"], capture_output=True, text=True, timeout=120
            )
    findings = {f["check"]: f for f in json.loads(done.stdout)["findings"]}
    assert findings["fault mcu-minor-version"]["verdict"] == "warn"
    assert findings["fault mcu-minor-version"]["detail"].endswith(says)


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ("stuck", "INDEX_NEVER"),
        ("slow", "WHEEL_SLOW"),
        ("slip", "WHEEL_SLIP"),
        ("too-fast", "WHEEL_TOO_FAST"),
    ],
)
def test_the_simulated_wheel_misbehaves_on_request(fault, name):
    rotator = f"sim:?fault={fault}&after_s=1"
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", f"--rotator={rotator}") as daemon:
        cam.accept()
        with daemon.client(health_period_ms=100) as client, streaming(cam, jpeg()):
            health = client.until(lambda h: h.faults, "health")
            assert {f.id for f in health.faults} == {name}
            assert not health.wheel.HasField("measured_deg")
            client.until(lambda e: e.flags & WHEEL_FAULT)


def test_simulated_wheel_and_ring():
    rotator, ring = "sim:?slew_deg_s=300", "sim:?lux=1,2,3,4,5,6,7,8,9&dead=4&silent_after_s=3"
    options = [f"--rotator={rotator}", f"--ring={ring}", "--wheel-angles=90"]
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", *options) as daemon:
        cam.accept()
        with daemon.client(health_period_ms=100) as client, streaming(cam, jpeg()):
            health = client.until(lambda h: h.ring.samples > 50, "health")
            assert list(health.ring.illuminance_lux)[3:] == [4, 5, 6, 7, 8, 9]
            estimate = client.until(lambda e: e.HasField("wheel_deg"))
            assert estimate.wheel_deg == 90
            assert estimate.flags & RING_FAULT
            client.until(lambda h: {f.id for f in h.faults} == {"ring-silent"}, "health")


def test_what_the_command_line_says_of_wheel_and_ring(tmp_path):
    def says(*options: str) -> str:
        status, _, log = run("--source=sim:/nowhere", "--check-config", *options)
        assert status == 2
        return log

    assert "name one: mcu:serial:" in says("--rotator=mcu:/dev/ttyUSB0")
    assert "known are mcu:, pca9685:, sim:" in says("--rotator=servo:")
    assert "known: baud, address, ring_scans" in says("--rotator=mcu:can:can0?rate=1")
    assert "ring_scans=2" in says("--ring=mcu:can:can0?ring_scans=2")  # 8 and more
    assert "baud" in says("--rotator=mcu:serial:/dev/x?baud=250000")
    assert "name the bus" in says("--rotator=pca9685:")
    assert "No such file or directory — check calibration=" in says(
        f"--ring=mcu:can:can0?calibration={tmp_path}/ring.ini"
    )
    values = "divider_ohm = 3300\ndrift_sigma = 0.15\nr10_ohm = 1000\n"
    (tmp_path / "ring.ini").write_text(f"[ring]\nversion = 2\n{values}")
    assert "nine are needed" in says(f"--ring=mcu:can:can0?calibration={tmp_path}/ring.ini")
    (tmp_path / "ring.ini").write_text("[ring]\nversion = 1\n")
    assert "calibrate again" in says(f"--ring=mcu:can:can0?calibration={tmp_path}/ring.ini")
    (tmp_path / "ring.ini").write_text("[ring]\ngamma = 2\n")
    assert "0.3..1.5" in says(f"--ring=mcu:can:can0?calibration={tmp_path}/ring.ini")
    status, _, log = run("--source=file:x.jpg", "--once", "--ring=sim:")
    assert status == 2
    assert "leave out --rotator and --ring" in log


@pytest.mark.nightly
@pytest.mark.parametrize("target", ["host", "avr"])
def test_random_faults_never_stamp_a_frame_wrongly(target):
    """Random moves and random faults; every estimate's angle is held against the true one.

    LP_WHEEL_SECONDS=n makes it longer (make test-firmware-long).
    """
    rng = random.Random(1)
    seconds = float(os.environ.get("LP_WHEEL_SECONDS", "25"))
    angles = ",".join(str(rng.choice((0, 45, 90, 135, 180, 20.5, 101.2))) for _ in range(16))
    with probe(target, f"--wheel-angles={angles}", "--wheel-dwell-ms=150") as p:
        p.until(lambda e: e.HasField("wheel_deg"))
        names: Counter[str] = Counter()
        end_s = p.now_s + seconds
        health = None
        while p.now_s < end_s:
            make, mend, wanted = FAULTS[rng.choice(sorted(FAULTS))]
            p.wait(rng.uniform(0.2, 2))
            if "lie_deg" in make and float(p.box.command("get wheel_deg")) > 90:
                make = {"stuck": 1, "lie_deg": -60}  # towards the middle: the comb has an end
            p.box.set(**make)
            health = p.until(lambda h: h.wheel.phase == Phase.FAULT, "health")
            seen = {f.id for f in health.faults}
            assert seen & wanted, (seen, wanted)
            names.update(seen & wanted)
            p.box.set(**mend)
            if rng.random() < 0.2:
                p.box.command("reset external" if target == "avr" else "reset")
            p.until(lambda e: e.HasField("wheel_deg"))
        assert p.stamped > 3
        health = p.until(lambda h: True, "health")
        print(
            f"{target}: {health.wheel.moves} moves, {p.stamped} stamped frames checked, the worst "
            f"{p.worst_sigmas:.2f} sigma off (limit 3); "
            f"faults: {dict(names)}"
        )
