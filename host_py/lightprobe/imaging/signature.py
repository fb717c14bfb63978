"""What a file is by its first bytes, whatever its name says."""

from __future__ import annotations

import re

#: First bytes of pictures that are no JPEG, and what the kind is called.
_KINDS = (
    (rb"\x89PNG", "PNG"),
    (rb"(II\*|MM\x00\*|II\+\x00|MM\x00\+)", "TIFF"),
    (rb"BM", "BMP"),
    (rb"GIF8", "GIF"),
    (rb"RIFF....WEBP", "WebP"),
    (rb"....ftyp(avif|avis)", "AVIF"),
    (rb"....ftyp(hei[cfmsx]|hev[cmsx]|mif1|msf1)", "HEIF"),
    (rb"(\x00\x00\x00\x0cJXL |\xff\x0a)", "JPEG XL"),
    (rb"(\x00\x00\x00\x0cjP  |\xff\x4f\xff\x51)", "JPEG 2000"),
    (rb"v/1\x01", "OpenEXR"),
    (rb"#\?(RADIANCE|RGBE)", "Radiance"),
    (rb"P[Ff]\s", "PFM"),
)
#: So many bytes tell.
MOST_BYTES = 16
#: What is read under a name; one reader has all pictures of 8 and 16 bits, whatever their names.
_CODES = frozenset({"PNG", "TIFF", "BMP"})
_READ: dict[str, frozenset[str]] = {
    ".jpg": frozenset(), ".jpeg": frozenset(), ".png": _CODES, ".tif": _CODES, ".tiff": _CODES,
    ".bmp": _CODES, ".exr": frozenset({"OpenEXR"}), ".hdr": frozenset({"Radiance"}),
    ".pfm": frozenset({"PFM"}),
}  # fmt: skip
#: A frame header of JPEG (ITU-T T.81, table B.1): its kind and bits a sample.
_FRAME = re.compile(rb"\xff([\xc0-\xc3\xc5-\xc7\xc9-\xcb\xcd-\xcf])..(.)", re.DOTALL)
_LOSSLESS, _BITS = (0xC3, 0xC7, 0xCB, 0xCF), 8


def other_kind(start: bytes, suffix: str) -> str:
    """Say that a file, of which these are the first bytes, is no picture that its name may have.

    Empty: it is one, or nobody knows.
    """
    kind = next((name for begin, name in _KINDS if re.match(begin, start, re.DOTALL)), "")
    if not kind or kind in _READ.get(suffix, {kind}):
        return ""
    known = any(kind in kinds for kinds in _READ.values())
    return f"it is {kind}, whatever its name says: {'rename' if known else 'convert'} it"


def unread_jpeg(file: bytes) -> str:
    """Say why a JPEG is of a kind that nobody here reads; empty: it is not that."""
    frame = _FRAME.search(file)
    if not file.startswith(b"\xff\xd8") or frame is None:
        return ""
    if frame[1][0] in _LOSSLESS:
        return "a lossless JPEG: convert it"
    if frame[2][0] != _BITS:
        return f"a JPEG of {frame[2][0]} bits a sample: expected {_BITS}: convert it"
    return ""
