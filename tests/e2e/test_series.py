"""--series: raw frames of a schedule of exposures into a folder, and nothing else."""

import json
import math
import resource
import signal
import stat

import numpy as np
from harness import Daemon, camera, jpeg, panorama, run, streaming, wait_for
from lightprobe.calibrate.exposure_series import load


def rows(folder):
    return [json.loads(line) for line in (folder / "index.jsonl").read_text().splitlines()]


def test_frames_follow_their_commands(tmp_path):
    folder = tmp_path / "series"
    with camera() as cam:
        daemon = Daemon(
            f"--source=sim:{cam.path}", f"--series={folder}", "--series-us=100,400,400,90000",
            "--series-frames=3", "--gain=2",
        ).start()  # fmt: skip
        assert cam.accept().startswith("hello")
        sent = [jpeg(panorama(level=40 + number)) for number in range(9)]
        commands = []
        for number, payload in enumerate(sent):
            if number % 3 == 0 and number:  # the command follows the last frame of a step
                commands.append(cam.line())
            cam.send(payload)
            if number == 0:
                commands.append(cam.line())
        assert daemon.wait() == 0
    # what the camera would do alike is not asked twice; too long is cut to what it can do
    assert commands == ["exposure 50 2", "exposure 200 2", "exposure 16500 2"]
    series = load(folder)
    assert [len(step) for step in series.steps()] == [3, 3, 3]
    assert [step[0].commanded_us for step in series.steps()] == [100, 400, 33000]
    assert [frame.sequence for frame in series.frames] == list(range(1, 10))
    assert [frame.path.read_bytes() for frame in series.frames] == sent
    assert all(frame.stated_us == 1000 for frame in series.frames)
    assert series.reports_exposure
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in folder.iterdir())


def test_corrupt_frames_first_do_not_spoil_what_is_said_of_the_camera(tmp_path):
    folder = tmp_path / "series"
    with camera() as cam:
        daemon = Daemon(f"--source=sim:{cam.path}", f"--series={folder}", "--series-frames=2")
        daemon.start()
        cam.accept()
        cam.send(jpeg(), exposure_us=math.nan, flags=1)
        cam.send(jpeg())
        cam.send(jpeg(), exposure_us=math.nan, flags=1)
        assert daemon.wait() == 0
    header, *frames, last = rows(folder)
    assert header["source"] == "sim"
    assert header["reports_exposure"]
    assert [frame["corrupt"] for frame in frames] == [False, True]
    assert last == {"frames": 2, "complete": True}


def test_a_file_gives_its_frames_as_they_come(tmp_path):
    for index in range(3):
        (tmp_path / f"{index}.jpg").write_bytes(jpeg(panorama(level=20 * (index + 1))))
    status, _, _ = run(
        f"--source=file:{tmp_path}?exposures_us=1000,4000,16000&gain=2",
        f"--series={tmp_path / 'series'}",
        "--series-frames=0",
    )
    assert status == 0
    series = load(tmp_path / "series")
    assert [step[0].stated_us for step in series.steps()] == [2000, 8000, 32000]
    assert np.all(np.diff([step[0].codes().mean() for step in series.steps()]) > 0)


def test_nothing_is_written_over(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    status, _, log = run(
        f"--source=file:{tmp_path / 'a.jpg'}", f"--series={tmp_path}", "--series-frames=1"
    )
    assert status == 2
    assert "not empty" in log
    assert [path.name for path in tmp_path.iterdir()] == ["a.jpg"]


def test_what_makes_no_sense_is_refused(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    source = f"--source=file:{tmp_path / 'a.jpg'}"
    into = f"--series={tmp_path / 'series'}"
    for arguments, text in (
        ((source, into, "--series-us=100"), "cannot be set"),
        ((source, into, "--once"), "with --once"),
        ((f"--source=sim:{tmp_path / 'sim'}", into, "--series-frames=0"), "never ends"),
        ((source, f"--series={tmp_path / 'a' / 'b'}"), "No such file"),
        ((into,), "needs one --source"),
    ):
        status, _, log = run(*arguments)
        assert status == 2, log
        assert text in log
        assert not (tmp_path / "series").exists()


def start_series(cam, folder):
    """A daemon that has written the first frame and waits for more."""
    daemon = Daemon(f"--source=sim:{cam.path}", f"--series={folder}").start()
    cam.accept()
    cam.send(jpeg())
    wait_for((folder / "00000.jpg").exists, "the first frame is not written")
    return daemon


def test_a_camera_that_goes_away_ends_it(tmp_path):
    folder = tmp_path / "series"
    with camera() as cam:
        daemon = start_series(cam, folder)
        cam.unplug()
        assert daemon.wait() == 1
        assert "not complete" in daemon.log()
    assert rows(folder)[-1] == {"frames": 1, "complete": False}


def test_a_signal_ends_it(tmp_path):
    folder = tmp_path / "series"
    with camera() as cam:
        daemon = start_series(cam, folder)
        assert daemon.stop(signal.SIGINT) == 1
    assert not rows(folder)[-1]["complete"]


def test_a_full_disk_is_a_failure(tmp_path):
    def limit_file_size():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))

    for index in range(3):
        noise = np.random.default_rng(index).integers(0, 255, (128, 256, 3), np.uint8)
        (tmp_path / f"{index}.jpg").write_bytes(jpeg(noise))
    status, _, log = run(
        f"--source=file:{tmp_path}", f"--series={tmp_path / 'series'}", "--series-frames=0",
        preexec_fn=limit_file_size,
    )  # fmt: skip
    assert status == 1
    assert "File too large" in log
    assert not rows(tmp_path / "series")[-1]["complete"]


def test_no_picture_is_served_meanwhile(tmp_path):
    """No publisher is opened: the camera's frames go to the folder and nowhere else."""
    with camera() as cam:
        daemon = Daemon(f"--source=sim:{cam.path}", f"--series={tmp_path / 'series'}")
        daemon.start()
        cam.accept()
        with streaming(cam, jpeg(), rate_hz=10):
            wait_for(lambda: (tmp_path / "series" / "00003.jpg").exists(), "no frames")
            assert not daemon.socket.exists()
            assert daemon.wait() == 0
