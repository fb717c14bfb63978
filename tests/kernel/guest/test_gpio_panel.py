# SPDX-License-Identifier: Apache-2.0
"""`lightprobe panel`: a real daemon, the kernel's GPIO, an LED and a button that a test sees and presses."""

import http.client
import json
import signal
import ssl
import subprocess
import threading
import time
from pathlib import Path

import pytest
from machine import modprobe, run, wait_for
from test_gpio import Chip

REPO = Path(__file__).resolve().parents[3]
COMMAND = (str(REPO / "build/venv/bin/lightprobe"), "panel")
LED, BUTTON = 7, 2
CONFIG = Path("/etc/lightprobe/lightprobed.conf")


@pytest.fixture(scope="module")
def chip():
    return Chip("panel", {LED: "GPIO27", BUTTON: "GPIO22"})


class Panel:
    """The command, with what it says, and a finger on its button."""

    def __init__(self, chip: Chip, *options: str) -> None:
        self._chip = chip
        self.states: list[dict[str, str]] = []
        self.said: list[str] = []
        self.process = subprocess.Popen(
            [*COMMAND, *options, "--json"], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        for stream, take in (
            (self.process.stdout, lambda line: self.states.append(json.loads(line))),
            (self.process.stderr, self.said.append),
        ):
            threading.Thread(target=self._read, args=(stream, take), daemon=True).start()

    @staticmethod
    def _read(stream, take) -> None:
        for line in stream:
            take(line)

    def wait_state(self, state: str) -> str:
        """Wait until it says this state as its newest; return why."""

        def now():
            assert self.process.poll() is None, self.said
            return self.states and self.states[-1]["state"] == state

        try:
            wait_for(state, now)
        finally:
            print(self.states, self.said)
        return self.states[-1]["why"]

    def wait_said(self, words: str) -> None:
        """Wait until it has said this."""
        wait_for(words, lambda: any(words in line for line in self.said))

    def hold(self, seconds: float) -> None:
        """Press and let go."""
        self._chip.pull(BUTTON, "down")
        time.sleep(seconds)
        self._chip.pull(BUTTON, "up")

    def flashes(self, seconds: float) -> list[float]:
        """Look at the LED; return how long each flash was."""
        end, since, found = time.monotonic() + seconds, None, []
        while (now := time.monotonic()) < end:
            lit = self._chip.value(LED) == "1"
            if lit and since is None:
                since = now
            elif not lit and since is not None:
                found.append(now - since)
                since = None
            time.sleep(0.01)
        return found

    def stop(self) -> None:
        """End it as systemd does."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(120) == 128 + signal.SIGTERM
        assert not any("Traceback" in line for line in self.said), self.said


@pytest.fixture
def panel(chip, request):
    """Start the panel, its button up; panel(*options)."""

    def begin(*options: str, down: bool = False) -> Panel:
        # A finger, or the resistor that the kernel is asked for.
        chip.pull(BUTTON, "down" if down else "up")
        made = Panel(chip, *options)
        request.addfinalizer(lambda: made.process.poll() is None and made.stop())
        return made

    return begin


@pytest.fixture(scope="module")
def network():
    """An interface with a carrier and an address."""
    modprobe("dummy")
    run("ip", "link", "add", "wire0", "type", "dummy")
    run("ip", "addr", "add", "192.0.2.7/24", "dev", "wire0")
    run("ip", "link", "set", "wire0", "up")
    yield "wire0"
    run("ip", "link", "del", "wire0")


def test_what_cannot_be_is_said(chip):
    cases = (
        (("--led", "gpiochip77:1"), "panel: LED gpiochip77:1: open: no /dev/gpiochip77", 1),
        (("--led", "GPIO99"), "panel: LED GPIO99: find: no line of gpiochip", 1),
        (("--led", f"{chip.name}:8"), f"find: /dev/{chip.name} has no line 8", 1),
        (("--led", "GPIO27", "--button", f"{chip.name}:{LED}"), "is the LED's line, too", 2),
        (("--led", "none", "--button", "none"), "neither LED nor button", 2),
        (("--led", "a b"), "no name of a line", 2),
    )
    for options, words, status in cases:
        done = subprocess.run([*COMMAND, *options], capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stdout) == (status, ""), done
        assert words in done.stderr
        assert done.stderr.count("\n") == 1
    with subprocess.Popen(["gpioset", "--mode=signal", chip.name, f"{LED}=1"]) as holder:
        wait_for("LED on", lambda: chip.value(LED) == "1")
        done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=300)
        holder.terminate()
    assert done.returncode == 1
    assert "LED GPIO27: request: gpioset uses it" in done.stderr


def test_from_the_start_to_the_end(chip, panel, start, network):
    daemon = start("example:")
    shown = panel(f"unix:{daemon.path}")
    shown.wait_state("measuring")
    time.sleep(4)  # the pattern before it is shown to its end
    flashes = shown.flashes(9.5)
    assert 3 <= len(flashes) <= 4
    assert max(flashes) < 0.25

    run("ip", "link", "set", network, "down")
    shown.wait_state("no-network")
    time.sleep(4)
    assert 6 <= len(shown.flashes(6)) <= 9
    run("ip", "link", "set", network, "up")
    shown.wait_state("measuring")

    daemon.stop()
    shown.wait_state("starting")
    time.sleep(4)
    assert 3 <= len(shown.flashes(4.2)) <= 5

    shown.stop()
    assert chip.value(LED) == "0"
    assert "used" not in next(line for line in run("gpioinfo", chip.name).splitlines()
                              if "GPIO27" in line).replace("unused", "")  # fmt: skip


def test_a_daemon_that_never_comes_is_a_fault(panel):
    shown = panel("unix:/run/nobody", "--no-network")
    shown.wait_state("starting")
    assert "/run/nobody" in shown.wait_state("fault")


def test_a_press_lets_one_client_pair(panel, start):
    CONFIG.parent.mkdir(parents=True, exist_ok=True)
    CONFIG.write_text("publish = wss:0.0.0.0:7702?pair=/etc/lightprobe/pair\n")
    daemon = start("example:")
    shown = panel(f"unix:{daemon.path}", "--no-network")
    shown.wait_state("measuring")
    shown.hold(0.3)
    shown.wait_state("pairing")
    url = wait_for("an address", ask_for_address)
    token = Path("/etc/lightprobe/pair/token").read_text().strip()
    assert f":7702/#token={token}&sha256=" in url
    shown.wait_state("measuring")
    assert not any(token in line for line in shown.said)


def ask_for_address() -> str:
    """What the first client gets; "" while nobody listens."""
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    connection = http.client.HTTPSConnection("127.0.0.1", 7704, timeout=60, context=tls)
    try:
        connection.request("POST", "/", headers={"Accept": "application/json"})
        answer = connection.getresponse()
        assert answer.status == 200
        return json.loads(answer.read())["url"]
    except ConnectionRefusedError:
        return ""
    finally:
        connection.close()


def test_what_a_press_starts_and_fails_is_shown(panel, start):
    """Here are no NetworkManager, no systemd as the first process, and no wss: to pair for."""
    CONFIG.parent.mkdir(parents=True, exist_ok=True)
    CONFIG.write_text("publish = tcp:127.0.0.1:7700\n")
    daemon = start("example:")
    shown = panel(f"unix:{daemon.path}", "--no-network")
    for held_s, words in (
        (4, "panel: access point on or off: nmcli: start: No such file or directory: "),
        (8, "panel: shut down: systemctl: "),
        (0.3, "no publish = wss:"),
    ):
        shown.wait_state("measuring")
        shown.hold(held_s)
        shown.wait_state("fault")
        shown.wait_said(words)
    for held_s in (2, 16):  # nothing: one changed one's mind, or leaned on it
        shown.wait_state("measuring")
        before = len(shown.said)
        shown.hold(held_s)
        time.sleep(1)
        assert shown.said[before:] == []


def test_bounces_and_a_button_that_is_down_at_the_start(chip, panel, start):
    daemon = start("example:")
    shown = panel(f"unix:{daemon.path}", "--no-network", down=True)
    why = shown.wait_state("fault")
    assert "stuck" in why
    chip.pull(BUTTON, "up")
    shown.wait_state("measuring")
    for _ in range(20):
        shown.hold(0.001)
    time.sleep(1)
    assert shown.said == []


@pytest.mark.parametrize("low", [False, True])
def test_either_way_round(chip, panel, low):
    """LED at 3.3 V, button at 3.3 V: lit and pressed are the other levels."""
    options = ("--led-low", "--button-high") if low else ()
    shown = panel("unix:/run/nobody", *options, down=low)
    shown.wait_state("starting")
    chip.pull(BUTTON, "up" if low else "down")
    lit = "0" if low else "1"
    wait_for("the LED answers", lambda: all(look(chip, lit) for _ in range(60)))
    chip.pull(BUTTON, "down" if low else "up")
    shown.wait_said("let a client pair")
    shown.stop()
    assert chip.value(LED) == ("1" if low else "0")


def look(chip: Chip, level: str) -> bool:
    """Whether the LED has this level, a moment later."""
    time.sleep(0.01)
    return chip.value(LED) == level
