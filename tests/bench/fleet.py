"""Many probes, many listeners, one broker: latency of the newest estimate, and the broker's memory.

`python tests/bench/fleet.py` starts Mosquitto on this machine. Each simulated probe publishes one
recorded estimate again and again, retained, with the time of sending in it; each listener follows
one probe and decodes all that comes. Both speak MQTT themselves, in few lines: a thousand clients
of a library would measure the library. They share the processors with the broker.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import resource
import selectors
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from lightprobe_proto import lightprobe_pb2 as pb

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "e2e"))

from broker import Broker  # noqa: E402
from harness import split  # noqa: E402

CONNECT, CONNACK, PUBLISH, SUBSCRIBE = 0x10, 0x20, 0x30, 0x82
RETAIN = 1
RECORDED = ROOT / "proto" / "golden" / "estimate_full.bin"
SETTLE_S = 1.0  # not judged: connections, and first turns
LONGEST_S = 60.0


# ---------------------------------------------------------------- MQTT 3.1.1


def packet(kind: int, body: bytes) -> bytes:
    """Put kind and length before a body."""
    length, prefix = len(body), bytearray([kind])
    while length > 0x7F:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    return bytes(prefix) + body


def text(words: str) -> bytes:
    """Two bytes of length, and UTF-8."""
    data = words.encode()
    return len(data).to_bytes(2, "big") + data


def connect(port: int, name: str) -> socket.socket:
    """Open a connection that needs no pings; wait for the broker."""
    until_s = time.monotonic() + LONGEST_S
    while True:
        with contextlib.suppress(ConnectionError):
            return shake_hands(socket.create_connection(("127.0.0.1", port), LONGEST_S), name)
        assert time.monotonic() < until_s, "no broker"
        time.sleep(0.05)


def shake_hands(connection: socket.socket, name: str) -> socket.socket:
    """Say who it is; ConnectionError when the broker goes meanwhile."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(packet(CONNECT, text("MQTT") + b"\x04\x02\x00\x00" + text(name)))
    if connection.recv(4)[:1] != bytes([CONNACK]):
        raise ConnectionResetError
    return connection


def packets(buffer: bytearray) -> Iterator[tuple[int, bytes]]:
    """Take what is whole out of a buffer: kind, and body."""
    while True:
        length = shift = 0
        at = 1
        while True:
            if at >= len(buffer):
                return
            length |= (buffer[at] & 0x7F) << shift
            shift += 7
            at += 1
            if buffer[at - 1] < 0x80:
                break
        if len(buffer) < at + length:
            return
        yield buffer[0], bytes(buffer[at : at + length])
        del buffer[: at + length]


# ---------------------------------------------------------------- listeners


class Listeners:
    """In a process of their own: each follows one probe."""

    def __init__(self, port: int, count: int, probes: int) -> None:
        self._port, self._probes = port, probes
        self._selector = selectors.DefaultSelector()
        self._delays_ns: list[int] = []
        for number in range(count):
            self._join(number)

    def _join(self, number: int) -> None:
        connection = connect(self._port, f"listener-{number}")
        topic = text(f"fleet/{number % self._probes}/estimate") + b"\x00"
        connection.sendall(packet(SUBSCRIBE, b"\x00\x01" + topic))
        connection.setblocking(False)
        self._selector.register(connection, selectors.EVENT_READ, (number, bytearray()))

    def listen(self, end: Connection, begin_ns: int) -> None:
        """Until the other process says that it is over; then tell it what came since `begin_ns`."""
        while not end.poll():
            for key, _ in self._selector.select(0.1):
                self._read(key, begin_ns)
        end.send(self._delays_ns)

    def _read(self, key: selectors.SelectorKey, begin_ns: int) -> None:
        number, buffer = key.data
        data = b""
        with contextlib.suppress(ConnectionError):
            data = key.fileobj.recv(1 << 16)  # type: ignore[union-attr]
        if not data:  # the broker has gone
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
            self._join(number)
        buffer.extend(data)
        for kind, body in packets(buffer):
            if kind & 0xF0 == PUBLISH:
                self._take(kind, body, begin_ns)

    def _take(self, kind: int, body: bytes, begin_ns: int) -> None:
        payload = body[2 + int.from_bytes(body[:2], "big") :]
        sent_ns = pb.FromProbe.FromString(payload).estimate.capture_time_unix_ns
        if sent_ns >= begin_ns and not kind & RETAIN:
            self._delays_ns.append(time.time_ns() - sent_ns)


