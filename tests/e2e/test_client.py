"""The clients against a probe that the test scripts: lost, silent, mad, slow, old."""

import asyncio
import contextlib
import socket
import threading
import time

import pytest
from lightprobe import wire
from lightprobe.client import (
    AsyncClient,
    Client,
    IncompatibleProbe,
    ProbeError,
    ProbeTimeout,
)
from lightprobe.wire import Subscription
from lightprobe_proto import lightprobe_pb2 as pb

LONG_S = 30


def hello(major=1):
    greeting = pb.Hello(protocol_major=major, software="lightprobed 0.0 scripted")
    return wire.delimit(pb.FromProbe(hello=greeting).SerializeToString())


def estimate(number, ttl_ms=60000, clock_off_s=0.0, old_s=0.0):
    sh = pb.SphericalHarmonics(kind=1, order=0, coefficients=[1, 1, 1])
    capture_ns = time.time_ns() + round(1e9 * (clock_off_s - old_s))
    message = pb.Estimate(sequence=number, sh=sh, ttl_ms=ttl_ms, capture_time_unix_ns=capture_ns,
                          send_delay_us=round(1e6 * old_s))  # fmt: skip
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


def test_estimates_come_with_hello_and_health():
    with Probe(serve(hello(), health(), estimate(5))) as probe, Client(probe.uri) as client:
        assert client.receive(LONG_S).sequence == 5
        assert client.connected
        assert client.hello.software == "lightprobed 0.0 scripted"
        assert client.health.source_state == "WAITING"
        assert client.latest().sequence == 5
        assert client.age_ms() < 1000 * LONG_S


def test_a_lost_connection_is_made_again_and_the_wish_repeated():
    wish = Subscription(rate_hz=10, sh_order=3)
    scripts = [serve(hello(), estimate(k), hold=False) for k in (1, 2)]
    with Probe(*scripts, serve(hello(), estimate(3))) as probe, Client(probe.uri, wish) as client:
        assert client.wait_for(lambda c: c.latest() and c.latest().sequence == 3, LONG_S)
        assert client.statistics.connections == 3
        assert client.statistics.failures == 2
        assert client.wait_for(lambda c: probe.requests, LONG_S)
        sent = pb.FromClient.FromString(probe.requests[0][1:]).subscribe
        assert (sent.rate_hz, sent.sh_order) == (10, 3)
        client.subscribe(Subscription(rate_hz=2))
        assert client.wait_for(lambda c: len(probe.requests) > 1, LONG_S)
        assert pb.FromClient.FromString(probe.requests[1][1:]).subscribe.rate_hz == 2


def test_the_last_estimate_survives_a_lost_connection_but_not_its_age():
    with (
        Probe(serve(hello(), lambda: estimate(1, ttl_ms=600), hold=False), serve(hello())) as probe,
        Client(probe.uri) as client,
    ):
        client.receive(LONG_S)
        assert client.wait_for(lambda c: c.latest() is None, LONG_S)
        assert client.age_ms() > 600


@pytest.mark.parametrize("clock_off_s", [-3600, 3600])
def test_ages_by_its_own_clock(clock_off_s):
    fresh = estimate(1, ttl_ms=20000, clock_off_s=clock_off_s)
    with Probe(serve(hello(), fresh)) as probe, Client(probe.uri) as client:
        client.receive(LONG_S)
        assert client.latest() is not None
        assert client.age_ms() < 20000


def test_an_old_estimate_is_old_on_arrival():
    """What a new client gets at once may be of long ago."""
    old = estimate(1, ttl_ms=2000, old_s=100)
    with Probe(serve(hello(), old)) as probe, Client(probe.uri) as client:
        assert client.receive(LONG_S).sequence == 1
        assert client.latest() is None
        assert client.age_ms() == pytest.approx(100e3, abs=20e3)


@pytest.mark.parametrize(
    "garbage", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\xff" * 64, b"\x05hello", estimate(1)]
)
def test_garbage_is_told_and_the_next_try_works(garbage):
    with Probe(serve(garbage), serve(hello(), estimate(2))) as probe, Client(probe.uri) as client:
        assert client.wait_for(lambda c: c.statistics.failures == 1, LONG_S)
        assert client.receive(LONG_S).sequence == 2
        assert client.statistics.connections == 1


