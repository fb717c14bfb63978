"""Pictures as cameras deliver them on a bad day: the daemon counts, says so, and goes on."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from harness import STALE, Daemon, camera, jpeg, panorama, pfm, streaming, wait_for
from lightprobe_proto import lightprobe_pb2 as pb

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
GOOD = jpeg()
State = pb.Health.SourceState


def says_its_age(estimate):
    """STALE exactly if it is older than its time to live, as on a busy machine fresh ones are."""
    return bool(estimate.flags & STALE) == (estimate.send_delay_us > 1000 * estimate.ttl_ms)


@pytest.fixture
def probe():
    """A camera on sim:, a daemon on it, and a client that asks for health."""
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}?late_ms=5&drop=0", "--ttl-ms=300") as daemon,
    ):
        assert cam.accept() == "hello late_ms=5&drop=0"
        with daemon.client(health_period_ms=100) as client:
            assert client.next().protocol_major == 1
            yield cam, daemon, client


def test_frames_become_estimates(probe):
    cam, _, client = probe
    for number in range(1, 6):
        cam.send(GOOD, exposure_us=2000)
        estimate = client.until(lambda e, n=number: e.sequence == n)
        assert estimate.exposure_us == 2000
        assert says_its_age(estimate)
    health = client.until(lambda h: h.estimates == 5, "health")
    assert health.source_state == State.STREAMING
    assert (health.frames_received, health.frames_rejected) == (5, 0)
    assert health.rss_kib > 1000


BAD_FRAMES = {
    "garbage": {"payload": b"\x00\x01garbage" * 100},
    "truncated JPEG": {"payload": GOOD[: len(GOOD) // 2]},
    "JPEG header only": {"payload": GOOD[:100]},
    "empty JPEG": {"payload": b""},
    "marked corrupt": {"payload": GOOD, "flags": 1},
    "YUYV of the wrong size": {"payload": bytes(1000), "format": "YUYV"},
    "NV12 of the wrong size": {"payload": bytes(1000), "format": "NV12"},
    "GREY of the wrong size": {"payload": bytes(1000), "format": "GREY"},
    "floats of the wrong size": {"payload": bytes(1000), "format": "RGBF"},
    "no pixels": {"payload": bytes(1), "format": "GREY", "width": 1, "height": 1},
}


@pytest.mark.parametrize("name", BAD_FRAMES)
def test_a_bad_frame_in_the_middle_of_a_stream(probe, name):
    cam, daemon, client = probe
    cam.send(GOOD)
    client.until(lambda e: e.sequence == 1)
    frame = dict(BAD_FRAMES[name])
    cam.send(frame.pop("payload"), **frame)
    health = client.until(lambda h: h.frames_received == 2, "health")
    health = client.until(lambda h: h.frames_rejected + h.estimates == 2, "health")
    cam.send(GOOD)
    good = client.until(lambda e: e.sequence == health.estimates + 1)
    assert len(good.lights) >= 1
    assert daemon.alive()
    if health.frames_rejected:
        assert any(line.startswith(("error ", "warning ")) for line in daemon.log().splitlines())


def test_corrupt_frames_before_the_first_good_one_are_counted(probe):
    cam, daemon, client = probe
    cam.send(GOOD, flags=1)
    cam.send(GOOD, flags=1)
    health = client.until(lambda h: h.frames_rejected == 2, "health")
    assert health.frames_received == 2
    assert health.source_state != health.STREAMING
    cam.send(GOOD)
    health = client.until(lambda h: h.estimates == 1, "health")
    assert health.source_state == health.STREAMING
    assert (health.frames_received, health.frames_rejected, health.frames_dropped) == (3, 2, 0)
    assert daemon.log().count("frames arrive") == 1


def test_floats_that_are_no_numbers(probe):
    cam, daemon, client = probe
    radiance = np.full((64, 128, 3), 1.0, np.float32)
    radiance[10, 10] = np.nan
    radiance[20, 20] = np.inf
    radiance[30, 30] = -5
    cam.send(radiance.tobytes(), format="RGBF")
    estimate = client.next("estimate")
    assert np.isfinite(estimate.sh.coefficients).all()
    assert estimate.flags & 128  # INVALID_INPUT
    cam.send(np.full((64, 128, 3), np.nan, np.float32).tobytes(), format="RGBF")
    cam.send(GOOD)
    assert np.isfinite(client.until(lambda e: not e.flags & 128).sh.coefficients).all()
    assert daemon.alive()


def test_black_and_white_pictures(probe):
    cam, daemon, client = probe
    for level in (0, 255):
        cam.send(jpeg(np.full((64, 128, 3), level, np.uint8)))
        assert np.isfinite(client.next("estimate").sh.coefficients).all()
    assert daemon.alive()


def test_size_and_format_may_change_in_mid_stream(probe):
    cam, _, client = probe
    cam.send(GOOD)
    client.until(lambda e: e.sequence == 1)
    cam.send(jpeg(panorama(256)), width=256, height=128)
    client.until(lambda e: e.sequence == 2)
    cam.send(bytes([100]) * 64 * 32, format="GREY", width=64, height=32)
    client.until(lambda e: e.sequence == 3)
    cam.send(GOOD)
    client.until(lambda e: e.sequence == 4)


def test_the_same_error_is_logged_once(probe):
    cam, daemon, client = probe
    for _ in range(50):
        cam.send(b"garbage")
    client.until(lambda h: h.frames_received == 50, "health")
    time.sleep(0.3)
    assert daemon.log().count("error ") <= 2


def test_silence_makes_the_last_estimate_stale(probe):
    cam, daemon, client = probe
    cam.send(GOOD)
    fresh = client.until(lambda e: e.sequence == 1)
    stale = client.until(lambda e: e.flags & STALE)
    assert stale.sequence == 1
    assert stale.sh == fresh.sh
    assert stale.send_delay_us > 200_000
    with daemon.client() as late:
        assert late.next("estimate").flags & STALE
    health = client.until(lambda h: h.source_state == State.STALLED, "health")
    assert health.faults[0].id == "source-stalled"
    assert "no frame for 2 s" in health.faults[0].text
    cam.send(GOOD)
    assert says_its_age(client.until(lambda e: e.sequence == 2))
    assert len(client.until(lambda h: h.source_state == State.STREAMING, "health").faults) == 0


def test_unplugged_and_plugged_in_again(probe):
    cam, daemon, client = probe
    cam.send(GOOD)
    client.until(lambda e: e.sequence == 1)
    cam.send(GOOD, cut=100)  # dies in the middle of a frame
    cam.unplug()
    health = client.until(lambda h: h.source_state == State.WAITING, "health")
    assert health.faults[0].id == "source-waiting"
    assert "the simulator has gone" in health.faults[0].text
    assert client.until(lambda e: e.flags & STALE).sequence == 1
    cam.accept()
    cam.send(GOOD)
    assert says_its_age(client.until(lambda e: e.sequence == 2))
    health = client.until(lambda h: h.source_reconnects == 1, "health")
    assert health.source_state == State.STREAMING
    assert daemon.alive()


def test_a_camera_that_talks_nonsense(probe):
    cam, daemon, client = probe
    cam.link.sendall(b"nonsense" * 100)
    client.until(lambda h: h.source_state == State.WAITING, "health")
    cam.accept()
    cam.send(GOOD)
    client.until(lambda e: e.sequence == 1)
    assert "header: does not begin with LPF1" in daemon.log()


def test_a_frame_larger_than_allowed(probe):
    cam, _, client = probe
    cam.send(b"", claim=1 << 40)
    client.until(lambda h: h.source_state == State.WAITING, "health")


@pytest.mark.parametrize("length", [12, 90, 95, 96, 97])
def test_a_fault_can_be_read_whatever_the_path_is_called(length):
    """Names of files are bytes; texts on the wire are UTF-8, and no longer than their field."""
    path = os.fsdecode((b"/tmp/\xff" + 40 * "€".encode())[:length])
    with Daemon(f"--source=sim:{path}") as daemon, daemon.client(health_period_ms=100) as client:
        health = client.until(lambda h: h.faults, "health")
        assert health.faults[0].id == "source-waiting"
        assert health.faults[0].text.startswith("sim: /tmp/?€")
        assert health.faults[0].text.endswith("Trying again")


def test_a_second_daemon_on_one_simulator_says_why_it_waits(tmp_path):
    """And it takes its turn when the first one has left."""
    socket = tmp_path / "camera"
    command = [LIGHTPROBE, "simulate", "--socket", socket, "--size", "64x32", "--act-s", "0"]
    with subprocess.Popen(command) as simulator:
        wait_for(socket.exists, "a simulator")
        with Daemon(f"--source=sim:{socket}") as first, first.client() as client:
            client.next("estimate")
            with (
                Daemon(f"--source=sim:{socket}") as second,
                second.client(health_period_ms=100) as waiting,
            ):
                health = waiting.until(lambda h: h.faults, "health")
                assert health.source_state == State.WAITING
                assert [fault.id for fault in health.faults] == ["source-waiting"]
                busy = "connect: busy — another lightprobed has this simulator"
                assert busy in health.faults[0].text
                assert busy in second.log()
                number = client.next("estimate").sequence
                client.until(lambda e: e.sequence > number + 10)  # the first one is served on
                first.stop()
                waiting.next("estimate")
                waiting.until(lambda h: not h.faults, "health")
        simulator.send_signal(signal.SIGINT)


def test_waits_for_a_camera_that_is_absent():
    with camera() as cam:
        cam.close()
        with (
            Daemon(f"--source=sim:{cam.path}") as daemon,
            daemon.client(health_period_ms=100) as client,
        ):
            health = client.until(lambda h: h.source_state == State.WAITING, "health")
            assert "connect: No such file or directory" in health.faults[0].text
            assert "lightprobe simulate" in health.faults[0].text
            assert daemon.alive()


def test_exposure_is_commanded_at_every_connection():
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", "--exposure-us=2500", "--gain=2"),
    ):
        for _ in range(2):
            assert cam.accept() == "hello "
            cam.send(GOOD)
            assert cam.line() == "exposure 2500 2"
            cam.unplug()


def test_newest_frame_wins_and_the_rest_is_counted():
    big = jpeg(panorama(2048))
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", "--preset=reference") as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        cam.accept()
        with streaming(cam, big, rate_hz=500, width=2048, height=1024):
            health = client.until(lambda h: h.frames_dropped > 5, "health")
        assert health.frames_received >= health.estimates + health.frames_dropped


def test_mjpeg_stream_with_damage(tmp_path):
    """From a file: garbage between pictures, one cut off, one of another size."""
    stream = GOOD + b"\0garbage\xff" + GOOD[:700] + GOOD + jpeg(panorama(256)) + GOOD
    (tmp_path / "a.mjpeg").write_bytes(stream)
    with (
        Daemon(f"--source=file:{tmp_path}/a.mjpeg?rate=20&loop=1") as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        client.until(lambda h: h.estimates > 10 and h.frames_rejected >= 2, "health")
        assert "bytes that belong to no picture are skipped" in daemon.log()
        assert "a picture is cut off or damaged" in daemon.log()


def test_a_finite_file_ends_and_its_estimate_stays(tmp_path):
    (tmp_path / "a.pfm").write_bytes(pfm(np.full((64, 128), 1.0, np.float32)))
    with (
        Daemon(f"--source=file:{tmp_path}/a.pfm?loop=0", "--ttl-ms=200") as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        client.until(lambda h: h.source_state == State.ENDED, "health")
        assert client.until(lambda e: e.flags & STALE).sequence == 1
        assert daemon.alive()


def test_a_file_that_vanishes_while_it_plays(tmp_path):
    picture = tmp_path / "a.jpg"
    picture.write_bytes(GOOD)
    with (
        Daemon(f"--source=file:{picture}?rate=100", "--ttl-ms=200") as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        client.next("estimate")
        picture.unlink()
        health = client.until(lambda h: h.source_state == State.DOWN, "health")
        assert health.faults[0].id == "source-down"
        assert client.until(lambda e: e.flags & STALE)
        wait_for(lambda: "open: No such file" in daemon.log(), "the reason in the log")
        assert daemon.alive()
