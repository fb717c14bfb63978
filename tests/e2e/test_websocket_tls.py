"""wss: pairs, certificates, tokens; and what is refused beyond this machine."""

from __future__ import annotations

import asyncio
import datetime
import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from harness import LONG_S, Daemon, run, wait_for
from lightprobe import AsyncClient, wire
from lightprobe import Client as ProbeClient
from lightprobe.errors import ProbeTimeout
from lightprobe_proto import lightprobe_pb2 as pb
from web_daemon import GOOD, LIGHTPROBE, PROTOCOL, WebDaemon, free_port, receive, unverified
from websockets.sync.client import connect

# ---------------------------------------------------------------- TLS and token


def make_pair(folder, *arguments):
    done = subprocess.run(
        [LIGHTPROBE, "pair", "--dir", folder, "--json", *arguments],
        capture_output=True, text=True, timeout=LONG_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def wss(folder, port, pair):
    picture = folder / "a.jpg"
    picture.write_bytes(GOOD)
    return (f"--source=file:{picture}?rate=30", f"--publish=wss:127.0.0.1:{port}?pair={pair}")


def refusal_of(url):
    with ProbeClient(url) as client, pytest.raises(ProbeTimeout) as refused:
        client.receive(3)
    return str(refused.value)


def code_of(url):
    """The code of what a probe says in place of a greeting."""
    codes = []

    def note(payload):
        codes.append(wire.decode(payload).code)

    async def ask():
        async with AsyncClient(url, on_payload=note) as client:
            while not client.statistics.refusals:
                await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(ask(), LONG_S))
    return codes[0]


def test_with_the_address_of_pair_the_light_comes_without_it_nothing(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    url = make_pair(pair, "--host", "127.0.0.1", "--port", str(port))["url"]
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        with ProbeClient(url) as client:
            client.receive(LONG_S)
            assert client.hello is not None
            assert not client.hello.insecure_lan
            assert "token" not in client.uri  # it stands in messages
        token = url.split("token=")[1].split("&")[0]
        assert "the token is missing or wrong" in refusal_of(url.replace(token, token[:-1] + "!"))
        without = url.replace(f"token={token}&", "")
        assert "the token is missing or wrong" in refusal_of(without)
        assert code_of(without) == wire.TOKEN_REFUSED  # clients wait for longer then
        assert token not in daemon.log()
        other = make_pair(tmp_path / "other", "--host", "127.0.0.1")["sha256"].replace(":", "")
        wrong = refusal_of(url.split("sha256=")[0] + "sha256=" + other)
        assert "is not the one of the address" in wrong
        assert "sha256=" in refusal_of(f"wss://127.0.0.1:{port}/")


def test_after_a_new_pairing_the_old_address_is_worth_nothing(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    old = make_pair(pair, *arguments)["url"]
    assert make_pair(pair, *arguments)["url"] == old  # found, not made
    new = make_pair(pair, *arguments, "--new")["url"]
    with Daemon(*wss(tmp_path, port, pair)):
        with ProbeClient(new) as client:
            client.receive(LONG_S)
        assert "is not the one of the address" in refusal_of(old)
        replayed = new.replace(new.split("token=")[1].split("&")[0],
                               old.split("token=")[1].split("&")[0])  # fmt: skip
        assert "the token is missing or wrong" in refusal_of(replayed)


def test_key_and_token_are_for_their_owner_alone(tmp_path):
    make_pair(tmp_path / "pair")
    for name in ("key.pem", "token"):
        assert (tmp_path / "pair" / name).stat().st_mode & 0o777 == 0o600


def expire(pair, in_s=-86400, begins_in_s=-9 * 86400):
    """Give the pair a certificate that expires in so many seconds: yesterday."""
    key = serialization.load_pem_private_key((pair / "key.pem").read_bytes(), None)
    name, now = x509.Name([]), datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(seconds=in_s)
    old = (
        x509.CertificateBuilder().subject_name(name).issuer_name(name).serial_number(1)
        .public_key(key.public_key())
        .not_valid_before(now + datetime.timedelta(seconds=begins_in_s)).not_valid_after(end)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("probe")]), False)
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    (pair / "certificate.pem").write_bytes(old.public_bytes(serialization.Encoding.PEM))


def other_key(pair):
    make_pair(pair.parent / "other")
    shutil.copy(pair.parent / "other" / "key.pem", pair / "key.pem")


