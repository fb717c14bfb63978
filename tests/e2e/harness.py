"""The real daemon, a raw client, and a camera on the simulator's socket, by the test's hand."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import signal
import socket
import struct
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from google.protobuf.internal.decoder import _DecodeVarint
from google.protobuf.internal.encoder import _VarintBytes
from lightprobe_proto import lightprobe_pb2 as pb

BUILD = Path(__file__).resolve().parents[2] / "build"
LONG_S = 60  # the machine may be busy: never a measure of speed
STALE, BRACKET_INCOMPLETE, MORE_LIGHTS = 1, 16, 64


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = LONG_S) -> Any:
    """Poll until `condition` gives something true; returns it."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        result = condition()
        if result:
            return result
        time.sleep(0.01)
    raise AssertionError(f"after {timeout_s} s: {what}")


def assert_sane(log: str) -> None:
    """No sanitizer has complained."""
    assert "Sanitizer" not in log, log
    assert "runtime error" not in log, log


# ---------------------------------------------------------------- the daemon


class Daemon:
    """lightprobed in a folder of its own; by default sanitized, on a Unix socket."""

    def __init__(self, *arguments: str, variant: str = "asan", **popen: Any) -> None:
        # Socket paths are short; pytest's folders are not.
        self._folder = tempfile.TemporaryDirectory(prefix="lp-")
        self.folder = Path(self._folder.name)
        self.folder.chmod(0o755)
        self.socket = self.folder / "probe"
        self.variant = variant
        self.arguments = list(arguments)
        if not any(argument.startswith(("--publish=", "--once")) for argument in arguments):
            self.arguments.append(f"--publish=unix:{self.socket}?mode=666&per_peer=4096")
        self.popen = popen
        self.log_path = self.folder / "log"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> Daemon:
        """Start without waiting."""
        environment = os.environ | {"XDG_RUNTIME_DIR": str(self.folder)} | self.popen.pop("env", {})
        with open(self.log_path, "wb") as log:
            self.process = subprocess.Popen(
                [BUILD / self.variant / "bin" / "lightprobed", *self.arguments],
                stdin=subprocess.DEVNULL,
                stderr=log,
                env=environment,
                **({"stdout": subprocess.PIPE} | self.popen),
            )
        return self

    def __enter__(self) -> Daemon:
        self.start()
        try:
            if not any(word in " ".join(self.arguments) for word in ("stdout:", "--once")):
                self.wait_log("listen: ")
        except BaseException:
            self.__exit__(AssertionError)
            raise
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        try:
            self.stop()
        except AssertionError:
            if kind is None:
                raise
        finally:
            if kind is not None:
                print(self.log())
            self._folder.cleanup()

    def log(self) -> str:
        """Everything it has said so far."""
        return self.log_path.read_text(errors="replace")

    def wait_log(self, text: str) -> None:
        """Wait until it says so."""

        def said() -> bool:
            assert self.process is not None
            ended = self.process.poll() is not None
            if text not in self.log() and ended:
                raise AssertionError(f"ended without saying '{text}':\n{self.log()}")
            return text in self.log()

        wait_for(said, f"the daemon has not said '{text}': {self.log()}")

    def wait(self) -> int:
        """Wait for its end; a sanitizer's complaint is a failure."""
        assert self.process is not None
        status = self.process.wait(LONG_S)
        if self.process.stdout:
            self.process.stdout.close()
        assert_sane(self.log())
        return status

    def stop(self, with_signal: int = signal.SIGTERM) -> int:
        """End it as systemd would."""
        assert self.process is not None
        if self.process.poll() is None:
            self.process.send_signal(with_signal)
        try:
            return self.wait()
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"does not end by {with_signal}:\n{self.log()}") from None

    def alive(self) -> bool:
        """It has not died."""
        assert self.process is not None
        return self.process.poll() is None

    def client(self, **wanted: Any) -> Client:
        """Connect a client; with arguments it subscribes."""
        client = Client(self.socket)
        if wanted:
            client.subscribe(**wanted)
        return client


