"""The whole daemon under a 30 Hz camera and many subscribers: latency, processor, memory, bytes."""

from __future__ import annotations

import itertools
import mmap
import os
import selectors
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from frames import Kind
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim.clock import SimulatedClock
from lightprobe.sim.live import LiveClient
from lightprobe.wire import Subscription
from lightprobe_proto import lightprobe_pb2 as pb
from websockets.client import ClientProtocol
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "e2e"))

from harness import Camera, Client, Daemon, camera, streaming  # noqa: E402

RATE_HZ = 30
COUNTER = ROOT / "build" / "release" / "bench" / "count_allocations.so"


@dataclass(frozen=True)
class Load:
    """What is sent to the daemon, and for how long."""

    kind: Kind
    files: Sequence[Path]
    seconds: float  # longer than the daemon's own window of figures (10 s), to be meaningful


def _tcp(port: int) -> socket.socket:
    """A subscriber at tcp:."""
    client = Client(("127.0.0.1", port))
    client.subscribe()
    return client.socket


def _web(port: int) -> socket.socket:
    """A subscriber at ws:, as a browser is one."""
    protocol = ClientProtocol(
        parse_uri(f"ws://127.0.0.1:{port}/"), subprotocols=[Subprotocol("lightprobe.v1")]
    )
    connection = socket.create_connection(("127.0.0.1", port))
    protocol.send_request(protocol.connect())
    connection.sendall(b"".join(protocol.data_to_send()))
    while protocol.state is not State.OPEN:
        protocol.receive_data(connection.recv(1 << 16))
        if protocol.handshake_exc is not None:
            raise protocol.handshake_exc
    request = pb.FromClient(subscribe=pb.Subscription())
    request.subscribe.SetInParent()
    protocol.send_binary(request.SerializeToString())
    connection.sendall(b"".join(protocol.data_to_send()))
    return connection


class Readers:
    """Subscribers that read as fast as they can, in one thread."""

    def __init__(self, subscribers: Sequence[socket.socket]) -> None:
        self._selector = selectors.DefaultSelector()
        self._ended = threading.Event()
        self._bytes = [0]
        for one in subscribers:
            one.setblocking(False)
            self._selector.register(one, selectors.EVENT_READ, one)
        self._thread = threading.Thread(target=self._read)

    def __enter__(self) -> Readers:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        for key in list(self._selector.get_map().values()):
            key.data.close()

    @property
    def bytes_read(self) -> int:
        """Of all subscribers together."""
        return self._bytes[0]

    def _read(self) -> None:
        while not self._ended.is_set():
            for key, _ in self._selector.select(0.1):
                data = key.data.recv(1 << 16)
                assert data, "a subscriber was disconnected"
                self._bytes[0] += len(data)


@contextmanager
def _running(load: Load, ports: dict[str, int]) -> Iterator[Daemon]:
    """The daemon with a camera that streams to it; exposure is left alone: one estimate a frame."""
    with camera() as cam:
        options = [f"--source=sim:{cam.path}", f"--camera={load.kind.camera}", "--brackets=0"]
        options += ["--max-clients=512"]
        options += [f"--publish={s}:127.0.0.1:{port}?per_peer=512" for s, port in ports.items()]
        with Daemon(*options, variant="release") as daemon:
            cam.accept()
            pictures = [path.read_bytes() for path in load.files]
            size = {"width": load.kind.width_px, "height": load.kind.height_px}
            with streaming(cam, pictures, RATE_HZ, **size, exposure_us=10000.0):
                yield daemon


@contextmanager
def simulated(
    load: Load, on_advance: Callable[[], None], *more: str, **popen: Any
) -> Iterator[tuple[Daemon, Camera, SimulatedClock]]:
    """The daemon in simulated time, with a camera and a clock in the caller's hand."""
    with camera() as cam, tempfile.TemporaryDirectory(prefix="lp-") as folder:
        path = Path(folder) / "time"
        clock = SimulatedClock(path, on_advance)
        options = [f"--source=sim:{cam.path}", f"--camera={load.kind.camera}", "--brackets=0"]
        options += [f"--simulated-time={path}", *more]
        with Daemon(*options, variant="release", **popen) as daemon:
            clock.advance(clock.now_ns())  # it connects to the camera
            cam.accept()
            try:
                yield daemon, cam, clock
            finally:
                clock.close()


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _peak_rss_kib(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0])


