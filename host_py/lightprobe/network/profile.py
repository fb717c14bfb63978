"""Files in which NetworkManager keeps a Wi-Fi network (nm-settings-keyfile(5)).

The password goes to NetworkManager in such a file alone: never as an argument of a program.
"""

from __future__ import annotations

import re
import uuid
from dataclasses import dataclass
from pathlib import Path

from lightprobe.errors import UsageError
from lightprobe.network import names
from lightprobe.whole_file import replacing, settle

#: Connections that this package has made: of each name one.
_SPACE = uuid.UUID("6f1f3b52-3c0e-4c55-9d2b-0d6c62b8a2a7")
_PREFIX, _SUFFIX = "lightprobe-wifi-", ".nmconnection"
_HEX = re.compile(r"[0-9a-f]{64}")  # of a key instead of a password
SECURITIES = OPEN, OWE, WPA2, WPA3 = "open", "OWE", "WPA2", "WPA3"
#: What NetworkManager calls them; "wpa-psk" takes WPA3 too where both are offered.
_KEY_MANAGEMENT = {OWE: "owe", WPA2: "wpa-psk", WPA3: "sae"}


@dataclass(frozen=True)
class Profile:
    """A network that is to be joined."""

    ssid: bytes
    security: str  # OPEN, OWE, WPA2 or WPA3
    password: str  # "" for OPEN and OWE
    hidden: bool  # it has not been seen: ask for it by its name

    def text(self) -> str:
        """What its file says."""
        octets = "".join(f"{byte};" for byte in self.ssid)
        lines = [
            "[connection]", f"id={_escaped('wifi ' + names.shown(self.ssid))}",
            f"uuid={uuid_of(self.ssid)}", "type=wifi", "autoconnect-priority=1",
            "[wifi]", f"ssid={octets}", f"hidden={str(self.hidden).lower()}",
        ]  # fmt: skip
        if self.security != OPEN:
            lines += ["[wifi-security]", f"key-mgmt={_KEY_MANAGEMENT[self.security]}"]
        if self.password:
            lines.append(f"psk={_escaped(self.password)}")
        return "\n".join(lines) + "\n"


def _escaped(value: str) -> str:
    """Write a value as keyfiles of GLib have it."""
    return value.replace("\\", "\\\\").replace(" ", "\\s")


def uuid_of(ssid: bytes) -> str:
    """Give NetworkManager's name of the connection."""
    return str(uuid.uuid5(_SPACE, ssid.hex()))


def file_of(folder: Path, ssid: bytes) -> Path:
    """Give the file of a network."""
    return folder / f"{_PREFIX}{ssid.hex()}{_SUFFIX}"


def ssids_in(folder: Path) -> list[bytes]:
    """Networks that have a file there; none where the folder cannot be read."""
    found = []
    for file in sorted(folder.glob(f"{_PREFIX}*{_SUFFIX}")):
        digits = file.name[len(_PREFIX) : -len(_SUFFIX)]
        if re.fullmatch(r"(?:[0-9a-f]{2}){1,32}", digits):
            found.append(bytes.fromhex(digits))
    return found


def check_ssid(ssid: bytes) -> None:
    """Raise UsageError for what is no name."""
    if not 1 <= len(ssid) <= names.MOST_BYTES or not ssid.strip(b"\0"):
        raise UsageError(f"wifi: a network's name has 1 to {names.MOST_BYTES} bytes")


def check_password(security: str, password: str) -> None:
    """Raise UsageError for what can be no password of such a network. It is not repeated."""
    if security in (OPEN, OWE):
        if password:
            raise UsageError("wifi: this network is open: leave the password out")
        return
    size = len(password.encode(errors="replace"))
    least = 1 if security == WPA3 else 8
    plain = not any(letter < " " or "\x7f" <= letter < "\xa0" for letter in password)
    sound = plain and not any("\ud800" <= letter <= "\udfff" for letter in password)
    if not sound or not (least <= size <= 63 or _HEX.fullmatch(password)):
        raise UsageError(
            f"wifi: a password of {security} has {least} to 63 characters in one line: type it "
            "as it stands on the router"
        )


def write(file: Path, text: str) -> None:
    """Write it, readable for its owner alone; raises OSError."""
    with replacing(file) as out:
        out.write(text.encode())


def remove(file: Path) -> None:
    """Remove it for good, if it is there; raises OSError."""
    file.unlink(missing_ok=True)
    settle(file.parent)
