# SPDX-License-Identifier: Apache-2.0
"""`lightprobe panel`: a real daemon, the kernel's GPIO, an LED that is looked at, a button.

One panel runs for all tests that need the whole of it: it takes long to start here.
"""

import http.client
import json
import signal
import ssl
import subprocess
import threading
import time
from pathlib import Path

import pytest
from lightprobe.errors import LightprobeError
from lightprobe.panel import lines
from machine import modprobe, run, wait_for
from test_gpio import Chip

REPO = Path(__file__).resolve().parents[3]
LED, BUTTON = 7, 2
CONFIG = Path("/etc/lightprobe/lightprobed.conf")


@pytest.fixture(scope="module")
def chip():
    return Chip("panel", {LED: "GPIO27", BUTTON: "GPIO22"})


# ---------------------------------------------------------------- lines


def wanted(what: str, name: str, low: bool = False) -> lines.Wanted:
    return lines.Wanted(what, name, low)


def refused(led: str, button: str) -> str:
    with pytest.raises(LightprobeError) as caught:
        lines.open_both(wanted("LED", led), wanted("button", button, True))
    return str(caught.value)


def test_what_cannot_be_is_said(chip):
    for led, button, words in (
        ("gpiochip77:1", "GPIO22", "panel: LED gpiochip77:1: open: no /dev/gpiochip77: gpiodetect"),
        ("GPIO99", "GPIO22", "panel: LED GPIO99: find: no line of gpiochip"),
        ("GPIO27", "GPIO99", "panel: button GPIO99: find: no line of gpiochip"),
        (f"{chip.name}:8", "GPIO22", f"find: /dev/{chip.name} has no line 8: gpioinfo"),
        ("GPIO27", f"{chip.name}:{LED}", "is the LED's line, too"),
        ("a b", "GPIO22", "no name of a line"),
        ("/dev/null:1", "GPIO22", "panel: LED /dev/null:1: open: /dev/null: "),
    ):
        assert words in refused(led, button)
    with subprocess.Popen(["gpioset", "--mode=signal", chip.name, f"{BUTTON}=1"]) as holder:
        wait_for("the holder", lambda: "gpioset" in run("gpioinfo", chip.name))
        words = refused("GPIO27", "GPIO22")
        holder.terminate()
    assert "panel: button GPIO22: request: gpioset uses it: end that" in words
    assert "lightprobe" not in run("gpioinfo", chip.name), "the LED's line was kept"


def test_two_lines_of_one_name_are_told(chip):
    other = Chip("other", {1: "GPIO27"})
    both = refused("GPIO27", "GPIO22")
    assert "2 lines have this name: name one of " in both
    assert f"{chip.name}:{LED}" in both
    assert f"{other.name}:1" in both
    found = lines.find(wanted("LED", f"{other.name}:GPIO27"))
    assert (found.chip, found.offset) == (f"/dev/{other.name}", 1)
    other.remove()


@pytest.mark.parametrize("low", [False, True])
def test_either_way_round(chip, low):
    """Lit and pressed are the high levels, or the low ones."""
    led, push = lines.open_both(
        wanted("LED", "GPIO27", low), wanted("button", f"{chip.name}:{BUTTON}", low)
    )
    dark, lit = ("1", "0") if low else ("0", "1")
    assert chip.value(LED) == dark
    led.set(True)
    assert chip.value(LED) == lit
    assert not push.pressed(), "the kernel's own resistor"
    chip.pull(BUTTON, "down" if low else "up")
    pressed, at_s = next(iter(push.edges(10)))
    assert pressed
    assert abs(at_s - time.monotonic()) < 5
    assert push.pressed()
    push.close()
    led.set(False)
    assert chip.value(LED) == dark
    led.close()  # who drives the line then is the board's matter
    assert "lightprobe" not in run("gpioinfo", chip.name)


def test_the_kernel_takes_bounces_away(chip):
    _, push = lines.open_both(None, wanted("button", "GPIO22", True))
    for _ in range(20):
        chip.pull(BUTTON, "down")
        chip.pull(BUTTON, "up")
    time.sleep(0.2)
    assert not any(pressed for pressed, _ in push.edges(0))
    push.close()


