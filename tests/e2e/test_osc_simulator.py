"""The simulated THETA, by clients that others wrote: npm's osc-client, Python's digest, FFmpeg."""

import contextlib
import http.client
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from harness import BUILD, LONG_S, wait_for
from lightprobe.errors import UsageError
from lightprobe.sim import scenes
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.server import BOUNDARY, OscServer
from lightprobe.sim.osc.white_balance import factors_of
from lightprobe.sim.world import Behaviour, World

HERE = Path(__file__).parent
LOGIN = ("THETAYN10100001", "10100001")
AFTER_OPTIONS_S = 1.05  # commands/camera.set_options.md


@pytest.fixture(scope="module")
def world() -> World:
    return World(scenes.load(["procedural:1"]), Behaviour(act_s=0), 30.0)


@contextlib.contextmanager
def theta(world, faults="", login=None, **about):
    camera = OscCamera(world, faults=OscFaults().merged(faults), **about)
    with OscServer(camera, ("127.0.0.1", 0), login) as server:
        yield Theta(server)


class Theta:
    """Requests to one camera."""

    def __init__(self, server):
        self.camera, self.port = server.camera, server.port
        self.url = f"http://127.0.0.1:{server.port}"

    def post(self, path, body=None, opener=urllib.request.urlopen):
        """Status and JSON."""
        data = json.dumps(body or {}).encode()
        request = urllib.request.Request(
            self.url + path, data, {"Content-Type": "application/json"}
        )
        try:
            with opener(request, timeout=LONG_S) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            text = error.read()
            return error.code, json.loads(text) if text else {}

    def execute(self, name, **parameters):
        return self.post("/osc/commands/execute", {"name": name, "parameters": parameters})

    def set(self, **options):
        status, answer = self.execute("camera.setOptions", options=options)
        return answer["error"]["code"] if status != 200 else "done"

    def live(self):
        """An open live preview."""
        body = b'{"name": "camera.getLivePreview"}'
        request = urllib.request.Request(self.url + "/osc/commands/execute", body)

        def begun():
            try:
                return urllib.request.urlopen(request, timeout=LONG_S)
            except urllib.error.HTTPError as error:
                if error.code != 503:
                    raise
                return None

        return wait_for(begun, "the live preview does not begin")

    def pictures(self, count):
        """So many pictures of the live preview, split without regard to any length."""
        data, delimiter = b"", BOUNDARY.encode()
        with self.live() as stream:
            while data.count(delimiter) <= count and (more := stream.read1(65536)):
                data += more
        parts = data.split(delimiter)[1 : count + 1]
        return [part.partition(b"\r\n\r\n")[2].rstrip(b"-").removesuffix(b"\r\n") for part in parts]


def brightness(picture):
    return float(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE).mean())


def test_the_npm_client_understands_it(world):
    modules = BUILD / "osc_client" / "node_modules"
    assert modules.is_dir(), "the npm package is missing: make build/osc_client/stamp"
    with theta(world) as camera:
        done = subprocess.run(
            ["node", HERE / "osc_client" / "check.js", "127.0.0.1", str(camera.port)],
            env=os.environ | {"NODE_PATH": str(modules)}, capture_output=True, timeout=LONG_S,
            check=True,
        )  # fmt: skip
        report = json.loads(done.stdout)
        assert report["info"]["model"] == "RICOH THETA X"
        assert report["state"]["state"]["batteryLevel"] == 0.8
        assert report["set"]["state"] == "done"
        assert report["options"]["results"]["options"]["shutterSpeed"] == 0.004
        assert 3200 in report["options"]["results"]["options"]["isoSupport"]
        assert report["wrongValue"]["code"] == "invalidParameterValue"
        assert report["wrongName"]["code"] == "invalidParameterName"
        assert report["wrongCommand"]["code"] == "unknownCommand"
        url = report["picture"]["results"]["fileUrl"]  # it polled until the picture was taken
        with urllib.request.urlopen(camera.url + url) as answer:
            assert cv2.imdecode(np.frombuffer(answer.read(), np.uint8), 1).shape == (512, 512, 3)
        assert camera.camera.options.get("exposureProgram") == 2  # the client has reset it


def test_ffmpeg_reads_the_live_preview(world):
    with theta(world) as camera:
        stream = cv2.VideoCapture(f"{camera.url}/getLivePreview", cv2.CAP_FFMPEG)
        for _ in range(5):
            found, picture = stream.read()
            assert found
            assert picture.shape == (512, 512, 3)
        stream.release()


