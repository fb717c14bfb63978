# SPDX-License-Identifier: Apache-2.0
"""What include/source.h promises of a camera, for `v4l2:` and `libcamera:` on the real kernel.

The same promises on all sources, without a kernel: tests/unit/test_source_contract.c.
"""

from camera import Camera

FOREVER = 1_000_000  # frames


def check_corrupt_frames_first(start, camera: Camera, source: str) -> None:
    """Corrupt frames are counted; STREAMING comes with the first usable one, and says so."""
    camera.command("error 3")
    camera.plug()
    daemon = start(source)
    daemon.wait_estimate()
    health = daemon.health()
    assert health.frames_rejected >= 3
    assert health.frames_received >= 4
    (line,) = [line for line in daemon.log().splitlines() if "stream: frames arrive" in line]
    assert "before were corrupt" in line


def check_only_corrupt_frames(start, camera: Camera, source: str) -> None:
    """A camera that gives nothing else is stalled, not streaming; and it recovers."""
    camera.command(f"error {FOREVER}")
    camera.plug()
    daemon = start(source)
    health = daemon.wait_state("STALLED")
    assert "only corrupt frames" in health.faults[0].text
    assert "frames arrive" not in daemon.log()
    assert not health.estimates
    camera.command("error 0")
    daemon.wait_state("STREAMING")
    daemon.wait_estimate()
