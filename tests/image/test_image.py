# SPDX-License-Identifier: Apache-2.0
"""The image of a card, from its first start to light: `make test-image`.

All of one start, which takes a minute or more, because programs for ARM64 are emulated here. The
tests do not depend on their order.
"""

from __future__ import annotations

import json
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from card_page import ask, state, token, wait_for_page
from lightprobe.client import Client
from machine import HALF_A, HALF_B, Card, Machine, card, free_port, machine, partitions
from recorded import Record, apply, records
from sound import faults, last_moments

REPO = Path(__file__).resolve().parents[2]
IMAGE = REPO / "build/image/lightprobe-pi4.img"
MORE_MB = 512
#: What the page says, by what.
FIGURES: dict[str, str] = {}
MOST_MEMORY_MB = 256
MOST_PACKED_MB = 700
CUTS = 100
SERVICE_S = 60
REPORT = r"report (uptime_s.*)"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Card:
    """A card of more room than the image."""
    return card(IMAGE, tmp_path_factory.mktemp("card"), MORE_MB)


@dataclass
class Recording:
    """What the machine wrote to the card, and what the set-up page has said to be saved."""

    before: Path  # the card before its first start
    log: Path
    saved: list[tuple[int, str]] = field(default_factory=list)  # length of the log, line


