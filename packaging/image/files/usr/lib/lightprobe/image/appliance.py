#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Name, networks and access of a probe whose root is never written.

`appliance.py start`, at each start before the network and the daemon: it reads lightprobe.txt on
the card's first partition, makes what is missing, and writes access.txt beside it, from which the
owner learns how to reach the probe. `appliance.py network`, each half minute: it opens the access
point where there is no other network. `appliance.py renew`, each day: another certificate when it
has expired.

Files are written whole or not at all, so the power may fail at any moment. What goes wrong is said
in the log and in access.txt, and never keeps the probe from starting.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from owner_settings import SETTINGS, Settings, decoded, read_settings

BOOT = Path("/boot/firmware")
STATE = Path("/etc/lightprobe")
#: The same folder as the image has it, below what is mounted there.
FACTORY = Path("/usr/share/lightprobe/image")
PROFILES = Path("/run/NetworkManager/system-connections")
#: In the state: networks that were joined by `lightprobe wifi` or the set-up page.
NETWORKS, NETWORK_FILES = "networks", "lightprobe-wifi-*.nmconnection"
ACCESS = "access.txt"
#: Connections of NetworkManager; the button (lightprobe panel) opens and closes the second.
HOME, ACCESS_POINT = "home", "lightprobe"
#: NetworkManager's own for a shared network.
ACCESS_POINT_ADDRESS = "10.42.0.1"
#: Without what is easily misread: 0 and o, 1 and l.
LETTERS = "abcdefghijkmnpqrstuvwxyz23456789"
PASSWORD_LETTERS = 12
#: The card's last partition grows into free space of at least so much.
LEAST_MORE_BYTES = 64 << 20
#: Is there while the access point is open because there was no other network.
OPENED = Path("/run/lightprobe-access-point")
#: The time of the last synchronisation, and that of the image.
CLOCKS = (Path("/data/timesync/clock"), Path("/usr/lib/clock-epoch"))
#: How long the access point is open before the known Wi-Fi is tried again.
TRY_S = 300.0
#: How long NetworkManager may need to begin with another network that it knows.
OTHERS_S = 10.0
SERVICES = ("lightprobed", "lightprobe-setup")
Run = Callable[[Sequence[str]], str]


