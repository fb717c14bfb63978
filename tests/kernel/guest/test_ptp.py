# SPDX-License-Identifier: Apache-2.0
"""Stills of a THETA over USB: PTP on a real bus, through libusb, into the daemon's estimates."""

import fcntl
import math
import shutil
import signal
import struct
import time

import pytest
from functionfs import StillCamera
from lightprobe_proto import lightprobe_pb2 as pb
from machine import run, wait_for
from room import CLIPPED, PICTURES, assert_room
from theta import BRACKET, FIRST_BRACKET, LIVE_STREAMING, STILL_CAPTURE_MODE, Theta

from daemon import Daemon

SERIAL = "YN10100042"
EXPOSURES_US = [100 * 2**k for k in range(10)]  # of make_pictures.py
#: 100, 800 and 6400 us; the camera lists 1/10000, 1/1250 and 1/160 s.
STILLS = "every=0.2&shortest_us=100&stops=3&exposures=3"
#: The exposure of the live pictures, in which the room's lamps clip.
LIVE_US, LIVE_HZ = 12800, 2
WATCHED_S = 15
CLAIM = 0x8004550F  # USBDEVFS_CLAIMINTERFACE


def picture(asked_us: float) -> tuple[bytes, float]:
    """Return the picture of the nearest exposure; the camera's nominal ones are rounded."""
    exposure_us = min(EXPOSURES_US, key=lambda us: abs(math.log2(us / asked_us)))
    return (PICTURES / f"640x320_{exposure_us}us_0.jpg").read_bytes(), exposure_us


@pytest.fixture(scope="module")
def camera():
    """The one camera of these tests, unplugged."""
    return StillCamera(Theta(picture, SERIAL))


@pytest.fixture(autouse=True)
def _as_new(camera):
    """Every test begins with a camera as it is sold, and on no bus."""
    yield
    camera.unplug()
    camera.become(Theta(picture, SERIAL))


def wait_fault(daemon, words: str) -> None:
    """Wait until health says so."""
    daemon.wait_health(words, lambda health: any(words in fault.text for fault in health.faults))


def assert_as_sold(theta) -> None:
    """Nothing is left behind: settings, session, stills."""
    assert theta.values == theta.first_values
    assert not theta.has_session
    assert theta.objects == {}


def test_stills_measure_the_room(start, camera, record_property):
    camera.plug()
    daemon = start(f"ptp:{SERIAL}?{STILLS}")
    estimate = wait_for(
        "three exposures",
        lambda: (e := daemon.wait_estimate()).exposure_count == 3 and not e.flags & CLIPPED and e,
    )
    assert_room(estimate)
    begun_s, sets = time.monotonic(), camera.theta.sets
    wait_for("sets", lambda: camera.theta.sets >= sets + 5)
    each_s = (time.monotonic() - begun_s) / 5
    record_property("figure", f"a set of three stills every {each_s:.2f} s of the guest's time")
    daemon.stop()
    assert_as_sold(camera.theta)


def test_a_set_on_request(start, camera):
    camera.plug()
    daemon = start(f"ptp:?{STILLS.replace('every=0.2', 'every=0')}")
    daemon.wait_estimate()
    wait_for("the first set", lambda: camera.theta.objects == {})
    for sets in (2, 3):
        wish = pb.FromClient()
        wish.take_stills.SetInParent()
        asked_ns = time.time_ns()
        daemon.request(wish)
        wait_for("a set", lambda sets=sets: camera.theta.sets == sets)
        daemon.wait_estimate(asked_ns)  # of a still that was taken since


def test_a_live_camera_learns_what_it_clips(start, camera, tmp_path):
    """Live pictures in which the lamps clip, and stills that show them: one map."""
    live = tmp_path / "live"
    live.mkdir()
    for number in range(2):
        shutil.copy(PICTURES / f"640x320_{LIVE_US}us_{number}.jpg", live)
    for name in ("live", "stills"):
        (tmp_path / f"{name}.camera").write_text("[camera]\nprojection = equirect\n")
    daemon = start(
        f"file:{live}?rate={LIVE_HZ}&exposures_us={LIVE_US}",
        f"--camera={tmp_path}/live.camera",
        f"--source=ptp:?{STILLS}",
        f"--camera={tmp_path}/stills.camera",
    )
    assert daemon.wait_estimate().flags & CLIPPED
    wait_fault(daemon, "no RICOH THETA on USB")
    camera.plug()
    # an estimate of a live frame: what stills told stays
    wait_for(
        "the lamps", lambda: (e := daemon.wait_estimate()).exposure_us == LIVE_US
        and not e.flags & CLIPPED, timeout_s=240,
    )  # fmt: skip
    # more stills than the guest's slow processor has time for: live frames go on
    begun_s, live_frames = time.monotonic(), 0
    while time.monotonic() < begun_s + WATCHED_S:
        live_frames += daemon.wait_estimate(time.time_ns()).exposure_us == LIVE_US
    assert live_frames > LIVE_HZ * WATCHED_S / 3
    camera.unplug()
    wait_fault(daemon, "no RICOH THETA on USB")
    assert_room(daemon.wait_estimate(time.time_ns()))


