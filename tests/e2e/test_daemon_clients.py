"""Clients with and without manners: each gets what it asked for, none can harm the others."""

import contextlib
import re
import socket
import struct
import time

import pytest
from harness import LONG_S, MORE_LIGHTS, Client, Daemon, camera, delimit, jpeg, split, streaming
from lightprobe_proto import lightprobe_pb2 as pb

GOOD = jpeg()
SH = pb.SphericalHarmonics


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    """One daemon for all of them: whatever one test does to it, the next must not notice."""
    picture = tmp_path_factory.mktemp("picture") / "a.jpg"
    picture.write_bytes(GOOD)
    with Daemon(f"--source=file:{picture}?rate=30") as daemon:
        yield daemon
        assert daemon.alive()


def test_hello_comes_first_then_the_last_value_at_once(probe):
    with probe.client() as client:
        hello = client.next()
        assert hello.software.startswith("lightprobed ")
        assert (hello.protocol_major, hello.source) == (1, "file")
        assert (hello.max_sh_order, hello.max_lights) == (4, 8)
        first = client.next()
        assert first.sh.order == 2
        assert first.sh.kind == SH.AMBIENT
        assert first.boot_id == hello.boot_id
        assert abs(first.capture_time_unix_ns / 1e9 - time.time()) < LONG_S


def test_each_client_has_its_own_subscription(probe):
    with (
        probe.client(sh_order=0, max_lights=0, kind=SH.TOTAL) as small,
        probe.client(sh_order=4, max_lights=8, smoothing=pb.Subscription.RAW) as large,
    ):
        estimate = small.until(lambda e: e.sh.order == 0)
        assert len(estimate.sh.coefficients) == 3
        assert estimate.sh.kind == SH.TOTAL
        assert estimate.flags & MORE_LIGHTS
        estimate = large.until(lambda e: e.sh.order == 4)
        assert len(estimate.sh.coefficients) == 75
        assert len(estimate.lights) >= 1
        small.subscribe(sh_order=1)  # the newest subscription holds, absent means default
        estimate = small.until(lambda e: e.sh.order == 1)
        assert estimate.sh.kind == SH.AMBIENT
        assert len(estimate.lights) >= 1


def test_sequence_has_no_gaps(probe):
    with probe.client() as client:
        numbers = [client.next("estimate").sequence for _ in range(60)]
    assert numbers == list(range(numbers[0], numbers[0] + 60))


def test_rate_is_limited(probe):
    with probe.client(rate_hz=5) as client:
        client.next("estimate")  # the default's last value may come before the subscription's
        client.next("estimate")
        begin = time.monotonic()
        for _ in range(10):
            client.next("estimate")
        assert time.monotonic() - begin > 10 / 5 * 0.7


def test_tolerance_chooses_the_model(probe):
    with probe.client(sh_order=4, max_lights=8, tolerance_permille=900) as client:
        estimate = client.until(lambda e: e.sh.order < 4)
        assert estimate.predicted_error_permille <= 900


def test_health_on_request(probe):
    with probe.client(health_period_ms=100) as client:
        health = client.next("health")
        assert health.clients >= 1
        assert health.latency_p50_us > 0
        assert health.latency_p99_us >= health.latency_p50_us
        assert health.preset == "balanced"
        later = client.until(lambda h: h.estimates_per_s > 0, "health")
        assert later.uptime_ms > 0
        assert later.packets_sent > health.packets_sent


@pytest.mark.parametrize(
    ("request_bytes", "code", "text"),
    [
        (delimit(b"\xff\xff\xff"), -74, "is no lightprobe.v1.FromClient message"),
        (delimit(bytes(257)), -90, "longer than a request may be"),
        (b"\xff\xff\xff\xff\xff", -90, "does not begin with its length"),
        (delimit(b"\x0a\x7f"), -74, "is no lightprobe.v1.FromClient message"),
        (b"GET / HTTP/1.1\r\nHost: probe\r\n" + b"Accept: */*\r\n" * 9, -74, "is no lightprobe.v1"),
    ],
)
def test_what_makes_no_sense_is_answered_and_ended(probe, request_bytes, code, text):
    with probe.client() as client:
        client.next("estimate")
        client.socket.sendall(request_bytes)
        error = client.next("error")
        assert (error.code, text in error.text) == (code, True)
        client.wait_closed()


def test_an_impossible_rate_is_answered_and_ended(probe):
    with probe.client(rate_hz=-1) as client:
        error = client.next("error")
        assert "rate_hz: must be 0 or a positive number" in error.text
        client.wait_closed()


def test_a_request_of_the_future_is_answered_and_forgiven(probe):
    with probe.client() as client:
        client.socket.sendall(delimit(b"\x7a\x02hi"))
        assert "is not known to this version" in client.next("error").text
        client.subscribe(sh_order=3)
        client.until(lambda e: e.sh.order == 3)


def test_requests_in_pieces_and_in_one_piece(probe):
    request = pb.FromClient(subscribe=pb.Subscription(sh_order=3)).SerializeToString()
    with probe.client() as client:
        for byte in delimit(request):
            client.socket.sendall(bytes([byte]))
            time.sleep(0.002)
        client.until(lambda e: e.sh.order == 3)
        last = pb.FromClient(subscribe=pb.Subscription(sh_order=1)).SerializeToString()
        client.socket.sendall(delimit(request) * 40 + delimit(last))
        client.until(lambda e: e.sh.order == 1)


def test_killed_in_the_middle_of_a_message(probe):
    for cut in range(1, 6):
        client = probe.client()
        request = pb.FromClient(subscribe=pb.Subscription(rate_hz=1)).SerializeToString()
        client.socket.sendall(delimit(request)[:cut])
        # An abortive close, as when the process is killed with data in flight.
        with contextlib.suppress(OSError):
            linger = struct.pack("ii", 1, 0)
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        client.socket.close()
    with probe.client() as client:
        client.next("estimate")