# ---------------------------------------------------------------- the whole of it


class Panel:
    """The command, with what it says, and a finger on its button."""

    def __init__(self, chip: Chip, *options: str) -> None:
        self._chip = chip
        self.states: list[dict[str, str]] = []
        self.said: list[str] = []
        self.process = subprocess.Popen(
            [REPO / "build/venv/bin/lightprobe", "panel", *options, "--json"], text=True,
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
        except AssertionError as error:
            raise AssertionError(f"{error}: {self.states} {self.said}") from None
        return self.states[-1]["why"]

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


@pytest.fixture(scope="module")
def network():
    """An interface with a carrier and an address."""
    modprobe("dummy")
    run("ip", "link", "add", "wire0", "type", "dummy")
    run("ip", "addr", "add", "192.0.2.7/24", "dev", "wire0")
    run("ip", "link", "set", "wire0", "up")
    return "wire0"


@pytest.fixture(scope="module")
def whole(chip, network):
    """Daemon and panel; the button is down at the start, and then let go."""
    from daemon import Daemon

    CONFIG.parent.mkdir(parents=True, exist_ok=True)
    CONFIG.write_text("publish = tcp:127.0.0.1:7700\n")
    daemon = Daemon("example:")
    chip.pull(BUTTON, "down")
    shown = Panel(chip, f"unix:{daemon.path}")
    shown.wait_state("starting")
    chip.pull(BUTTON, "up")
    yield shown, daemon
    daemon.stop()


def test_all_is_well_is_one_flash_in_three_seconds(whole):
    shown, _ = whole
    shown.wait_state("measuring")
    time.sleep(4)  # the pattern before it is shown to its end
    flashes = shown.flashes(9.5)
    assert 3 <= len(flashes) <= 4
    assert max(flashes) < 0.25
    assert shown.said == [], "the button was down before"


def test_three_flashes_without_a_network(whole, network):
    shown, _ = whole
    run("ip", "link", "set", network, "down")
    shown.wait_state("no-network")
    time.sleep(4)
    assert 6 <= len(shown.flashes(6.9)) <= 9
    run("ip", "link", "set", network, "up")
    shown.wait_state("measuring")


@pytest.mark.parametrize(
    ("held_s", "words"),
    [
        (4, "panel: access point on or off: nmcli: "),
        (8, "panel: shut down: systemctl: "),
        (0.3, "no publish = wss:"),
    ],
)
def test_what_a_press_starts_and_fails_is_a_fault_for_a_while(whole, held_s, words):
    """There are no connection, no systemd as the first process, and no wss: to pair for."""
    shown, _ = whole
    shown.hold(held_s)
    wait_for(words, lambda: any(words in line for line in shown.said))
    assert words in shown.wait_state("fault")
    shown.wait_state("measuring")


@pytest.mark.parametrize("held_s", [0.001, 2, 16])
def test_nothing_happens_when_one_changes_ones_mind(whole, held_s):
    shown, _ = whole
    before = len(shown.said)
    shown.hold(held_s)
    time.sleep(1)
    assert shown.said[before:] == []


def test_a_press_lets_one_client_pair(whole):
    shown, _ = whole
    CONFIG.write_text("publish = wss:0.0.0.0:7702?pair=/etc/lightprobe/pair\n")
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


def test_a_daemon_that_ends_is_awaited_and_then_a_fault_and_the_led_ends_dark(whole, chip):
    shown, daemon = whole
    daemon.stop()
    shown.wait_state("starting")
    time.sleep(4)
    assert 3 <= len(shown.flashes(4.2)) <= 5
    assert str(daemon.path) in shown.wait_state("fault")
    shown.process.send_signal(signal.SIGTERM)
    assert shown.process.wait(120) == 128 + signal.SIGTERM
    assert not any("Traceback" in line for line in shown.said), shown.said
    assert chip.value(LED) == "0"
    assert "lightprobe" not in run("gpioinfo", chip.name)
