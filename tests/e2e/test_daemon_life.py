"""Beginning and end: signals, systemd, a reader that goes."""

import os
import signal
import socket

import pytest
from harness import Daemon, camera, jpeg, run, split, wait_for


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg())
    return path


@pytest.mark.parametrize("with_signal", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_end_it_cleanly(picture, with_signal):
    with Daemon(f"--source=file:{picture}") as daemon:
        with daemon.client() as client:
            client.next("estimate")
            assert daemon.socket.is_socket()
            assert daemon.stop(with_signal) == 0
            assert not daemon.socket.exists()
            client.wait_closed()
        assert "ending" in daemon.log()


@pytest.mark.parametrize("ignored", [signal.SIGHUP, signal.SIGINT])
def test_a_signal_that_the_parent_ignores_does_not_end_it(picture, ignored):
    """As nohup does with SIGHUP, and a shell without job control with SIGINT in the background."""

    def ignore():
        signal.signal(ignored, signal.SIG_IGN)

    with Daemon(f"--source=file:{picture}", preexec_fn=ignore) as daemon:
        with daemon.client() as client:
            client.next("estimate")
            daemon.process.send_signal(ignored)
            # Signals are delivered in the order of their numbers, so this one is the last.
            assert daemon.stop(signal.SIGTERM) == 0
        assert "signal: Terminated: ending" in daemon.log()
        assert daemon.log().count("ending") == 1


def test_signal_while_waiting_for_the_camera():
    with Daemon("--source=sim:/no/such/camera") as daemon:
        assert daemon.stop() == 0


def test_signal_before_a_set_is_complete_is_a_failure():
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", "--once") as daemon:
        cam.accept()
        assert daemon.stop() == 1


def test_ends_with_the_reader_of_its_standard_output(picture):
    with Daemon(f"--source=file:{picture}", "--publish=stdout:") as daemon:
        first = daemon.process.stdout.read(300)
        assert split(first)[0][0].WhichOneof("message") == "hello"
        daemon.process.stdout.close()
        daemon.process.stdout = None
        assert daemon.wait() == 0
        assert "stdout:: write: the reader is gone: ending" in daemon.log()


def test_a_reader_that_does_not_read_does_not_stop_it(picture):
    """The pipe fills; other clients go on; what is read at last are whole messages."""
    daemon = Daemon(f"--source=file:{picture}?rate=200", "--publish=stdout:")
    daemon.arguments.append(f"--publish=unix:{daemon.socket}")
    daemon.start()
    daemon.wait_log("listen: ")
    with daemon.client(health_period_ms=100) as client:
        client.until(lambda h: h.packets_superseded > 20, "health")
    data = b""
    os.set_blocking(daemon.process.stdout.fileno(), False)
    while True:
        chunk = daemon.process.stdout.read(1 << 20)
        if not chunk:
            break
        data += chunk
    messages, _ = split(data)
    assert len(messages) > 10
    assert daemon.stop() == 0


def test_full_disk_is_a_failure(picture):
    with open("/dev/full", "wb") as full:
        daemon = Daemon(f"--source=file:{picture}", "--publish=stdout:", stdout=full)
        assert daemon.start().wait() == 1
    assert "stdout:: write: No space left on device" in daemon.log()


class Supervisor:
    """systemd's end of the notification socket."""

    def __init__(self, folder):
        self.path = str(folder / "notify")
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(self.path)
        self.socket.settimeout(60)
        self.heard = []

    def wait(self, word):
        while not any(word in line for line in self.heard):
            self.heard += self.socket.recv(4096).decode().splitlines()
        return next(line for line in self.heard if word in line)


def test_systemd_hears_ready_status_watchdog_and_stopping(picture):
    daemon = Daemon(f"--source=file:{picture}")
    supervisor = Supervisor(daemon.folder)
    daemon.popen["env"] = {"NOTIFY_SOCKET": supervisor.path, "WATCHDOG_USEC": "400000"}
    with daemon:
        supervisor.wait("READY=1")
        daemon.client().next("estimate")  # it was true
        supervisor.heard = []
        for _ in range(3):
            supervisor.wait("WATCHDOG=1")
            supervisor.heard = []
        daemon.stop()
        supervisor.wait("STOPPING=1")


def test_watchdog_is_not_fed_while_the_worker_is_stuck():
    """One huge frame keeps the worker busy for longer than half the watchdog's patience."""
    if "WITH_SYSTEMD=1" not in run("--version")[1].decode():
        pytest.skip("built with WITH_SYSTEMD=0")
    with camera() as cam:
        daemon = Daemon(f"--source=sim:{cam.path}", "--preset=reference")
        supervisor = Supervisor(daemon.folder)
        daemon.popen["env"] = {"NOTIFY_SOCKET": supervisor.path, "WATCHDOG_USEC": "20000"}
        with daemon:
            cam.accept()
            supervisor.wait("WATCHDOG=1")
            cam.send(bytes(5000 * 2500 * 4), format="YUYV", width=5000 * 2, height=2500)
            wait_for(lambda: "watchdog: one frame has taken" in daemon.log(), "no complaint")


def test_journal_gets_priorities(picture):
    """Under systemd, standard error is the journal: levels travel as its <N> prefix."""
    daemon = Daemon("--source=file:/no/such.jpg")
    daemon.log_path.touch()
    status = daemon.log_path.stat()
    daemon.popen["env"] = {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}
    assert daemon.start().wait() == 1
    assert "<3>file: /no/such.jpg: open: No such file" in daemon.log()
    assert "<6>unix:" in daemon.log()