def run(*arguments: str, variant: str = "asan", **popen: Any) -> tuple[int, bytes, str]:
    """Run to the end: exit status, standard output, log."""
    done = subprocess.run(
        [BUILD / variant / "bin" / "lightprobed", *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=LONG_S,
        **popen,
    )
    log = done.stderr.decode(errors="replace")
    assert_sane(log)
    return done.returncode, done.stdout, log


# ---------------------------------------------------------------- messages


def delimit(message: bytes) -> bytes:
    """Put the length before it."""
    return _VarintBytes(len(message)) + message


def split(data: bytes) -> tuple[list[pb.FromProbe], bytes]:
    """Whole messages, and what is left."""
    messages, at = [], 0
    while at < len(data):
        try:
            size, body = _DecodeVarint(data, at)
        except IndexError:
            break
        if len(data) < body + size:
            break
        messages.append(pb.FromProbe.FromString(data[body : body + size]))
        at = body + size
    return messages, data[at:]


class Client:
    """A client without manners: blocking, raw, no reconnecting."""

    def __init__(self, address: Path | tuple[str, int]) -> None:
        family = socket.AF_UNIX if isinstance(address, Path) else socket.AF_INET
        self.socket = socket.socket(family, socket.SOCK_STREAM)
        self.socket.settimeout(LONG_S)
        self.socket.connect(str(address) if isinstance(address, Path) else address)
        self.rest = b""
        self.messages: list[pb.FromProbe] = []

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def subscribe(self, **wanted: Any) -> None:
        """Send a Subscription."""
        request = pb.FromClient(subscribe=pb.Subscription(**wanted))
        if not wanted:
            request.subscribe.SetInParent()
        self.socket.sendall(delimit(request.SerializeToString()))

    def next(self, kind: str | None = None) -> Any:
        """The next message (of this kind, others skipped). EOFError: the daemon has closed."""
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            while self.messages:
                message = self.messages.pop(0)
                found = message.WhichOneof("message")
                if kind in (None, found):
                    return getattr(message, found)
            data = self.socket.recv(65536)
            if not data:
                raise EOFError
            self.messages, self.rest = split(self.rest + data)
        raise AssertionError(f"no {kind} in {LONG_S} s")

    def take(self) -> list[pb.FromProbe]:
        """All that has come, without waiting."""
        taken, self.messages = self.messages, []
        self.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while data := self.socket.recv(65536):
                messages, self.rest = split(self.rest + data)
                taken += messages
        self.socket.settimeout(LONG_S)
        return taken

    def wait_closed(self) -> None:
        """Read until the daemon closes the connection."""
        with contextlib.suppress(EOFError, ConnectionError):
            self.next("nothing of this name, so everything is skipped")

    def until(self, condition: Callable[[Any], bool], kind: str = "estimate") -> Any:
        """The first message of a kind that fulfils a condition."""
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            message = self.next(kind)
            if condition(message):
                return message
        raise AssertionError(f"no such {kind} in {LONG_S} s; the last one: {message}")


# ---------------------------------------------------------------- pictures


def panorama(width: int = 128, level: int = 60, lamp_column: float = 0.5) -> np.ndarray:
    """8-bit BGR equirectangular room: dim, with one bright lamp above the horizon."""
    height = width // 2
    picture = np.full((height, width, 3), level, np.uint8)
    centre = (round(lamp_column * width), round(0.3 * height))
    cv2.circle(picture, centre, max(1, width // 100), (250, 250, 250), -1)
    return picture


def jpeg(picture: np.ndarray | None = None, quality: int = 90) -> bytes:
    """Encode a picture (a default one)."""
    picture = panorama() if picture is None else picture
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return data.tobytes()


def pfm(radiance: np.ndarray) -> bytes:
    """Little-endian PFM of rows from the top, colour or grey."""
    kind = "PF" if radiance.ndim == 3 else "Pf"
    height, width = radiance.shape[:2]
    header = f"{kind}\n{width} {height}\n-1.0\n".encode()
    return header + np.ascontiguousarray(radiance[::-1], "<f4").tobytes()


# ---------------------------------------------------------------- a camera on sim:


class Camera:
    """The simulator's end of the link, sending what the test tells it to."""

    HEADER = struct.Struct("<4sIQ4sIIIQqffII5ff")

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sequence = 0
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.listener.bind(str(path))
        self.listener.listen(1)
        self.listener.settimeout(LONG_S)
        self.link: socket.socket | None = None
        self.lines = b""

    def accept(self) -> str:
        """Wait for the daemon; returns its hello."""
        self.link, _ = self.listener.accept()
        self.link.settimeout(LONG_S)
        return self.line()

    def line(self) -> str:
        """The next command of the daemon."""
        assert self.link is not None
        while b"\n" not in self.lines:
            data = self.link.recv(4096)
            if not data:
                raise EOFError
            self.lines += data
        line, self.lines = self.lines.split(b"\n", 1)
        return line.decode()

    def send(
        self,
        payload: bytes,
        format: str = "MJPG",
        width: int = 128,
        height: int = 64,
        exposure_us: float = 1000.0,
        flags: int = 0,
        claim: int | None = None,
        cut: int = 0,
        t_start_ns: int | None = None,
    ) -> None:
        """Send one frame; `claim` lies about the payload's size, `cut` leaves its end out.

        Its exposure began at `t_start_ns`, or ends now.
        """
        assert self.link is not None
        self.sequence += 1
        if t_start_ns is None:
            t_start_ns = time.monotonic_ns()
            t_start_ns -= 0 if math.isnan(exposure_us) else round(exposure_us * 1e3)
        header = self.HEADER.pack(
            b"LPF1",
            self.HEADER.size,
            len(payload) if claim is None else claim,
            format.encode(),
            width,
            height,
            0,
            self.sequence,
            t_start_ns,
            exposure_us,
            1.0,
            flags,
            0,
            *[math.nan] * 5,  # no orientation
            0.0,  # µs: all rows at once
        )
        self.link.sendall(header + payload[: len(payload) - cut])

    def unplug(self) -> None:
        """Close the link, keep listening."""
        assert self.link is not None
        self.link.close()
        self.lines = b""

    def close(self) -> None:
        """Close all, and remove the socket file."""
        if self.link:
            self.link.close()
        self.listener.close()
        self.path.unlink(missing_ok=True)


@contextlib.contextmanager
def camera() -> Iterator[Camera]:
    """A camera listening on a socket of its own."""
    with tempfile.TemporaryDirectory(prefix="lp-cam-") as folder:
        listening = Camera(Path(folder) / "camera")
        try:
            yield listening
        finally:
            listening.close()


@contextlib.contextmanager
def streaming(
    cam: Camera, payload: bytes | Sequence[bytes], rate_hz: float = 30, **frame: Any
) -> Iterator[None]:
    """Send the same frame, or these in turn, again and again in the background."""
    payloads = itertools.cycle([payload] if isinstance(payload, bytes) else payload)
    ended = threading.Event()

    def stream() -> None:
        due = time.monotonic()
        with contextlib.suppress(OSError):
            while not ended.is_set():
                cam.send(next(payloads), **frame)
                due = max(due + 1 / rate_hz, time.monotonic())
                ended.wait(max(0.0, due - time.monotonic()))

    thread = threading.Thread(target=stream)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