def test_half_open_connections_do_no_harm(tmp_path):
    """Over TCP: peers that vanish without a word, seen from the daemon as silence."""
    (tmp_path / "a.jpg").write_bytes(GOOD)
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30", "--publish=tcp:127.0.0.1:0") as daemon:
        port = int(daemon.log().split("127.0.0.1 port ")[1].split()[0])
        silent = [Client(("127.0.0.1", port)) for _ in range(5)]
        for client in silent:
            client.socket.shutdown(socket.SHUT_RD)  # takes nothing, says nothing
        with Client(("127.0.0.1", port)) as client:
            client.subscribe(health_period_ms=100)
            numbers = [client.next("estimate").sequence for _ in range(60)]
            assert numbers[5:] == list(range(numbers[5], numbers[5] + 55))
        for client in silent:
            client.socket.close()
        with Client(("127.0.0.1", port)) as client:
            client.subscribe(health_period_ms=100)
            client.until(lambda h: h.clients == 1, "health")


def test_a_slow_reader_gets_the_newest(probe):
    with probe.client() as slow, probe.client(health_period_ms=100) as client:
        before = client.next("health").packets_superseded
        client.until(lambda h: h.packets_superseded > before + 10, "health")
        newest = client.next("estimate").sequence
        slow.until(lambda e: e.sequence >= newest)
        # What it got in between are whole messages, or parsing would have failed.


def test_one_client_too_many_is_refused_with_a_reason(tmp_path):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    with Daemon(f"--source=file:{tmp_path}/a.jpg", "--max-clients=3") as daemon:
        clients = [daemon.client() for _ in range(3)]
        for client in clients:
            client.next("hello")
        with daemon.client() as refused:
            error = refused.next()
            assert "3 clients are connected — raise --max-clients" in error.text
            with pytest.raises(EOFError):
                refused.next()
        clients.pop().socket.close()

        def admitted():
            with daemon.client() as client:
                return client.messages or client.next().DESCRIPTOR.name == "Hello"

        assert any(admitted() or time.sleep(0.05) for _ in range(100))
        for client in clients:
            client.socket.close()


def test_the_network_does_not_lock_local_clients_out(tmp_path):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    options = ["--publish=tcp:127.0.0.1:0?per_peer=4096", "--max-clients=16"]
    with Daemon(f"--source=file:{tmp_path}/a.jpg", *options, f"--publish=unix:{tmp_path}/s") as d:
        port = int(d.log().split("127.0.0.1 port ")[1].split()[0])
        crowd = [Client(("127.0.0.1", port)) for _ in range(20)]
        assert [client.next().DESCRIPTOR.name for client in crowd[:14]] == ["Hello"] * 14
        refused = crowd[14].next("error")
        assert "14 clients are connected — raise --max-clients" in refused.text
        with Client(tmp_path / "s") as local:
            local.next("estimate")
        for client in crowd:
            client.socket.close()


def test_one_address_is_counted_over_all_publishers_and_refused_ones_are_not(tmp_path):
    """It would hold what two publishers have, and whoever is refused would hold a place."""
    (tmp_path / "a.jpg").write_bytes(GOOD)
    options = ["--publish=tcp:127.0.0.1:0", "--publish=tcp:127.0.0.1:0?clients=99"]
    with Daemon(f"--source=file:{tmp_path}/a.jpg", *options, "--max-clients=16",
                f"--publish=unix:{tmp_path}/s") as d:  # fmt: skip
        ports = [int(port) for port in re.findall("listen: 127.0.0.1 port ([0-9]+)", d.log())]
        crowd = [Client(("127.0.0.1", ports[k % 2])) for k in range(40)]
        kinds = [client.next().DESCRIPTOR.name for client in crowd]
        assert (kinds.count("Hello"), kinds.count("Error")) == (8, 32)
        for port in ports:  # crowd still holds all of its connections
            raw = socket.create_connection(("127.0.0.1", port), LONG_S, ("127.0.0.9", 0))
            with contextlib.closing(raw):
                data = b""
                while not split(data)[0] and (more := raw.recv(4096)):
                    data += more
                assert split(data)[0][0].HasField("hello")
        with Client(tmp_path / "s") as local:
            local.next("estimate")
        for client in crowd:
            client.socket.close()


@pytest.mark.parametrize(
    "flood", [bytes(65536), 21845 * delimit(pb.FromClient(subscribe={}).SerializeToString())]
)
def test_a_flood_of_requests_ends_with_its_connection(probe, flood):
    """Each request costs the loop some time: so many are allowed, and no more."""
    with probe.client() as client, probe.client(health_period_ms=100) as other:
        client.next("estimate")
        with contextlib.suppress(ConnectionError):  # it is closed while it still sends
            client.socket.sendall(flood)
        assert "more than 50 in a second" in client.until(lambda e: e.code == -122, "error").text
        client.wait_closed()
        other.until(lambda e: e.requests_rejected > 0, "health")
        other.next("estimate")


def test_sends_no_picture_whatever_it_is_asked():
    """Bytes to a client are a few hundred for a frame of many thousands."""
    with camera() as cam, Daemon(f"--source=sim:{cam.path}") as daemon:
        cam.accept()
        big = jpeg(quality=100)
        with daemon.client(sh_order=4, max_lights=8) as client, streaming(cam, big):
            client.until(lambda e: e.sh.order == 4)
            for _ in range(10):
                assert client.next("estimate").ByteSize() < 1000
