"""Two hundred clients at 30 Hz, ten of which never read: the healthy ones miss nothing."""

import selectors
import socket
import time

from harness import LONG_S, Daemon, delimit, jpeg, split
from lightprobe_proto import lightprobe_pb2 as pb

CLIENTS, SILENT, ESTIMATES = 200, 10, 300


def connect(path):
    client = socket.socket(socket.AF_UNIX)
    client.connect(str(path))
    return client


class Crowd:
    """Healthy clients, read by one thread as fast as they are readable."""

    def __init__(self, path, count):
        self.selector = selectors.DefaultSelector()
        self.sequences = []
        self.rests = []
        for index in range(count):
            client = connect(path)
            client.setblocking(False)
            # A quarter each: the default, raw, small, everything with the lights in.
            kind = index % 4
            request = pb.FromClient(
                subscribe=pb.Subscription(
                    smoothing=pb.Subscription.RAW if kind == 1 else pb.Subscription.SMOOTHED,
                    sh_order=(2, 2, 1, 4)[kind],
                    kind=(1, 1, 1, 2)[kind],
                )
            )
            client.sendall(delimit(request.SerializeToString()))
            self.selector.register(client, selectors.EVENT_READ, index)
            self.sequences.append([])
            self.rests.append(b"")

    def read(self, until_count):
        """Read until every client has so many estimates."""
        end = time.monotonic() + LONG_S + ESTIMATES / 30
        while min(len(numbers) for numbers in self.sequences) < until_count:
            assert time.monotonic() < end, [len(numbers) for numbers in self.sequences]
            for key, _ in self.selector.select(1):
                index = key.data
                data = key.fileobj.recv(65536)
                assert data, "a healthy client was disconnected"
                messages, self.rests[index] = split(self.rests[index] + data)
                self.sequences[index] += [
                    m.estimate.sequence for m in messages if m.HasField("estimate")
                ]

    def close(self):
        for key in list(self.selector.get_map().values()):
            key.fileobj.close()
        self.selector.close()


def test_two_hundred_clients(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    daemon = Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30", variant="release")
    with daemon, daemon.client(health_period_ms=100, rate_hz=0.001) as watcher:
        silent = [connect(daemon.socket) for _ in range(SILENT)]
        crowd = Crowd(daemon.socket, CLIENTS - SILENT)
        crowd.read(ESTIMATES // 3)  # every pool has been out once by now
        before = watcher.until(lambda h: h.clients == CLIENTS + 1, "health")
        crowd.read(ESTIMATES)
        after = watcher.until(lambda h: h.estimates >= before.estimates + 100, "health")
        assert after.clients == CLIENTS + 1
        assert after.packets_superseded > 0  # the silent ones lost the old
        growth_kib = after.rss_kib - before.rss_kib
        print(
            f"crowd: {after.estimates_per_s:.1f} estimates/s to {CLIENTS} clients, "
            f"latency p50 {after.latency_p50_us} us p99 {after.latency_p99_us} us, "
            f"cpu {after.cpu_percent:.0f} %, rss {after.rss_kib} KiB ({growth_kib:+d})"
        )
        assert growth_kib < 512
        for numbers in crowd.sequences:
            # The last value comes at once, and again by the subscription: then no gap, no repeat.
            contiguous = numbers[2:]
            assert contiguous == list(range(contiguous[0], contiguous[0] + len(contiguous)))
        crowd.close()
        for client in silent:
            client.close()
