"""`lightprobe find`: what is announced on loopback, as by Avahi or a camera, is found."""

import contextlib
import fcntl
import json
import socket
import subprocess
import sys
import threading
from pathlib import Path
from xml.etree import ElementTree

import pytest
from harness import BUILD, LONG_S, Daemon
from lightprobe.cli import find, find_cameras, pair
from lightprobe_proto import lightprobe_pb2 as pb
from zeroconf import DNSOutgoing, DNSPointer, ServiceInfo, Zeroconf, const

SERVICE_FILE = Path(__file__).parents[2] / "packaging/avahi/lightprobe.service"


def announcement(name, port, properties):
    return ServiceInfo(
        find.SERVICE_TYPE, f"{name}.{find.SERVICE_TYPE}", port=port, properties=properties,
        server="probe.local.", addresses=[socket.inet_aton("127.0.0.1")],
    )  # fmt: skip


def lightprobe_find(*words):
    command = [Path(sys.executable).parent / "lightprobe", "find", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)


@pytest.fixture(autouse=True)
def alone():
    """Tests that run at the same time would find each other's probes: loopback is one network."""
    with (BUILD / "find.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture
def network():
    with Zeroconf(interfaces=["127.0.0.1"]) as zeroconf:
        yield zeroconf
        zeroconf.unregister_all_services()


def service_file():
    """Port and properties that Avahi announces by our file."""
    service = ElementTree.parse(SERVICE_FILE).find("service")
    assert service.findtext("type") + ".local." == find.SERVICE_TYPE
    records = [record.text.split("=") for record in service.findall("txt-record")]
    return int(service.findtext("port")), dict(records)


def test_what_the_service_file_announces_is_found(network):
    port, properties = service_file()
    assert port == pair._PORT
    network.register_service(announcement("lightprobe on desk", port, properties))
    done = lightprobe_find("--interface", "127.0.0.1")
    assert done.returncode == 0, done.stderr
    assert "lightprobe on desk: https://probe.local:7702/ (127.0.0.1)" in done.stdout.splitlines()
    assert "lightprobe pair" in done.stderr


def announce_name(network, name, stop):
    """Send, again and again, that there is such a service, and nothing else of it."""
    while not stop.wait(0.2):
        answer = DNSOutgoing(const._FLAGS_QR_RESPONSE | const._FLAGS_AA)
        pointer = (find.SERVICE_TYPE, const._TYPE_PTR, const._CLASS_IN, 4500)
        answer.add_answer_at_time(DNSPointer(*pointer, f"{name}.{find.SERVICE_TYPE}"), 0)
        network.send(answer)


def test_strange_announcements_do_no_harm(network):
    network.register_service(announcement("odd", 1, {"scheme": "go\x1b[31m"}))
    network.register_service(announcement("plain", 7700, {"scheme": "tcp"}))
    network.register_service(announcement("bare", 7700, {}))
    stop = threading.Event()
    for name in ("nowhere", "red \x1b[31m"):
        threading.Thread(target=announce_name, args=(network, name, stop)).start()
    done = lightprobe_find("--interface", "127.0.0.1", "--json")
    stop.set()
    assert done.returncode == 0, done.stderr
    found = {one["name"]: (one["uri"], one["scheme"]) for one in json.loads(done.stdout)}
    assert found == {
        "odd": (None, "go?[31m"), "plain": ("tcp:probe.local:7700", "tcp"), "bare": (None, ""),
    }  # fmt: skip
    assert "nowhere: announced, but it does not say where it is" in done.stderr
    assert "\x1b" not in done.stdout + done.stderr


def test_without_a_probe_it_says_what_to_do():
    done = lightprobe_find("--interface", "127.0.0.1", "--seconds", "0.5")
    assert done.returncode == 1
    assert "no probe announced itself in 0.5 s" in done.stderr
    assert "avahi-daemon" in done.stderr


def test_an_interface_that_is_not_there():
    done = lightprobe_find("--interface", "192.0.2.77", "--seconds", "0.5")
    assert done.returncode == 1
    assert "192.0.2.77" in done.stderr or "check --interface" in done.stderr


@contextlib.contextmanager
def simulated_theta(*arguments):
    """`lightprobe simulate --osc`; gives its name, once it has announced itself."""
    command = [Path(sys.executable).parent / "lightprobe", "simulate", "--osc", "0", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        lines = (line for line in process.stderr if "announced as" in line)
        try:
            yield next(lines).split("announced as ")[1].strip()
        finally:
            process.terminate()


def cameras():
    """What the command lists, by name."""
    done = lightprobe_find("--cameras", "--interface", "127.0.0.1", "--json")
    assert done.returncode == 0, done.stderr
    return {one["name"]: one for one in json.loads(done.stdout)}


def test_a_camera_is_found_and_read():
    with simulated_theta("--osc-model", "z1") as name:
        found = cameras()[name]
        assert (found["model"], found["needs_password"]) == ("RICOH THETA Z1", False)
        with (
            Daemon(f"--source={found['uri']}?size=1024x512") as daemon,
            daemon.client(health_period_ms=100) as client,
        ):
            client.until(lambda h: h.source_state == pb.Health.SourceState.STREAMING, "health")


def test_a_camera_with_a_password_is_found(tmp_path):
    """What it is, it tells only who has the password; that it is there, it tells everybody."""
    password = tmp_path / "password"
    password.write_text("THETAYN10100001:10100001\n")
    password.chmod(0o600)
    with simulated_theta("--osc-password-file", password) as name:
        found = cameras()[name]
        assert (found["model"], found["needs_password"]) == (None, True)
        done = lightprobe_find("--cameras", "--interface", "127.0.0.1")
        assert f"{name}: --source={found['uri']}?password_file=FILE" in done.stdout
        with (
            Daemon(f"--source={found['uri']}?size=1024x512&password_file={password}") as daemon,
            daemon.client(health_period_ms=100) as client,
        ):
            client.until(lambda h: h.source_state == pb.Health.SourceState.STREAMING, "health")


@pytest.mark.nightly
def test_two_cameras_of_one_number_have_two_names():
    with simulated_theta() as first, simulated_theta() as second:
        assert {first, second} <= set(cameras())


def osc_announcement(name, port):
    return ServiceInfo(
        find_cameras.SERVICE_TYPE, f"{name}.{find_cameras.SERVICE_TYPE}", port=port,
        server="mixer.local.", addresses=[socket.inet_aton("127.0.0.1")],
    )  # fmt: skip


def test_open_sound_control_is_no_camera(network):
    """It has the same service type. One says nothing for long, one is not there at all."""
    with socket.create_server(("127.0.0.1", 0)) as mixer, socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        network.register_service(osc_announcement("mixer", mixer.getsockname()[1]))
        network.register_service(osc_announcement("gone", nobody.getsockname()[1]))
        done = lightprobe_find("--cameras", "--interface", "127.0.0.1")
    assert done.returncode == 1
    assert "note: mixer: no camera, or not awake" in done.stderr
    assert "note: gone: no camera" in done.stderr
    assert "a THETA does so in client mode" in done.stderr
    assert "osc:192.168.1.1" in done.stderr
