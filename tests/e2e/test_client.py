"""The clients against a probe that the test scripts: lost, silent, mad, slow, old."""

import asyncio
import contextlib
import socket
import sys
import threading
import time

import numpy as np
import pytest
from lightprobe import async_client, drained, wire
from lightprobe.address import Address
from lightprobe.client import AsyncClient, Client
from lightprobe.errors import IncompatibleProbe, ProbeError, ProbeTimeout
from lightprobe.wire import Subscription, SubscriptionError
from lightprobe_proto import lightprobe_pb2 as pb
from scripted_probe import LONG_S, Probe, estimate, health, hello, serve


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


def test_after_a_pause_what_came_meanwhile_is_read_before_light_counts_as_old():
    """The event loop is blocked for longer than the time to live, while the probe goes on."""
    over = threading.Event()

    def stream(probe, connection):
        connection.sendall(hello())
        number = 0
        while not over.is_set():
            number += 1
            connection.sendall(estimate(number, ttl_ms=800))
            time.sleep(0.02)
        probe.hold(connection)

    async def run(uri):
        async with AsyncClient(uri) as client:
            await client.receive(LONG_S)
            await asyncio.sleep(0.5)
            before = client.latest().sequence
            time.sleep(1.2)  # the pause
            assert client.age_ms() > 800  # the age itself is told as it is
            while (found := client.latest()) is not None and found.sequence == before:
                await asyncio.sleep(0.005)
            assert found is not None, "dark after the pause"
            over.set()
            while client.latest() is not None:  # nothing comes: it is old all the same
                await asyncio.sleep(0.01)
        assert client.latest() is None

    with Probe(stream) as probe:
        asyncio.run(asyncio.wait_for(run(probe.uri), 2 * LONG_S))


def test_a_pause_is_no_silence_of_the_probe(monkeypatch):
    monkeypatch.setattr(async_client, "HELLO_TIMEOUT_S", 1.0)
    paused = threading.Event()

    def late(probe, connection):
        paused.wait(LONG_S)
        connection.sendall(hello() + estimate(1))
        probe.hold(connection)

    async def run(probe):
        async with AsyncClient(probe.uri) as client:
            while not probe.connections:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)
            paused.set()
            time.sleep(1.5)  # the pause
            assert (await client.receive(LONG_S)).sequence == 1
            assert (client.statistics.failures, probe.connections) == (0, 1)

    with Probe(late) as probe:
        asyncio.run(run(probe))


def test_light_ages_on_when_the_client_is_left():
    with Probe(serve(hello(), estimate(1, ttl_ms=700))) as probe:
        with Client(probe.uri) as client:
            client.receive(LONG_S)
        assert client.wait_for(lambda c: c.latest() is None, LONG_S)


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
    "garbage",
    [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\xff" * 64, b"\x05hello", estimate(1)],
    ids=["http", "ones", "text", "no-hello-first"],
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
    ["", "tcp:", "tcp:host", "tcp:host:0", "tcp:host:70000", "udp:host:1", "unix:", "x" * 300,
     "127.0.0.1:7700", "localhost", "tcp:a/b:1"],
)  # fmt: skip
def test_addresses_that_are_none(uri):
    with pytest.raises(ProbeError, match="expected tcp:HOST:PORT, unix:PATH"):
        Client(uri)


@pytest.mark.parametrize("place", ["probe:7701", "127.0.0.1:7701"])
@pytest.mark.parametrize("scheme", ["http", "ws"])
def test_a_token_goes_over_tls_alone(scheme, place):
    with pytest.raises(ProbeError, match=r"would send the token in clear.*https: or wss:") as told:
        AsyncClient(f"{scheme}://{place}/#token=secret&sha256=")
    assert "secret" not in str(told.value)


@pytest.mark.parametrize("uri", ["tcp://127.0.0.1:7700", "tcp://[::1]:7700"])
def test_an_address_is_no_url(uri):
    with pytest.raises(ProbeError, match=r"expected tcp:HOST:PORT \(without //\)"):
        Client(uri)


@pytest.mark.parametrize("uri", ["tcp:[::1]:9", "tcp:::1:9"])
def test_ipv6_with_brackets_and_without(uri):
    assert Address.parse(uri) == Address("::1", 9, None)


