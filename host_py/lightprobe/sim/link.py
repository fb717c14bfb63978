"""The simulator's end of the link to the daemon (proto/sim.md): a camera on a Unix socket."""

from __future__ import annotations

import heapq
import json
import math
import selectors
import socket
import struct
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.sim import orientation
from lightprobe.sim.auto_exposure import AutoExposure
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.clock import Clock, SystemClock
from lightprobe.sim.faults import Faults, spoil
from lightprobe.sim.motion import angles_deg
from lightprobe.sim.world import State

#: Orientation x y z w and its sigma, row time, and limits of exposure follow what was there first.
HEADER = struct.Struct("<4sIQ4sIIIQqffII4fff3f4f")
MAGIC = b"LPF1"
#: Instead of a header, to a daemon that comes while another one is served.
BUSY = b"BUSY".ljust(64, b"\0")
MARKED_CORRUPT = 1
_SEND_TIMEOUT_S = 2.0
_LISTEN_NS = 100_000_000  # how often it is looked whether to stop
_MOST_COMMAND_BYTES = 4096


class LinkError(LightprobeError):
    """The socket cannot be served."""


@dataclass
class Counters:
    """What has been sent since the start."""

    connections: int = 0
    frames: int = 0
    dropped: int = 0  # by fault, or because the daemon or this machine was too slow
    commands: int = 0


@dataclass
class Exposure:
    """The camera's exposure control: automatic until commanded, then as late as real ones."""

    camera: SimulatedCamera
    bracket: int = 1  # exposures that automatic mode cycles through
    fixed: Shot | None = None
    delay_frames: int = 0
    _pending: deque[tuple[int, Shot | None]] = field(default_factory=deque)

    def command(self, shot: Shot | None, next_frame: int, delay_frames: int) -> None:
        """Take a command that arrives before `next_frame` is exposed; None: automatic again.

        What is taken is within the camera's limits.
        """
        delay = self.delay_frames if delay_frames < 0 else delay_frames
        possible = shot and replace(shot, exposure_us=self.camera.limits.nearest(shot.exposure_us))
        self._pending.append((next_frame + delay, possible))

    def shot(self, frame: int) -> Shot:
        """Exposure of a frame."""
        while self._pending and self._pending[0][0] <= frame:
            self.fixed = self._pending.popleft()[1]
        if self.fixed is not None:
            return self.fixed
        return self.camera.automatic(frame, self.bracket)[frame % self.bracket]


class Surroundings(Protocol):
    """What else there is besides the camera: a polarizer before its lens, and a ring."""

    def wheel_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """Angles of the polarizer from `from_ns` to `to_ns` (CLOCK_MONOTONIC), both past.

        None: nobody knows any more.
        """

    def misbehave(self, query: str) -> str:
        """Take what is not the camera's out of a query string of faults, and do it."""

    def truth(self, state: State) -> dict[str, Any]:
        """What is true of them, for the account of a frame."""


