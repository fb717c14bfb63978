# SPDX-License-Identifier: Apache-2.0
"""Power cuts: a card as it is after any of the writes that a machine has sent to it.

QEMU's filter `blklogwrites` keeps every write and flush in their order, in the form of Linux'
dm-log-writes. A card that loses its power has what was written before the last flush; of what came
later each write is there, not there, or torn at a sector.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

SECTOR = 512
_SUPER = struct.Struct("<QQQI")
_ENTRY = struct.Struct("<QQQQ")
_MAGIC = 0x6A736677736872
_FLUSH, _FUA, _DISCARD = 1, 2, 4


@dataclass(frozen=True)
class Record:
    """A write, or with no data a flush."""

    offset: int
    data: bytes
    flushes: bool  # what came before is on the card
    stays: bool  # itself, too (force unit access)
    logged: int  # length of the log with it


def blockdev(disk: Path, log: Path) -> str:
    """What QEMU takes as a drive that records; the log must exist."""
    return (
        "driver=blklogwrites,log-super-update-interval=1,"
        f"file.driver=raw,file.file.driver=file,file.file.filename={disk},"
        f"log.driver=file,log.filename={log}"
    )


def records(log: Path) -> Iterator[Record]:
    """What was recorded, in its order, up to where the file ends."""
    with log.open("rb") as file:
        magic, _version, _count, sector = _SUPER.unpack(file.read(_SUPER.size))
        assert magic == _MAGIC
        file.seek(sector)
        while len(head := file.read(sector)) == sector:
            first, count, flags, _length = _ENTRY.unpack(head[: _ENTRY.size])
            if not flags and not count:
                return
            data = b"" if flags & _DISCARD else file.read(count * sector)
            if flags & _DISCARD:
                data = bytes(count * sector)  # QEMU's zeroes; what is discarded may be anything
            if len(data) == count * sector:
                yield Record(
                    first * sector, data, bool(flags & _FLUSH), bool(flags & _FUA), file.tell()
                )


def kept(before: list[Record], chance: random.Random | None) -> list[Record]:
    """What is on the card: of the writes after the last flush each by chance; None: all of them."""
    if chance is None:
        return before
    safe = max((index for index, one in enumerate(before) if one.flushes), default=-1)
    found = before[: safe + 1]
    for one in before[safe + 1 :]:
        fate = 0 if one.stays else chance.randrange(3)
        if fate == 0:
            found.append(one)
        elif fate == 1:
            whole = chance.randrange(len(one.data) // SECTOR + 1) * SECTOR
            found.append(replace(one, data=one.data[:whole]))
    return found


def apply(card: Path, written: list[Record]) -> None:
    """Write them to a card."""
    with card.open("r+b") as file:
        for one in written:
            file.seek(one.offset)
            file.write(one.data)