SPOILT = {
    "other key": (other_key, "belongs to another certificate — make it with lightprobe pair"),
    "no key": (lambda p: (p / "key.pem").unlink(), "No such file"),
    "key is a FIFO": (lambda p: ((p / "key.pem").unlink(), os.mkfifo(p / "key.pem")), "is no file"),
    "no token": (lambda p: (p / "token").write_text("\n"), "holds no token"),
    "short token": (lambda p: (p / "token").write_text("secret\n"), "holds no token"),
    "no certificate": (lambda p: (p / "certificate.pem").write_text("x"), "holds no certificate"),
}


@pytest.mark.nightly_rows
@pytest.mark.parametrize("how", SPOILT)
def test_a_spoilt_pair_is_told_at_the_start(tmp_path, how):
    spoil, text = SPOILT[how]
    make_pair(tmp_path / "pair")
    spoil(tmp_path / "pair")
    status, _, log = run(*wss(tmp_path, free_port(), tmp_path / "pair"))
    assert status == 2
    assert text in log
    assert str(tmp_path / "pair") in log


def has_fault(client, id):
    return client.health and any(fault.id == id for fault in client.health.faults)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("when", ["not yet", "expired"])
def test_a_certificate_that_is_not_valid_now_keeps_one_publisher_waiting(tmp_path, when):
    """As on a machine without a clock of its own. The others serve, and it begins by itself."""
    port, pair, local = free_port(), tmp_path / "pair", tmp_path / "probe"
    make_pair(pair)
    expire(pair, *((86400, 8) if when == "not yet" else (-86400,)))
    url = make_pair(tmp_path / "new", "--port", str(port), "--host", "127.0.0.1")["url"]
    arguments = (*wss(tmp_path, port, pair), f"--publish=unix:{local}")
    with Daemon(*arguments) as daemon, ProbeClient(f"unix:{local}") as near:
        near.receive(LONG_S)
        wait_for(lambda: has_fault(near, "publisher-waits"), "no fault")
        assert f"{pair}/certificate.pem: the certificate" in daemon.log()
        if when == "expired":
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", port), LONG_S)
            for name in ("key.pem", "token", "certificate.pem"):
                shutil.copy(tmp_path / "new" / name, pair / name)
        else:
            fingerprint = make_pair(pair)["sha256"].replace(":", "")
            token = (pair / "token").read_text().strip()
            url = f"wss://127.0.0.1:{port}/#token={token}&sha256={fingerprint}"
        daemon.wait_log("certificate: SHA-256")
        with ProbeClient(url) as client:
            client.receive(LONG_S)
        wait_for(lambda: not has_fault(near, "publisher-waits"), "the fault stays")


def test_a_pair_that_is_made_anew_is_taken_without_a_restart(tmp_path):
    """Clients that are connected stay. What cannot be used changes nothing."""
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    old = make_pair(pair, *arguments)["url"]
    with Daemon(*wss(tmp_path, port, pair)) as daemon, ProbeClient(old) as stays:
        stays.receive(LONG_S)
        good = (pair / "certificate.pem").read_bytes()
        (pair / "certificate.pem").write_text("nonsense")
        daemon.wait_log("holds no certificate")
        with ProbeClient(old) as client:
            client.receive(LONG_S)
        (pair / "certificate.pem").write_bytes(good)
        made = make_pair(pair, *arguments, "--new")
        daemon.wait_log(f"certificate: SHA-256 {made['sha256']}")
        with ProbeClient(made["url"]) as client:
            client.receive(LONG_S)
        assert "is not the one of the address" in refusal_of(old)
        stays.receive(LONG_S)
        assert stays.statistics.failures == 0


def try_token(port, token, address="127.0.0.1"):
    """The first message that a client with this token gets, from this address."""
    raw = socket.create_connection(("127.0.0.1", port), LONG_S, (address, 0))
    with connect(
        f"wss://127.0.0.1:{port}/", sock=raw, ssl=unverified(), open_timeout=LONG_S,
        subprotocols=[PROTOCOL, f"token.{token}"],
    ) as web:  # fmt: skip
        return receive(web)