def digest_opener(camera, user, password):
    passwords = urllib.request.HTTPPasswordMgrWithDefaultRealm()
    passwords.add_password(None, camera.url, user, password)
    return urllib.request.build_opener(urllib.request.HTTPDigestAuthHandler(passwords)).open


def test_digest_as_python_answers_it(world):
    with theta(world, "nonce_uses=1", LOGIN) as camera:
        opener = digest_opener(camera, *LOGIN)
        for _ in range(3):  # each time the nonce is stale
            assert camera.post("/osc/state", opener=opener)[0] == 200
        assert camera.post("/osc/state")[0] == 401
        assert camera.post("/osc/state", opener=digest_opener(camera, "THETA", "x"))[0] == 401


def test_exposure_is_manual_and_late(world):
    with theta(world, delay_frames=6) as camera:
        assert camera.set(shutterSpeed=0.001) == "invalidParameterValue"  # it is automatic
        assert camera.set(exposureProgram=1, shutterSpeed=0.001) == "done"
        assert camera.set(shutterSpeed=0.0011) == "invalidParameterValue"
        dark = brightness(camera.pictures(1)[0])
        data, seen = b"", []
        with camera.live() as stream:
            while len(seen) < 40:
                data += stream.read1(65536)
                *parts, data = data.split(BOUNDARY.encode())
                seen += [brightness(p.partition(b"\r\n\r\n")[2]) for p in parts if len(p) > 9]
                if len(seen) == 10:
                    assert camera.set(shutterSpeed=0.008) == "done"
        changed = next(k for k, value in enumerate(seen) if value > 1.5 * dark)
        assert changed >= 10 + 6
        assert seen[-1] > 1.5 * dark


def test_each_mode_has_its_own_settings(world):
    with theta(world) as camera:
        assert camera.set(exposureProgram=1) == "done"
        assert camera.set(captureMode="video") == "done"
        assert camera.set(exposureProgram=1) == "serviceUnavailable"  # the mode is changing
        wait_for(lambda: camera.set(sleepDelay=180) == "done", "the mode does not change")
        names = ["exposureProgram", "shutterSpeedSupport"]
        options = camera.execute("camera.getOptions", optionNames=names)[1]["results"]["options"]
        assert options == {"exposureProgram": 2, "shutterSpeedSupport": [0]}
        assert camera.set(exposureProgram=1) == "done"
        options = camera.execute("camera.getOptions", optionNames=names)[1]["results"]["options"]
        speeds = options["shutterSpeedSupport"]
        assert (speeds[0], speeds[-1]) == (0.0000625, 0.03333333)
        assert camera.set(shutterSpeed=0.0625, iso=100) == "invalidParameterValue"
        assert camera.camera.options.get("iso") == 50  # all or none