def test_unplugged_in_the_middle_and_back(start, camera):
    camera.plug()
    daemon = start(f"ptp:?{STILLS}")
    daemon.wait_estimate()
    camera.theta.moods.late_s = 2.0  # pulled while stills are awaited
    sets = camera.theta.sets
    wait_for("a set", lambda: camera.theta.sets > sets)
    camera.unplug()
    daemon.wait_state("WAITING")
    camera.theta.moods.late_s = 0.05
    camera.theta.set_number(0xD808, 0)
    camera.plug()
    daemon.wait_state("STREAMING")
    daemon.wait_estimate(time.time_ns())
    daemon.stop()
    # what it was before the daemon came, not what it was when it came back
    assert camera.theta.values == camera.theta.first_values


def test_what_a_camera_may_do(start, camera):
    """A session of a crashed program, busy now and then, stills that are announced late."""
    camera.plug()
    camera.theta.has_session = True
    camera.theta.moods.busy = 3
    camera.theta.moods.late_s = 1.0
    daemon = start(f"ptp:?{STILLS}")
    daemon.wait_state("STREAMING")
    camera.theta.moods.busy = 2
    daemon.wait_estimate(time.time_ns())


def test_a_daemon_that_ends_in_the_middle_of_a_set(start, camera):
    camera.plug()
    camera.theta.moods.late_s = 1.5
    daemon = start(f"ptp:?{STILLS}")
    wait_for("a still", lambda: camera.theta.stills > 0)
    daemon.stop()
    assert_as_sold(camera.theta)


def test_a_daemon_that_was_killed(start, camera):
    """Its session and its settings are left; the next one takes over."""
    camera.plug()
    daemon = Daemon(f"ptp:?{STILLS}")
    daemon.wait_estimate()
    daemon.stop(by=signal.SIGKILL)
    assert camera.theta.has_session
    start(f"ptp:?{STILLS}").wait_estimate(time.time_ns())


def test_stills_that_never_come(start, camera):
    camera.plug()
    camera.theta.moods.loses = 1
    daemon = start(f"ptp:?{STILLS}")
    wait_fault(daemon, "2 of 3 came: beginning again")
    daemon.wait_state("STREAMING")


def test_damaged_stills(start, camera):
    camera.plug()
    camera.theta.moods.cuts = True
    daemon = start(f"ptp:?{STILLS}")
    wait_fault(daemon, "only corrupt stills")
    camera.theta.moods.cuts = False
    assert daemon.wait_state("STREAMING").frames_rejected >= 3


def test_no_answer(start, camera):
    camera.plug()
    daemon = start(f"ptp:?{STILLS}")
    daemon.wait_estimate()
    camera.theta.moods.mute = True
    wait_fault(daemon, "no answer: beginning again")
    camera.theta.moods.mute = False
    daemon.wait_estimate(time.time_ns())


def test_its_mode_is_changed_by_hand(start, camera):
    camera.plug()
    daemon = start(f"ptp:?{STILLS}")
    daemon.wait_estimate()
    camera.theta.set_number(STILL_CAPTURE_MODE, LIVE_STREAMING)
    wait_fault(daemon, "live streaming mode, which takes no stills")
    camera.theta.set_number(STILL_CAPTURE_MODE, 1)
    daemon.wait_estimate(time.time_ns())


def test_another_model(start, camera):
    camera.theta.model = "RICOH THETA SC2"
    camera.plug()
    wait_fault(start("ptp:"), "RICOH THETA SC2: brackets are known of RICOH THETA X, Z1 and V only")


def test_a_setting_is_refused(start, camera):
    camera.theta.moods.refuses = {BRACKET}
    camera.plug()
    wait_fault(start("ptp:"), "bracket: the camera refuses: value not allowed (0x201c)")
    assert camera.theta.values[BRACKET] == FIRST_BRACKET


def test_another_serial_number(start, camera):
    camera.plug()
    wait_fault(start("ptp:YN10100043"), "no THETA with the serial number YN10100043 among 1 on USB")


def node() -> str:
    """Path of the camera's device file."""
    line = next(line for line in run("lsusb").splitlines() if "05ca:" in line)
    return f"/dev/bus/usb/{line.split()[1]}/{line.split()[3].rstrip(':')}"


def test_another_program_has_it(start, camera):
    camera.plug()
    path = wait_for("the camera", lambda: "05ca:" in run("lsusb") and node())
    with open(path, "wb", buffering=0) as other:
        fcntl.ioctl(other, CLAIM, struct.pack("I", 0))
        daemon = start(f"ptp:?{STILLS}")
        wait_fault(daemon, "another program has it")
    daemon.wait_state("STREAMING")


def test_no_permission(start, camera):
    camera.plug()
    wait_for("the camera", lambda: "05ca:" in run("lsusb"))
    daemon = start(f"ptp:?{STILLS}", user=65534)
    wait_fault(daemon, "no permission")
    run("chmod", "666", node())
    daemon.wait_state("STREAMING")
