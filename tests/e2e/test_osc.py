"""The daemon on a camera that follows Open Spherical Camera, with all that goes wrong with one."""

import contextlib
import itertools
import math
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest
from harness import Daemon, run
from lightprobe import wire
from lightprobe.calibrate import camera_file, exposure_series
from lightprobe.cli import doctor, view
from lightprobe.client import Client
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate.evaluation import reference
from lightprobe.sim import scenes
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.options import RefusedError
from lightprobe.sim.osc.server import OscServer
from lightprobe.sim.world import Behaviour, World
from lightprobe_proto import lightprobe_pb2 as pb

State = pb.Health.SourceState
LOGIN = ("THETAYN10100001", "10100001")
#: The simulated camera's change of mode; how often it is asked meanwhile; what it wants to pass
#: between options and live preview (RICOH's commands/camera.set_options.md).
MODE_S, BUSY_PAUSE_S, AFTER_OPTIONS_S = 1.5, 0.1, 1.0
#: What a camera is when nobody has touched it.
FACTORY = {"captureMode": "image", "exposureProgram": 2, "shutterSpeed": 0, "iso": 0,
           "whiteBalance": "auto", "_colorTemperature": 5000, "sleepDelay": 180, "offDelay": 600,
           "previewFormat": {"width": 512, "height": 512, "framerate": 30},
           "_topBottomCorrection": "Apply"}  # fmt: skip


@pytest.fixture(scope="module")
def world() -> World:
    return World(scenes.load(["room"]), Behaviour(act_s=0), 4.0)


@contextlib.contextmanager
def theta(world, faults="", login=None, port=0, **about):
    camera = OscCamera(world, faults=OscFaults().merged(faults), **about)
    if camera.faults.playback:
        camera.press("playback")
    with OscServer(camera, ("127.0.0.1", port), login) as server:
        yield camera, server.port


