# SPDX-License-Identifier: Apache-2.0
"""What the owner has written into lightprobe.txt on the card's first partition."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

SETTINGS = "lightprobe.txt"
MOST_SSID_BYTES = 32
PASSWORD = re.compile(r"[ -~]{8,63}")  # of WPA2, as IEEE 802.11 has it
FORMS = {
    "name": (re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,30}[A-Za-z0-9])?"), "letters, digits, -"),
    "country": (re.compile(r"[A-Z]{2}"), "two capital letters, as DE"),
    "wifi-name": (re.compile(r"[^\0\n\ufffd]{1,32}"), "at most 32 bytes of UTF-8"),
    "wifi-password": (PASSWORD, "8 to 63 characters"),
    "access-point-password": (PASSWORD, "8 to 63 characters"),
    "access-number": (re.compile(r"[0-9]{1,9}"), "digits"),
}


@dataclass
class Settings:
    """What lightprobe.txt says, and what is wrong with it."""

    values: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def too_long(name: str, value: str) -> bool:
    """Tell whether it is a network's name of more bytes than Wi-Fi has room for."""
    return name == "wifi-name" and len(value.encode()) > MOST_SSID_BYTES


def decoded(data: bytes) -> str:
    """Read a text as editors write it: UTF-8, or as old ones of Windows do."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def read_settings(text: str) -> Settings:
    """Read NAME = VALUE lines; what is empty is not there, and what is wrong is left out."""
    found = Settings()
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        name, equals, value = (part.strip() for part in line.partition("="))
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"{SETTINGS}, line {number}"
        if not equals or name not in FORMS:
            found.problems.append(f"{where}: not a setting; there are {', '.join(FORMS)}")
        elif value and (not FORMS[name][0].fullmatch(value) or too_long(name, value)):
            found.problems.append(f"{where}: {name} is left out: it needs {FORMS[name][1]}")
        elif value:
            found.values[name] = value
    if ("wifi-name" in found.values) != ("wifi-password" in found.values):
        found.problems.append(
            f"{SETTINGS}: a Wi-Fi needs its name and its password; it is left out"
        )
        found.values.pop("wifi-name", None)
    return found
