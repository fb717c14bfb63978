"""The simulator over its real socket, as the daemon sees it (proto/sim.md)."""

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe.sim.link import HEADER, MAGIC

SMALL = ["--size", "256x128", "--scenes", "procedural:1", "--act-s", "0"]
LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


@contextlib.contextmanager
def simulator(tmp_path, *options, small=SMALL):
    path = tmp_path / "sim.sock"
    command = [LIGHTPROBE, "simulate", "--socket", path, *small, *options]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        yield path, process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)


class Camera:
    """What the daemon's driver does, by hand."""

    def __init__(self, path, hello=""):
        deadline = time.monotonic() + 60
        while True:
            self.socket = socket.socket(socket.AF_UNIX)
            self.socket.settimeout(30)
            try:
                self.socket.connect(str(path))
                break
            except OSError:
                self.socket.close()
                assert time.monotonic() < deadline
                time.sleep(0.05)
        self.send(f"hello {hello}\n")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send(self, text):
        self.socket.sendall(text.encode())

    def bytes(self, number):
        data = bytearray()
        while len(data) < number:
            piece = self.socket.recv(number - len(data))
            if not piece:
                raise EOFError(len(data))
            data += piece
        return bytes(data)

    def frame(self):
        names = ["magic", "header", "size", "format", "width", "height", "stride", "sequence",
                 "t_start_ns", "exposure_us", "gain", "flags", "reserved", "x", "y", "z", "w",
                 "orientation_sigma_deg", "row_time_us", "exposure_min_us", "exposure_max_us",
                 "exposure_step_us", "place_x", "place_y", "place_z",
                 "position_sigma_m"]  # fmt: skip
        header = dict(zip(names, HEADER.unpack(self.bytes(116)), strict=True))
        assert (header["magic"], header["header"]) == (MAGIC, 116)
        return header, self.bytes(header["size"])

    def frames(self, number):
        return [self.frame() for _ in range(number)]


def decode(payload):
    return cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)


def test_frames_are_pictures_with_their_time_and_exposure(tmp_path):
    with simulator(tmp_path) as (path, _), Camera(path) as camera:
        for header, payload in camera.frames(5):
            now_ns = time.monotonic_ns()
            assert (header["format"], header["width"], header["height"]) == (b"MJPG", 256, 128)
            assert decode(payload).shape == (128, 256, 3)
            assert 0 < now_ns - header["t_start_ns"] < 20e9
            assert header["exposure_us"] == pytest.approx(8333, rel=0.1)
            assert (header["gain"], header["flags"], header["stride"]) == (1, 0, 0)


def test_header_is_the_one_in_the_contract():
    assert HEADER.size == 116
    offsets = [0, 4, 8, 16, 20, 24, 28, 32, 40, 48, 52, 56, 60, 64, 80, 84, 88, 100]
    parts = [
        "4s",
        "I",
        "Q",
        "4s",
        "I",
        "I",
        "I",
        "Q",
        "q",
        "f",
        "f",
        "I",
        "I",
        "4f",
        "f",
        "f",
        "3f",
        "4f",
    ]
    assert HEADER.format == "<" + "".join(parts)
    import struct

    assert [struct.calcsize("<" + "".join(parts[:k])) for k in range(18)] == offsets


def test_the_same_seed_repeats_every_byte(tmp_path):
    runs = []
    for _ in range(2):
        changing = ["--seed", "7", "--turn-deg-s", "9", "--switch-s", "1"]
        with simulator(tmp_path, *changing) as (path, _), Camera(path) as camera:
            runs.append({header["sequence"]: payload for header, payload in camera.frames(60)})
    common = runs[0].keys() & runs[1].keys()
    assert common, "the two runs share no frame number"
    assert all(runs[0][number] == runs[1][number] for number in common)
    assert len(set(runs[0].values())) == len(runs[0])  # and no frame is another's copy


@pytest.mark.parametrize("delay", [0, 2, 4])
def test_exposure_commands_land_late(tmp_path, delay):
    with simulator(tmp_path, "--delay-frames", str(delay), "--rate", "5") as (path, _), \
            Camera(path) as camera:  # fmt: skip
        before = camera.frame()[0]
        camera.send("exposure 340 2\n")  # UVC counts in steps of 100 µs
        after = camera.frames(delay + 4)
        landed = next(h for h, _ in after if h["exposure_us"] == 300)
        assert landed["gain"] == 2
        # The frame under exposure when the command comes is not counted.
        assert landed["sequence"] - before["sequence"] in (delay + 1, delay + 2)
        assert all(h["exposure_us"] == 300 for h, _ in after if h["sequence"] > landed["sequence"])


def test_exposure_changes_the_picture(tmp_path):
    with simulator(tmp_path, "--delay-frames", "0") as (path, _), Camera(path) as camera:
        bright = decode(camera.frame()[1]).mean()
        camera.send("exposure 100 1\n")
        dark = decode(camera.frames(10)[-1][1]).mean()
        assert dark < 0.3 * bright


