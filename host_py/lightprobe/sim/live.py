"""A daemon before a simulated camera. In simulated time no load changes what it does."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self

from lightprobe.daemon import Daemon
from lightprobe.estimate import Estimate, Health
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS, UNIX_NS, SimulatedClock, WatchedClock
from lightprobe.sim.faults import Faults
from lightprobe.sim.link import Exposure, Link
from lightprobe.sim.live_box import LiveBox
from lightprobe.sim.surroundings import FixedPolarizer
from lightprobe.wire import Decoder, Message, Subscription, encode_subscription


@dataclass(frozen=True)
class Received:
    """A message, and when it came, in seconds since the start."""

    t_s: float
    message: Message


class LiveClient:
    """A client of the daemon that reads whatever there is."""

    def __init__(self, path: Path, subscription: Subscription | None = None) -> None:
        """Connect to the daemon's Unix socket; without a subscription as newcomers do."""
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(path))
        self._socket.setblocking(False)
        self._decoder = Decoder()
        self.received: list[Received] = []
        self.bytes_received = 0
        if subscription is not None:
            self.subscribe(subscription)

    def subscribe(self, subscription: Subscription) -> None:
        """Ask for something else from now on."""
        self.send(encode_subscription(subscription))

    def send(self, request: bytes) -> None:
        """Send a request, length included."""
        self._socket.sendall(request)

    def read(self, t_s: float) -> None:
        """Take what has come."""
        while True:
            try:
                data = self._socket.recv(1 << 16)
            except BlockingIOError:
                return
            if not data:
                return
            self.bytes_received += len(data)
            self.received += [Received(t_s, message) for message in self._decoder.feed(data)]

    @property
    def estimates(self) -> list[Estimate]:
        """All estimates so far."""
        return [r.message for r in self.received if isinstance(r.message, Estimate)]

    @property
    def health(self) -> Health | None:
        """The newest health message."""
        found = [r.message for r in self.received if isinstance(r.message, Health)]
        return found[-1] if found else None

    def close(self) -> None:
        """Leave."""
        self._socket.close()


class App(Protocol):
    """What does something at times of its own while the simulated world goes on."""

    def due_ns(self) -> int:
        """When it wants to do something next, by the probe's clock."""

    def work(self) -> None:
        """Do it."""


class LiveProbe:
    """Simulated camera, daemon and clients; time goes on in :meth:`run` only.

    with LiveProbe(camera) as probe:
        client = probe.client(Subscription(max_lights=8))
        probe.run(5.0)
        print(client.estimates[-1].flags)
    """

    def __init__(
        self,
        camera: SimulatedCamera,
        arguments: Sequence[str] = (),
        *,
        delay_frames: int = 2,
        faults: Faults | None = None,
        box: LiveBox | None = None,
        film_deg: float | None = None,
        others: Sequence[SimulatedCamera] = (),
        real_time: bool = False,
    ) -> None:
        """`arguments`: more of lightprobed's; `delay_frames`: from exposure command to effect;
        `box`: its wheel turns the camera's polarizer; `film_deg`: the polarizer is fixed by hand at
        that angle instead; `others`: more cameras in the same world,
        each of which wants a --camera= of its own, after that of the first;
        `real_time`: the daemon's time is this machine's, for what cannot be simulated."""
        self._folder = tempfile.TemporaryDirectory(prefix="lp-")  # socket paths are short
        folder = Path(self._folder.name)
        self.socket, self.log_path = folder / "probe", folder / "log"
        self.clients: list[LiveClient] = []
        self.apps: list[App] = [box] if box else []
        self.clock: SimulatedClock | WatchedClock = (
            WatchedClock(self._read, lambda: self._daemon.check())
            if real_time
            else SimulatedClock(folder / "time", self._read, lambda: self._daemon.check())
        )
        self._start_ns = self.clock.now_ns()
        fixed = None if film_deg is None else FixedPolarizer(film_deg)
        self.link = Link(
            folder / "camera", camera, Exposure(camera, delay_frames=delay_frames), faults,
            surroundings=fixed or box, say=lambda text: None, clock=self.clock,
        )  # fmt: skip
        self.other_links = [
            Link(
                folder / f"camera{k}", other, Exposure(other, delay_frames=delay_frames), faults,
                say=lambda text: None, clock=self.clock,
            )
            for k, other in enumerate(others, 1)
        ]  # fmt: skip
        self.apps += self.other_links
        self._daemon = Daemon(
            [
                *(f"--source=sim:{link.path}" for link in (self.link, *self.other_links)),
                f"--publish=unix:{self.socket}",
                *([] if real_time else [f"--simulated-time={folder / 'time'}"]), *arguments,
            ],
            self.log_path,
        )  # fmt: skip

    def __enter__(self) -> Self:
        """Start the daemon; its time stands still."""
        for link in (self.link, *self.other_links):
            link.listen()
        self._daemon.__enter__()
        try:
            self.clock.advance(self._start_ns)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End everything."""
        for client in self.clients:
            client.close()
        self._daemon.__exit__()
        for link in (self.link, *self.other_links):
            link.close()
        self.clock.close()
        self._folder.cleanup()

    @property
    def t_s(self) -> float:
        """Seconds since the start: the simulated world's time."""
        return (self.clock.now_ns() - self._start_ns) / 1e9

    @property
    def log(self) -> str:
        """What the daemon has said."""
        return self.log_path.read_text(errors="replace")

    def client(self, subscription: Subscription | None = None) -> LiveClient:
        """Connect one more client; it hears from the daemon as time goes on."""
        client = self._connected(subscription)
        self.clients.append(client)
        return client

    def _connected(self, subscription: Subscription | None) -> LiveClient:
        while True:
            try:
                return LiveClient(self.socket, subscription)
            except (FileNotFoundError, ConnectionRefusedError):
                if not isinstance(self.clock, WatchedClock):
                    raise
                # It has started, and does not listen yet.
                self.clock.advance(self.clock.now_ns() + 10_000_000)

    def run(self, seconds: float) -> None:
        """Let time go on."""
        end_ns = self.clock.now_ns() + round(1e9 * seconds)
        while self.apps:
            app = min(self.apps, key=lambda one: one.due_ns())
            if app.due_ns() > end_ns:
                break
            self.link.run_until(app.due_ns())
            app.work()
            self.clock.advance(self.clock.now_ns())  # the daemon takes it now
        self.link.run_until(end_ns)

    def captured_s(self, estimate: Estimate) -> float:
        """Say when an estimate's newest frame was captured, in simulated time since the start."""
        return (estimate.capture_time_unix_ns - UNIX_NS - START_NS) / 1e9

    def _read(self) -> None:
        for client in self.clients:
            client.read(self.t_s)
