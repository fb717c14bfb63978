"""The whole path, real: simulator, daemon, clients, `watch` and `doctor`."""

import contextlib
import json
import os
import pty
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.client import Client
from lightprobe.estimate import EstimateFlag
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import World
from lightprobe.wire import Subscription

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 60


@pytest.fixture(scope="module")
def shared(tmp_path_factory, probe):
    """One probe for all tests that only look."""
    with probe(tmp_path_factory.mktemp("probe"), daemon_options=["--brackets=2"]) as uri:
        yield uri


def run(*arguments, timeout_s=LONG_S):
    return subprocess.run(
        [LIGHTPROBE, *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s
    )


def test_light_of_the_scene_reaches_the_client(shared):
    with Client(shared, Subscription(smoothing="RAW", max_lights=8)) as client:
        client.receive(LONG_S)
        # the first frames have one exposure, and a lamp that they clip is no lamp yet
        assert client.wait_for(
            lambda c: c.latest().lights and c.latest().exposure_count >= 2, LONG_S
        )
        estimate = client.latest()
        assert client.hello.source == "sim"
    (lamp,) = random_scene(0).lamps
    (light,) = estimate.lights
    assert geometry.angle_deg(light.direction, lamp.direction) < 0.5
    assert estimate.exposure_count >= 2


def test_every_client_has_its_own_subscription(shared):
    plain, rich = Subscription(sh_order=0, max_lights=0), Subscription(sh_order=4, kind="TOTAL")
    with Client(shared, plain) as one, Client(shared, rich) as two:
        poor, full = one.receive(LONG_S), two.receive(LONG_S)
        # The daemon may answer with its last estimate before it has read the wish, and with one
        # that was begun before.
        assert one.wait_for(lambda c: c.latest().sh.order == 0, LONG_S)
        assert two.wait_for(lambda c: c.latest().sh.order == 4, LONG_S)
        poor, full = one.receive(LONG_S), two.receive(LONG_S)
    assert (poor.sh.order, poor.lights) == (0, ())
    assert (full.sh.order, len(full.sh.coefficients)) == (4, 25)
    assert poor.total().coefficients[0] == pytest.approx(full.sh.coefficients[0], rel=0.1)


def test_watch_json_lines(shared):
    done = run("watch", shared, "--json", "--count", 5, "--order", 1)
    assert done.returncode == 0
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 5
    # The last estimate comes at once, and perhaps again when the daemon has read the wish.
    assert np.all(np.diff([line["sequence"] for line in lines]) >= 0)
    assert lines[-1]["sequence"] > lines[0]["sequence"]
    assert all("sh" in line and "lights" in line for line in lines)


def test_watch_plain_lines_when_nobody_looks(shared):
    done = run("watch", shared, "--seconds", 3)
    assert done.returncode == 0
    assert "lamps 1 [#" in done.stdout
    assert "\x1b" not in done.stdout


def test_watch_dashboard_on_a_terminal(shared):
    leader, follower = pty.openpty()
    environment = {**os.environ, "COLUMNS": "160", "LINES": "50", "TERM": "xterm-256color"}
    command = [LIGHTPROBE, "watch", shared, "--seconds", "3"]
    process = subprocess.Popen(command, stdout=follower, stderr=follower, env=environment)
    os.close(follower)
    text = bytearray()

    def read():
        with contextlib.suppress(OSError):
            while piece := os.read(leader, 65536):
                text.extend(piece)

    reader = threading.Thread(target=read)
    reader.start()
    assert process.wait(LONG_S) == 0
    reader.join()
    os.close(leader)
    seen = text.decode(errors="replace")
    for word in ("lightprobed", "azimuth", "irradiance", "l = 2", "latency p50", "streaming"):
        assert word in seen, word


def test_watch_nobody_there(tmp_path):
    done = run("watch", f"unix:{tmp_path / 'none.sock'}", "--seconds", 1)
    assert done.returncode == 1
    assert "is lightprobed running" in done.stderr
    assert run("watch", "nonsense").returncode == 1
    assert run("watch", "--kind", "BOTH").returncode == 2


def test_a_daemon_that_is_restarted_is_found_again(tmp_path, probe):
    with probe(tmp_path) as uri, Client(uri) as client:
        first = client.receive(LONG_S)
    with Client(uri) as client:
        time.sleep(0.3)
        with probe(tmp_path):
            second = client.receive(LONG_S)
    assert second.boot_id != first.boot_id


def test_estimates_go_stale_when_the_camera_is_gone(tmp_path, probe):
    stalling = probe(tmp_path, faults="stall_after=20", daemon_options=["--ttl-ms=500"])
    with stalling as uri, Client(uri) as client:
        while EstimateFlag.STALE not in client.receive(LONG_S).flags:
            pass
        assert client.latest() is None
        assert client.wait_for(lambda c: c.health.source_state == "STALLED", LONG_S)


def whole(client):
    """The bracket has found its exposures: nothing is lost to clipping."""
    estimate = client.latest()
    return estimate and estimate.lights and EstimateFlag.CLIPPED not in estimate.flags


def test_spoiled_frames_are_counted_and_the_light_goes_on(tmp_path, probe):
    """Half of the frames; the lamp is listed once the bracket has exposures as short as it needs,
    and then in every estimate. RAW: nothing is held over a gap."""
    spoiling = probe(tmp_path, faults="garbage=0.2&truncate=0.2&marked=0.1")
    with spoiling as uri, Client(uri, Subscription(smoothing="RAW")) as client:
        assert client.wait_for(lambda c: c.health and c.health.frames_rejected >= 5, LONG_S)
        assert client.wait_for(whole, LONG_S)
        before = client.health.frames_rejected
        estimates = [client.receive(LONG_S) for _ in range(60)]
        assert client.wait_for(lambda c: c.health.frames_rejected >= before + 5, LONG_S)
    assert [len(estimate.lights) for estimate in estimates] == [1] * len(estimates)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("delay_frames", [4, 1])
def test_no_wrong_merge_of_a_late_camera_that_tells_no_exposure(tmp_path, probe, delay_frames):
    """Ten stops between room and a lamp smaller than a hundredth of the picture; lost frames. A
    busy machine makes commands come late: then packets are flagged, or right all the same."""
    options = ["--delay-frames", delay_frames, "--rate", "30"]
    late = probe(tmp_path, *map(str, options), faults="hide_exposure=1&drop=0.1")
    healthy = []
    with late as uri, Client(uri, Subscription(smoothing="RAW")) as client:
        assert client.wait_for(whole, LONG_S)
        while len(healthy) < 150:
            estimate = client.receive(LONG_S)
            if not estimate.flags:
                healthy.append(estimate)
    (scene,) = World([random_scene(0)], median_radiance=30).scenes
    truth = scene.truth([1]).total[0]
    for estimate in healthy:
        assert estimate.total().coefficients[0] == pytest.approx(truth, rel=0.05)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("pixel_format", ["YUYV", "NV12", "RGBF"])
def test_every_frame_format_shows_the_lamp(tmp_path, probe, pixel_format):
    """Raw frames of the simulated camera are what the daemon takes them for."""
    options = ["--format", pixel_format, "--rate", "10"]
    with probe(tmp_path, *options) as uri, Client(uri, Subscription(smoothing="RAW")) as client:
        assert client.wait_for(whole, LONG_S)
        estimate = client.receive(LONG_S)
    (lamp,) = random_scene(0).lamps
    assert geometry.angle_deg(estimate.lights[0].direction, lamp.direction) < 0.5
    (scene,) = World([random_scene(0)], median_radiance=30).scenes
    truth = scene.truth([1]).total[0]
    assert estimate.total().coefficients[0] == pytest.approx(truth, rel=0.05)