def test_limits_of_exposure_and_row_time_are_told(tmp_path):
    options = ("--exposure-max-us", "5000", "--row-time-us", "12.5")
    with simulator(tmp_path, *options) as (path, _), Camera(path) as camera:
        header, _ = camera.frame()
        names = ("exposure_min_us", "exposure_max_us", "exposure_step_us")
        assert [header[name] for name in names] == [100, 5000, 100]
        assert header["exposure_us"] == 5000
        assert header["row_time_us"] == 12.5


def test_bracket_cycles(tmp_path):
    fine = ("--exposure-min-us", "1", "--exposure-step-us", "0")
    with simulator(tmp_path, "--bracket", "3", *fine) as (path, _), Camera(path) as camera:
        frames = camera.frames(7)
        ladder = sorted({h["exposure_us"] for h, _ in frames}, reverse=True)
        assert np.divide(ladder[:-1], ladder[1:]) == pytest.approx(16, rel=1e-3)
        assert all(h["exposure_us"] == ladder[h["sequence"] % 3] for h, _ in frames)


def test_truth_is_written_for_every_frame(tmp_path):
    truth = tmp_path / "truth.jsonl"
    with simulator(tmp_path, "--truth", str(truth), "--switch-s", "1", "--turn-deg-s", "30") as \
            (path, _), Camera(path) as camera:  # fmt: skip
        frames = camera.frames(4)
        lines = {line["sequence"]: line for line in map(json.loads, truth.read_text().splitlines())}
    for header, _ in frames:
        line = lines[header["sequence"]]
        assert line["t_start_ns"] == header["t_start_ns"]
        assert line["exposure_us"] == pytest.approx(header["exposure_us"])
        assert line["yaw_deg"] == pytest.approx(30 * line["t_s"] % 360, abs=360 / 256)
        assert line["scene"] == "procedural-0"
        half = np.radians(line["yaw_deg"]) / 2
        assert (header["y"], header["w"]) == pytest.approx((np.sin(half), np.cos(half)), abs=1e-6)
        assert header["x"] == header["z"] == 0


def test_a_recorded_path_is_replayed(tmp_path):
    """By frames, their truth and their orientation; in the room the camera goes along, too."""
    path, truth = tmp_path / "head.txt", tmp_path / "truth.jsonl"
    # A quarter of a turn about a tilted axis in 2 s, half a metre to the right in all.
    half = np.pi / 4
    x, y, z = 0.6 * np.sin(half), 0.8 * np.sin(half), 0.0
    path.write_text(
        f"# as recorded\n1305031100.5 7 1.5 2 0 0 0 1\n1305031102.5 7.5 1.5 2 {x} {y} {z} "
        f"{np.cos(half)}\n"
    )
    with simulator(
        tmp_path, "--scenes", "room", "--act-s", "0", "--path", path, "--truth", str(truth),
        "--row-time-us", "20", small=["--size", "256x128"],
    ) as (socket_path, _), Camera(socket_path) as camera:  # fmt: skip
        frames = camera.frames(4)
        lines = {line["sequence"]: line for line in map(json.loads, truth.read_text().splitlines())}
    for header, _ in frames:
        line = lines[header["sequence"]]
        told = [header[name] for name in "xyzw"]
        assert told == pytest.approx(line["rotation_xyzw"], abs=1e-6)
        middle_s = line["t_s"] + 0.5e-6 * line["exposure_us"]
        share = 1 - abs(1 - middle_s / 2 % 2)  # there and back
        assert line["place_m"] == pytest.approx([0.5 * share, 0, 0], abs=1e-6)
        turned = [0.6 * np.sin(share * half), 0.8 * np.sin(share * half), 0, np.cos(share * half)]
        assert line["rotation_xyzw"] == pytest.approx(turned, abs=1e-6)


