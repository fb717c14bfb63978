"""mqtt: and mqtts: with a real broker: what comes, what stays, and what is said when it fails."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from broker import Broker, write_certificates
from harness import LONG_S, Daemon, jpeg, wait_for
from lightprobe import AsyncClient
from lightprobe import Client as ProbeClient
from lightprobe.errors import ProbeError, ProbeTimeout
from lightprobe.wire import Subscription
from lightprobe_proto import lightprobe_pb2 as pb

TOPIC = "rooms/kitchen"
BENCH = Path(__file__).resolve().parents[1] / "bench" / "fleet.py"


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(prefix="lp-") as name:  # paths of sockets are short
        yield Path(name)


@pytest.fixture
def broker(folder):
    with Broker(folder) as running:
        yield running


class MqttDaemon(Daemon):
    """On a broker and on a Unix socket."""

    def __init__(self, folder, port, query="", scheme="mqtt", host="127.0.0.1", source=None):
        picture = folder / "a.jpg"
        picture.write_bytes(jpeg())
        self.local = folder / "probe"
        super().__init__(
            f"--source={source or f'file:{picture}?rate=30'}",
            f"--publish={scheme}:{host}:{port}/{TOPIC}{query}",
            f"--publish=unix:{self.local}",
        )

    def faults(self):
        """Texts by name, as the daemon tells them now."""
        with ProbeClient(f"unix:{self.local}", Subscription(health_period_ms=100)) as near:
            near.wait_for(lambda probe: probe.health is not None, LONG_S)
            return {fault.id: fault.text for fault in near.health.faults}


def address(broker, extra="", scheme="mqtt"):
    return f"{scheme}://127.0.0.1:{broker.port}/{TOPIC}{extra}"


async def _payloads(uri, subscription, count):
    """So many estimates as they came, by sequence."""
    came = {}

    def note(payload):
        message = pb.FromProbe.FromString(payload)
        if message.WhichOneof("message") == "estimate":
            came[message.estimate.sequence] = message.estimate

    async with AsyncClient(uri, subscription, on_payload=note):
        while len(came) < count:
            await asyncio.sleep(0.02)
    return came


def test_a_broker_gives_what_a_socket_gives(broker, folder):
    wish = Subscription(sh_order=3, max_lights=2, kind="TOTAL")

    async def both(local):
        near = _payloads(f"unix:{local}", wish, 30)
        return await asyncio.gather(_payloads(address(broker), None, 30), near)

    with MqttDaemon(folder, broker.port, "?rate=0&sh_order=3&max_lights=2&kind=total") as daemon:
        far, near = asyncio.run(asyncio.wait_for(both(daemon.local), LONG_S))
    shared = [number for number in far if number in near and near[number].subscription]
    assert len(shared) > 10
    for number in shared:
        times_ns = [one[number].capture_time_unix_ns for one in (far, near)]
        assert abs(times_ns[0] - times_ns[1]) < 1e6  # each is read off two clocks
        for one in (far[number], near[number]):
            for name in ("subscription", "send_delay_us", "capture_time_unix_ns"):
                one.ClearField(name)
        assert far[number] == near[number]
    assert far[shared[0]].sh.order == 3
    # Nothing is subscribed to: a broker cannot steer a probe.
    assert "as lightprobe-" in broker.log()
    assert "Received SUBSCRIBE from lightprobe-" not in broker.log()


def test_who_comes_late_gets_the_newest_and_a_killed_probe_is_gone(broker, folder, caplog):
    with MqttDaemon(folder, broker.port) as daemon, ProbeClient(address(broker)) as client:
        client.receive(LONG_S)
        assert client.hello.source == "file"
        kept = broker.retained(TOPIC, 4)
        assert kept["state"] == b"online"
        assert pb.FromProbe.FromString(kept["hello"]).hello.source == "file"
        newest = pb.FromProbe.FromString(kept["estimate"]).estimate.sequence
        assert newest >= client.latest().sequence - 3
        with pytest.raises(ProbeError, match="subscribe: a probe hears nothing over MQTT"):
            client.subscribe(Subscription())
        with pytest.raises(ProbeError, match="pose: a probe hears nothing over MQTT"):
            client.send_pose([0, 0, 0, 1])
        with pytest.raises(ProbeError, match="request: a probe hears nothing over MQTT"):
            client.take_stills()
        daemon.process.send_signal(signal.SIGKILL)
        daemon.process.wait(LONG_S)
        assert client.wait_for(lambda probe: "has gone" in (probe.last_error or ""), LONG_S)
        assert not client.connected
        assert broker.retained(TOPIC, 4)["state"] == b"offline"
    with caplog.at_level(logging.WARNING, "lightprobe"):
        late = ProbeClient(address(broker), Subscription(sh_order=4))
    assert "subscription: not sent: a probe hears nothing over MQTT" in caplog.text
    with late, pytest.raises(ProbeTimeout, match="the probe is offline"):
        late.receive(6)
    with MqttDaemon(folder, broker.port, source=f"sim:{folder / 'no_camera'}"):
        wait_for(
            lambda: set(broker.retained(TOPIC, 3)) == {"state", "hello", "health"}, "old light"
        )


def test_a_broker_that_comes_back_gets_the_newest(broker, folder):
    with MqttDaemon(folder, broker.port) as daemon, ProbeClient(address(broker)) as client:
        before = client.receive(LONG_S).sequence
        assert daemon.faults() == {}
        broker.kill()
        text = (
            f"mqtt:127.0.0.1:{broker.port}/{TOPIC}: connect: Connection refused — does the broker"
        )
        wait_for(lambda: text in daemon.faults().get("publisher-waits", ""), "it is not missed")
        time.sleep(0.5)
        broker.start()  # it has forgotten everything
        wait_for(lambda: daemon.faults() == {}, "the fault stays")
        assert broker.retained(TOPIC, 4)["state"] == b"online"
        assert client.wait_for(lambda probe: probe.connected, LONG_S)
        assert client.receive(LONG_S).sequence > before + 10
        assert daemon.stop() == 0
    assert broker.retained(TOPIC, 4)["state"] == b"offline"  # a probe that ends says so


def test_a_wrong_password_is_named_and_mended_without_a_restart(folder):
    right, wrong = folder / "right", folder / "wrong"
    right.write_text("probe\nsecret\n")
    wrong.write_text("probe\nsecrets\n")
    wrong.chmod(0o644)
    with (
        Broker(folder, password="secret") as broker,
        MqttDaemon(folder, broker.port, f"?login={wrong}") as daemon,
    ):
        daemon.wait_log("user name or password is wrong")
        assert "correct the file of login=" in daemon.faults()["publisher-waits"]
        assert f"{wrong}: every user of this machine can read it — chmod 600" in daemon.log()
        assert "secret" not in daemon.log()
        for login, words in (("", "use #login=FILE"), (f"#login={wrong}", "is the file of #login")):
            with ProbeClient(address(broker, login)) as client, pytest.raises(ProbeTimeout) as told:
                client.receive(1)
            assert words in str(told.value)
        wrong.write_text("probe\nsecret\n")
        with ProbeClient(address(broker, f"#login={right}")) as client:
            client.receive(LONG_S)
            assert "login" not in client.uri


def test_a_fleet_is_measured():
    command = (sys.executable, BENCH, "--probes=2", "--subscribers=6", "--seconds=1", "--json")
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S, check=True)
    figures = json.loads(done.stdout)
    assert figures["received"] >= 0.8 * figures["expected"] >= 40
    assert 0 < figures["p50_ms"] <= figures["p99_ms"]
    assert figures["broker_rss_end_mib"] > 1


def test_tls_with_the_authority_that_is_named(folder):
    write_certificates(folder)
    tls = (f"certfile {folder / 'cert.pem'}", f"keyfile {folder / 'key.pem'}")
    ca = folder / "ca.pem"
    with Broker(folder, *tls) as broker:
        with MqttDaemon(folder, broker.port, f"?ca={ca}", "mqtts"):
            with ProbeClient(address(broker, f"#ca={ca}", "mqtts")) as client:
                client.receive(LONG_S)
            with (
                ProbeClient(address(broker, "", "mqtts")) as client,
                pytest.raises(
                    ProbeTimeout,
                    match="name the certificate of the broker's authority with #ca=FILE",
                ),
            ):
                client.receive(2)
        with MqttDaemon(folder, broker.port, "", "mqtts") as daemon:
            daemon.wait_log("certificate: the broker's certificate is not trusted")
        with MqttDaemon(folder, broker.port, f"?ca={ca}", "mqtts", "localhost") as daemon:
            daemon.wait_log("certificate: the broker's certificate is for another name")
        with MqttDaemon(folder, broker.port) as daemon:
            daemon.wait_log("with TLS it is mqtts:")