class Link:
    """Serves frames to one daemon at a time, by a clock, until told to stop."""

    def __init__(
        self,
        path: Path,
        camera: SimulatedCamera,
        exposure: Exposure,
        faults: Faults | None = None,
        truth: TextIO | None = None,
        surroundings: Surroundings | None = None,
        say: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True),
        clock: Clock | None = None,
    ) -> None:
        """`truth` gets one JSON line per frame; `say` gets log lines. Without `surroundings`
        there is no polarizer; without `clock` it is the system's."""
        self.path, self.camera, self.exposure = path, camera, exposure
        self.automatic = AutoExposure(camera)
        self.faults = faults or Faults()
        self.counters = Counters()
        self.surroundings = surroundings
        self._session: _Session | None = None
        self._truth, self._say = truth, say
        self._stop = threading.Event()
        self.clock = clock or SystemClock()
        self._start_ns = self.clock.now_ns()
        self._listener: socket.socket | None = None

    def stop(self) -> None:
        """End :meth:`serve` soon; from any thread."""
        self._stop.set()

    def serve(self, seconds: float | None = None) -> None:
        """Listen and serve until :meth:`stop`, or for some seconds."""
        self.listen()
        try:
            self.run_until(math.inf if seconds is None else self.clock.now_ns() + 1e9 * seconds)
        finally:
            self.close()

    def run_until(self, end_ns: float) -> None:
        """Serve until a time of the clock, or until :meth:`stop`."""
        while not self._stop.is_set() and self.clock.now_ns() < end_ns:
            if self._session is not None:
                self._serve(self._session, end_ns)
            else:
                self._accept(round(min(end_ns, self.clock.now_ns() + _LISTEN_NS)))

    def due_ns(self) -> int:
        """Give the time of the clock at which there is something to do next."""
        if self._session is None:
            return self.clock.now_ns() + _LISTEN_NS
        return self._session.due_ns()

    def work(self) -> None:
        """Do what is due now, beside another link that lets time go on."""
        now_ns = self.clock.now_ns()
        if self._session is None:
            self._accept(now_ns)
        session = self._session
        if session is not None:
            self._serve(session, now_ns)

    def _accept(self, until_ns: int) -> None:
        """Wait for a daemon until a time of the clock; nobody comes to an unplugged camera."""
        with selectors.DefaultSelector() as selector:
            if self._listener is not None:
                selector.register(self._listener, selectors.EVENT_READ)
            if self.clock.wait_until(until_ns, selector) and self._listener is not None:
                connection, _ = self._listener.accept()
                self.counters.connections += 1
                self._session = _Session(self, connection, self._listener)

    def close(self) -> None:
        """Unplug the camera; :meth:`listen` brings it back."""
        self._end_session()
        if self._listener is not None:
            self._listener.close()
            self._listener = None
            self.path.unlink(missing_ok=True)

    def listen(self) -> None:
        """Begin to wait for a daemon."""
        listener = socket.socket(socket.AF_UNIX)
        try:
            if self.path.is_socket() and not _alive(self.path):
                self.path.unlink()  # left over from a simulator that was killed
            listener.bind(str(self.path))
        except OSError as error:
            listener.close()
            next_step = "is another simulator running?" if error.errno == 98 else "choose --socket"
            raise LinkError(f"simulate: {self.path}: bind: {error.strerror}: {next_step}") from None
        listener.listen(1)
        self._listener = listener

    def _end_session(self) -> None:
        if self._session is not None:
            self._session.connection.close()
            self._session = None

    def _serve(self, session: _Session, end_ns: float) -> None:
        """One daemon, until `end_ns`, or until it leaves or a fault unplugs the camera."""
        try:
            while not self._stop.is_set() and session.due_ns() <= end_ns:
                if not session.step():
                    self._end_session()
                    return
            if not self._stop.is_set() and not session.wait_until(round(end_ns)):
                self._end_session()
        except (OSError, TimeoutError) as error:
            self._say(f"simulate: daemon: {error}: waiting for the next")
            self._end_session()

    def misbehave(self, query: str) -> None:
        """Change the faults from now on, from any thread; UsageError for unknown ones."""
        rest = self.surroundings.misbehave(query) if self.surroundings else query
        self.faults = self.faults.merged(rest)
        session = self._session
        if session is not None:
            session.faults = session.faults.merged(rest)

    def state_now(self) -> State:
        """Give the world as it is now; flicker at its mean. From any thread."""
        elapsed_s = (self.clock.now_ns() - self._start_ns) / 1e9
        flicker = self.camera.world.behaviour.flicker
        return self.camera.world.at(elapsed_s, 1 / flicker.hz if flicker.is_on else 0)

    # The parts of a frame's life that a session needs.

    def frame_now(self) -> int:
        """Give the number of the frame whose exposure started last."""
        elapsed_s = (self.clock.now_ns() - self._start_ns) / 1e9
        return math.floor((elapsed_s - self.camera.phase_s) * self.camera.rate_hz)

    def begin_ns(self, frame: int) -> int:
        """CLOCK_MONOTONIC when a frame's exposure is chosen and may begin."""
        return self._start_ns + round(1e9 * self.camera.begin_s(frame))

    def start_ns(self, frame: int, shot: Shot) -> int:
        """CLOCK_MONOTONIC at the start of the exposure of a frame's first row."""
        return self._start_ns + round(1e9 * self.camera.start_s(frame, shot))

    def read_ns(self, frame: int) -> int:
        """CLOCK_MONOTONIC when a frame's first row has been exposed and is read."""
        return self._start_ns + round(1e9 * self.camera.read_s(frame))

    def stamp_ns(self, frame: int, shot: Shot, faults: Faults) -> int:
        """What the camera's clock says of the start of a frame's exposure.

        Where it hides its exposure: of the end.
        """
        read_ns = self.read_ns(frame)
        before_ns = 0 if faults.hide_exposure else read_ns - self.start_ns(frame, shot)
        return faults.stamp_ns(read_ns, self._start_ns) - before_ns

    def log_truth(self, frame: int, shot: Shot, wheel_deg: tuple[float, ...]) -> None:
        """Write what is true during a frame."""
        if self._truth is None:
            return
        state = self.camera.state(frame, shot)
        line = account(self.camera, frame, shot, self.start_ns(frame, shot))
        if self.surroundings is not None:
            line |= {
                "wheel_deg": sum(wheel_deg) / len(wheel_deg),
                "polarizer_gain": self.camera.gain,
            }
            line |= self.surroundings.truth(state)
        self._truth.write(json.dumps(line) + "\n")
        self._truth.flush()

    def say(self, text: str) -> None:
        """Log a line."""
        self._say(text)


