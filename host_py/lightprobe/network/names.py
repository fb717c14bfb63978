"""Names of Wi-Fi networks: up to 32 bytes of any kind, as text that can be shown and typed."""

from __future__ import annotations

import re

MOST_BYTES = 32
_ESCAPE = re.compile(rb"\\(?:x([0-9a-f]{2})|(\\))|([^\\])", re.S)


def shown(ssid: bytes) -> str:
    r"""Give the text of a name: printable, one line, and each name its own.

    A backslash becomes \\, and what cannot be printed \xNN.
    """
    return "".join(_printable(letter) for letter in ssid.decode(errors="surrogateescape"))


def _printable(letter: str) -> str:
    if letter == "\\":
        return "\\\\"
    if letter.isprintable():
        return letter
    return "".join(f"\\x{byte:02x}" for byte in letter.encode(errors="surrogateescape"))


def typed(text: str) -> list[bytes]:
    """Names that a user may mean: as it is shown, else as it stands."""
    raw = text.encode(errors="surrogateescape")
    parts = list(_ESCAPE.finditer(raw))
    meant = b"".join(_byte(part) for part in parts)
    whole = sum(len(part[0]) for part in parts) == len(raw)
    return [meant, raw] if whole and meant != raw else [raw]


def _byte(part: re.Match[bytes]) -> bytes:
    return bytes([int(part[1], 16)]) if part[1] else part[2] or part[3]