def test_paths_that_cannot_be_replayed(tmp_path):
    def said(text, *options):
        path = tmp_path / "path.csv"
        path.write_text(text)
        (tmp_path / "scenario.toml").write_text(f'path = "{path}"\n')
        command = [LIGHTPROBE, "simulate", "--socket", tmp_path / "sock", *SMALL, *options]
        command += ["--scenario", tmp_path / "scenario.toml", "--seconds", "0.1"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stderr.replace(str(tmp_path), "DIR")

    still, off = "5,0,0,0,1,0,0,0\n", "5,0,0,0,1,0,0,0\n1000000005,9,0,0,1,0,0,0\n"
    assert said(still)[0] == 0
    bad = said("5,0,0,0,1,0,0,0\n6,0,0,0,1,0,0\n")
    assert bad[0] == 2
    assert "path: DIR/path.csv:2: 7 numbers: expected t, x, y, z, qw, qx, qy, qz" in bad[1]
    assert "leave out what turns" in said(still, "--turn-deg-s", "3")[1]
    assert "1 s after its start the probe would be outside" in said(off, "--scenes", "room")[1]
    assert (
        "the ring of --firmware cannot walk"
        in said(off, "--scenes", "room", "--firmware", "host")[1]
    )
    far = said(off)
    assert far[0] == 0
    assert "all that procedural-0 shows is far away: there the camera turns" in far[1]


def test_misbehaviour_on_request(tmp_path):
    """Each fault as the daemon asks for it: hello KEY=VALUE&…"""
    with simulator(tmp_path) as (path, _):
        with Camera(path, "hide_exposure=1") as camera:
            header, _ = camera.frame()
            assert math.isnan(header["exposure_us"])
            assert math.isnan(header["gain"])
        with Camera(path, "wrong_size=1&marked=1") as camera:
            header, payload = camera.frame()
            assert (header["width"], header["height"], header["flags"]) == (128, 64, 1)
            assert decode(payload).shape == (128, 256, 3)
        with Camera(path, "truncate=1") as camera:
            _, payload = camera.frame()
            assert payload[:2] == b"\xff\xd8"
            assert payload[-2:] != b"\xff\xd9"
        with Camera(path, "garbage=1") as camera:
            assert decode(camera.frame()[1]) is None
        with Camera(path, "corrupt=1") as camera:
            _, payload = camera.frame()
            assert payload
        with Camera(path, "drop=0.5") as camera:
            numbers = [h["sequence"] for h, _ in camera.frames(20)]
            assert numbers[-1] - numbers[0] > 22
        with Camera(path, "late_ms=300") as camera:
            header, _ = camera.frame()
            assert time.monotonic_ns() - header["t_start_ns"] > 300e6
        with Camera(path, "ignore_exposure=1") as camera:
            camera.send("exposure 340 2\n")  # UVC counts in steps of 100 µs
            assert all(h["exposure_us"] != 250 for h, _ in camera.frames(8))
        with Camera(path, "auto_exposure=1") as camera:
            camera.send("exposure 340 2\n")
            headers = [header for header, _ in camera.frames(8)]
            assert all(h["exposure_max_us"] == 0 for h in headers)  # it takes no commands
            assert all(h["exposure_us"] not in (300, 340) for h in headers)
        with Camera(path, "auto_exposure=1&ignore_exposure=1") as camera:
            assert camera.frame()[0]["exposure_max_us"] == 33000  # it only seems to
        with Camera(path, "disconnect_after=3") as camera:
            camera.frames(3)
            with pytest.raises(EOFError):
                camera.frame()
        with Camera(path, "cut_after=2") as camera:
            camera.frame()
            with pytest.raises(EOFError):
                camera.frame()


def test_stall_and_recovery(tmp_path):
    with simulator(tmp_path) as (path, _), Camera(path, "stall_after=3&stall_s=0.5") as camera:
        numbers = [h["sequence"] for h, _ in camera.frames(4)]
        assert numbers[3] - numbers[2] > 10


def test_a_daemon_that_leaves_or_babbles_does_no_harm(tmp_path):
    with simulator(tmp_path) as (path, process):
        with Camera(path) as camera:
            camera.send("exposure nan 1\nexposure\nfire!\n\xff\xfe\nexposure 400 1\n")
            frames = camera.frames(20)
            assert frames[-1][0]["exposure_us"] == 400
        with Camera(path, "explode=1") as camera:
            camera.frame()
        assert process.poll() is None
    # The context has ended it by SIGINT; what it said is in the pipe it was given.


def test_counters_and_exit(tmp_path):
    path = tmp_path / "sim.sock"
    command = [LIGHTPROBE, "simulate", "--socket", path, *SMALL, "--seconds", "0.5", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert json.loads(done.stdout)["connections"] == 0
    assert not path.exists()


def test_socket_in_use_and_left_over(tmp_path):
    with simulator(tmp_path) as (path, _), Camera(path):
        command = [LIGHTPROBE, "simulate", "--socket", path, *SMALL]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 1
        assert "is another simulator running?" in done.stderr
    left = tmp_path / "left.sock"
    with socket.socket(socket.AF_UNIX) as sock:
        sock.bind(str(left))
    assert os.path.exists(left)
    command = [LIGHTPROBE, "simulate", "--socket", left, *SMALL, "--seconds", "0.2"]
    assert subprocess.run(command, capture_output=True, timeout=60).returncode == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "17"], "expected WIDTHxHEIGHT"),
        (["--size", "255x128"], "even numbers"),
        (["--format", "H264"], "expected one of MJPG"),
        (["--faults", "explode=1"], "unknown option explode"),
        (["--scenes", "procedural:0"], "procedural:N with N"),
        (["--scenes", "nowhere.exr"], "no such file"),
        (["--camera", "nowhere.camera"], "nowhere.camera: open"),
    ],
)
def test_bad_options_say_what_to_do(options, message):
    done = subprocess.run([LIGHTPROBE, "simulate", *options], capture_output=True, text=True)
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr
