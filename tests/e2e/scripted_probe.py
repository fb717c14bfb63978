"""A probe that a test scripts: what it says on each connection, and what it is asked."""

import contextlib
import socket
import threading
import time

import numpy as np
from lightprobe import wire
from lightprobe_proto import lightprobe_pb2 as pb

LONG_S = 30
_SH = pb.SphericalHarmonics(kind=1, order=0, coefficients=[1, 1, 1])


def hello(major=1, minor=0):
    """A greeting; by default of a daemon that knows no subscription numbers."""
    greeting = pb.Hello(
        protocol_major=major, protocol_minor=minor, software="lightprobed 0.0 scripted"
    )
    return wire.delimit(pb.FromProbe(hello=greeting).SerializeToString())


def estimate(number, ttl_ms=60000, clock_off_s=0.0, old_s=0.0, subscription=0):
    sh = pb.SphericalHarmonics(kind=1, order=0, coefficients=[1, 1, 1])
    capture_ns = time.time_ns() + round(1e9 * (clock_off_s - old_s))
    message = pb.Estimate(sequence=number, sh=sh, ttl_ms=ttl_ms, capture_time_unix_ns=capture_ns,
                          send_delay_us=round(1e6 * old_s), subscription=subscription)  # fmt: skip
    return wire.delimit(pb.FromProbe(estimate=message).SerializeToString())


def health(state=2):
    message = pb.FromProbe(health=pb.Health(source_state=state))
    return wire.delimit(message.SerializeToString())


class Probe:
    """A server that runs one script per connection, the last one again and again."""

    def __init__(self, *scripts):
        self.scripts, self.requests, self.connections = list(scripts), [], 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(0.05)
        self.uri = f"tcp:127.0.0.1:{self.listener.getsockname()[1]}"
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.thread.join()
        self.listener.close()

    def run(self):
        while not self.ended.is_set():
            with contextlib.suppress(TimeoutError, OSError):
                connection, _ = self.listener.accept()
                script = self.scripts[min(self.connections, len(self.scripts) - 1)]
                self.connections += 1
                with connection:
                    connection.settimeout(LONG_S)
                    script(self, connection)

    def hold(self, connection):
        """Keep it open until the client leaves or the test ends; note what the client asks."""
        connection.settimeout(0.05)
        while not self.ended.is_set():
            with contextlib.suppress(TimeoutError):
                data = connection.recv(4096)
                if not data:
                    return
                self.requests.append(data)


def serve(*messages, hold=True):
    """Script: send these, then hold the connection or close it."""

    def script(probe, connection):
        for message in messages:
            connection.sendall(message() if callable(message) else message)
        if hold:
            probe.hold(connection)

    return script


def polarized(*, refuse=None, sweeps=0, minor=5):
    """Script: answer requests for maps and sweeps, or refuse them with a text."""
    cells = np.array([[[2, 0.3, -0.4, 0.01], [np.nan] * 4]], "<f2")
    grid = pb.PolarizationMap(width=2, height=1, s0_unit=0.5, cells=cells.tobytes(), sweeps=sweeps)

    def answers(request):
        kind = request.WhichOneof("message")
        if kind == "subscribe":
            return [pb.FromProbe(estimate=pb.Estimate(subscription=1, sh=_SH))]
        if kind == "ping":
            return []
        if refuse:
            return [pb.FromProbe(error=pb.Error(code=-1, text=refuse))]
        if kind == "get_polarization_map":
            return [pb.FromProbe(polarization_map=grid)]
        if kind == "take_stills":
            return [pb.FromProbe(stills_asked=pb.StillsAsked(cameras=1))]
        done = pb.Health(wheel=pb.Wheel(phase=3, sweeps=sweeps))
        started = pb.SweepStarted(done_at=sweeps)
        return [pb.FromProbe(sweep_started=started), pb.FromProbe(health=done)]

    def script(probe, connection):
        connection.sendall(hello(minor=minor))
        connection.settimeout(0.05)
        data = b""
        while not probe.ended.is_set():
            with contextlib.suppress(TimeoutError):
                got = connection.recv(4096)
                if not got:
                    return
                data += got
            while data and len(data) > data[0]:  # requests are short
                request, data = pb.FromClient.FromString(data[1 : 1 + data[0]]), data[1 + data[0] :]
                for answer in answers(request):
                    connection.sendall(wire.delimit(answer.SerializeToString()))

    return script