def test_garbage_after_good_estimates():
    with (
        Probe(serve(hello(), estimate(1), b"\xff" * 99), serve(hello(), estimate(2))) as probe,
        Client(probe.uri) as client,
    ):
        assert client.wait_for(lambda c: c.latest() and c.latest().sequence == 2, LONG_S)


def test_a_silent_server_is_no_probe():
    with Probe(serve()) as probe, Client(probe.uri) as client:
        assert client.wait_for(lambda c: c.last_error, LONG_S)
        assert "silent" in client.last_error


def test_a_slow_probe_is_read_byte_by_byte():
    data = hello() + estimate(1)
    crawl = serve(*(data[k : k + 1] for k in range(len(data))))
    with Probe(crawl) as probe, Client(probe.uri) as client:
        assert client.receive(LONG_S).sequence == 1


def test_a_slow_reader_gets_the_newest_and_counts_what_it_skipped():
    with (
        Probe(serve(hello(), *(estimate(k) for k in range(1, 8)))) as probe,
        Client(probe.uri) as client,
    ):
        assert client.wait_for(lambda c: c.statistics.estimates == 7, LONG_S)
        assert client.receive(LONG_S).sequence == 7
        assert client.statistics.skipped == 6
        with pytest.raises(ProbeTimeout, match="connected, but no estimate"):
            client.receive(0.2)


def test_another_protocol_is_final():
    with Probe(serve(hello(major=2))) as probe, Client(probe.uri) as client:
        with pytest.raises(IncompatibleProbe, match="speaks protocol 2, this client 1: install"):
            client.receive(LONG_S)
        time.sleep(0.5)
        assert probe.connections == 1


def test_nobody_there():
    with socket.create_server(("127.0.0.1", 0)) as free:
        uri = f"tcp:127.0.0.1:{free.getsockname()[1]}"
    with Client(uri) as client:
        with pytest.raises(ProbeTimeout, match="is lightprobed running"):
            client.receive(1.0)
        assert client.latest() is None
        assert not client.connected
    missing = Client("unix:/nowhere/probe.sock")
    with missing as client, pytest.raises(ProbeTimeout, match="is lightprobed running"):
        client.receive(1.0)


@pytest.mark.parametrize(
    "uri",
    ["", "tcp:", "tcp:host", "tcp:host:0", "tcp:host:70000", "udp:host:1", "unix:", "x" * 300],
)
def test_addresses_that_are_none(uri):
    with pytest.raises(ProbeError, match="want tcp:HOST:PORT or unix:PATH"):
        Client(uri)


async def take_while_they_come(client):
    with contextlib.suppress(ProbeTimeout):
        async for got in client.estimates(1.0):
            yield got


async def test_asyncio_client_iterates_and_times_out():
    with Probe(serve(hello(), estimate(1), estimate(2))) as probe:
        async with AsyncClient(probe.uri) as client:
            numbers = [got.sequence async for got in take_while_they_come(client)]
            assert numbers[-1] == 2
            assert client.latest().sequence == 2


async def test_asyncio_clients_side_by_side():
    with Probe(serve(hello(), estimate(1))) as one, Probe(serve(hello(), estimate(2))) as two:
        async with AsyncClient(one.uri) as a, AsyncClient(two.uri) as b:
            got = await asyncio.gather(a.receive(LONG_S), b.receive(LONG_S))
            assert [e.sequence for e in got] == [1, 2]


def test_leaving_while_it_tries_to_connect_is_quick():
    with Client("tcp:127.0.0.1:9") as client:
        client.wait_for(lambda c: c.statistics.failures > 2, LONG_S)
        started = time.monotonic()
    assert time.monotonic() - started < 5
    assert not any(t.name.startswith("lightprobe tcp") for t in threading.enumerate())


def test_a_probe_that_falls_silent_is_left():
    """Half-open: health was promised every 100 ms, and nothing comes for 5 s."""
    with (
        Probe(serve(hello(), estimate(1)), serve(hello(), estimate(2))) as probe,
        Client(probe.uri, Subscription(health_period_ms=100)) as client,
    ):
        assert client.wait_for(lambda c: c.latest() and c.latest().sequence == 2, LONG_S)
        assert client.statistics.failures == 1
