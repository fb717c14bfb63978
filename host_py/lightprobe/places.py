"""Who may be connected to one of this package's small servers: so many in all, and from one peer.

A newcomer is let in where there is anybody to make room: the oldest that has not proven itself, of
the newcomer's own peer where that has its fill, else of the peer that has most. So who holds many
connections, or opens them all the time, pushes out its own.
"""

from __future__ import annotations

import ipaddress
import threading
from collections.abc import Callable
from dataclasses import dataclass

#: The first bits of an IPv6 address are one household's; the others each of its devices chooses.
_NETWORK_BITS = 64


def peer_of(host: str) -> str:
    """What counts as one peer: an IPv4 address, or the first 64 bits of an IPv6 address."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, _NETWORK_BITS), strict=False))


@dataclass(eq=False)
class Place:
    """Of one connection."""

    peer: str
    leave: Callable[[], None]  # another needs the place: close, at once


class Places:
    """The account. Any thread."""

    def __init__(self, most: int, most_of_peer: int, most_proven: int) -> None:
        """Give how many may be new in all, how many of one peer, and how many may be proven."""
        self._most, self._most_of_peer, self._most_proven = most, most_of_peer, most_proven
        self._lock = threading.Lock()
        self._new: dict[str, dict[Place, None]] = {}  # by peer, the oldest first
        self._proven: dict[Place, None] = {}  # the oldest first
        self._taken = 0  # new ones

    def enter(self, peer: str, leave: Callable[[], None]) -> Place:
        """Let a connection in; another may have to leave for it."""
        place = Place(peer, leave)
        with self._lock:
            gone = self._make_room(peer)
            self._new.setdefault(peer, {})[place] = None
            self._taken += 1
        if gone:
            gone.leave()
        return place

    def prove(self, place: Place) -> None:
        """It has shown the secret: it makes room for proven ones alone."""
        gone = None
        with self._lock:
            if not self._forget(place):
                return
            if len(self._proven) >= self._most_proven:
                gone = next(iter(self._proven))
                del self._proven[gone]
            self._proven[place] = None
        if gone:
            gone.leave()

    def exit(self, place: Place) -> None:
        """It has gone. Also one that had to leave may say so."""
        with self._lock:
            self._proven.pop(place, None)
            self._forget(place)

    @property
    def taken(self) -> int:
        """How many are connected."""
        with self._lock:
            return self._taken + len(self._proven)

    def _make_room(self, peer: str) -> Place | None:
        """Take the place of the one that has to leave for a newcomer, if one has to."""
        if len(self._new.get(peer, ())) < self._most_of_peer:
            if self._taken < self._most:
                return None
            peer = max(self._new, key=lambda one: len(self._new[one]))
        gone = next(iter(self._new[peer]))
        self._forget(gone)
        return gone

    def _forget(self, place: Place) -> bool:
        """Strike a new one out; whether it was there."""
        of_peer = self._new.get(place.peer, {})
        if place not in of_peer:
            return False
        del of_peer[place]
        self._taken -= 1
        if not of_peer:
            del self._new[place.peer]
        return True