@pytest.fixture(scope="module")
def recording(written: Card, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Begun with the first start."""
    folder = tmp_path_factory.mktemp("recording")
    subprocess.run(["cp", "--sparse=always", written.disk, folder / "before.img"], check=True)
    return Recording(folder / "before.img", folder / "writes")


@pytest.fixture(scope="module")
def started(
    written: Card, recording: Recording, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Machine]:
    """The first start; the access is on the card when the set-up page answers."""
    began = time.monotonic()
    with machine(written, tmp_path_factory.mktemp("machine"), recording.log) as one:
        wait_for_page(one)
        FIGURES["first start to the set-up page"] = f"{time.monotonic() - began:.0f} s"
        yield one


@pytest.fixture(scope="module")
def owner(written: Card, started: Machine) -> str:
    """The token that the owner reads on the card."""
    return token(written)


@pytest.fixture(scope="module")
def camera() -> Iterator[int]:
    """A simulated THETA on the network; its port."""
    port = free_port()
    command = [str(Path(sys.executable).with_name("lightprobe")), "simulate", "--osc", str(port),
               "--size", "480x240", "--rate", "5"]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    yield port
    process.send_signal(signal.SIGINT)
    process.wait(30)


@pytest.fixture(scope="module")
def chosen(recording: Recording, started: Machine, owner: str, camera: int) -> str:
    """The camera that the set-up page has taken, as the daemon names it."""
    source = f"osc:10.0.2.2:{camera}"  # this machine, as QEMU shows it to its guest
    status, text = ask(started, owner, "PUT", "settings", {"set": {"source": [source]}})
    assert status == 200, text
    recording.saved.append((recording.log.stat().st_size, f"source = {source}"))
    return source


def reported(one: Machine) -> dict[str, str]:
    """What the machine says of itself next."""
    length = len(one.said())
    end = time.monotonic() + 120
    while not (found := re.search(rf"{REPORT}\n", one.said()[length:].replace("\r", ""))):
        assert time.monotonic() < end, one.said()[-4000:]
        time.sleep(1)
    return {name: value for name, _, value in (w.partition("=") for w in found[1].split())}


def test_the_card_says_how_to_reach_the_probe(written: Card, owner: str) -> None:
    access = written.read("access.txt")
    print(re.sub(r"(owner|token)=\S+", r"\1=…", access))
    name = re.search(r"^Name: +(\S+)$", access, re.M)
    assert name is not None
    assert f"https://{name[1]}.local:7703/setup.html" in access
    assert "wrong" not in access, access


def test_only_the_owner_may_set_it_up(started: Machine, owner: str) -> None:
    assert ask(started, owner[:-1] + "x", "GET", "state")[0] == 401
    assert state(started, owner)["config"] == "/etc/lightprobe/lightprobed.conf"


def test_a_client_receives_light_once_the_page_has_chosen_a_camera(
    written: Card, started: Machine, chosen: str
) -> None:
    began = time.monotonic()
    found = re.search(r"https://\S+:7702(/#\S+)", written.read("access.txt"))
    assert found is not None
    with Client(f"wss://127.0.0.1:{started.ports[7702]}{found[1]}") as client:
        end = time.monotonic() + 300
        while not client.receive(300).lights:
            assert time.monotonic() < end
    waited_s = time.monotonic() - began
    FIGURES["camera taken by the page, to light in a client"] = f"{waited_s:.0f} s"


@pytest.mark.usefixtures("chosen")
def test_memory_and_the_card(started: Machine, owner: str) -> None:
    """By what the machine tells of itself while the daemon measures and the page is served."""
    report = reported(started)
    print(report)
    FIGURES["memory in use with all services"] = f"{report['used_mb']} MB"
    assert int(report["used_mb"]) <= MOST_MEMORY_MB
    assert report["root"] == "ro"
    assert int(report["data_mb"]) > MORE_MB  # it has grown
    assert report["failed"] == ""
    halves = json.loads(report["update"])
    assert (halves["running"], halves["starts_next"], halves["kept"]) == ("a", "a", True)
    assert halves["version"] == state(started, owner)["card"]
    later = reported(started)
    while (seconds := int(later["uptime_s"]) - int(report["uptime_s"])) < SERVICE_S:
        later = reported(started)
    written = int(later["written_bytes"]) - int(report["written_bytes"])
    FIGURES[f"written to the card in {seconds} s of service"] = f"{written} bytes"
    assert written / seconds * 3600 <= 1e6


def test_a_headset_joins_the_probes_own_wifi(started: Machine) -> None:
    """Simulated radios; the password is that of access.txt."""
    end = time.monotonic() + 300
    while not (report := reported(started))["address"] and time.monotonic() < end:
        pass
    assert re.fullmatch(r"10\.42\.0\.\d+/24", report["address"]), report
    view = json.loads(report["wifi"])
    print(view)
    own = {"kind": "accesspoint", "name": view["own_access_point"]}
    assert any(own.items() <= link.items() for link in view["links"]), view
    assert view["own_access_point"] == report["name"]
    assert any(link["kind"] == "cable" and link["is_up"] for link in view["links"])


def test_the_second_start_is_the_same_probe(
    written: Card, recording: Recording, owner: str, chosen: str, tmp_path: Path
) -> None:
    """After a power failure: of a card with all that was written until now."""
    cut = tmp_path / "cut.img"
    subprocess.run(["cp", "--sparse=always", recording.before, cut], check=True)
    apply(cut, list(records(recording.log)))
    with machine(Card(cut), tmp_path) as again:
        wait_for_page(again)
        assert state(again, owner)["settings"]["source"] == [chosen]
        assert Card(cut).read("access.txt") == written.read("access.txt")


def torn(every: list[Record]) -> list[Record]:
    """A write that spoils the configuration, as a program would that writes it in place."""
    whole = b"# Configuration of lightprobed"
    return [replace(one, data=bytes(len(one.data))) for one in every if one.data.startswith(whole)]


@pytest.mark.usefixtures("chosen")
def test_power_cuts(recording: Recording, tmp_path: Path) -> None:
    """After each cut the probe has a whole root, settings that are the old or the new ones."""
    every = list(records(recording.log))
    assert len(every) > CUTS, "too few writes for that many cuts"
    for first, length in partitions(recording.before)[HALF_A : HALF_B + 1]:
        assert not [one for one in every if one.data and first <= one.offset < first + length]
    ends = [len(every) * (index + 1) // CUTS for index in range(CUTS)]
    bad = []
    assert recording.saved[0][0] < every[-1].logged
    for seed in (None, 1):
        card = tmp_path / "cut.img"
        subprocess.run(["cp", "--sparse=always", recording.before, card], check=True)
        done = 0
        for end in ends:
            flushed = max((i + 1 for i in range(end) if every[i].flushes), default=0)
            apply(card, every[done:flushed])
            done = flushed
            with last_moments(card, every[flushed:end], seed and random.Random(seed * end)):
                saved = [line for at, line in recording.saved if at <= every[end - 1].logged]
                found = faults(card, recording.before, saved[-1:])
                bad += [f"cut {end}, seed {seed}: {what}" for what in found]
    subprocess.run(["cp", "--sparse=always", recording.before, card], check=True)
    apply(card, [*every, *torn(every)])
    assert any("torn" in what for what in faults(card, recording.before, []))
    FIGURES["power cuts, and cards with a fault after them"] = f"{2 * CUTS}, {len(bad)}"
    assert bad == []


def test_the_image_is_small() -> None:
    """Prints the figures of docs/users/image.md."""
    packed = IMAGE.with_suffix(".img.xz").stat().st_size / 1e6
    FIGURES["the image, compressed"] = f"{packed:.0f} MB"
    FIGURES["an update"] = f"{IMAGE.with_suffix('.raucb').stat().st_size / 1e6:.0f} MB"
    FIGURES["on the card"] = f"{IMAGE.stat().st_size / 1e6:.0f} MB"
    lines = ["| | |", "| --- | --- |", *(f"| {one} | {of} |" for one, of in FIGURES.items())]
    print("\n" + "\n".join(lines))
    assert packed <= MOST_PACKED_MB
