"""A real daemon with a simulated camera lights a scene."""

import math
import os
import subprocess
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.lightprobe import scene_lamps, session
from lightprobe import Client, Subscription
from lightprobe.daemon import Daemon
from mathutils import Vector
from probes import LONG_S, ticked_until
from rendering import WHITE, camera, render, sphere, sphere_normals

BUILD = Path(__file__).parents[3] / "build"
LIGHTPROBE = BUILD / "venv/bin/lightprobe"


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    """Address of a daemon that sees a simulated room and gives out reflection maps."""
    folder = tmp_path_factory.mktemp("probe")
    os.environ["LIGHTPROBED"] = str(BUILD / "release/bin/lightprobed")
    command = [LIGHTPROBE, "simulate", "--socket", folder / "sim.sock", "--size", "960x480",
               "--scenes", "procedural:3", "--act-s", "0", "--rate", "10",
               "--exposure-min-us", "1", "--exposure-step-us", "0"]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    simulator = subprocess.Popen(command, start_new_session=True, **quiet)
    uri = f"unix:{folder}/probe.sock"
    options = [f"--source=sim:{folder}/sim.sock", f"--publish={uri}", "--reflection-map=64",
               "--orientation=none"]  # fmt: skip
    try:
        with Daemon(options, folder / "log") as running:
            wait_until_steady(uri)
            yield uri
            running.check()
    finally:
        simulator.terminate()
        simulator.wait(30)


def wait_until_steady(uri):
    """Exposures and lamps of a daemon need a while after its start."""
    deadline_s = time.monotonic() + LONG_S
    with Client(uri, Subscription(max_lights=8)) as client:
        before = client.receive(LONG_S)
        while time.monotonic() < deadline_s:
            time.sleep(1)
            now = client.receive(LONG_S)
            if same_light(before, now):
                return
            before = now
    raise AssertionError(f"{uri}: the light has not become steady in {LONG_S} s")


def same_light(a, b):
    if [light.id for light in a.lights] != [light.id for light in b.lights] or not a.lights:
        return False
    pairs = [(a.sh.coefficients, b.sh.coefficients)]
    pairs += [(x.irradiance, y.irradiance) for x, y in zip(a.lights, b.lights, strict=True)]
    return all(np.abs(x - y).max() < 0.005 * np.abs(x).max() for x, y in pairs)


def settled(scene, uri, **settings):
    """Connect, and wait until the light is there at full strength."""
    for name, value in {"uri": uri, **settings}.items():
        setattr(scene.lightprobe, name, value)
    bpy.ops.lightprobe.connect()
    running = session.current()
    ticked_until(running, lambda: running.fader.world_gain == 1, "no light")
    ticked_until(running, lambda: all(x.gain == 1 for x in running.fader.lamps), "no lamps")
    return running


def test_a_daemon_drives_the_lamps(scene, probe):
    running = settled(scene, probe, map_size="0", max_lamps=8)
    lamps = scene_lamps.lamps(scene.lightprobe.root)
    with Client(probe, Subscription(sh_order=4, max_lights=8)) as other:
        estimate = other.receive(LONG_S)
    assert {key[1] for key in lamps} == {light.id for light in estimate.lights}
    for light in estimate.lights:
        lamp = lamps[estimate.boot_id, light.id]
        scene.view_layers[0].update()
        shines = lamp.matrix_world.to_quaternion() @ Vector((0, 0, -1))
        x, y, z = light.direction
        assert math.degrees((-shines).angle(Vector((x, -z, y)))) < 0.5
        sent = np.array(lamp.data.color) * lamp.data.energy
        assert np.allclose(sent, light.irradiance, rtol=0.05)
        assert math.degrees(lamp.data.angle) == pytest.approx(2 * light.angular_radius_deg, rel=0.1)
        assert lamp.parent == scene.lightprobe.root
    seen = running.link.seen
    ticked_until(running, lambda: running.link.seen.estimate is not seen.estimate, "no news")
    running.tick()
    assert scene_lamps.lamps(scene.lightprobe.root) == lamps  # the same objects
    assert running.report.state in ("FRESH", "FAULTY")


def pixels(scene, size_px=24):
    """Pixels of a white sphere from two sides, one row for each normal."""
    rows = []
    for eye in ((1, -1, 1), (-1, 1, -0.3)):
        normals = sphere_normals(camera(eye), size_px, 2.0)
        rows.append(render(size_px, 1024)[np.isfinite(normals[..., 0])])
    return np.concatenate(rows)


def test_total_as_a_map_is_ambient_and_lamps(scene, probe):
    """No way to show the light counts any of it twice, or leaves some out."""
    sphere()
    found = {}
    for name, settings in {
        "lamps and SH": {"mode": "LAMPS", "map_size": "0"},
        "lamps and AMBIENT map": {"mode": "LAMPS", "map_size": "64"},
        "TOTAL map": {"mode": "MAP", "map_size": "64"},
    }.items():
        running = settled(scene, probe, **settings)
        if name == "lamps and SH":
            bpy.ops.lightprobe.fit_scale()
            running.tick()
            estimate = running.link.seen.estimate
            lamp = estimate.lights[0]  # enough that counting it twice would show
            assert lamp.irradiance[1] > 0.2 * estimate.irradiance(lamp.direction)[1]
        lamps = scene_lamps.lamps(scene.lightprobe.root)
        assert (len(lamps) == 0) == (name == "TOTAL map")
        assert running.link.seen.sky.source == ("SH" if name == "lamps and SH" else "MAP")
        bpy.ops.lightprobe.disconnect()
        found[name] = pixels(scene)
    most = found["TOTAL map"].max()
    assert 0.5 * WHITE < most < WHITE
    for name in ("lamps and SH", "lamps and AMBIENT map"):
        off = found[name] - found["TOTAL map"]
        rms, worst = np.sqrt(np.mean(off**2)) / most, np.abs(off).max() / most
        print(f"{name} against TOTAL map: {100 * rms:.2f} % rms, {100 * worst:.2f} % at most")
        assert rms < 0.01
        assert worst < 0.03


def test_light_once_is_for_scripts(scene, probe):
    scene.lightprobe.uri = probe
    assert bpy.ops.lightprobe.light_once(timeout_s=LONG_S) == {"FINISHED"}
    assert session.current() is None
    assert len(scene_lamps.lamps(scene.lightprobe.root)) > 0
    assert scene.world == scene.lightprobe.world


def test_a_recording_of_the_daemon_becomes_keyframes(scene, probe, tmp_path):
    file = tmp_path / "room.mcap"
    command = [LIGHTPROBE, "record", file, "--from", probe, "--seconds", "1"]
    subprocess.run(command, check=True, capture_output=True, timeout=LONG_S)
    assert bpy.ops.lightprobe.keyframe_recording(filepath=str(file)) == {"FINISHED"}
    lamps = scene_lamps.lamps(scene.lightprobe.root)
    with Client(probe, Subscription(max_lights=8)) as other:
        listed = {light.id for light in other.receive(LONG_S).lights}
    assert listed <= {key[1] for key in lamps}
    assert len(list((tmp_path / "room_sky").glob("*.exr"))) >= 20