def listeners(end: Connection, port: int, count: int, probes: int) -> None:
    """Run a process."""
    crowd = Listeners(port, count, probes)
    end.send("ready")
    crowd.listen(end, end.recv())


# ---------------------------------------------------------------- probes


class Probes:
    """A recorded estimate, published by each of them at a rate, one after the other."""

    def __init__(self, port: int, count: int) -> None:
        (self._message,), _ = split(RECORDED.read_bytes())
        self.bytes = len(self._message.SerializeToString())
        self._port = port
        self._connections = [connect(port, f"probe-{number}") for number in range(count)]
        self.sent = 0  # judged

    def publish(self, rate_hz: float, seconds: float, begin_ns: int) -> None:
        """Evenly spread over the time; what is late is sent at once."""
        count = len(self._connections)
        start_s = time.monotonic()
        for turn in range(round(seconds * rate_hz * count)):
            wait_s = start_s + turn / (rate_hz * count) - time.monotonic()
            if wait_s > 0:
                time.sleep(wait_s)
            self._send(turn % count, turn // count, begin_ns)

    def _send(self, number: int, sequence: int, begin_ns: int) -> None:
        now_ns = time.time_ns()
        self._message.estimate.sequence = sequence
        self._message.estimate.capture_time_unix_ns = now_ns
        body = text(f"fleet/{number}/estimate") + self._message.SerializeToString()
        try:
            self._connections[number].sendall(packet(PUBLISH | RETAIN, body))
        except ConnectionError:  # the next one is newer
            self._connections[number] = connect(self._port, f"probe-{number}")
        self.sent += now_ns >= begin_ns


# ---------------------------------------------------------------- measuring


def cpu_s(pid: int) -> float:
    """Processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """All figures of one run."""
    with Broker(folder, "log_type error", "log_type information") as broker:
        assert broker.process is not None
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.Process(
            target=listeners,
            args=(theirs, broker.port, options.subscribers, options.probes),
            daemon=True,
        )
        process.start()
        assert ours.recv() == "ready"
        probes = Probes(broker.port, options.probes)
        begin_ns = time.time_ns() + round(1e9 * SETTLE_S)
        ours.send(begin_ns)
        probes.publish(options.rate, SETTLE_S, begin_ns)
        rss_kib, parts = broker.rss_kib(), 1 + options.restart
        for part in range(parts):
            if part:
                broker.kill()
                broker.start()
            before_s = cpu_s(broker.process.pid)
            probes.publish(options.rate, options.seconds / parts, begin_ns)
        load = (cpu_s(broker.process.pid) - before_s) * parts / options.seconds
        rss_end_kib = broker.rss_kib()
        time.sleep(0.5)  # what is on its way
        ours.send("over")
        delays_ms = sorted(delay / 1e6 for delay in ours.recv())
        process.join()
    each = options.subscribers / options.probes
    quantiles = statistics.quantiles(delays_ms, n=100) if len(delays_ms) > 1 else [0.0] * 99
    return {
        "probes": options.probes,
        "subscribers": options.subscribers,
        "rate_hz": options.rate,
        "seconds": options.seconds,
        "estimate_bytes": probes.bytes,
        "expected": round(probes.sent * each),
        "received": len(delays_ms),
        "p50_ms": quantiles[49],
        "p99_ms": quantiles[98],
        "max_ms": delays_ms[-1] if delays_ms else 0.0,
        "broker_cpu_percent": 100 * load,
        "broker_rss_mib": rss_kib / 1024,
        "broker_rss_end_mib": rss_end_kib / 1024,
        "processors": os.cpu_count(),
        "load_average": os.getloadavg()[0],  # of all programs of this machine
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probes", type=int, default=100, help="simulated probes (100)")
    parser.add_argument("--subscribers", type=int, default=1000, help="listeners (1000)")
    parser.add_argument("--rate", type=float, default=10.0, help="estimates a second of each (10)")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long it is judged (60)")
    parser.add_argument("--restart", action="store_true", help="the broker is killed half way")
    parser.add_argument("--json", action="store_true", help="the figures as JSON")
    options = parser.parse_args()
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # of the broker, too
    with tempfile.TemporaryDirectory(prefix="lp-") as folder:
        figures = measure(options, Path(folder))
    if options.json:
        print(json.dumps(figures, indent=2))
        return
    for name, value in figures.items():
        print(f"{name:20} {value:.2f}" if isinstance(value, float) else f"{name:20} {value}")


if __name__ == "__main__":
    main()
