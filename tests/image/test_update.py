# SPDX-License-Identifier: Apache-2.0
"""Updates of a card: one that works, ones that do not, and a power cut at any moment.

RAUC, U-Boot, kernel and services are the real ones, in an emulated machine.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from card_page import ask, state, token, wait_for_page
from machine import BOOT, HALF_A, HALF_B, Card, Machine, card, machine, partitions
from recorded import Record, apply, records
from sound import faults, last_moments

REPO = Path(__file__).resolve().parents[2]
IMAGE = REPO / "build/image/lightprobe-pi4.img"
KEYS = Path(os.environ.get("UPDATE_KEYS") or Path.home() / ".config/lightprobe/update")
MORE_MB = 3000
CUTS = 100
NEW = "999912312359-new"


def bundle(folder: Path, root: Path, keys: Path, compatible: str = "lightprobe-pi4") -> Path:
    """An update that writes this file system."""
    inside = folder / "bundle"
    inside.mkdir()
    shutil.move(root, inside / "root.ext4")
    (inside / "manifest.raucm").write_text(
        f"[update]\ncompatible={compatible}\nversion={NEW}\n"
        "[bundle]\nformat=verity\n[image.rootfs]\nfilename=root.ext4\n"
    )
    subprocess.run(
        ["rauc", "bundle", f"--cert={keys}/certificate.pem", f"--key={keys}/key.pem",
         "--mksquashfs-args=-comp zstd -Xcompression-level 1", inside, folder / "new.raucb"],
        check=True, capture_output=True,
    )  # fmt: skip
    return folder / "new.raucb"


def small(folder: Path, keys: Path, compatible: str = "lightprobe-pi4") -> bytes:
    """An update of a file system that holds nothing of use."""
    root, inside = folder / "root.ext4", folder / "inside"
    inside.mkdir()
    (inside / "noise").write_bytes(random.Random(3).randbytes(1 << 16))
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", inside, root, "4M"], check=True,
                   capture_output=True)  # fmt: skip
    return bundle(folder, root, keys, compatible).read_bytes()


@dataclass
class Update:
    """The update that works."""

    file: Path
    root: Path  # its file system


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Card:
    """A card of 8 GB, nearly."""
    return card(IMAGE, tmp_path_factory.mktemp("card"), MORE_MB)


@pytest.fixture(scope="module")
def new(tmp_path_factory: pytest.TempPathFactory) -> Update:
    """The image's system, which says another version of itself."""
    folder = tmp_path_factory.mktemp("update")
    first, length = partitions(IMAGE)[HALF_A]
    subprocess.run(
        ["dd", f"if={IMAGE}", f"of={folder / 'root.ext4'}", "bs=1M", "conv=sparse", "status=none",
         "iflag=skip_bytes,count_bytes", f"skip={first}", f"count={length}"], check=True,
    )  # fmt: skip
    (folder / "version").write_text(NEW + "\n")
    script = (
        "rm /usr/share/lightprobe/image-version\n"
        f"write {folder / 'version'} /usr/share/lightprobe/image-version\n"
    )
    subprocess.run(["debugfs", "-w", folder / "root.ext4"], input=script, text=True, check=True,
                   capture_output=True)  # fmt: skip
    file = bundle(folder, folder / "root.ext4", KEYS)
    return Update(file, folder / "bundle/root.ext4")


@dataclass
class Updated:
    """What happened to the machine that took the update."""

    before: Path  # the card before
    log: Path  # what was written from then on
    token: str
    seconds: dict[str, float]


def told(one: Machine, owner: str, done_s: float = 900) -> tuple[int | None, list[str]]:
    """How the task ends, and what it says; None: the machine restarts."""
    lines: list[str] = []
    said = 0
    end = time.monotonic() + done_s
    while time.monotonic() < end:
        status, text = ask(one, owner, "GET", f"job?after={said}")
        if status == 404:
            return None, lines
        if status == 0:  # it restarts, or is slow
            time.sleep(2)
            continue
        assert status == 200, text
        answer = json.loads(text)
        lines += answer["lines"]
        said = answer["said"]
        if answer["status"] is not None:
            return answer["status"], lines
    raise AssertionError(lines)