def write_whole(file: Path, text: str, mode: int = 0o600) -> bool:
    """Write a file unless it says so already, so that it is the old one or the new one at any time.

    Returns whether it was written; raises OSError.
    """
    try:
        if file.read_text() == text:
            return False
    except (OSError, UnicodeDecodeError):
        pass
    fresh = file.with_name(f".{file.name}.new")
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "w") as writing:
        writing.write(text)
        writing.flush()
        os.fsync(writing.fileno())
    os.replace(fresh, file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return True


def kept(file: Path, make: Callable[[], str]) -> str:
    """Give what a file of one line says; it is made if there is none. Raises OSError."""
    try:
        if found := file.read_text().strip():
            return found
    except (OSError, UnicodeDecodeError):
        pass
    made = make()
    write_whole(file, made + "\n")
    return made


def password() -> str:
    """Choose a password that can be typed on a phone: 59 bits."""
    return "".join(secrets.choice(LETTERS) for _ in range(PASSWORD_LETTERS))


def own_digits() -> str:
    """Four digits that tell this probe from others: of the first network card's address."""
    for card in sorted(Path("/sys/class/net").glob("*")):
        address = (card / "address").read_text().strip() if (card / "address").exists() else ""
        if (card / "device").exists() and address:
            return address.replace(":", "")[-4:]
    return secrets.token_hex(2)


def escaped(value: str) -> str:
    """Write a value as keyfiles of GLib have it."""
    text = value.replace("\\", "\\\\")
    return "\\s" + text[1:] if text.startswith(" ") else text


def bytes_of(ssid: str) -> str:
    """Write the name of a network as NetworkManager takes any name: its bytes."""
    return "".join(f"{byte};" for byte in ssid.encode())


def profiles(name: str, settings: Settings, own_password: str) -> dict[str, str]:
    """Give NetworkManager's files: the access point, which waits, and the known Wi-Fi."""
    point = f"""[connection]
id={ACCESS_POINT}
type=wifi
autoconnect=false
[wifi]
mode=ap
band=bg
channel=6
ssid={bytes_of(name)}
[wifi-security]
key-mgmt=wpa-psk
proto=rsn
pairwise=ccmp
psk={escaped(own_password)}
[ipv4]
method=shared
address1={ACCESS_POINT_ADDRESS}/24
[ipv6]
method=ignore
"""
    found = {ACCESS_POINT: point}
    if "wifi-name" in settings.values:
        found[HOME] = f"""[connection]
id={HOME}
type=wifi
[wifi]
ssid={bytes_of(settings.values["wifi-name"])}
[wifi-security]
key-mgmt=wpa-psk
psk={escaped(settings.values["wifi-password"])}
"""
    return found


def access(
    name: str, own_password: str, settings: Settings, client: str, owner: str, problems: list[str]
) -> str:
    """Give the text of access.txt."""
    wifi = settings.values.get("wifi-name")
    lines = [
        "How to reach this probe. Who has this file can change everything on it.",
        "",
        f"Name:                {name}",
        f"Known Wi-Fi:         {wifi or f'none: write yours into {SETTINGS}'}",
        f"Its own Wi-Fi:       {name}, where no known network is",
        f"Password of that:    {own_password}",
        "",
        "To set it up, in a browser:",
        f"    https://{name}.local:7703/setup.html#owner={owner}",
        f"    https://{ACCESS_POINT_ADDRESS}:7703/setup.html#owner={owner}    in its own Wi-Fi",
        "",
        "For apps, and to see the light (the viewer):",
        f"    {client}",
        "",
        *([f"What is wrong with {SETTINGS} or the card:"] if problems else []),
        *(f"    {one}" for one in problems),
    ]
    return "\n".join(lines).rstrip() + "\n"


@contextmanager
def writable(folder: Path, run: Run) -> Iterator[None]:
    """Mount a file system so that it can be written, and back."""
    run(["mount", "-o", "remount,rw", str(folder)])
    try:
        yield
    finally:
        run(["sync", "--file-system", str(folder)])
        run(["mount", "-o", "remount,ro", str(folder)])


def run_now(words: Sequence[str]) -> str:
    """Run a program; returns what it prints. Raises OSError with its words if it fails."""
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    if done.returncode != 0:
        raise OSError(f"{' '.join(words)}: {(done.stderr or done.stdout).strip()}")
    return done.stdout


class Appliance:
    """What is done at each start; folders and programs are given, so that it can be tested."""

    def __init__(
        self,
        *,
        boot: Path = BOOT,
        state: Path = STATE,
        factory: Path = FACTORY,
        profiles: Path = PROFILES,
        run: Run = run_now,
    ) -> None:
        """Folders of the card's first partition, of the state, of the image's own files."""
        self.boot, self.state, self.factory, self.profiles = boot, state, factory, profiles
        self.run = run
        self.problems: list[str] = []

    def attempt(self, what: str, step: Callable[[], None]) -> None:
        """Do a step; if it fails, say so and go on."""
        try:
            step()
        except (OSError, ValueError, KeyError, subprocess.SubprocessError) as failure:
            self.problems.append(f"{what}: {failure}")

    def start(self) -> list[str]:
        """Do all of it; returns the problems."""
        settings = self.read()
        self.problems += settings.problems
        self.attempt("the card's last partition cannot be used, settings are lost at the next "
                     "start", self.ensure_writable)  # fmt: skip
        self.attempt("clock", self.keep_clock)
        self.attempt("grow", self.grow)
        self.attempt("access", lambda: self.forget_access(settings))
        name, own_password = self.name_and_password(settings)
        self.attempt("name", lambda: self.set_name(name))
        self.attempt("country", lambda: self.set_country(settings))
        self.attempt("networks", lambda: self.write_profiles(name, settings, own_password))
        self.attempt("networks that were joined", self.copy_networks)
        self.attempt(ACCESS, lambda: self.write_access(name, own_password, settings))
        return self.problems

    def read(self) -> Settings:
        """Read lightprobe.txt; without one nothing is set."""
        try:
            return read_settings(decoded((self.boot / SETTINGS).read_bytes()))
        except OSError as failure:
            return Settings(problems=[f"{SETTINGS} cannot be read: {failure.strerror}"])

    def ensure_writable(self) -> None:
        """Put what the image has into the state's folder, which is in memory if the card fails.

        Raises OSError after that, so that it is said.
        """
        fails = not os.access(self.state, os.W_OK)
        if fails:
            self.run(["mount", "-t", "tmpfs", "-o", "mode=755,size=8m", "tmpfs", str(self.state)])
        for file in sorted(self.factory.iterdir()):
            if not (self.state / file.name).exists():
                write_whole(self.state / file.name, file.read_text(), 0o644)
        if fails:
            raise OSError("it is damaged, or not there: write the image to another card")

    def keep_clock(self) -> None:
        """Let the time of the last synchronisation outlive this start, and begin with it.

        A Raspberry Pi has no clock that goes on without power.
        """
        newest = max((file.stat().st_mtime for file in CLOCKS if file.exists()), default=0.0)
        if time.time() < newest:
            time.clock_settime(time.CLOCK_REALTIME, newest)
        clock = Path("/var/lib/systemd/timesync")
        self.run(["mkdir", "-p", str(clock)])
        self.run(["mount", "--bind", "/data/timesync", str(clock)])

    def grow(self) -> None:
        """Let the last partition have the rest of the card, and its file system the partition.

        Each by itself: the power may have failed between them.
        """
        device = self.run(["findmnt", "-no", "SOURCE", "/data"]).strip()
        disk = "/dev/" + self.run(["lsblk", "-ndo", "PKNAME", device]).strip()
        number = re.search(r"\d+$", device)
        free = self.run(["sfdisk", "--list-free", "--output", "Size", "--bytes", disk])
        sizes = [int(word) for word in free.split() if word.isdigit()]
        if number is not None and sizes and max(sizes) >= LEAST_MORE_BYTES:
            subprocess.run(
                ["sfdisk", "--no-reread", "--force", "-N", number[0], disk],
                input=", +\n", text=True, check=True, capture_output=True,
            )  # fmt: skip
            self.run(["partx", "--update", "--nr", number[0], disk])
        self.run(["resize2fs", device])  # writes nothing where the file system is as large

    def forget_access(self, settings: Settings) -> None:
        """Let passwords and tokens be made anew, if the owner has written another number."""
        number, file = settings.values.get("access-number", ""), self.state / "access-number"
        if number and (not file.exists() or file.read_text().strip() != number):
            shutil.rmtree(self.state / "pair", ignore_errors=True)
            (self.state / "access-point-password").unlink(missing_ok=True)
            write_whole(file, number + "\n")

    def name_and_password(self, settings: Settings) -> tuple[str, str]:
        """Give those of the probe and of its own Wi-Fi: as the owner wishes, or its own."""
        name = settings.values.get("name") or self.own_name()
        return name, settings.values.get("access-point-password") or self.own_password()

    def own_name(self) -> str:
        """A name that stays, also when the network card is another one."""
        try:
            return kept(self.state / "name", lambda: f"lightprobe-{own_digits()}")
        except OSError as failure:
            self.problems.append(f"name: {failure}")
            return f"lightprobe-{own_digits()}"

    def own_password(self) -> str:
        """A password of the access point that stays."""
        try:
            return kept(self.state / "access-point-password", password)
        except OSError as failure:
            self.problems.append(f"password: {failure}")
            return password()

    def set_name(self, name: str) -> None:
        """Give this machine its name, until it is switched off."""
        if socket.gethostname() != name:
            self.run(["hostname", name])

    def set_country(self, settings: Settings) -> None:
        """Tell the radios where they are."""
        if "country" in settings.values:
            self.run(["iw", "reg", "set", settings.values["country"]])

    def write_profiles(self, name: str, settings: Settings, own_password: str) -> None:
        """Write NetworkManager's files, in memory."""
        self.profiles.mkdir(parents=True, exist_ok=True)
        for one, text in profiles(name, settings, own_password).items():
            write_whole(self.profiles / f"{one}.nmconnection", text)

    def copy_networks(self) -> None:
        """Give NetworkManager the networks that were joined on the set-up page.

        One that cannot be read is said, and left out. Raises OSError.
        """
        folder = self.state / NETWORKS
        folder.mkdir(mode=0o700, exist_ok=True)
        for file in sorted(folder.glob(NETWORK_FILES)):
            text = file.read_text(errors="replace")
            if re.search(r"^ssid=(?:[0-9]+;)+$", text, re.MULTILINE):
                write_whole(self.profiles / file.name, text)
            else:
                self.problems.append(f"{file}: is damaged: join that network again")

    def known(self) -> list[str]:
        """Files of the networks that may be joined."""
        files = [self.profiles / f"{HOME}.nmconnection", *self.profiles.glob(NETWORK_FILES)]
        return sorted(str(file) for file in files if file.exists())

    def pair(self, name: str) -> str:
        """Give the address for clients; certificate and token are made if they are not there.

        Also if they are damaged, expired, or for another name.
        """
        hosts = [f"{name}.local", ACCESS_POINT_ADDRESS]
        words = ["lightprobe", "pair", "--json", "--dir", str(self.state / "pair")]
        words += [word for host in hosts for word in ("--host", host)]
        try:
            said = self.run(words)
        except OSError:
            said = self.run([*words, "--new"])
        # The name is not announced yet, so the command shows the other one.
        return str(json.loads(said)["url"]).replace(ACCESS_POINT_ADDRESS, hosts[0])

    def write_access(self, name: str, own_password: str, settings: Settings) -> None:
        """Write access.txt, if it says something else, or is not there."""
        client = self.pair(name)
        owner = kept(self.state / "pair" / "owner", lambda: secrets.token_urlsafe(24))
        text = access(name, own_password, settings, client, owner, self.problems)
        file = self.boot / ACCESS
        if not file.exists() or file.read_text(errors="replace") != text:
            with writable(self.boot, self.run):
                write_whole(file, text)

    def renew(self) -> None:
        """Make another certificate if the network's time shows that it has expired."""
        certificate, settings = self.state / "pair" / "certificate.pem", self.read()
        name, own_password = self.name_and_password(settings)
        before = certificate.read_bytes()
        self.pair(name)
        if certificate.read_bytes() != before:
            self.problems += settings.problems
            self.write_access(name, own_password, settings)
            self.run(["systemctl", "restart", *SERVICES])

    def look_for_network(self) -> None:
        """Open the access point where there is no other network, and close it where there is.

        Also now and then for the known Wi-Fi, while nobody is in it. What the button has opened
        stays.
        """
        active = self.active()
        point = active.pop(ACCESS_POINT, None)
        if point is None:
            OPENED.unlink(missing_ok=True)
            if not active:
                self.open_access_point()
            return
        if not OPENED.exists() or self.run(["iw", "dev", point, "station", "dump"]):
            return
        if active:
            self.run(["nmcli", "connection", "down", ACCESS_POINT])
        elif self.known() and time.time() - OPENED.stat().st_mtime > TRY_S:
            self.try_known()

    def active(self) -> dict[str, str]:
        """Connections that are up or on their way, and their devices."""
        listed = self.run(["nmcli", "-t", "-f", "NAME,DEVICE", "connection", "show", "--active"])
        found = dict(line.rpartition(":")[::2] for line in listed.splitlines())
        return {name: device for name, device in found.items() if device != "lo"}

    def try_known(self) -> None:
        """Try one of the known networks, another each time, and open the access point again.

        While that is closed, NetworkManager joins by itself whatever else it knows.
        """
        known, tries = self.known(), self.tries()
        uuid = re.search(r"^uuid=(\S+)$", Path(known[tries % len(known)]).read_text(), re.MULTILINE)
        which = ["uuid", uuid[1]] if uuid else [HOME]
        try:
            self.run(["nmcli", "--wait", "60", "connection", "up", *which])
        except OSError:  # it is not there
            if len(known) > 1:
                time.sleep(OTHERS_S)
            if not set(self.active()) - {ACCESS_POINT}:
                self.open_access_point(tries + 1)

    def tries(self) -> int:
        """How often a known network has been tried since the access point was opened first."""
        text = OPENED.read_text()
        return int(text) if text.isdigit() else 0

    def open_access_point(self, tries: int = 0) -> None:
        """Open it, and note since when, and how often a known network has been tried."""
        self.run(["nmcli", "--wait", "60", "connection", "up", ACCESS_POINT])
        OPENED.write_text(str(tries))


def main() -> None:
    """Do one of them, and say what went wrong."""
    appliance = Appliance()
    if sys.argv[1:] == ["start"]:
        problems = appliance.start()
    elif sys.argv[1:] == ["network"]:
        appliance.attempt("network", appliance.look_for_network)
        problems = appliance.problems
    elif sys.argv[1:] == ["renew"]:
        appliance.attempt("certificate", appliance.renew)
        problems = appliance.problems
    else:
        sys.exit("appliance.py start|network|renew")
    for problem in problems:
        print(f"lightprobe: {problem}", flush=True)


if __name__ == "__main__":
    main()
