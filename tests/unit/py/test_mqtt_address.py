"""Addresses of a broker, and the order in which what it keeps is read."""

import asyncio
import sys
import time

import pytest
from lightprobe import Client
from lightprobe.address import Address
from lightprobe.clock_offset import ClockOffset
from lightprobe.errors import MissingPackage, ProbeError
from lightprobe.mqtt import BrokerAddress, MqttStream
from lightprobe.wire import delimit


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("mqtt://host/a", BrokerAddress("mqtt", "host", 1883, "a")),
        ("mqtt:127.0.0.1:77/a/b", BrokerAddress("mqtt", "127.0.0.1", 77, "a/b")),
        ("mqtts://[::1]/a%20b", BrokerAddress("mqtts", "::1", 8883, "a b")),
        (
            "mqtts://host/a#login=/x/y&ca=/z",
            BrokerAddress("mqtts", "host", 8883, "a", "/x/y", "/z"),
        ),
    ],
)
def test_an_address_names_broker_and_topic(uri, expected):
    address = Address.parse(uri)
    assert address.broker == expected
    assert address.is_read_only
    assert "#" not in address.without_secrets(uri)


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("mqtt://host", "is no topic of one probe"),
        ("mqtt://host/", "is no topic of one probe"),
        ("mqtt://host/a/+", "is no topic of one probe"),
        ("mqtt://host/a//b", "is no topic of one probe"),
        ("mqtt:///a", "expected mqtt://HOST"),
        ("mqtt://host:x/a", "address"),
        ("mqtt://host/a?rate=3", "keys are those of lightprobed"),
        ("mqtt://host/a#ca=/x", "ca= is for mqtts:"),
    ],
)
def test_what_is_no_address_is_told(uri, words):
    with pytest.raises(ProbeError, match=words):
        Address.parse(uri)


def test_a_password_in_the_address_is_refused_and_not_repeated():
    with pytest.raises(ProbeError, match="#login=FILE") as told:
        Address.parse("mqtt://me:secret@host/a")
    assert "secret" not in str(told.value)


@pytest.mark.parametrize(("text", "words"), [(None, "No such file"), ("user\n", "needs two lines")])
def test_a_login_is_a_file_of_two_lines(tmp_path, text, words):
    file = tmp_path / "login"
    if text is not None:
        file.write_text(text)

    async def connect():
        await BrokerAddress("mqtt", "127.0.0.1", 9, "a", str(file)).connect()

    with pytest.raises(ProbeError, match=words):
        asyncio.run(connect())


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    with (
        Client("mqtt://127.0.0.1/a") as client,
        pytest.raises(MissingPackage, match="pip install paho-mqtt"),
    ):
        client.receive(60)


async def test_hello_comes_first_and_retained_is_told_from_live():
    stream = MqttStream(BrokerAddress("mqtt", "127.0.0.1", 1, "a"))
    for name, payload, retained in (
        ("estimate", b"old", True),
        ("health", b"health", True),
        ("estimate", b"", True),  # the broker is to forget one
        ("hello", b"hello", True),
        ("estimate", b"new", False),
        ("estimate", b"newer", False),
    ):
        stream._note(name, payload, retained)
    assert await stream.read() == delimit(b"hello")
    assert await stream.read() == delimit(b"old") + delimit(b"health")
    assert stream.retained
    assert await stream.read() == delimit(b"new") + delimit(b"newer")
    assert not stream.retained
    stream._note("state", b"online", True)
    stream._note("state", b"offline", False)
    with pytest.raises(ProbeError, match="the probe has gone"):
        await stream.read()


def test_before_any_message_the_clocks_count_as_equal():
    offset = ClockOffset()
    hour_ago_ns = time.time_ns() - 3600 * 10**9
    age_s = (time.monotonic_ns() - offset.ours_ns(hour_ago_ns)) / 1e9
    assert age_s == pytest.approx(3600, abs=1)
    offset.arrived(hour_ago_ns, time.monotonic_ns())  # a clock that is an hour behind
    assert (time.monotonic_ns() - offset.ours_ns(hour_ago_ns)) / 1e9 < 1