@contextlib.contextmanager
def probing(port, keys="", size="1024x512"):
    size = f"&size={size}" if size else ""
    with (
        Daemon(
            f"--source=osc:127.0.0.1:{port}?stall_ms=1500{size}{keys}", "--ttl-ms=300"
        ) as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        yield daemon, client


def options(camera, *names):
    return {name: camera.options.get(name) for name in (names or FACTORY)}


def fault(client, fault_id):
    """Wait for a fault; gives its text."""
    health = client.until(lambda h: any(f.id == fault_id for f in h.faults), "health")
    return next(f.text for f in health.faults if f.id == fault_id)


def test_light_from_a_theta(world):
    """Manual, held, bracketed, right; and as it was before, at the end."""
    with theta(world) as (camera, port):
        assert options(camera) == FACTORY
        with probing(port) as (daemon, client):
            client.until(lambda e: e.exposure_count >= 2)
            held = options(camera, "captureMode", "exposureProgram", "iso", "whiteBalance",
                           "_colorTemperature", "sleepDelay")  # fmt: skip
            assert held == {
                "captureMode": "video", "exposureProgram": 1, "iso": 50,
                "whiteBalance": "_colorTemperature", "_colorTemperature": 6500, "sleepDelay": 65535,
            }  # fmt: skip
            truth = reference(world.scenes[0])

            def is_right(message):
                packet = pb.FromProbe(estimate=message).SerializeToString()
                return truth.score(wire.decode(packet)).relighting_mae < 0.02

            client.until(is_right)
            assert client.until(lambda h: h.estimates > 0, "health").frames_rejected == 0
            daemon.stop()
            assert "as they were" in daemon.log()
        assert options(camera) == FACTORY


class Watched(OscCamera):
    """Notes, by its own clock, when it was asked for what, and what it refused."""

    def __init__(self, world):
        super().__init__(world)
        self.asked = []

    def note(self, name, call):
        try:
            answer = call()
        except RefusedError as refused:
            self.asked.append((time.monotonic(), name, refused.code))
            raise
        self.asked.append((time.monotonic(), name, "done"))
        return answer

    def execute(self, name, parameters):
        return self.note(name, lambda: super(Watched, self).execute(name, parameters))

    def begin_preview(self):
        return self.note("camera.getLivePreview", super().begin_preview)


def test_no_time_is_lost_before_the_first_estimate(world):
    """Only the camera's change of mode is waited for, and the second that RICOH asks for after
    options: as what is asked in between tells, and the shortest of some pauses, which a busy
    machine only makes longer."""
    camera = Watched(world)
    with OscServer(camera, ("127.0.0.1", 0)) as server, probing(server.port) as (_, client):
        client.until(lambda e: e.exposure_count >= 1)
        begun = [name for _, name, _ in camera.asked].index("camera.getLivePreview")
        refused = [at_s for at_s, _, code in camera.asked[:begun] if code != "done"]
        assert 2 <= len(refused) <= MODE_S / BUSY_PAUSE_S + 1
        assert min(b - a for a, b in itertools.pairwise(refused)) < 1.5 * BUSY_PAUSE_S
        assert begun - len(refused) <= 11
        for _ in range(4):
            health = client.until(lambda h: h.source_state == State.STREAMING, "health")
            camera.end_preview()
            received = health.frames_received
            client.until(lambda h, n=received: h.frames_received > n + 20, "health")
    pauses = []
    for (set_s, name, code), (asked_s, after, _) in itertools.pairwise(camera.asked):
        if (name, code, after) == ("camera.setOptions", "done", "camera.getLivePreview"):
            pauses.append(asked_s - set_s)
    assert all(code == "done" for _, name, code in camera.asked if name == "camera.getLivePreview")
    assert len(pauses) >= 5
    assert AFTER_OPTIONS_S <= min(pauses) < AFTER_OPTIONS_S + 0.05


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    "faults",
    ["pieces=1", "wrong_length=1", "no_length=1&pieces=1", "bare_boundary=1", "busy=0.3",
     "slow_ms=300&delay_jitter_frames=3", "late_ms=150&jitter_ms=60", "burst_ms=400"],
)  # fmt: skip
def test_networks_and_cameras_as_they_are(world, faults):
    with theta(world, faults) as (_, port), probing(port) as (_, client):
        client.until(lambda e: e.exposure_count >= 2)
        health = client.until(lambda h: h.frames_received > 60, "health")
        assert health.frames_rejected == 0


def test_damaged_pictures_are_counted(world):
    faults = "truncate=0.2&garbage=0.1&drop=0.1"
    with theta(world, faults) as (_, port), probing(port) as (_, client):
        client.until(lambda h: h.frames_rejected > 5 and h.estimates > 20, "health")


def test_only_damaged_pictures_are_a_stall(world):
    with theta(world, "truncate=1") as (camera, port), probing(port) as (_, client):
        assert "only corrupt frames" in fault(client, "source-stalled")
        camera.misbehave("truncate=0")
        client.until(lambda h: h.source_state == State.STREAMING, "health")


@pytest.mark.parametrize("button", ["shutter", "mode"])
def test_a_hand_on_the_camera(world, button):
    with theta(world) as (camera, port), probing(port) as (_, client):
        client.until(lambda e: e.exposure_count >= 1)
        camera.press(button)
        assert "a button, a picture, a change" in fault(client, "source-stalled")
        client.until(lambda h: h.source_state == State.STREAMING, "health")
        assert camera.options.mode == "video"


def test_a_stream_that_ends_again_and_again(world):
    with theta(world, "end_after=20") as (_, port), probing(port) as (_, client):
        client.until(lambda h: h.frames_received > 45, "health")


def test_a_stream_that_changes_its_size(world):
    with theta(world, "size_after=20") as (camera, port):
        with probing(port) as (_, client):
            assert "pictures of 512x256 came instead of 1024x512" in fault(client, "source-stalled")
            client.until(lambda h: h.source_state == State.STREAMING, "health")
        assert options(camera) == FACTORY


