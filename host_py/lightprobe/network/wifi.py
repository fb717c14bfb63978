"""Which Wi-Fi this machine has joined, which it can join, and joining: or back to what it had."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.network import names, nmcli, profile
from lightprobe.network.profile import Profile

#: NetworkManager's own, and of a card's image, whose root is never written: what is kept of it in
#: the one folder is copied to the other at each start (packaging/image).
SAVED = Path("/etc/NetworkManager/system-connections")
KEPT, IN_MEMORY = Path("/etc/lightprobe/networks"), Path("/run/NetworkManager/system-connections")
#: Is there while the image has opened the access point because there was no other network.
OPENED = Path("/run/lightprobe-access-point")
#: An access point answers within seconds; its addresses may take half a minute.
_JOIN_S = 60
_BACK_S = 60
_REASONS = (
    ("secrets were required", "the password is wrong, or the network does not take this machine"),
    ("could not be found", "it is not in reach"),
    ("ip configuration", "it gives no address"),
    ("timeout", "it does not answer in time"),
)


@dataclass(frozen=True)
class Folders:
    """Where networks are kept, and where NetworkManager reads them: often the same."""

    kept: Path
    read: Path

    @staticmethod
    def of_machine(other: Path | None = None) -> Folders:
        """Those of this machine, or one other for both."""
        if other:
            return Folders(other, other)
        return Folders(KEPT, IN_MEMORY) if KEPT.is_dir() else Folders(SAVED, SAVED)


@dataclass(frozen=True)
class Network:
    """A network in reach, or a known one."""

    name: str  # as it can be shown and typed
    ssid: str  # its bytes in hexadecimal digits: what the page calls it
    security: str  # open, OWE, WPA2, WPA3, WEP, enterprise; "" if it is not in reach
    signal_percent: int | None  # None: it is not in reach
    joined: bool
    known: bool


@dataclass(frozen=True)
class Link:
    """What this machine is connected by."""

    kind: str  # wifi, access point, cable, other
    name: str
    device: str
    is_up: bool  # else it is on its way


@dataclass(frozen=True)
class View:
    """How it stands."""

    links: list[Link]
    networks: list[Network]

    @property
    def own_access_point(self) -> str:
        """Name of the Wi-Fi that this machine has opened itself; "" without."""
        return next((link.name for link in self.links if link.kind == "access point"), "")

    def as_json(self) -> dict[str, Any]:
        """For the page and --json."""
        return asdict(self) | {"own_access_point": self.own_access_point}


class Wifi:
    """The Wi-Fi of this machine. All may block for a minute; any thread."""

    def __init__(self, folders: Folders | None = None, opened: Path = OPENED) -> None:
        """`folders`: of networks; `opened`: see OPENED."""
        self._folders, self._opened = folders or Folders.of_machine(), opened

    # ------------------------------------------------------------ what there is

    def look(self) -> View:
        """See how it stands; raises LightprobeError where there is no Wi-Fi."""
        nmcli.ensure_radio()
        links = [self._link(one) for one in nmcli.active()]
        own = {link.name for link in links if link.kind == "access point"}
        seen = [one for one in nmcli.seen() if names.shown(one.ssid) not in own]
        known = self._known()
        joined = {one.ssid for one in seen if one.joined}
        rows: dict[tuple[bytes, str], Network] = {}
        for one in seen:
            rows.setdefault((one.ssid, one.security), Network(
                names.shown(one.ssid), one.ssid.hex(), one.security, one.signal_percent,
                one.ssid in joined, one.ssid in known,
            ))  # fmt: skip
        away = sorted(known - {one.ssid for one in seen})
        return View(links, [
            *rows.values(),
            *(Network(names.shown(ssid), ssid.hex(), "", None, False, True) for ssid in away),
        ])  # fmt: skip

    def _link(self, one: nmcli.Active) -> Link:
        if one.kind != nmcli.WIFI:
            kind = "cable" if "ethernet" in one.kind else "other"
            return Link(kind, _plain(one.name), one.device, one.is_up)
        is_own = nmcli.of_connection(one.uuid, f"{nmcli.WIFI}.mode") == "ap"
        ssid = self._own().get(one.uuid) or _ssid(one.uuid)
        return Link(
            "access point" if is_own else "wifi", names.shown(ssid), one.device, one.is_up
        )  # fmt: skip

    def _own(self) -> dict[str, bytes]:
        """Networks that this package has joined, by their UUID."""
        folders = (self._folders.kept, self._folders.read)
        return {
            profile.uuid_of(ssid): ssid for folder in folders for ssid in profile.ssids_in(folder)
        }

    def _others(self) -> dict[str, bytes]:
        """Networks that NetworkManager knows besides, by their UUID."""
        own = self._own()
        found = {uuid: _ssid(uuid) for uuid in nmcli.saved() if uuid not in own}
        return {
            uuid: ssid
            for uuid, ssid in found.items()
            if ssid and nmcli.of_connection(uuid, f"{nmcli.WIFI}.mode") not in ("ap", "mesh")
        }

    def _known(self) -> set[bytes]:
        return {*self._own().values(), *self._others().values()}

    # ------------------------------------------------------------ changes

    def join(self, ssid: bytes, password: str, security: str = "") -> None:
        """Join a network and keep it; what fails is taken back. Raises LightprobeError.

        No password: an open network, or one that is known. `security`: of a network that is not
        seen; else as it is seen.
        """
        profile.check_ssid(ssid)
        with self._alone():
            view = self.look()
            wanted = _profile(view, ssid, password, security)
            before = next((one for one in nmcli.active() if one.kind == nmcli.WIFI), None)
            link, was_marked = self._link(before) if before else None, self._opened.exists()
            try:
                self._join(ssid, wanted)
            except LightprobeError as error:
                back = self._back(before, link, was_marked)
                raise LightprobeError(
                    f"wifi: {names.shown(ssid)}: join: {_reason(error)}{back}"
                ) from None
            if wanted:
                self._keep(ssid, wanted)

    def _join(self, ssid: bytes, wanted: Profile | None) -> None:
        """Let NetworkManager join; a new file is taken back if that fails."""
        file, uuid = profile.file_of(self._folders.read, ssid), profile.uuid_of(ssid)
        if wanted is None:
            if uuid not in self._own():
                uuid = next((one for one, name in self._others().items() if name == ssid), uuid)
            nmcli.run("connection", "up", "uuid", uuid, wait_s=_JOIN_S)
            return
        former = file.read_text(encoding="utf-8", errors="replace") if file.exists() else None
        try:
            self._load(file, wanted.text())
            nmcli.run("connection", "up", "uuid", uuid, wait_s=_JOIN_S)
        except LightprobeError:
            with contextlib.suppress(LightprobeError):
                if former is None:
                    self._delete(uuid, file)
                else:
                    self._load(file, former)
            raise

    def _load(self, file: Path, text: str) -> None:
        try:
            profile.write(file, text)
        except OSError as error:
            raise LightprobeError(f"{file}: write: {error.strerror}") from None
        nmcli.run("connection", "load", str(file))

    def _delete(self, uuid: str, file: Path) -> None:
        with contextlib.suppress(nmcli.NmcliError):  # it is not loaded
            nmcli.run("connection", "delete", "uuid", uuid)
        try:
            profile.remove(file)
        except OSError as error:
            raise LightprobeError(f"wifi: {file}: remove: {error.strerror}") from None

    def _keep(self, ssid: bytes, joined: Profile) -> None:
        """Let it outlive a restart."""
        if self._folders.kept == self._folders.read:
            return
        file = profile.file_of(self._folders.kept, ssid)
        try:
            profile.write(file, joined.text())
        except OSError as error:
            raise LightprobeError(
                f"wifi: {names.shown(ssid)}: is joined, but will be forgotten at the next start: "
                f"{file}: write: {error.strerror}"
            ) from None

    def _back(self, before: nmcli.Active | None, link: Link | None, was_marked: bool) -> str:
        """Go back to what there was; gives the words for that."""
        if before is None or link is None:
            return ""
        where = "its own Wi-Fi " * (link.kind == "access point") + link.name
        try:
            if all(one.uuid != before.uuid or not one.is_up for one in nmcli.active()):
                nmcli.run("connection", "up", "uuid", before.uuid, wait_s=_BACK_S)
        except LightprobeError as error:
            return f"; {where} does not come back: {error}: look at journalctl -u NetworkManager"
        if was_marked:  # or the image's timer has taken it for opened by the button meanwhile
            with contextlib.suppress(OSError):
                self._opened.touch()
        return f"; {where} is back"

    def forget(self, ssid: bytes) -> None:
        """Leave a network, and join it no more by itself; raises LightprobeError."""
        profile.check_ssid(ssid)
        with self._alone():
            nmcli.ensure_radio()
            own = profile.uuid_of(ssid)
            others = [uuid for uuid, name in self._others().items() if name == ssid]
            if not others and own not in self._own():
                raise UsageError(
                    f"wifi: {names.shown(ssid)}: is not known: lightprobe wifi lists what is"
                )
            if others and self._folders.kept != self._folders.read:
                raise UsageError(
                    f"wifi: {names.shown(ssid)}: is named in lightprobe.txt on the card: take it "
                    "out there"
                )
            self._remove_kept(profile.file_of(self._folders.kept, ssid))
            for uuid in [*others, own]:
                self._delete(uuid, profile.file_of(self._folders.read, ssid))

    def _remove_kept(self, file: Path) -> None:
        try:
            profile.remove(file)
        except OSError as error:
            raise LightprobeError(f"wifi: {file}: remove: {error.strerror}") from None

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """One change at a time, of this and other programs."""
        folder = self._folders.read
        try:
            handle = os.open(folder, os.O_RDONLY)
        except FileNotFoundError:
            raise LightprobeError(
                f"wifi: {folder}: no such folder: is NetworkManager installed?"
            ) from None
        except PermissionError:
            raise LightprobeError(
                f"wifi: {folder}: only root may change networks: run it with sudo"
            ) from None
        import fcntl  # not on Windows, where nmcli is missed before

        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LightprobeError(
                "wifi: a network is being joined or forgotten: wait a minute"
            ) from None
        else:
            if not os.access(folder, os.W_OK):
                raise LightprobeError(
                    f"wifi: {folder}: only root may change networks: run it with sudo"
                )
            yield
        finally:
            os.close(handle)


def page_host() -> str:
    """Name by which others in the same network find this machine."""
    return f"{socket.gethostname().partition('.')[0]}.local"


def _plain(text: str) -> str:
    return names.shown(text.encode(errors="surrogateescape"))


def _ssid(uuid: str) -> bytes:
    """Name of a connection's network: exactly, where it is one of this package."""
    text = nmcli.of_connection(uuid, f"{nmcli.WIFI}.ssid")
    return text.encode(errors="surrogateescape")


