# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a card after a power cut, as the probe's next start would find it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random

from machine import DATA, Card, partitions
from recorded import Record, apply, kept


@contextmanager
def last_moments(card: Path, written: list[Record], chance: Random | None) -> Iterator[None]:
    """The card with what came after its last flush; afterwards it is as before."""
    applied = kept(written, chance)
    with card.open("rb") as file:
        former = []
        for one in applied:
            file.seek(one.offset)
            former.append(replace(one, data=file.read(len(one.data))))
    apply(card, applied)
    try:
        yield
    finally:
        apply(card, former[::-1])


def faults(card: Path, before: Path, saved: list[str], settled: bool = False) -> Iterator[str]:
    """Everything that is wrong; `saved`: lines that the set-up page has said to be saved.

    `settled`: the card has been started before, so each file must be there.
    """
    were, are = partitions(before), partitions(card)
    if [one[0] for one in were] != [one[0] for one in are] or were[:DATA] != are[:DATA]:
        yield f"partitions {are}"
        return
    yield from _boot(Card(card), Card(before))
    data = card.with_suffix(".data")
    words = ["dd", f"if={card}", f"of={data}", "bs=1M", "conv=sparse", "status=none",
             "iflag=skip_bytes", f"skip={are[DATA][0]}"]  # fmt: skip
    subprocess.run(words, check=True)
    yield from _data(data, are[DATA][1], settled)
    config = read(data, "/lightprobe/lightprobed.conf")
    for line in saved:
        if f"\n{line}\n" not in config:
            yield f"{line} was saved, and is lost"


def _boot(card: Card, before: Card) -> Iterator[str]:
    """FAT keeps no journal: access.txt may be empty, and is written again (test_appliance.py)."""
    for name in ("lightprobe.txt", "config.txt", "arguments.env", "boot.scr", "u-boot.bin"):
        try:
            if card.read(name) != before.read(name):
                yield f"{name} is another"
        except FileNotFoundError:
            yield f"{name} is gone"


def _data(data: Path, length: int, settled: bool) -> Iterator[str]:
    subprocess.run(["e2fsck", "-E", "journal_only", "-fy", data], capture_output=True)  # as a mount
    checked = subprocess.run(["e2fsck", "-fn", data], capture_output=True, text=True)
    if checked.returncode != 0:
        yield f"file system: {checked.stdout.strip()[-500:]}"
        return
    shown = subprocess.run(["dumpe2fs", "-h", data], capture_output=True, text=True).stdout
    blocks, size = (int(re.search(rf"^{name}: +(\d+)$", shown, re.M)[1])  # type: ignore[index]
                    for name in ("Block count", "Block size"))  # fmt: skip
    if blocks * size > length:
        yield f"file system of {blocks * size} bytes in a partition of {length}"
    for name, form in (
        ("lightprobed.conf", r"# Configuration(.*\n)*smoothing-ms = .*\nttl-ms = .*\n(.*\n)*"),
        ("name", r"lightprobe-[0-9a-f]{4}\n"), ("access-point-password", r"[a-z2-9]{12}\n"),
        ("pair/owner", r"\S{32,}\n"), ("pair/token", r"\S{32}\n"),
        ("pair/key.pem", r"-----BEGIN PRIVATE KEY-----\n(.*\n)+-----END PRIVATE KEY-----\n"),
        ("pair/certificate.pem", r"-----BEGIN CERTIFICATE-----\n(.*\n)+-----END CERTIFIC.*-----\n"),
    ):  # fmt: skip
        text = read(data, f"/lightprobe/{name}")
        if (text or settled) and not re.fullmatch(form, text):
            yield f"{name} is torn, or gone: {text!r}"


def read(data: Path, name: str) -> str:
    """A file of the last partition; nothing if there is none."""
    words = ["debugfs", "-R", f"cat {name}", data]
    return subprocess.run(words, capture_output=True, text=True).stdout