def send(one: Machine, owner: str, update: bytes) -> tuple[int | None, list[str]]:
    """Send an update by the page, and follow the task."""
    status, text = ask(one, owner, "PUT", "upload", update)
    assert status == 200, text
    status, text = ask(one, owner, "POST", "job", {"task": "update", "fields": {"file": "x.raucb"}})
    assert status == 200, text
    return told(one, owner)


def wait_for(what: str, is_so, seconds: float = 900) -> None:
    """Look until it is so."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, what
        time.sleep(2)


def half(one: Card) -> str:
    """The half that is kept."""
    return one.read("half.env").strip().removeprefix("half=")


def version(one: Machine, owner: str) -> str:
    """What the page shows, nothing while it does not answer."""
    status, text = ask(one, owner, "GET", "state")
    return str(json.loads(text)["card"]) if status == 200 else ""


@pytest.fixture(scope="module")
def updated(written: Card, new: Update, tmp_path_factory: pytest.TempPathFactory) -> Updated:
    """A machine that refuses what it must, then takes the update and keeps it."""
    folder = tmp_path_factory.mktemp("machine")
    found = Updated(folder / "before.img", folder / "writes", "", {})
    with machine(written, folder) as one:  # the first start
        wait_for_page(one)
        found.token = token(written)
        status, text = ask(one, found.token, "PUT", "settings", {"set": {"name": ["kept"]}})
        assert status == 200, text
        check_refusals(one, found.token, tmp_path_factory)
    subprocess.run(["cp", "--sparse=always", written.disk, found.before], check=True)
    with machine(written, folder, found.log) as one:
        wait_for_page(one)
        began = time.monotonic()
        old = version(one, found.token)
        status, lines = send(one, found.token, new.file.read_bytes())
        print("\n".join(lines))
        assert status in (0, None), one.said()[-4000:]
        assert status is None or any("100 %" in line for line in lines)
        found.seconds["written"] = time.monotonic() - began
        wait_for("the new version", lambda: version(one, found.token) == NEW)
        found.seconds["new version answers"] = time.monotonic() - began
        assert old not in ("", NEW)
        wait_for("it is kept", lambda: half(written) == "b")
        found.seconds["kept"] = time.monotonic() - began
        assert not written.has("try")
        assert state(one, found.token)["settings"]["name"] == ["kept"]
    return found


def check_refusals(one: Machine, owner: str, folders: pytest.TempPathFactory) -> None:
    """What is cut, not ours, or for another machine is refused, with its reason."""
    other_keys = folders.mktemp("keys")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
         "-nodes", "-keyout", other_keys / "key.pem", "-out", other_keys / "certificate.pem",
         "-subj", "/CN=somebody"], check=True, capture_output=True,
    )  # fmt: skip
    ours = small(folders.mktemp("small"), KEYS)
    changed = bytearray(ours)
    changed[len(changed) // 3] ^= 1
    wrong = []
    for what, file, words in (
        ("other keys", small(folders.mktemp("small"), other_keys), "not signed with the key"),
        ("cut", ours[: len(ours) // 2], "only a part"),
        ("no update", random.Random(1).randbytes(20000), "no update"),
        ("another machine", small(folders.mktemp("small"), KEYS, "toaster"), "another machine"),
        ("changed", bytes(changed), ""),
    ):
        status, lines = send(one, owner, file)
        print(what, lines[-1:])
        if status != 1 or words not in " ".join(lines):
            wrong.append((what, status, lines))
    assert wrong == []


def test_an_update_is_taken_and_kept(updated: Updated) -> None:
    for what, seconds in updated.seconds.items():
        print(f"{what} after {seconds:.0f} s (emulated)")


@pytest.fixture
def on_trial(updated: Updated, new: Update, tmp_path: Path) -> Iterator[Card]:
    """A card to which the update has been written, and which has not started since."""
    one = Card(tmp_path / "card.img")
    subprocess.run(["cp", "--sparse=always", updated.before, one.disk], check=True)
    first, _ = partitions(one.disk)[HALF_B]
    subprocess.run(
        ["dd", f"if={new.root}", f"of={one.disk}", "bs=1M", "conv=notrunc", "status=none",
         "oflag=seek_bytes", f"seek={first}"], check=True,
    )  # fmt: skip
    (tmp_path / "try").write_text("once\n")
    one.write(tmp_path / "try", "try")
    yield one
    one.disk.unlink()


@pytest.mark.parametrize(
    ("what", "script"),
    [
        ("its kernel is gone", "rm /boot/vmlinuz\n"),
        ("its kernel is no kernel", "rm /boot/vmlinuz\nwrite {garbage} /boot/vmlinuz\n"),
        ("its first program ends", "rm /boot/initrd.img\nwrite {garbage} /boot/initrd.img\n"),
        ("it has no system", "rm /usr/lib/systemd/systemd\n"),
        ("its daemon does not run", "rm /usr/bin/lightprobed\n"),
    ],
)
def test_after_a_bad_update_the_former_version_is_back(
    updated: Updated, on_trial: Card, tmp_path: Path, what: str, script: str
) -> None:
    garbage = tmp_path / "garbage"
    garbage.write_bytes(random.Random(2).randbytes(1 << 20))
    on_trial.change(HALF_B, script.format(garbage=garbage))
    with machine(on_trial, tmp_path) as one:
        began = time.monotonic()
        wait_for("it is tried", lambda: "half b of the card starts" in one.said(), 120)
        wait_for("the former one starts", lambda: "half a of the card starts" in
                 one.said().split("half b of the card starts", 1)[1], 1200)  # fmt: skip
        print(f"{what}: the former version starts after {time.monotonic() - began:.0f} s")
        wait_for("the page", lambda: version(one, updated.token) not in ("", NEW))
        assert half(on_trial) == "a"
        assert not on_trial.has("try")


def test_power_cuts_in_an_update(updated: Updated, new: Update, tmp_path: Path) -> None:
    """After each cut a whole system starts, the old one or the new one, with its settings."""
    every = list(records(updated.log))
    bad, cuts, tried, kept = [], 0, 0, 0
    for seed in (None, 1):
        cut = tmp_path / "cut.img"
        subprocess.run(["cp", "--sparse=always", updated.before, cut], check=True)
        done = 0
        for end in moments(every, updated.before):
            flushed = max((i + 1 for i in range(end) if every[i].flushes), default=0)
            apply(cut, every[done:flushed])
            done = max(done, flushed)
            with last_moments(cut, every[flushed:end], seed and random.Random(seed * end)):
                one = Card(cut)
                cuts += 1
                starts_b = one.has("try") or half(one) == "b"
                tried += one.has("try")
                kept += half(one) == "b"
                found = list(faults(cut, updated.before, ["name = kept"], settled=True))
                if half(one) not in ("a", "b"):
                    found.append(f"half.env: {one.read('half.env')!r}")
                if not same(cut, HALF_A, updated.before):
                    found.append("the old system is another")
                if starts_b and not holds(cut, HALF_B, new.root):
                    found.append("the new system is not whole, and may start")
                bad += [f"cut {end}, seed {seed}: {what}" for what in found]
    print(f"{cuts} cuts, {tried} of them with a trial ahead, {kept} with the new version kept, "
          f"{len(bad)} faults")  # fmt: skip
    assert tried
    assert kept
    assert bad == []


def moments(every: list[Record], before: Path) -> list[int]:
    """Where the power is cut: spread evenly, and where the first partition changes."""
    first, length = partitions(before)[BOOT]
    ours = [
        i + 1 for i, one in enumerate(every) if one.data and first <= one.offset < first + length
    ]
    evenly = [len(every) * (i + 1) // CUTS for i in range(CUTS)]
    return sorted({*evenly, *ours[:: max(1, len(ours) // CUTS)], *ours[-3:]} - {0})


def same(card: Path, part: int, other: Path) -> bool:
    """Whether a partition is as on another card."""
    first, length = partitions(other)[part]
    return _equal(card, first, other, first, length)


def holds(card: Path, part: int, system: Path) -> bool:
    """Whether a partition begins with a file system."""
    return _equal(card, partitions(card)[part][0], system, 0, system.stat().st_size)


def _equal(one: Path, at: int, other: Path, other_at: int, length: int) -> bool:
    words = ["cmp", "-s", "-n", str(length), "-i", f"{at}:{other_at}", one, other]
    return subprocess.run(words).returncode == 0