@dataclass(order=True)
class _Ready:
    """A frame on its way to the daemon: exposed, then developed, then delivered."""

    due_ns: int
    number: int
    shot: Shot = field(compare=False)
    deliver_ns: int = field(compare=False)
    payload: bytes | None = field(compare=False, default=None)
    developed: bool = field(compare=False, default=False)


class _Session:
    """One connection: commands in, frames out."""

    def __init__(self, link: Link, connection: socket.socket, listener: socket.socket) -> None:
        connection.settimeout(_SEND_TIMEOUT_S)
        self.link, self.connection, self.faults = link, connection, link.faults
        self.frames = 0  # sent on this connection
        self.next = link.frame_now() + 1  # to be exposed
        self.stalled_ns: int | None = None  # since when the camera is silent
        self._ready: list[_Ready] = []  # a heap
        self._text = b""
        self._selector = selectors.DefaultSelector()
        self._listener = listener
        for one in (connection, listener):
            self._selector.register(one, selectors.EVENT_READ)

    def due_ns(self) -> int:
        """Give the time of the next step."""
        begin_ns = self.link.begin_ns(self.next)
        return min(begin_ns, self._ready[0].due_ns) if self._ready else begin_ns

    def step(self) -> bool:
        """Expose or deliver one frame, whichever is due first; False ends the connection."""
        begin_ns = self.link.begin_ns(self.next)
        if self._ready and self._ready[0].due_ns <= begin_ns:
            if not self.wait_until(self._ready[0].due_ns):
                return False
            ready = heapq.heappop(self._ready)
            if ready.developed and ready.payload is not None:
                return self._send(ready, ready.payload)
            self._develop(ready)
            return True
        if not self.wait_until(begin_ns):
            return False
        self._expose()
        return True

    def _rng(self, frame: int, purpose: int) -> np.random.Generator:
        """Chance that repeats: by seed, frame and what it is for."""
        return np.random.default_rng([self.link.camera.sensor.seed, frame, purpose])

    def _expose(self) -> None:
        """Take the next frame; those that this machine was too slow for are lost."""
        link, f = self.link, self.faults
        frame = max(self.next, link.frame_now())
        link.counters.dropped += frame - self.next
        self.next = frame + 1
        rng = self._rng(frame, 0)
        if self._stalled():
            return
        if rng.random() < f.drop:
            link.counters.dropped += 1
            return
        shot = (link.automatic if f.auto_exposure else link.exposure).shot(frame)
        if f.auto_exposure and f.breathe_stops:
            swing = math.sin(2 * math.pi * link.camera.begin_s(frame) / f.breathe_s)
            breathed_us = shot.exposure_us * 2 ** (f.breathe_stops * swing)
            shot = replace(shot, exposure_us=link.camera.limits.nearest(breathed_us))
        late_ms = f.late_ms + f.jitter_ms * rng.random()
        read_out_us = link.camera.row_time_us * link.camera.size_px[1]
        end_ns = link.read_ns(frame) + round(1e3 * read_out_us)
        ready = _Ready(end_ns, frame, shot, end_ns + round(1e6 * late_ms))
        if link.surroundings is None or not link.camera.sees_wheel(link.camera.state(frame, shot)):
            ready.payload = link.camera.frame(frame, shot)
        # Else its picture must wait until the wheel's way during the exposure is known.
        heapq.heappush(self._ready, ready)

    def _develop(self, ready: _Ready) -> None:
        """Finish a frame whose exposure has ended, and put it on its way."""
        link, frame, shot = self.link, ready.number, ready.shot
        wheel_deg: tuple[float, ...] | None = (0.0,)
        if link.surroundings is not None:
            start_ns = link.start_ns(frame, shot)
            wheel_deg = link.surroundings.wheel_deg(start_ns, ready.due_ns)
        if wheel_deg is None:
            link.counters.dropped += 1
            return
        if ready.payload is None:
            ready.payload = link.camera.frame(frame, shot, wheel_deg)
        link.log_truth(frame, shot, wheel_deg)
        ready.due_ns, ready.developed = ready.deliver_ns, True
        heapq.heappush(self._ready, ready)

    def _stalled(self) -> bool:
        f = self.faults
        if not f.stall_after or self.frames < f.stall_after:
            return False
        now_ns = self.link.clock.now_ns()
        if self.stalled_ns is None:
            self.stalled_ns = now_ns
        if f.stall_s and now_ns - self.stalled_ns > 1e9 * f.stall_s:
            self.stalled_ns, self.frames = None, 0
            return False
        return True

    def _send(self, ready: _Ready, payload: bytes) -> bool:
        f, camera, rng = self.faults, self.link.camera, self._rng(ready.number, 1)
        payload = spoil(payload, f, rng)
        width, height = camera.size_px
        if rng.random() < f.wrong_size:
            width, height = width // 2, height // 2
        header = HEADER.pack(
            MAGIC, HEADER.size, len(payload), camera.pixel_format.encode(), width, height, 0,
            ready.number,
            self.link.stamp_ns(ready.number, ready.shot, f),
            math.nan if f.hide_exposure else ready.shot.exposure_us,
            math.nan if f.hide_exposure else ready.shot.gain,
            MARKED_CORRUPT if rng.random() < f.marked else 0, 0,
            *orientation.reading(camera, ready.number, ready.shot, f),
            camera.row_time_us,
            *self._limits_us(),
            *orientation.place(camera, ready.number, ready.shot, f),
        )  # fmt: skip
        self.frames += 1
        if f.cut_after and self.frames >= f.cut_after:
            self.connection.sendall(header + payload[: len(payload) // 2])
            return False
        self.connection.sendall(header)
        self.connection.sendall(payload)
        self.link.counters.frames += 1
        return not (f.disconnect_after and self.frames >= f.disconnect_after)

    def _limits_us(self) -> tuple[float, float, float]:
        """Shortest and longest exposure that can be commanded, and the step; 0: none can be."""
        if self.faults.auto_exposure and not self.faults.ignore_exposure:
            return 0.0, 0.0, 0.0
        limits = self.link.camera.limits
        return limits.least_us, limits.most_us, limits.step_us

    def wait_until(self, t_ns: int) -> bool:
        """Wait, taking commands meanwhile; False when the daemon has left."""
        clock = self.link.clock
        while True:
            is_due = clock.now_ns() >= t_ns
            if (came := clock.wait_until(t_ns, self._selector)) and not self._attend():
                return False
            if is_due or (not came and clock.now_ns() >= t_ns):
                return True

    def _attend(self) -> bool:
        """Do what has come; False when the daemon has left."""
        ready = [key.fileobj for key, _ in self._selector.select(0)]
        if self.connection in ready:  # first: it may be that this daemon has left
            return self._take_commands()
        if self._listener in ready:
            self._turn_away()
        return True

    def _turn_away(self) -> None:
        """Tell another daemon that there is one already."""
        another, _ = self._listener.accept()
        with another, suppress(OSError):  # it may be another simulator that only looked
            another.setblocking(False)
            another.sendall(BUSY)

    def _take_commands(self) -> bool:
        data = self.connection.recv(4096)
        if not data:
            return False
        *lines, self._text = (self._text + data).split(b"\n")
        if len(self._text) > _MOST_COMMAND_BYTES:
            raise OSError("a command without end")
        for line in lines:
            self._obey(line.decode(errors="replace").strip())
        return True

    def _obey(self, line: str) -> None:
        """Carry out one command; what is not understood is told and left."""
        self.link.counters.commands += 1
        word, _, rest = line.partition(" ")
        try:
            if word == "hello":
                around = self.link.surroundings
                self.faults = self.link.faults.merged(around.misbehave(rest) if around else rest)
            elif word == "exposure":
                exposure_us, gain = (float(value) for value in rest.split())
                if not (exposure_us > 0 and gain > 0):
                    raise ValueError(line)
                if not (self.faults.ignore_exposure or self.faults.auto_exposure):
                    shot = Shot(exposure_us, gain)
                    self.link.exposure.command(shot, self.next, self.faults.delay_frames)
            else:
                raise ValueError(line)
        except ValueError:
            self.link.say(f"simulate: command not understood: {line!r}")
        except UsageError as error:
            self.link.say(f"simulate: hello: {error}")


def account(camera: SimulatedCamera, frame: int, shot: Shot, start_ns: int) -> dict[str, Any]:
    """Give what is true during a frame, as a line of `simulate --truth` has it."""
    state = camera.state(frame, shot)
    w, x, y, z = rotation = camera.true_rotation(state).tolist()
    yaw_deg, nod_deg, roll_deg = angles_deg(rotation)
    return {
        "sequence": frame,
        "t_start_ns": start_ns,
        "t_s": state.t_s,
        "exposure_us": shot.exposure_us,
        "gain": shot.gain,
        "scene": state.scene.name,
        "act": state.act,
        "yaw_deg": yaw_deg % 360,
        "nod_deg": nod_deg,
        "roll_deg": roll_deg,
        "rotation_xyzw": [x, y, z, w],
        "powers": state.powers.tolist(),
        "place_m": state.place_m,
        "is_covered": state.is_covered,
    }


def _alive(path: Path) -> bool:
    """Say whether somebody listens on a socket."""
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True