def crowd(load: Load, tcp: int, web: int) -> dict[str, float]:
    """Figures of the daemon's own health report, and of the operating system, over some seconds.

    `tcp` subscribers are at tcp:, `web` ones at ws:.
    """
    ports, subscribers = {"tcp": _free_port(), "ws": _free_port()}, tcp + web
    with _running(load, ports) as daemon, ExitStack() as stack:
        sockets = [_tcp(ports["tcp"]) for _ in range(tcp)]
        sockets += [_web(ports["ws"]) for _ in range(web)]
        readers = stack.enter_context(Readers(sockets))
        watcher = stack.enter_context(Client(("127.0.0.1", ports["tcp"])))
        watcher.subscribe(rate_hz=0.001, health_period_ms=1000)
        watcher.until(lambda h: h.estimates >= RATE_HZ, "health")
        assert daemon.process is not None
        pid = daemon.process.pid
        first = watcher.next("health")
        begin_s, cpu_s, data = time.monotonic(), _cpu_s(pid), readers.bytes_read
        end_s = begin_s + load.seconds
        last = watcher.until(lambda h: time.monotonic() >= end_s, "health")
        elapsed_s = time.monotonic() - begin_s
        packets = subscribers * (last.estimates - first.estimates)
        return {
            "latency_p50_ms": last.latency_p50_us / 1e3,
            "latency_p99_ms": last.latency_p99_us / 1e3,
            "cpu_percent": 100 * (_cpu_s(pid) - cpu_s) / elapsed_s,
            "peak_rss_mib": _peak_rss_kib(pid) / 1024,
            "bytes_per_packet": (readers.bytes_read - data) / max(packets, 1),
            "estimates_per_s": (last.estimates - first.estimates) / elapsed_s,
        }


def allocations_per_frame(load: Load, folder: Path) -> float:
    """Calls that allocate, in the whole daemon, per estimate with ten subscribers.

    Two of them get reflection maps, too.

    In simulated time: each frame is an estimate, sent to all, before the next one comes. Nobody
    asks for health reports, which read files of the operating system.
    """
    path = folder / "allocations"
    path.write_bytes(bytes(8))
    environment = {"LD_PRELOAD": str(COUNTER), "LP_ALLOCATIONS": str(path)}
    clients: list[LiveClient] = []

    def read() -> None:
        for client in clients:
            client.read(0)

    with (
        open(path, "r+b") as file,
        mmap.mmap(file.fileno(), 8) as counter,
        simulated(load, read, "--reflection-map=32", env=environment) as (daemon, cam, clock),
    ):
        for size, kind in [(0, "TOTAL")] * 8 + [(16, "TOTAL"), (32, "AMBIENT")]:
            wish = Subscription(
                health_period_ms=0, reflection_map_size=size, reflection_map_rate_hz=30,
                reflection_map_kind=kind,
            )  # fmt: skip
            clients.append(LiveClient(daemon.socket, wish))
        pictures = itertools.cycle([path.read_bytes() for path in load.files])
        size = {"width": load.kind.width_px, "height": load.kind.height_px}

        def send(count: int) -> None:
            for _ in range(count):
                now_ns = clock.now_ns()
                cam.send(next(pictures), **size, exposure_us=10000.0, t_start_ns=now_ns)
                clock.advance(now_ns + 1_000_000_000 // RATE_HZ)

        send(3 * len(load.files) + RATE_HZ)
        before, seen = int.from_bytes(counter[:8], "little"), len(clients[0].estimates)
        assert before > 0, "the counter counts nothing: is LD_PRELOAD allowed?"
        send(3 * RATE_HZ)
        count = int.from_bytes(counter[:8], "little") - before
        assert len(clients[0].estimates) == seen + 3 * RATE_HZ
        assert any(isinstance(one.message, ReflectionMap) for one in clients[-1].received)
        for client in clients:
            client.close()
        return count / (3 * RATE_HZ)
