# SPDX-License-Identifier: Apache-2.0
"""The installed service: systemd is the guest's first process, and starts it as its own user.

Real: systemd with its cgroups, seccomp filters, dynamic user and watchdog; udev with the project's
rules; the journal; uvcvideo, cdc-acm, I2C, GPIO and CAN of the kernel. Made in software: the
camera behind uvcvideo, the box behind the serial line.
"""

import http.client
import json
import os
import signal
import socket
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from box import CanBridge, Firmware, SerialBridge
from camera import load_drivers
from gadget import Gadget
from machine import modprobe, run, wait_for
from service import (
    CONFIG,
    DROP_INS,
    REPO,
    SOCKET,
    Service,
    add_drop_in,
    configure,
    install,
    journal,
    remove_drop_ins,
    show,
    wait_restart,
)
from test_mcu import check_session, is_settled
from udev import settle

ARDUINO = 0x2341  # its serial line is /dev/lightprobe-mcu by 71-lightprobe-mcu.rules
MCU = "mcu:serial:/dev/lightprobe-mcu?ring_scans=80"
SMALL = "v4l2:?size=640x320"
NEEDED = {"videodev", "mc", "usbcore", "cdc_acm", "usbserial"}
#: Of systemd-analyze: from 0, no exposure, to 10.
MOST_EXPOSURE = 1.5


@pytest.fixture(scope="module", autouse=True)
def _installed():
    install()


@pytest.fixture
def service():
    """Start the service with configuration lines; stop it after the test."""
    started = []

    def begin(*lines: str, without: str = "") -> Service:
        configure(*lines, without=without)
        started.append(Service())
        return started[0]

    yield begin
    for one in started:
        print(one.log())
        one.stop()
    remove_drop_ins()


@contextmanager
def box():
    """A microcontroller on USB."""
    load_drivers()
    modprobe("usb_f_acm")
    gadget = Gadget("mcu", "acm.usb0", 0x0043, ARDUINO)
    gadget.plug(port=1)
    firmware = Firmware("box")
    bridge = SerialBridge(firmware.line, Path("/dev/ttyGS0"))
    try:
        wait_for("the rule's name", Path("/dev/lightprobe-mcu").exists)
        yield gadget, firmware
    finally:
        bridge.stop()
        firmware.stop()
        gadget.unplug()


def loaded() -> set[str]:
    """Names of the loaded modules."""
    return {line.split()[0] for line in Path("/proc/modules").read_text().splitlines()}


