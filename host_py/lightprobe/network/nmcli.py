"""NetworkManager's command line: what it is asked, and what it says (nmcli(1), of 1.42)."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass

from lightprobe.errors import LightprobeError
from lightprobe.network import profile

WIFI = "802-11-wireless"
_NOT_RUNNING = 8
#: More than its own --wait.
_MORE_S = 20
_FIELD = re.compile(r"((?:[^:\\]|\\.)*)(?::|$)", re.S)
_STARTS = ("Error: ", "Connection activation failed: ")


class NmcliError(LightprobeError):
    """It has failed; says why."""


@dataclass(frozen=True)
class Active:
    """A connection that is up, or on its way."""

    uuid: str
    kind: str  # NetworkManager's type
    device: str
    is_up: bool
    name: str


@dataclass(frozen=True)
class Seen:
    """A network in reach, at one access point."""

    ssid: bytes
    joined: bool
    signal_percent: int
    security: str  # of profile, else what it is called


def run(*words: str, wait_s: int = 15) -> str:
    """Ask it; raises LightprobeError. No word may be a secret: others can read them."""
    try:
        done = subprocess.run(
            ["nmcli", "--wait", str(wait_s), *words], stdin=subprocess.DEVNULL,
            capture_output=True, text=True, errors="replace", timeout=wait_s + _MORE_S,
            env=os.environ | {"LC_ALL": "C.UTF-8", "LANGUAGE": ""},
        )  # fmt: skip
    except FileNotFoundError:
        raise LightprobeError(
            "wifi: nmcli: not found: this machine has no NetworkManager: sudo apt-get install "
            "network-manager, or use what manages its networks"
        ) from None
    except OSError as error:
        raise LightprobeError(f"wifi: nmcli: start: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise NmcliError(f"no answer of NetworkManager in {wait_s + _MORE_S} s") from None
    if done.returncode == _NOT_RUNNING:
        raise LightprobeError(
            "wifi: NetworkManager: is not running: sudo systemctl start NetworkManager"
        )
    if done.returncode:
        raise NmcliError(_words(done.stderr or done.stdout) or f"nmcli: status {done.returncode}")
    return done.stdout


def _words(text: str) -> str:
    line = next(iter(text.strip().splitlines()), "")
    for start in _STARTS:
        line = line.removeprefix(start)
    return line.rstrip(".")


def fields(line: str) -> list[str]:
    r"""Split a line of `nmcli -t -e yes`: values between colons, in which \ escapes : and \."""
    found, at = [], 0
    while at <= len(line):
        match = _FIELD.match(line, at)
        if match is None:  # it ends with an escape of nothing
            break
        found.append(re.sub(r"\\(.)", r"\1", match[1], flags=re.S))
        if match.end() == len(line) and not match[0].endswith(":"):
            break
        at = match.end()
    return found


def _table(names: str, *words: str, wait_s: int = 15) -> list[list[str]]:
    """Rows of a table that have as many values as were asked for."""
    wanted = names.count(",") + 1
    text = run("-t", "-e", "yes", "-f", names, *words, wait_s=wait_s)
    rows = [fields(line) for line in text.split("\n") if line]
    return [row for row in rows if len(row) == wanted]


def ensure_radio() -> None:
    """Raise LightprobeError where no Wi-Fi can be used, with the reason."""
    radios = [row for row in _table("DEVICE,TYPE,STATE", "device", "status") if row[1] == "wifi"]
    if not radios:
        raise LightprobeError("wifi: this machine has no Wi-Fi: plug in an adapter, or use a cable")
    if all(state in ("unavailable", "unmanaged") for _, _, state in radios):
        raise LightprobeError(
            f"wifi: {radios[0][0]}: is {radios[0][2]}: run nmcli radio wifi on, and look whether "
            "rfkill or NetworkManager's configuration holds it"
        )


def active() -> list[Active]:
    """Connections of now, without the loopback."""
    rows = _table("UUID,TYPE,DEVICE,STATE,NAME", "connection", "show", "--active")
    return [
        Active(uuid, kind, device, state == "activated", name)
        for uuid, kind, device, state, name in rows
        if kind != "loopback"
    ]


def saved() -> list[str]:
    """Wi-Fi connections that NetworkManager knows, by their UUID."""
    return [uuid for uuid, kind in _table("UUID,TYPE", "connection", "show") if kind == WIFI]


def of_connection(uuid: str, name: str) -> str:
    """Give one property of a connection: its first line; "" where it has none."""
    try:
        text = run("-t", "-f", name, "connection", "show", "uuid", uuid)
    except NmcliError:  # it has gone meanwhile
        return ""
    return text.split("\n", 1)[0].partition(":")[2]


def seen() -> list[Seen]:
    """Networks in reach, the strongest first."""
    found = []
    for joined, digits, signal, security, flags in _table(
        "IN-USE,SSID-HEX,SIGNAL,SECURITY,RSN-FLAGS", "device", "wifi", "list", "--rescan", "auto",
        wait_s=30,
    ):  # fmt: skip
        ssid = _bytes(digits)
        if ssid.strip(b"\0"):
            percent = int(signal) if signal.isdigit() else 0
            found.append(Seen(ssid, joined == "*", percent, _security(security, flags)))
    return sorted(found, key=lambda one: -one.signal_percent)


def _bytes(digits: str) -> bytes:
    try:
        return bytes.fromhex(digits)
    except ValueError:
        return b""


def _security(words: str, flags: str) -> str:
    """What a network asks for, of its words in the table and its flags."""
    told, rsn = words.split(), flags.split()
    if "psk" in rsn or (("WPA1" in told or "WPA2" in told) and "802.1X" not in told):
        return profile.WPA2
    if "WPA3" in told and "802.1X" not in told:
        return profile.WPA3
    if any("802.1X" in word or "EAP" in word.upper() for word in told):
        return "enterprise"
    if "OWE" in told:
        return profile.OWE
    return "WEP" if "WEP" in told else profile.OPEN