def test_without_websockets_one_sentence_says_so_and_nothing_is_tried_again(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.client", None)
    with Client("ws://127.0.0.1:9/") as client:
        with pytest.raises(ProbeError, match="needs the package websockets: pip install websocke"):
            client.receive(LONG_S)
        assert client.statistics.failures == 0


# ---------------------------------------------------------------- subscriptions


def test_estimates_of_another_subscription_are_dropped():
    """What a probe sent before it read our subscription: its number is another."""
    messages = [estimate(1), estimate(1, subscription=1), estimate(2), estimate(3, subscription=1)]
    with (
        Probe(serve(hello(minor=1), *messages)) as probe,
        Client(probe.uri, Subscription(kind="TOTAL")) as client,
    ):
        assert client.wait_for(lambda c: c.statistics.estimates == 2, LONG_S)
        assert client.receive(LONG_S).sequence == 3
        assert client.statistics.not_ours == 2
        sent = pb.FromClient.FromString(probe.requests[0][1:]).subscribe
        assert sent.number == 1


def test_a_new_subscription_ends_the_former_at_once():
    """Nothing of the former is received any more, though it had come and not been taken."""

    def script(probe, connection):
        connection.sendall(hello(minor=1) + estimate(1, subscription=1))
        while len(probe.requests) < 2 and not probe.ended.is_set():
            probe.requests.append(connection.recv(4096))
        looked.wait(LONG_S)
        connection.sendall(estimate(2, subscription=1) + estimate(2, subscription=2))
        probe.hold(connection)

    looked = threading.Event()
    with Probe(script) as probe, Client(probe.uri) as client:
        assert client.wait_for(lambda c: c.latest(), LONG_S)
        client.subscribe(Subscription(kind="TOTAL"))
        assert client.latest().subscription == 1  # better than none, for a frame
        looked.set()
        got = client.receive(LONG_S)
        assert (got.sequence, got.subscription) == (2, 2)
        assert client.statistics.not_ours == 1


def test_a_refusal_stays_the_reason_when_the_probe_closes():
    error = wire.delimit(
        pb.FromProbe(error=pb.Error(code=-87, text="8 clients are connected")).SerializeToString()
    )

    def refuse(probe, connection):
        connection.recv(4096)
        connection.sendall(error)

    with Probe(refuse) as probe, Client(probe.uri) as client:
        with pytest.raises(ProbeTimeout, match="request: 8 clients are connected"):
            client.receive(1.0)
        assert client.statistics.refusals > 0


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("rate_hz", float("nan"), "expected 0…1000"),
        ("rate_hz", float("inf"), "expected 0…1000"),
        ("rate_hz", -1, "expected 0…1000"),
        ("rate_hz", "30", "expected 0…1000"),
        ("sh_order", -1, "whole number, 0…4"),
        ("sh_order", 9, "whole number, 0…4"),
        ("sh_order", 2.5, "whole number, 0…4"),
        ("max_lights", 9, "whole number, 0…8"),
        ("max_lights", None, "whole number, 0…8"),
        ("kind", "total", "expected AMBIENT or TOTAL"),
        ("kind", "KIND_UNSPECIFIED", "expected AMBIENT or TOTAL"),
        ("tolerance", 50, "0.05 is 5 %"),
        ("tolerance", float("nan"), "0.05 is 5 %"),
        ("smoothing", "smoothed", "expected SMOOTHED or RAW"),
        ("health_period_ms", 2**32, "whole number"),
        ("quiet_ms", 60001, "whole number"),
    ],
)
def test_a_subscription_is_checked_when_it_is_made(field, value, message):
    with pytest.raises(SubscriptionError, match=f"{field} = .*{message}") as error:
        Subscription(**{field: value})
    assert isinstance(error.value, ValueError)
    assert error.value.exit_code == 2


def test_numbers_of_numpy_are_numbers():
    wish = Subscription(np.float32(2.5), np.int64(3), np.uint8(4), tolerance=np.float64(0.5))
    sent = pb.FromClient.FromString(wire.encode_subscription(wish)[1:]).subscribe
    assert (sent.rate_hz, sent.sh_order, sent.max_lights) == (2.5, 3, 4)


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


def refusal(code):
    """What a probe says in place of a greeting."""
    message = pb.FromProbe(error=pb.Error(code=code, text="it says why"))
    return serve(wire.delimit(message.SerializeToString()), hold=False)


def test_after_a_refused_token_it_waits_more_than_a_minute_after_another_refusal_not(monkeypatch):
    pauses, sleep = [], asyncio.sleep

    async def note(seconds):
        if seconds == drained.PERIOD_S:  # a turn of the loop, and no pause
            return await sleep(seconds)
        pauses.append(seconds)
        await sleep(0)

    monkeypatch.setattr(asyncio, "sleep", note)
    codes = (-87, wire.TOKEN_REFUSED, -87, wire.TOKEN_REFUSED, -87)
    with Probe(*map(refusal, codes)) as probe, Client(probe.uri) as client:
        assert client.wait_for(lambda client: client.statistics.refusals >= 5, LONG_S)
        assert client.last_error == f"{probe.uri}: request: it says why"
    for code, pause_s in zip(codes, pauses[:4], strict=False):
        assert 60 < pause_s < 120 if code == wire.TOKEN_REFUSED else pause_s < 10


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