def test_one_command_at_a_time(world):
    with theta(world, "slow_ms=2000") as camera:
        answers = []
        threads = [
            threading.Thread(target=lambda: answers.append(camera.set(sleepDelay=180)))
            for _ in range(6)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(LONG_S)
        assert "done" in answers
        assert "serviceUnavailable" in answers


def test_a_button_and_sleep_end_the_stream(world):
    with theta(world, "sleep_s=2") as camera:
        with camera.live() as stream:
            assert stream.read(1) == b"-"
            camera.camera.press("mode")
            assert stream.read().endswith(b"\r\n")
        assert camera.camera.options.mode == "video"
        with camera.live() as stream:
            stream.read()  # ends when it falls asleep, though pictures are watched
        assert camera.camera.is_asleep()
        with socket.create_connection(("127.0.0.1", camera.port)) as connection:
            connection.sendall(b"GET /osc/info HTTP/1.1\r\nHost: x\r\n\r\n")
            with contextlib.suppress(ConnectionError):
                assert connection.recv(1) == b""
        camera.camera.press("capture")
        assert camera.post("/osc/state")[0] == 200


@pytest.mark.parametrize(
    "faults", ["", "pieces=1", "wrong_length=1", "no_length=1", "bare_boundary=1", "burst_ms=300"]
)
def test_pictures_are_whole_however_they_are_sent(world, faults):
    with theta(world, faults) as camera:
        for picture in camera.pictures(4):
            assert picture.startswith(b"\xff\xd8")
            assert picture.endswith(b"\xff\xd9")


def test_the_stream_ends_changes_its_size_or_falls_silent(world):
    with theta(world, "end_after=3&size_after=2") as camera:
        sizes = [
            cv2.imdecode(np.frombuffer(picture, np.uint8), 0).shape
            for picture in camera.pictures(9)
        ]
        assert sizes == [(512, 512), (512, 512), (256, 256)]


def test_what_it_refuses(world):
    for faults, code in (("charging=1", "disabledCommand"), ("hot=1", "disabledCommand"),
                         ("other_make=1", "unknownCommand")):  # fmt: skip
        with theta(world, faults) as camera:
            status, answer = camera.execute("camera.getLivePreview")
            assert (status, answer["error"]["code"]) == (400 if "make" in faults else 403, code)
    with theta(world) as camera:
        camera.camera.press("playback")
        assert camera.execute("camera.getLivePreview")[1]["error"]["code"] == "disabledCommand"
        assert camera.set(_cameraMode="capture") == "done"
        camera.live().close()
        with pytest.raises(UsageError, match="osc x: expected shutter"):
            camera.camera.press("x")


def test_the_image_processing_of_each_model(world):
    """As RICOH publishes it: options/_filter.md, options/_top_bottom_correction.md."""
    with theta(world, model="z1") as camera:
        assert camera.set(_filter="hdr") == "done"
        assert camera.set(exposureProgram=1) == "done"
        assert camera.camera.options.get("exposureProgram") == 2  # the filter has priority
        assert camera.set(_filter="off") == camera.set(exposureProgram=1) == "done"
        assert camera.camera.options.get("exposureProgram") == 1
        assert camera.set(_topBottomCorrection="Disapply") == "done"
        camera.camera.options.force("captureMode", "video")
        assert camera.set(_filter="off") == "disabledCommand"
        assert camera.set(_topBottomCorrection="Apply") == "disabledCommand"
    with theta(world, model="x") as camera:
        assert camera.set(_filter="DR Comp") == "invalidParameterValue"
        camera.camera.options.force("captureMode", "video")
        assert camera.set(_topBottomCorrection="Disapply") == "done"
    with theta(world, model="sc") as camera:
        assert camera.set(_topBottomCorrection="Apply") == "invalidParameterName"


def test_a_lost_network_says_nothing_and_comes_back(world):
    with theta(world, "network_after=3&network_s=1.5") as camera:
        with camera.live() as stream, pytest.raises(http.client.IncompleteRead):
            stream.read()
        assert camera.camera.frames == 3
        assert camera.post("/osc/state")[0] == 200


def test_white_balance_in_kelvin():
    assert factors_of(6500) == pytest.approx((1, 1, 1))
    red, _, blue = factors_of(2800)  # makes the light of a bulb white
    assert red < 0.65
    assert blue > 2
    red, _, blue = factors_of(9000)
    assert red > 1 > blue


# ---------------------------------------------------------------- the command


def simulate(*arguments, **popen):
    command = [sys.executable, "-m", "lightprobe", "simulate", "--scenes", "procedural:1"]
    return subprocess.Popen(
        [*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        **popen,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--firmware", "host"], "--firmware host: the camera of --osc is a THETA"),
        (["--format", "YUYV"], "--format YUYV: the camera of --osc is a THETA"),
        (["--osc-model", "y"], "expected x, z1, v, sc"),
        (["--faults", "stuck=1"], "unknown option stuck"),
        (["--osc-password-file", "{}"], "line 1: expected USER:PASSWORD"),
    ],
)
def test_what_the_command_refuses(tmp_path, arguments, words):
    empty = tmp_path / "empty"
    empty.touch()
    process = simulate("--osc", 0, *(word.format(empty) for word in arguments))
    _, err = process.communicate(timeout=LONG_S)
    assert process.returncode == 2
    assert words in err


def test_the_command_serves_and_is_steered():
    with tempfile.TemporaryDirectory(prefix="lp-") as folder:  # socket paths are short
        control = Path(folder) / "control"
        process = simulate("--osc", 0, "--osc-model", "z1", "--control", control, "--json")
        words = process.stderr.readline()
        assert "RICOH THETA Z1 on port" in words
        port = int(words.split(" on port ")[1].split(":")[0])
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/osc/info") as answer:
            assert json.load(answer)["model"] == "RICOH THETA Z1"
        steer = [sys.executable, "-m", "lightprobe", "control"]
        subprocess.run([*steer, "press", control, "mode"], check=True, timeout=LONG_S)
        done = subprocess.run(
            [*steer, "status", control], check=True, timeout=LONG_S, capture_output=True, text=True
        )
        assert json.loads(done.stdout)["options"]["captureMode"] == "video"
        process.terminate()
        out, _ = process.communicate(timeout=LONG_S)
    assert process.returncode == 0
    assert json.loads(out) == {"frames": 0, "commands": 0}