def _reason(error: LightprobeError) -> str:
    words = str(error)
    return next((say for sign, say in _REASONS if sign in words.lower()), words)


def _profile(view: View, ssid: bytes, password: str, security: str) -> Profile | None:
    """What is to be joined; None: a known network as it is known. Raises UsageError."""
    rows = [one for one in view.networks if one.ssid == ssid.hex()]
    offered = [one.security for one in rows if one.security]
    if not password and not security and any(one.known for one in rows):
        return None
    wanted = security or _chosen(offered, password)
    where = f"wifi: {names.shown(ssid)}"
    if security and security not in profile.SECURITIES:
        raise UsageError(f"{where}: security: one of {', '.join(profile.SECURITIES)}")
    if wanted == "enterprise":
        raise UsageError(
            f"{where}: it asks for a user name (802.1X, enterprise): a probe joins networks with a "
            "password alone; use another, or a cable"
        )
    if wanted == "WEP":
        raise UsageError(f"{where}: WEP protects nothing: set the router to WPA2 or WPA3")
    if wanted in (profile.WPA2, profile.WPA3) and not password:
        raise UsageError(f"{where}: it needs its password")
    profile.check_password(wanted, password)
    return Profile(ssid, wanted, password, hidden=not offered)


def _chosen(offered: list[str], password: str) -> str:
    """Security of a network: where one name has several, what fits a password comes first."""
    for one in (profile.WPA2, profile.WPA3):
        if one in offered:
            return one
    if offered:
        return offered[0]
    return profile.WPA2 if password else profile.OPEN