def test_who_tries_tokens_has_to_wait_and_nobody_else(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    good = (pair / "token").read_text().strip()
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        while "wait ten seconds" not in (text := try_token(port, "a" * 32).text):
            assert "the token is missing or wrong — open the address" in text
        assert isinstance(try_token(port, good, "127.0.0.9"), pb.Hello)
        daemon.wait_log("127.0.0.1: it has sent wrong tokens; none of its tokens counts")
        wait_for(lambda: isinstance(try_token(port, good), pb.Hello), "it waits for ever")


@pytest.mark.parametrize("name", ["key.pem", "token"])
def test_a_secret_that_everybody_can_read_is_told(tmp_path, name):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    (pair / name).chmod(0o644)
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        assert f"{pair}/{name}: every user of this machine can read it — chmod 600" in daemon.log()
        assert daemon.log().count("every user") == 1


def test_ciphers_of_yesterday_are_refused(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    with Daemon(*wss(tmp_path, port, pair)):
        for ciphers, is_good in (("ECDHE+AESGCM", True), ("AES128-SHA:ECDHE+AES+SHA1", False)):
            context = unverified()
            context.maximum_version = ssl.TLSVersion.TLSv1_2
            context.set_ciphers(ciphers)
            with socket.create_connection(("127.0.0.1", port), LONG_S) as raw:
                if is_good:
                    assert "GCM" in context.wrap_socket(raw).cipher()[0]
                else:
                    with pytest.raises((ssl.SSLError, ConnectionError)):
                        context.wrap_socket(raw)


def test_pair_says_when_its_certificate_has_expired(tmp_path):
    make_pair(tmp_path / "pair")
    expire(tmp_path / "pair")
    done = subprocess.run([LIGHTPROBE, "pair", "--dir", tmp_path / "pair"], capture_output=True,
                          text=True, timeout=LONG_S)  # fmt: skip
    assert done.returncode == 1
    assert "expired on" in done.stderr
    assert "--new" in done.stderr


def test_a_certificate_that_ends_while_the_daemon_runs(tmp_path):
    """Health and log say so before and after; who knows the fingerprint still gets the light."""
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    make_pair(pair, *arguments)
    expire(pair, in_s=20)
    url = make_pair(pair, "--port", str(port))["url"].replace("//probe:", "//127.0.0.1:")

    def told(client, text):
        faults = client.health.faults if client.health else ()
        return any(fault.id == "certificate-expires" and text in fault.text for fault in faults)

    with Daemon(*wss(tmp_path, port, pair)) as daemon, ProbeClient(url) as client:
        wait_for(lambda: told(client, "expires within 14 days"), "no warning")
        wait_for(lambda: told(client, "has expired: browsers refuse it"), "no fault")
        daemon.wait_log("certificate: the certificate has expired")
        client.receive(LONG_S)
        with ProbeClient(url) as late:
            late.receive(LONG_S)


def test_pair_prints_address_fingerprint_and_a_qr_code(tmp_path):
    done = subprocess.run([LIGHTPROBE, "pair", "--dir", tmp_path / "pair", "--host", "probe.local"],
                          capture_output=True, text=True, timeout=LONG_S)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "https://probe.local:7702/#token=" in done.stdout
    assert "SHA-256" in done.stdout
    assert "▀" in done.stdout


# ---------------------------------------------------------------- the network


@pytest.mark.parametrize("uri", ["tcp:0.0.0.0:7700", "ws:0.0.0.0:7701", "ws:[::]:7701"])
def test_nothing_unencrypted_beyond_this_machine(tmp_path, uri):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    status, _, log = run(f"--source=file:{tmp_path}/a.jpg", f"--publish={uri}")
    assert status == 2
    assert "without encryption — publish on wss:" in log


def test_insecure_lan_is_told_to_all(tmp_path):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    port = free_port()
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30", f"--publish=tcp:0.0.0.0:{port}",
                "--insecure-lan") as daemon:  # fmt: skip
        with ProbeClient(f"tcp:127.0.0.1:{port}") as client:
            client.receive(LONG_S)
            assert client.hello.insecure_lan
            wait_for(lambda: client.health, "no health")
            assert [fault.id for fault in client.health.faults] == ["insecure-lan"]
        assert "anyone on the network can read the light" in daemon.log()


def test_insecure_lan_alone_opens_nothing(tmp_path):
    with WebDaemon("--insecure-lan", folder=tmp_path) as daemon, daemon.open() as web:
        assert not receive(web).insecure_lan


def test_from_another_address_only_with_the_token(tmp_path):
    """In a network namespace of its own, so that an address beyond loopback exists everywhere."""
    script = Path(__file__).with_name("websocket_network.py")
    command = ["unshare", "--user", "--map-root-user", "--net", sys.executable, script, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=2 * LONG_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines() == [
        "with the address of pair: an estimate",
        "without token: refused",
        "a page of another origin: 403",
        "tcp: beyond loopback: status 2",
    ]
