"""`lightprobe calibrate` with the real daemon and the simulated camera."""

import contextlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from lightprobe.evaluate import evaluation, offline
from lightprobe.evaluate.evaluation import Input
from lightprobe.imaging import camera, image
from lightprobe.sim import response as responses
from lightprobe.sim import scenes
from lightprobe.sim.sensor import Sensor

pytestmark = pytest.mark.many_frames

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 300  # the machine may be busy


def lightprobe(*arguments, status=0):
    done = subprocess.run(
        [LIGHTPROBE, *map(str, arguments)], capture_output=True, text=True, timeout=LONG_S
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done


@contextlib.contextmanager
def simulated(folder, *options):
    """A simulated camera; yields its socket. Small pictures: the machine may be busy."""
    socket = folder / "sim"
    process = subprocess.Popen(
        [LIGHTPROBE, "simulate", "--socket", socket, "--size", "640x320", "--scenes", "room",
         "--act-s", "0", *options],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield socket
    finally:
        process.terminate()
        process.wait(30)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("delay", [0, 3])
def test_the_delay_of_a_camera_is_found_and_written(tmp_path, delay):
    out = tmp_path / "probe.camera"
    out.write_text("; mine\n[camera]\nprojection = equirect\nwidth_px = 640\nheight_px = 320\n")
    with simulated(tmp_path, "--delay-frames", str(delay)) as socket:
        done = lightprobe(
            "calibrate", "exposure", f"sim:{socket}?hide_exposure=1&late_ms=8", "--output", out,
            "--json",
        )  # fmt: skip
    report = json.loads(done.stdout)
    assert report["follows"]
    # A command that answers a frame 8 ms late finds the next one begun: it is read without it.
    assert report["delay_frames"] == 1 + delay
    assert report["linearity_error"] < 0.05
    text = out.read_text()
    assert text.startswith("; mine\n[camera]\n")
    assert f"[v4l2]\nexposure_delay_frames = {1 + delay}\n" in text


def test_frames_that_tell_their_exposure_are_compared_with_it(tmp_path):
    with simulated(tmp_path) as socket:
        done = lightprobe("calibrate", "exposure", f"sim:{socket}", "--json")
    report = json.loads(done.stdout)
    assert report["reports_exposure"]
    assert all(s["stated_us"] == pytest.approx(s["commanded_us"]) for s in report["steps"])


def test_a_camera_that_ignores_commands_is_told_and_nothing_is_written(tmp_path):
    out = tmp_path / "probe.camera"
    with simulated(tmp_path) as socket:
        done = lightprobe(
            "calibrate", "exposure", f"sim:{socket}?hide_exposure=1&ignore_exposure=1",
            "--output", out, status=1,
        )  # fmt: skip
        assert "ignores exposure commands" in done.stderr
        done = lightprobe(
            "calibrate", "response", f"sim:{socket}?hide_exposure=1&ignore_exposure=1", status=1
        )
        assert "check with `lightprobe calibrate exposure` that the camera obeys" in done.stderr
    assert not out.exists()


def test_darkness_is_told(tmp_path):
    with simulated(tmp_path, "--median-radiance", "0.0003") as socket:
        for what in ("exposure", "response"):
            done = lightprobe("calibrate", what, f"sim:{socket}?hide_exposure=1", status=1)
            assert (
                "more light" in done.stderr
                or "add light" in done.stderr
                or "large even surfaces" in done.stderr
            )


def test_a_camera_that_is_not_there_is_told(tmp_path):
    done = lightprobe("calibrate", "response", f"sim:{tmp_path}/x", "--patience-s", "1", status=1)
    assert "lightprobe simulate" in done.stderr
    done = lightprobe("calibrate", "exposure", "sum:/x", status=2)
    assert "known" in done.stderr


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("curve", "format"),
    [("film", "MJPG"), ("gamma:1.8,2.2,2.6", "YUYV"), ("log:6", "NV12")],
)
def test_an_unknown_response_is_found_within_one_percent(tmp_path, curve, format):
    out, plot = tmp_path / "probe.camera", tmp_path / "curve.png"
    with simulated(tmp_path, "--response", curve, "--format", format) as socket:
        lightprobe(
            "calibrate", "response", f"sim:{socket}?hide_exposure=1", "--frames", "8",
            "--output", out, "--plot", plot,
        )  # fmt: skip
    error = camera.load(str(out)).response - responses.parse(curve)
    rms = np.sqrt(np.mean(error**2, axis=0))
    print(f"{curve} {format}: RMS error {100 * rms.round(5)} % of full scale")
    assert np.all(rms <= 0.01)
    assert plot.stat().st_size > 10000


def test_the_calibrated_camera_measures_better(tmp_path, released_daemon):
    """Relighting with the found curve is as good as with the true one, and far better than none."""
    out = tmp_path / "probe.camera"
    with simulated(tmp_path, "--response", "film") as socket:
        lightprobe("calibrate", "response", f"sim:{socket}?hide_exposure=1", "--output", out)
    settings = {"none": offline.Settings(), "found": offline.Settings(camera=str(out))}
    loaded = scenes.load(["procedural:2"])
    cases = evaluation.evaluate(
        loaded, settings, [Input("3")], response=responses.parse("film"), jobs=1
    )
    known = evaluation.evaluate(loaded, {"known": offline.Settings()}, [Input("3")], jobs=1)
    mae = {
        name: np.mean([c.score.relighting_mae for c in cases + known if c.settings == name])
        for name in ("none", "found", "known")
    }
    print(f"relighting MAE: {mae}")
    assert mae["found"] < 1.1 * mae["known"]
    assert mae["found"] < 0.6 * mae["none"]


def bracket(folder, exposures_us, curve="gamma:2.4"):
    """Pictures of the room, without loss."""
    import cv2

    scene = scenes.load(["room"])[0]
    radiance = scene.render(640, 320).compose(np.ones(len(scene.lamps)))
    sensor = Sensor(640, 320, response=responses.parse(curve))
    scale = 30 / np.median(radiance)
    files = []
    for number, exposure_us in enumerate(exposures_us):
        codes = sensor.capture((radiance * scale).astype(np.float32), exposure_us, number)
        files.append(folder / f"{number:02}.png")
        cv2.imwrite(str(files[-1]), codes[..., ::-1])
    return files


def test_pictures_with_known_exposures_do_as_well(tmp_path):
    exposures_us = [round(20 * 1.8**k) for k in range(12)]
    folder = tmp_path / "pictures"
    folder.mkdir()
    files = bracket(folder, exposures_us)
    listed = ",".join(map(str, exposures_us))
    table = {}
    done = lightprobe("calibrate", "response", *files, "--exposures", listed, "--json")
    table["files"] = np.array(json.loads(done.stdout)["table"])
    done = lightprobe("calibrate", "response", *files, "--exposures", "1,2", status=2)
    assert "one for each file" in done.stderr
    done = lightprobe("calibrate", "response", f"file:{folder}", status=1)
    assert "no picture in this folder" in done.stderr  # the daemon reads no PNG
    for file in files:
        offline.write_jpeg(folder / f"{file.stem}.jpg", image.read_srgb8(file))
        file.unlink()
    done = lightprobe("calibrate", "response", f"file:{folder}", status=1)
    assert "exposures_us" in done.stderr
    done = lightprobe("calibrate", "response", f"file:{folder}?exposures_us={listed}", "--json")
    table["source"] = np.array(json.loads(done.stdout)["table"])
    for found in table.values():
        error = found - responses.parse("gamma:2.4")
        assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.01)


