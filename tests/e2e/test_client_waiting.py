"""A client that waits: entered, left and entered again, told why there is nothing."""

import asyncio
import socket
import threading
import time

import pytest
from lightprobe.client import AsyncClient, Client
from lightprobe.errors import ProbeError, ProbeTimeout
from lightprobe.wire import Subscription
from scripted_probe import LONG_S, Probe, estimate, health, hello, serve


def in_time(call):
    """Result or error of a call that must not hang, from a thread of its own."""
    outcome = []

    def run():
        try:
            outcome.append(call())
        except Exception as error:
            outcome.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(LONG_S)
    assert outcome, "it hangs"
    return outcome[0]


@pytest.mark.parametrize("timeout_s", [1.0, None])
def test_receive_outside_with_is_an_error_and_no_wait(timeout_s):
    client = Client("tcp:127.0.0.1:9")
    assert client.latest() is None
    for call in (lambda: client.receive(timeout_s), lambda: client.subscribe(Subscription())):
        error = in_time(call)
        assert isinstance(error, ProbeError)
        assert not isinstance(error, ProbeTimeout)
        assert "use it within `with Client" in str(error)
    client.__exit__()  # never entered: nothing to do


def test_a_client_is_entered_again_after_it_was_left():
    with Probe(serve(hello(), estimate(1)), serve(hello(), estimate(2))) as probe:
        client = Client(probe.uri)
        with client:
            assert client.receive(LONG_S).sequence == 1
        assert "use it within" in str(in_time(lambda: client.receive(1.0)))
        with client:
            assert client.receive(LONG_S).sequence == 2
            with pytest.raises(ProbeError, match="already in use"):
                client.__enter__()
            assert client.connected  # and goes on


async def test_an_asyncio_client_is_entered_again_after_it_was_left():
    with Probe(serve(hello(), estimate(1)), serve(hello(), estimate(2))) as probe:
        client = AsyncClient(probe.uri)
        with pytest.raises(ProbeError, match="not running"):
            await client.receive(1.0)
        for number in (1, 2):
            async with client:
                assert (await client.receive(LONG_S)).sequence == number
                with pytest.raises(ProbeError, match="already in use"):
                    await client.__aenter__()


def test_a_thread_that_waits_is_told_when_the_client_is_left():
    with Probe(serve(hello())) as probe:
        outcome = []
        with Client(probe.uri) as client:
            thread = threading.Thread(target=lambda: outcome.append(in_time(client.receive)))
            thread.start()
            client.wait_for(lambda c: c.connected, LONG_S)
        thread.join(LONG_S)
        assert isinstance(outcome[0], ProbeError)
        assert "not running" in str(outcome[0])


async def test_a_task_that_waits_is_told_when_the_client_is_left():
    with Probe(serve(hello())) as probe:
        async with AsyncClient(probe.uri) as client:
            waiting = asyncio.create_task(client.receive())
            while not client.connected:
                await asyncio.sleep(0.01)
        with pytest.raises(ProbeError, match="not running"):
            await asyncio.wait_for(waiting, LONG_S)


def test_a_timeout_of_zero_polls():
    with Probe(serve(hello(), estimate(1))) as probe, Client(probe.uri) as client:
        assert client.wait_for(lambda c: c.statistics.estimates == 1, LONG_S)
        assert client.receive(0).sequence == 1
        with pytest.raises(ProbeTimeout):
            client.receive(0)


@pytest.mark.parametrize("timeout_s", [-1, float("nan")])
def test_timeouts_that_make_no_sense(timeout_s):
    with Client("tcp:127.0.0.1:9") as client, pytest.raises(ValueError, match="expected seconds"):
        client.receive(timeout_s)


def nobody():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"tcp:127.0.0.1:{free.getsockname()[1]}"


def test_estimates_say_what_they_wait_for(caplog):
    """The README's example without a daemon: a warning that names the next step."""
    with Client(nobody()) as client, caplog.at_level("WARNING", "lightprobe"):
        with pytest.raises(ProbeTimeout, match="is lightprobed running"):
            next(client.estimates(5.0))
        (record,) = caplog.records
        assert "nobody listens there: is lightprobed running? (lightprobe doctor): waiting" in (
            record.getMessage()
        )


def test_each_reason_is_said_once_to_whom_it_shall_be():
    def silent_camera(probe, connection):
        connection.sendall(hello() + health(2))
        while not probe.ended.is_set() and len(said) < 1:
            time.sleep(0.01)
        connection.sendall(health(4))
        while not probe.ended.is_set() and len(said) < 2:
            time.sleep(0.01)
        connection.sendall(estimate(1))
        probe.hold(connection)

    said = []
    with Probe(silent_camera) as probe, Client(probe.uri) as client:
        assert in_time(lambda: next(client.estimates(on_waiting=said.append))).sequence == 1
    assert [line.partition("receive: ")[2] for line in said] == [
        "connected, but no estimate (source: WAITING): waiting",
        "connected, but no estimate (source: STALLED): waiting",
    ]


async def test_asyncio_estimates_say_what_they_wait_for():
    said = []
    async with AsyncClient(nobody()) as client:
        with pytest.raises(ProbeTimeout):
            async for _ in client.estimates(5.0, on_waiting=said.append):
                pass
    assert len(said) == 1
    assert "is lightprobed running" in said[0]


def test_a_fault_of_the_client_ends_the_wait(monkeypatch):
    """Whatever ends the background task is told to who waits."""
    monkeypatch.setattr("lightprobe.async_client.encode_subscription", lambda *_: 1 / 0)
    with Probe(serve(hello())) as probe, Client(probe.uri) as client:
        error = in_time(client.receive)
        assert isinstance(error, ProbeError)
        assert "unexpected ZeroDivisionError" in str(error)