def test_the_network_is_lost_and_comes_back(world):
    """What the camera was is remembered beyond the loss."""
    with theta(world, "network_after=30") as (camera, port):
        with probing(port) as (_, client):
            client.until(lambda h: h.source_state == State.STREAMING, "health")
            assert "no frame for 1500 ms" in fault(client, "source-stalled")
            assert "is the camera awake" in fault(client, "source-waiting")
            camera.misbehave("network_after=0")
            health = client.until(lambda h: h.source_state == State.STREAMING, "health")
            assert health.source_reconnects >= 1
        assert options(camera) == FACTORY


def test_a_reset_connection(world):
    with theta(world, "disconnect_after=15") as (_, port), probing(port) as (_, client):
        assert "the connection broke" in fault(client, "source-waiting")
        client.until(lambda h: h.frames_received > 40, "health")


def test_it_is_kept_awake(world):
    """A camera that would sleep after two seconds does not."""
    with theta(world, "sleep_s=2") as (camera, port), probing(port) as (_, client):
        client.until(lambda h: h.source_state == State.STREAMING, "health")
        begun = camera.frames
        client.until(lambda h: camera.frames > begun + 150, "health")
        assert not camera.is_asleep()


def test_another_camera_comes_to_the_address(world):
    """Each gets back its own options, and none those of the other."""
    with theta(world) as (first, port), probing(port) as (_, client):
        client.until(lambda h: h.source_state == State.STREAMING, "health")
        first.press("capture")
    with theta(world) as (camera, port), probing(port) as (daemon, client):
        client.until(lambda h: h.source_state == State.STREAMING, "health")
        camera.serial = "YN20200002"
        camera.options.reset()
        camera.options.set({"offDelay": 7200})
        camera.end_preview()
        client.until(lambda h: "YN20200002" in daemon.log(), "health")
        client.until(lambda h: camera.options.get("offDelay") == 65535, "health")
        daemon.stop()
        assert options(camera) == FACTORY | {"offDelay": 7200}


def password_file(tmp_path, user, password):
    path = tmp_path / "password"
    path.write_text(f"{user}:{password}\n")
    path.chmod(0o600)
    return path


def test_a_password(world, tmp_path):
    with theta(world, "nonce_uses=3", LOGIN) as (camera, port):
        with probing(port) as (_, client):
            assert "asks for a password" in fault(client, "source-down")
        wrong = password_file(tmp_path, LOGIN[0], "no")
        with probing(port, f"&password_file={wrong}") as (_, client):
            assert "refuses user or password" in fault(client, "source-down")
        assert options(camera) == FACTORY
        with probing(port, f"&password_file={password_file(tmp_path, *LOGIN)}") as (daemon, client):
            client.until(lambda e: e.exposure_count >= 2)
            assert LOGIN[1] not in daemon.log().replace(camera.serial, "")
        assert options(camera) == FACTORY


REFUSALS = {
    "other_make=1": ("source-down", "Insta360 X4 (firmware 1.1.6) has no live preview"),
    "charging=1": ("source-waiting", "leave playback, settings, charging or USB mode"),
    "hot=1": ("source-waiting", "or let the camera cool"),
}


@pytest.mark.nightly_rows
@pytest.mark.parametrize("faults", REFUSALS)
def test_cameras_that_give_no_live_preview(world, faults):
    fault_id, text = REFUSALS[faults]
    with theta(world, faults) as (camera, port):
        with probing(port, size="") as (_, client):
            assert text in fault(client, fault_id)
        if camera.model.formats:  # nothing is left behind
            assert options(camera) == FACTORY


def test_playback_is_left(world):
    with theta(world, "playback=1") as (camera, port), probing(port) as (_, client):
        client.until(lambda h: h.source_state == State.STREAMING, "health")
        assert camera.options.get("_cameraMode") == "capture"


def test_an_old_firmware(world):
    """No manual exposure of movies: relative light, and a word about it."""
    with (
        theta(world, "old_firmware=1") as (camera, port),
        probing(port, size="") as (daemon, client),
    ):
        client.until(lambda e: e.sequence > 3)
        assert "has no manual exposure in the mode 'video'" in daemon.log()
    assert options(camera) == FACTORY