FISHEYE = """[camera]
projection = fisheye
width_px = 480
height_px = 480
[lens.0]
cx_px = 240
cy_px = 240
fx_px = 141
fy_px = 141
max_theta_deg = 97
"""


@pytest.mark.nightly
def test_the_roll_off_of_a_camera_that_turns_is_found(tmp_path, released_daemon):
    """By the daemon's own frames, at an exposure that the command chooses."""
    true = (-0.4935, 0.0961, -0.0076)  # about the fourth power of the cosine of half the angle
    module, probe = tmp_path / "module.camera", tmp_path / "probe.camera"
    probe.write_text(FISHEYE)
    module.write_text(FISHEYE + f"rolloff = {true[0]}, {true[1]}, {true[2]}\n")
    scene = Path(__file__).resolve().parents[2] / "build/scenes/courtyard.exr"
    options = ("--scenes", scene, "--camera", module, "--size", "480x480", "--rate", "10")
    turning = ("--turn-deg-s", "40", "--median-radiance", "200")
    with simulated(tmp_path, *map(str, options), *turning) as socket:
        done = lightprobe(
            "calibrate", "roll-off", f"sim:{socket}", "--output", probe, "--frames", "105", "--json"
        )
    (report,) = json.loads(done.stdout)
    theta = np.radians(np.linspace(0, 92, 93))
    terms = theta[:, None] ** np.array([2, 4, 6])
    error = np.abs((1 + terms @ report["rolloff"]) / (1 + terms @ true) - 1).max()
    print(f"roll-off by 36 frames of a camera that turns: within {100 * error:.1f} %")
    assert error < 0.04
    assert camera.load(str(probe)).lenses[0].rolloff == pytest.approx(report["rolloff"], rel=1e-4)
