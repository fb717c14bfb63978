# SPDX-License-Identifier: Apache-2.0
"""The daemon from the test's side: start it, read its messages, stop it.

Reads the wire by the generated schema alone; the client library would import numpy, which takes
seconds here.
"""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from lightprobe_proto import lightprobe_pb2 as pb
from machine import wait_for

BUILD = Path(os.environ["LP_BUILD"])
HEALTH_PERIOD_MS = 100
#: An estimate without a new frame: an old one repeated, or the ring's alone.
STALE, RING_ONLY = 1, 512
NO_FRAME = STALE | RING_ONLY


def parse_delimited(data: bytes) -> tuple[bytes | None, bytes]:
    """Split off the first whole message; None when it is not whole."""
    length = shift = 0
    for i, byte in enumerate(data):
        length |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            end = i + 1 + length
            return (data[i + 1 : end], data[end:]) if len(data) >= end else (None, data)
    return None, data


class Client:
    """One connection to a daemon's Unix socket, and what it says there."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX)
        self._data = b""
        self.connect()

    def connect(self) -> None:
        """Connect (again), once somebody listens, and subscribe."""
        self._socket.close()
        self._socket = socket.socket(socket.AF_UNIX)
        wait_for("lightprobed", lambda: self._socket.connect_ex(str(self.path)) == 0)
        self._data = b""
        wish = pb.FromClient()
        wish.subscribe.health_period_ms = HEALTH_PERIOD_MS
        wish.subscribe.max_lights = 8
        wish.subscribe.smoothing = pb.Subscription.RAW
        self.request(wish)

    def next_message(self, timeout_s: float = 120) -> pb.FromProbe:
        """Return the next message of any kind."""
        end = time.monotonic() + timeout_s
        while True:
            message, self._data = parse_delimited(self._data)
            if message is not None:
                return pb.FromProbe.FromString(message)
            self._socket.settimeout(max(0.001, end - time.monotonic()))
            received = self._socket.recv(65536)
            assert received, f"the daemon has gone:\n{self.log()}"
            self._data += received

    def wait_health(
        self, what: str, condition: Callable[[pb.Health], bool], timeout_s: float = 120
    ) -> pb.Health:
        """Read until a health message satisfies the condition; return it."""
        end = time.monotonic() + timeout_s
        last = None
        while time.monotonic() < end:
            try:
                message = self.next_message(max(0.001, end - time.monotonic()))
            except TimeoutError:
                break
            if message.HasField("health"):
                last = message.health
                if condition(last):
                    return last
        raise AssertionError(f"{what}: not within {timeout_s} s; last: {last}\n{self.log()}")

    def wait_state(self, name: str, timeout_s: float = 120) -> pb.Health:
        """Wait for a state of the source: "STREAMING", "WAITING", ..."""
        wanted = pb.Health.SourceState.Value(name)
        return self.wait_health(name, lambda health: health.source_state == wanted, timeout_s)

    def wait_estimate(self, captured_after_unix_ns: int = 0, timeout_s: float = 120) -> pb.Estimate:
        """Wait for an estimate from a frame captured after that time.

        After a time, one that is STALE will do: its frame came late, but it is no repetition.
        """
        unfit = RING_ONLY if captured_after_unix_ns else NO_FRAME
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            message = self.next_message(max(0.001, end - time.monotonic()))
            estimate = message.estimate
            if (
                message.HasField("estimate")
                and not estimate.flags & unfit
                and estimate.capture_time_unix_ns > captured_after_unix_ns
            ):
                return estimate
        raise AssertionError(f"no new estimate within {timeout_s} s\n{self.log()}")

    def _skip_waiting(self) -> None:
        """Forget the whole messages that have arrived, or were written before this call."""
        self._socket.settimeout(2 * HEALTH_PERIOD_MS / 1000)
        end = time.monotonic() + 2 * HEALTH_PERIOD_MS / 1000
        while time.monotonic() < end:
            with suppress(TimeoutError):
                self._data += self._socket.recv(1 << 20)
        message: bytes | None = b""
        while message is not None:
            message, self._data = parse_delimited(self._data)

    def request(self, wish: pb.FromClient) -> None:
        """Send a request."""
        payload = wish.SerializeToString()
        self._socket.sendall(bytes([len(payload)]) + payload)

    def health(self) -> pb.Health:
        """Return the state as it is now."""
        self._skip_waiting()
        return self.wait_health("health", lambda health: True)

    def expect_stall(self, silence: Callable[[str], object], told: str) -> None:
        """A camera that falls silent is a state, told in the log's words; and it ends."""
        self.wait_estimate()
        silence("silent 1")
        health = self.wait_state("STALLED")
        assert told in health.faults[0].text
        silence("silent 0")
        self.wait_state("STREAMING")
        self.wait_estimate(time.time_ns())

    def log(self) -> str:
        """Return all that the daemon has printed, as far as this end knows."""
        return ""


class Daemon(Client):
    """lightprobed with one source. `options`: further arguments, as on its command line."""

    def __init__(
        self,
        source: str,
        *options: str,
        user: int | None = None,
        groups: str = "",
        build: Path = BUILD,
    ) -> None:
        path = Path(f"/run/lp-{time.monotonic_ns()}.sock")
        self._log = Path(f"{path}.log")
        which = f"--groups={groups}" if groups else "--clear-groups"
        drop = ["setpriv", f"--reuid={user}", which] if user else []
        if user:
            path = Path("/tmp") / path.name
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [*drop, build / "bin" / "lightprobed", f"--source={source}",
                 f"--publish=unix:{path}", *options],
                stderr=log,
            )  # fmt: skip
        super().__init__(path)

    def log(self) -> str:
        """Return all that it has printed."""
        return self._log.read_text(errors="replace")

    def stop(self, by: int = signal.SIGTERM) -> str:
        """End it; returns its log."""
        if self._process.poll() is None:
            self._process.send_signal(by)
        status = self._process.wait(timeout=60)
        self._socket.close()
        assert by == signal.SIGKILL or status == 0, f"status {status}\n{self.log()}"
        return self.log()