def test_a_model_without_movies(world):
    with theta(world, model="sc") as (_, port):
        with probing(port, size="") as (_, client):
            assert "has no mode 'video' — try mode=image" in fault(client, "source-down")
        with probing(port, "&mode=image", size="640x320") as (_, client):
            client.until(lambda e: e.sequence > 3)


def processing_of(daemon):
    """What the daemon says that the camera does to its pictures, once it knows."""
    with daemon.client() as client:
        return list(client.next("hello").processing)


def test_processing_is_switched_off_and_put_back(world):
    """Above all an image filter, with which a THETA knows no manual exposure."""
    with theta(world, model="z1") as (camera, port):
        before = {"_filter": "hdr", "_topBottomCorrection": "ApplyAuto", "exposureProgram": 2}
        camera.options.set(before)
        with probing(port, "&mode=image") as (daemon, client):
            client.until(lambda e: e.exposure_count >= 2)
            assert options(camera, *before) == {
                "_filter": "off", "_topBottomCorrection": "Disapply", "exposureProgram": 1,
            }  # fmt: skip
            assert processing_of(daemon) == []
            assert "switched off: _filter hdr → off, _topBottomCorrection" in daemon.log()
            camera.end_preview()  # and connected again: its own values are not taken for ours
            client.until(lambda h: h.source_state == State.STALLED, "health")
            client.until(lambda h: h.source_state == State.STREAMING, "health")
            assert daemon.log().count("switched off") == 1
        assert options(camera, *before) == before


def assert_people_are_told(uri, words):
    """By `lightprobe doctor`, with the next step, and by `lightprobe watch`."""
    found = {finding.check: finding for finding in doctor.probe(uri, 60)}["processing"]
    assert (found.verdict, found.detail) == ("warn", f"the camera alters the light: {words}")
    assert "the log of lightprobed says why" in found.next_step
    with Client(uri) as client:
        client.receive(60)
        console = view.console()
        with console.capture() as capture:
            console.print(view.dashboard(client, 1.0))
        assert f"alters the light: {words}" in " ".join(capture.get().split())


@pytest.mark.parametrize(
    ("faults", "words"),
    [("refuse_processing=1", "refused: the camera does not take this value"),
     ("keep_processing=1", "off was written")],
)  # fmt: skip
def test_processing_that_stays_on_is_told(world, faults, words):
    """The light goes on, with what such a picture is worth."""
    with theta(world, faults) as (camera, port):
        camera.options.set({"_filter": "Noise Reduction"})
        with probing(port, "&mode=image") as (daemon, client):
            estimate = client.until(lambda e: e.sequence > 3)
            assert estimate.flags & EstimateFlag.EXPOSURE_UNKNOWN
            assert processing_of(daemon) == ["noise-reduction", "stabilization"]
            assert f"_filter Noise Reduction ({words}" in daemon.log()
            assert_people_are_told(f"unix:{daemon.socket}", "noise-reduction, stabilization")
            assert "switch _filter off" in daemon.log()
        assert options(camera, "_filter") == {"_filter": "Noise Reduction"}


def test_processing_that_the_mode_does_not_know(world):
    """A Z1 turns no movies upright, and says so when asked."""
    with theta(world, model="z1") as (_, port), probing(port) as (daemon, client):
        client.until(lambda e: e.exposure_count >= 2)
        assert processing_of(daemon) == ["stabilization"]
        assert "_topBottomCorrection Apply (refused" in daemon.log()


def test_processing_is_kept_on_request(world):
    with theta(world) as (camera, port):
        with probing(port, "&processing=keep&white_balance_k=0") as (daemon, client):
            client.until(lambda e: e.exposure_count >= 2)
            assert processing_of(daemon) == ["white-balance", "stabilization"]
            assert "kept, as processing=keep says: _topBottomCorrection Apply" in daemon.log()
            assert camera.options.get("_topBottomCorrection") == "Apply"
        assert options(camera) == FACTORY


