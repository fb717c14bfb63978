# SPDX-License-Identifier: Apache-2.0
"""Unplugging while the daemon streams; and the full rate, with every loss counted."""

import time

import pytest
from camera import load_drivers
from machine import wait_for

from daemon import Daemon

USB = "v4l2:1d6b:0102"
CYCLES = 20
RESUME_LIMIT_S = 2.0


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


def wait_until_steady(value) -> int:
    """Poll a number until it has been the same for a second; return it."""
    seen = [-1]

    def is_steady() -> bool:
        time.sleep(1)
        seen.append(value())
        return seen[-1] == seen[-2]

    wait_for("a steady number", is_steady)
    return seen[-1]


@pytest.fixture
def decoy(make_camera):
    """Another camera, which takes the node while the camera is away."""
    return make_camera(port=1, serial="0002")


@pytest.mark.nightly
@pytest.mark.limit_s(600)
def test_twenty_replugs(camera, decoy, record_property):
    """Each time the next estimate is there within two seconds of the node's return.

    Every second time another camera has taken the node meanwhile.
    """
    nodes = {camera.plug()}
    daemon = Daemon(f"{USB}?size=640x320", "--exposure-us=2000")
    daemon.wait_estimate()
    waits = []
    for cycle in range(CYCLES):
        camera.unplug()
        daemon.wait_state("WAITING")
        (decoy.unplug if cycle % 2 else decoy.plug)()
        nodes.add(camera.plug())
        back, back_unix_ns = time.monotonic(), time.time_ns()
        daemon.wait_estimate(captured_after_unix_ns=back_unix_ns)
        waits.append(time.monotonic() - back)
    health = daemon.health()
    daemon.stop()
    record_property(
        "figure",
        f"{CYCLES} replugs: resumed within {max(waits):.2f} s, mean {sum(waits) / CYCLES:.2f} s",
    )
    assert len(nodes) == 2
    assert health.source_reconnects == CYCLES
    assert max(waits) < RESUME_LIMIT_S


def test_same_camera_under_another_node(camera, decoy):
    """While it is away another camera takes its node: the daemon is not fooled."""
    node = camera.plug()
    daemon = Daemon(f"v4l2:{node}?size=640x320")
    daemon.wait_estimate()
    camera.unplug()
    daemon.wait_state("WAITING")
    assert decoy.plug() == node
    time.sleep(2)
    assert daemon.health().source_state == 2  # WAITING
    other = camera.plug()
    assert other != node
    daemon.wait_state("STREAMING")
    assert f"v4l2: {other}: open" in daemon.log()
    daemon.stop()


def test_estimates_go_stale_while_it_is_away(camera):
    camera.plug()
    daemon = Daemon(f"{USB}?size=640x320", "--ttl-ms=300")
    daemon.wait_estimate()
    camera.unplug()

    def is_stale() -> bool:
        message = daemon.next_message()
        return message.HasField("estimate") and bool(message.estimate.flags & 1)

    wait_for("a stale estimate", is_stale)
    camera.plug()
    daemon.wait_estimate(time.time_ns())
    daemon.stop()


def test_end_while_it_is_away(camera):
    camera.plug()
    daemon = Daemon(f"{USB}?size=640x320")
    daemon.wait_estimate()
    camera.unplug()
    daemon.wait_state("WAITING")
    daemon.stop()


@pytest.mark.nightly
@pytest.mark.limit_s(600)
def test_full_rate_without_uncounted_loss(camera, record_property):
    """1920x960 MJPEG at 30 frames a second: each frame sent is an estimate, or counted as lost."""
    camera.plug()
    daemon = Daemon(
        f"{USB}?size=1920x960&format=mjpeg&fps=30&stall_ms=60000",
        "--preset=fast",
        "--exposure-us=2000",
    )
    daemon.wait_estimate()
    time.sleep(10)
    camera.command("silent 1")
    sent = wait_until_steady(lambda: camera.state()["sent"])
    wait_until_steady(lambda: daemon.health().estimates)
    health, overrun = daemon.health(), camera.state()["overrun"]
    daemon.stop()
    record_property(
        "figure",
        f"{sent} frames of 1920x960 sent, {overrun} never left the camera;"
        f" {health.frames_received} received, {health.frames_dropped} dropped and counted,"
        f" {health.estimates} estimates",
    )
    assert sent >= 150  # 300 and more, but for a machine that is busy with other things
    assert health.frames_received >= sent * 19 // 20
    accounted = health.estimates + health.frames_dropped + health.frames_rejected
    # Rarely uvcvideo's numbers skip one for a frame that has come: a loss too many, never too few.
    assert sent <= accounted <= sent + sent // 50