def status_of(pid: int) -> dict[str, str]:
    """What the kernel says about a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


# The first test: it looks at what happens before any driver is there.
def test_camera_comes_long_after_the_service(service, request, record_property):
    """The packaged configuration; DeviceAllow knows drivers that nobody had needed yet."""
    assert not NEEDED & loaded()
    running = service()
    running.wait_state("WAITING")
    assert loaded() >= NEEDED
    assert "source waiting" in run("systemctl", "status", "lightprobed")

    process = status_of(running.pid)
    user = int(process["Uid"].split()[0])
    assert 61184 <= user <= 65519, "no dynamic user"
    assert int(process["CapEff"], 16) == int(process["CapBnd"], 16) == 0
    assert (process["NoNewPrivs"], process["Seccomp"]) == ("1", "2")
    record_property("figure", f"service: user {user}, groups {process['Groups']}")

    from camera import Camera

    load_drivers()
    camera = Camera()
    request.addfinalizer(camera.close)
    camera.plug()
    running.wait_state("STREAMING")
    running.wait_estimate()
    # Any user of this machine may read.
    run("setpriv", "--reuid=65534", "--clear-groups", "python3", "-c",
        f"import socket; socket.socket(socket.AF_UNIX).connect('{SOCKET}')")  # fmt: skip


def test_camera_wheel_and_ring_survive_their_cables(service, camera):
    camera.plug()
    before = camera.state()
    with box() as (gadget, firmware):
        running = service(f"source = {SMALL}", f"rotator = {MCU}", f"ring = {MCU}")
        check_session(running, firmware)
        pid = running.pid
        running.wait_estimate()
        for _ in range(3):
            camera.unplug()
            running.wait_state("WAITING")
            camera.plug()
            running.wait_estimate(time.time_ns())
        gadget.unplug()
        running.wait_health("mcu gone", lambda h: "mcu-waiting" in {f.id for f in h.faults})
        gadget.plug(port=1)
        running.wait_health(
            "mcu back", lambda h: is_settled(h) and h.wheel.reconnects > 0 and not h.faults
        )
        assert running.health().source_reconnects == 3
        assert (running.pid, show("NRestarts")) == (pid, "0")
        held = camera.state()
        running.stop()
    # The next camera session finds what the last one has found.
    after = camera.state()
    assert before["ae_mode"] != held["ae_mode"]
    assert before["ae_mode"] == after["ae_mode"]


def test_hanging_camera_is_cured_by_a_reset_of_its_port(service, camera):
    """The right to reset it comes from the udev rule and from DeviceAllow."""
    camera.plug()
    running = service(f"source = {SMALL}&stall_ms=500")
    running.wait_estimate()
    camera.command("hang 1")
    running.wait_state("STALLED")
    running.wait_state("STREAMING")
    assert "the camera hung: its USB port" in running.log()


def test_libcamera_may_use_its_media_device(service, camera):
    modprobe("firmware_node")
    camera.plug()
    settle()
    running = service("source = libcamera:?size=640x320")
    running.wait_estimate()


# ---------------------------------------------------------------- life


def test_an_error_in_the_configuration_is_not_tried_again():
    configure("source = nonsense:")
    since = time.time()
    assert "status=2" in run("systemctl", "start", "lightprobed", check=False) + run(
        "systemctl", "status", "lightprobed", check=False
    )
    # Not "activating (auto-restart)", in which it would wait for its next try.
    assert (show("ActiveState"), show("SubState")) == ("failed", "failed")
    assert (show("ExecMainStatus"), show("NRestarts")) == ("2", "0")
    assert "nonsense: is not a known scheme" in journal(since)
    run("systemctl", "reset-failed", "lightprobed")


@pytest.mark.parametrize(
    ("by", "words"), [(signal.SIGKILL, "killed"), (signal.SIGSTOP, "watchdog")]
)
def test_one_that_died_or_hangs_is_restarted(service, by, words):
    running = service()
    os.kill(running.pid, by)
    wait_restart(1)
    running.connect()
    running.wait_state("WAITING")
    assert words in running.log().lower()


# ---------------------------------------------------------------- the network


@pytest.fixture(scope="module")
def network():
    """Another machine: a name space with an address; gives a test whether it can connect."""
    modprobe("veth")
    run("ip", "netns", "add", "far")
    run("ip", "link", "add", "near0", "type", "veth", "peer", "name", "far0", "netns", "far")
    run("ip", "addr", "add", "192.0.2.1/24", "dev", "near0")
    run("ip", "link", "set", "near0", "up")
    run("ip", "-n", "far", "addr", "add", "192.0.2.2/24", "dev", "far0")
    run("ip", "-n", "far", "link", "set", "far0", "up")

    def can_connect() -> bool:
        """A packet that is let through is answered at once; others are lost in silence."""
        program = "import socket; socket.create_connection(('192.0.2.1', 7700), 10).recv(1)"
        done = subprocess.run(
            ["ip", "netns", "exec", "far", "python3", "-c", program], capture_output=True, text=True
        )
        assert done.returncode == 0 or "TimeoutError" in done.stderr, done.stderr
        return done.returncode == 0

    return can_connect


@pytest.mark.parametrize("is_open", [pytest.param(False, marks=pytest.mark.nightly), True])
def test_the_network_is_let_in_on_request_only(service, network, is_open):
    if is_open:
        add_drop_in("override.conf", "[Service]\nIPAddressAllow=192.0.2.0/24\n")
    service("publish = tcp:0.0.0.0:7700", "insecure-lan = yes", f"publish = unix:{SOCKET}")
    run("python3", "-c", "import socket; socket.create_connection(('127.0.0.1', 7700)).recv(1)")
    assert network() == is_open


# ---------------------------------------------------------------- drop-ins


def wait_fault(running: Service, fault: str, text: str) -> None:
    """Wait for a fault whose text says this."""
    running.wait_health(fault, lambda h: any(f.id == fault and text in f.text for f in h.faults))


@pytest.mark.nightly
def test_can_needs_its_drop_in(service, vcan):
    firmware = Firmware("can-box")
    bridge = CanBridge(firmware.line, vcan)
    lines = (f"rotator = mcu:can:{vcan}", f"ring = mcu:can:{vcan}?ring_scans=80")
    try:
        running = service(*lines)
        wait_fault(running, "mcu-waiting", "drop-in can.conf")
        add_drop_in("can.conf")
        run("systemctl", "restart", "lightprobed")
        running.connect()
        check_session(running, firmware)
    finally:
        bridge.stop()
        firmware.stop()


def test_i2c_and_gpio_need_their_drop_in(service):
    from test_gpio import Chip
    from test_mcu_hat import LINE, Wheel, register_bus, settled_at

    bus, chip = register_bus(), Chip()
    chip.pull(LINE, "up")
    settle()
    wheel = Wheel(bus, chip)
    rotator = f"pca9685:{bus}?chip={chip.name}&line={LINE}&slew_deg_s=20&lag_ms=20"
    try:
        running = service(f"rotator = {rotator}", "wheel-angles = 0")
        wait_fault(running, "pca9685-waiting", "drop-in i2c.conf")
        add_drop_in("i2c.conf")
        run("systemctl", "restart", "lightprobed")
        running.connect()
        running.wait_health("at 0", settled_at(0))
        assert set(status_of(running.pid)["Groups"].split()) >= {
            run("getent", "group", name).split(":")[2] for name in ("i2c", "gpio")
        }
    finally:
        wheel.stop()


# ---------------------------------------------------------------- what systemd says


@pytest.mark.nightly
def test_systemd_finds_no_mistake(record_property):
    for name in ("", *(path.name for path in DROP_INS.iterdir())):
        if name:
            add_drop_in(name)
        printed = run("systemd-analyze", "verify", "lightprobed.service")
        assert "lightprobed" not in printed, printed
    remove_drop_ins()
    printed = run("systemd-analyze", "security", "--no-pager", "lightprobed.service")
    line = printed.splitlines()[-1]
    record_property("figure", f"systemd-analyze security: {line.removeprefix('→ ')}")
    assert float(line.split(":")[1].split()[0]) <= MOST_EXPOSURE


def test_an_update_keeps_the_configuration():
    CONFIG.write_text("source = sim:/run/mine\n")
    install()
    assert CONFIG.read_text() == "source = sim:/run/mine\n"


# ---------------------------------------------------------------- the set-up page


def test_the_set_up_page_changes_the_service(service):
    """`lightprobe setup`, as root: a good change counts, and a bad one does not."""
    service("source = example:", "name = before")
    command = [REPO / "build/venv/bin/lightprobe", "setup", "--page", REPO / "build/web"]
    page = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def ask(method, path, body=None):
        connection = http.client.HTTPConnection("127.0.0.1", 7703, timeout=240)
        headers = {"Authorization": f"Bearer {token}"}
        connection.request(method, f"/api/{path}", json.dumps(body), headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())

    try:
        token = page.stdout.readline().strip().partition("#owner=")[2]
        wait_for("the page", lambda: not socket.socket().connect_ex(("127.0.0.1", 7703)))
        before, pid = CONFIG.read_text(), show("MainPID")
        status, answer = ask("PUT", "settings", {"set": {"name": ["after"]}})
        assert status == 200, answer
        assert CONFIG.read_text() == before.replace("name = before", "name = after")
        assert show("ActiveState") == "active"
        assert show("MainPID") != pid
        good = CONFIG.read_text()
        with socket.create_server(("127.0.0.1", 0)) as taken:
            publish = [f"tcp:127.0.0.1:{taken.getsockname()[1]}", f"unix:{SOCKET}?mode=666"]
            status, answer = ask("PUT", "settings", {"set": {"publish": publish}})
        assert status == 409, answer
        assert "the former settings are back" in answer["problem"]
        assert (CONFIG.read_text(), show("ActiveState")) == (good, "active")
        assert ask("PUT", "settings", {"set": {"preset": ["fastest"]}})[0] == 422
        state = ask("GET", "state")[1]
        assert state["runs"]
        assert any("listen: " in line for line in state["log"])
    finally:
        page.terminate()
        page.wait(60)