def test_a_camera_file_that_was_measured_otherwise_is_told(world, tmp_path):
    """From the series of a calibration into the camera file, and back to the daemon."""
    file, folder = tmp_path / "theta.camera", tmp_path / "series"
    linear = np.repeat(np.linspace(0, 1, 256)[:, None], 3, 1)
    with theta(world) as (_, port):
        source = f"--source=osc:127.0.0.1:{port}?size=1024x512"
        assert run(source + "&processing=keep", f"--series={folder}", "--series-frames=2")[0] == 0
        processing = exposure_series.load(folder).processing
        assert processing == ("stabilization",)
        camera_file.save_response(file, (1024, 512), linear, "", processing)
        with (
            Daemon(source, f"--camera={file}") as daemon,
            daemon.client(health_period_ms=100) as client,
        ):
            text = fault(client, "camera-processing")
            assert text.endswith("lightprobe calibrate response")
            words = "was measured with stabilization on, now it is nothing — set processing=keep"
            assert words in daemon.log()
        file.write_text(file.read_text() + "\n[osc]\nprocessing = keep\n")
        with (
            Daemon(source, f"--camera={file}") as daemon,
            daemon.client(health_period_ms=100) as client,
        ):
            client.until(lambda h: h.estimates > 3, "health")
            assert not client.until(lambda _: True, "health").faults


def test_what_is_not_offered(world):
    """And nothing is left behind on a camera that was half prepared."""
    with theta(world) as (camera, port):
        with probing(port, size="1000x500") as (_, client):
            assert "1024x512 at 30" in fault(client, "source-down")
        assert options(camera) == FACTORY
        with probing(port, "&iso=51") as (_, client):
            assert "iso: 51 is not offered" in fault(client, "source-down")
            assert camera.options.mode == "video"
        assert options(camera) == FACTORY


def test_no_camera_there(world):
    class Page(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<html>a router</html>")

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Page) as page:
        threading.Thread(target=page.serve_forever, daemon=True).start()
        with probing(page.server_address[1]) as (_, client):
            assert "no Open Spherical Camera" in fault(client, "source-down")
        page.shutdown()
        port = page.server_address[1]
    with probing(port) as (_, client):
        assert "is the camera switched on" in fault(client, "source-waiting")
        with theta(world, port=port):
            client.until(lambda h: h.source_state == State.STREAMING, "health")


def test_battery_and_heat(world):
    with theta(world, "battery=0.1") as (camera, port), probing(port) as (_, client):
        assert "battery at 10 %" in fault(client, "camera-battery")
        camera.faults = OscFaults().merged("hot=1&temperature_c=74")  # and it goes on
        text = fault(client, "camera-hot")
        assert "HIGH_TEMPERATURE, board at 74 °C" in text
        camera.faults = OscFaults()
        client.until(lambda h: not h.faults, "health")
        assert np.isfinite(client.until(lambda e: e.sequence > 1).exposure_us)


def test_a_low_battery_outlives_the_connection(world):
    """Neither a new connection nor a report that says nothing of the battery ends it."""
    seen, asked = [], []
    with theta(world, "battery=0.1&network_after=60&network_s=2") as (camera, port):
        report = camera.state
        camera.state = lambda: asked.append(camera.faults.battery) or report()
        with probing(port) as (_, client):

            def until(condition):
                client.until(lambda h: seen.append(h) or condition(h), "health")

            fault(client, "camera-battery")
            until(lambda h: h.source_state == State.STALLED)
            camera.faults = OscFaults(battery=math.nan, network_s=2)
            until(lambda h: h.source_state == State.STREAMING and math.isnan(asked[-1]))
            answered = len(seen) + 5
            until(lambda _: len(seen) >= answered)
            assert all("camera-battery" in [f.id for f in h.faults] for h in seen)
            camera.faults = OscFaults()
            client.until(lambda h: not h.faults, "health")
