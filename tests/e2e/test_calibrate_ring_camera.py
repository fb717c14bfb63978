"""`calibrate ring --from-camera`: the real daemon before a simulated camera that is turned.

In simulated time, with the LDRs of :mod:`lightprobe.sim.ldr`; the command itself runs with the
flashed firmware.
"""

import contextlib
import copy
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from lightprobe import daemon
from lightprobe.calibrate import ring, ring_plot, ring_seats
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.ring_turning import Samples, Turning
from lightprobe.client import Client
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.imaging import camera as lenses
from lightprobe.sim import ldr, scenes
from lightprobe.sim.box import Box
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.ldr import Ldrs
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.surroundings import draw_ring
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from test_calibrate_box import calibrate
from test_simulated_box import simulator

pytestmark = pytest.mark.many_frames

LUX_PER_UNIT = 60.0
#: What the film on the simulated box's wheel lets pass, and its options: without surfaces, which
#: would take other light than the ring's. A user takes the film off.
FILM, FILM_OPTIONS = 0.42, ("--film", "0.84,500,0,1")
READING_S = 0.02
TURNING = Behaviour(act_s=0, turn_deg_s=20, nod_deg=15, nod_hz=0.11)


def turned(
    parts: Ldrs, behaviour: Behaviour = TURNING, scene: str = "room", seconds: float = 40.0
) -> Turning:
    """What a probe has seen of a room while it was turned, and the ring beside it."""
    world = World(scenes.load([scene]), behaviour)
    camera = SimulatedCamera(world, lenses.load("equirect"), (480, 240), rate_hz=15)
    with LiveProbe(camera) as probe:
        client = probe.client(Subscription(smoothing="RAW", sh_order=4, max_lights=8))
        probe.run(seconds)
        seen = [(probe.captured_s(estimate), estimate) for estimate in client.estimates]
    turning = Turning()
    read(turning, RingLight(world, LUX_PER_UNIT, parts), world, parts, seen[-1][0])
    for t_s, estimate in seen:
        now_ns = estimate.send_time_unix_ns - estimate.capture_time_unix_ns + round(1e9 * t_s)
        turning.estimate(estimate, LUX_PER_UNIT, now_ns)
    return turning


def read(turning: Turning, light: RingLight, world: World, parts: Ldrs, until_s: float) -> None:
    """Readings of LDRs that lag, in a warm room, after a brighter hour."""
    felt = light.lux(world.at(0.0))
    rested = 5 * felt.mean()
    for t_s in np.arange(0, until_s, READING_S):
        lux = light.lux(world.at(t_s))
        felt += (lux - felt) * (1 - np.exp(-READING_S / np.where(lux > felt, 0.02, 0.03)))
        level = parts.level(felt, 32.0, rested)
        turning.ring(round(1e6 * t_s), level, round(1e9 * t_s))


@pytest.fixture(scope="module")
def turning() -> tuple[Ldrs, Turning]:
    parts = Ldrs.draw(np.random.default_rng(7))
    return parts, turned(parts)


@pytest.fixture(scope="module")
def samples(turning: tuple[Ldrs, Turning]) -> tuple[Ldrs, Samples]:
    return turning[0], turning[1].samples()


def test_turning_finds_what_each_sensor_reads(
    samples: tuple[Ldrs, Samples], tmp_path: Path
) -> None:
    parts, taken = samples
    found = ring_seats.fit(taken, 0.02)
    true = ring.Ring(ldr.drift(1.0, 32.0) * parts.r10_ohm, parts.gamma, parts.series_ohm)
    for share in (0.05, 0.5, 0.95):
        lux = np.quantile(taken.lux[:, 0], share, axis=0)
        level = true.level(lux)
        off = np.log(found.ring.lux(level) / lux)
        nominal = np.log(ring.Ring().lux(level) / lux)
        # light of a brighter hour before is in the readings, and not in `true`
        assert np.std(off) < 0.04 < 0.2 < np.std(nominal)
        assert np.sqrt(np.mean(off**2)) < 0.08
        own = np.hypot(found.ring.sigma_of(level), 0.01)
        assert np.all(np.abs(off - off.mean()) < 3 * own)
    assert found.ring.drift_common_sigma > 0.14
    right = found.ring.seat_right_deg[:8] - parts.seats_deg[:8, 0]
    assert np.sqrt(np.mean(right**2)) < 1.2 < np.std(parts.seats_deg)
    # as a measure of the print: what the resin reflects makes them lean
    lean = np.column_stack([found.ring.seat_right_deg, found.ring.seat_up_deg]) - parts.seats_deg
    assert np.all(np.abs(lean) < 2 * found.seat_sigma_deg[:, None])
    assert np.sqrt(np.mean((lean / found.seat_sigma_deg[:, None]) ** 2)) > 0.4
    file = tmp_path / "ring.ini"
    file.write_text(found.ring.text())
    read_again = ring.load(file)
    assert read_again.seats_deg == pytest.approx(found.ring.seats_deg, rel=0.01)
    assert read_again.drift_common_sigma == pytest.approx(found.ring.drift_common_sigma, rel=1e-5)
    ring_plot.draw(taken, found, tmp_path / "ring.png")
    assert (tmp_path / "ring.png").stat().st_size > 10_000


def test_what_a_slow_camera_says_again_does_not_count(
    turning: tuple[Ldrs, Turning], samples: tuple[Ldrs, Samples]
) -> None:
    """A probe repeats the last estimate, as STALE, while it waits for the next frame."""
    again = copy.deepcopy(turning[1])
    count = len(again._lux)
    last = Estimate(
        1, 2, again._captured_unix_ns, 2_000_000, 500, EstimateFlag.STALE, (),
        SphericalHarmonics("AMBIENT", 2, np.ones((9, 3))), None, None, 1, None,
    )  # fmt: skip
    for _ in range(2 * count):
        assert not again.estimate(last, LUX_PER_UNIT, last.send_time_unix_ns)
    np.testing.assert_array_equal(again.samples().lux, samples[1].lux)


def starts(folder: Path, ring_uri: str) -> None:
    """Start a daemon with this ring, until it listens."""
    arguments = [f"--ring={ring_uri}", f"--publish=unix:{folder / 'probe'}"]
    with daemon.Daemon(arguments, folder / "log") as probe:
        while not (folder / "probe").exists():
            probe.check()
            time.sleep(0.05)


def test_the_daemon_reads_the_file(samples: tuple[Ldrs, Samples], tmp_path: Path) -> None:
    file = tmp_path / "ring.ini"
    file.write_text(ring_seats.fit(samples[1], 0.02).ring.text())
    uri = f"mcu:serial:{tmp_path / 'none'}?calibration={file}"
    starts(tmp_path, uri)
    file.write_text(file.read_text().replace("seat_up_deg = ", "seat_up_deg = 1, "))
    (tmp_path / "probe").unlink(missing_ok=True)
    with pytest.raises(daemon.DaemonError, match=r"seat_up_deg: 10 values, but nine"):
        starts(tmp_path, uri)


def test_a_dead_sensor_is_named(samples: tuple[Ldrs, Samples]) -> None:
    level = samples[1].level.copy()
    level[:, 3] = np.nan
    with pytest.raises(CalibrationError, match="sensor 3: only 0 usable readings"):
        ring_seats.fit(Samples(samples[1].lux, level), 0.02)
    level[:, 3] = np.random.default_rng(0).uniform(500, 3500, len(level))
    with pytest.raises(CalibrationError, match="sensor 3: its readings lie on no LDR's curve"):
        ring_seats.fit(Samples(samples[1].lux, level), 0.02)


@pytest.mark.parametrize(
    ("behaviour", "scene", "reason"),
    [
        (Behaviour(act_s=0, swing_deg=40), "room", "too little turning"),
        (Behaviour(act_s=0, turn_deg_s=60), "sky", "clipping"),
        (
            Behaviour(act_s=0, turn_deg_s=60, flicker=Flicker(8.0, (0.9,), (0.0,), ("sine",))),
            "room",
            "flicker",
        ),
    ],
)
def test_what_cannot_calibrate_is_refused_by_its_reason(
    behaviour: Behaviour, scene: str, reason: str
) -> None:
    parts = Ldrs.draw(np.random.default_rng(7))
    with pytest.raises(CalibrationError, match=reason):
        turned(parts, behaviour, scene, 8.0).samples()


def test_light_from_everywhere_is_refused(turning: tuple[Ldrs, Turning]) -> None:
    even = copy.copy(turning[1])
    even._lux = [np.full_like(lux, 100.0) for lux in even._lux]
    with pytest.raises(CalibrationError, match="too little range of light"):
        even.samples()


@contextlib.contextmanager
def probe_before(folder: Path, *options: str, firmware: str) -> Iterator[str]:
    """A daemon before a simulated camera in a room, with a box beside it; its address."""
    uri = f"unix:{folder / 'probe'}"
    room = ("--size", "240x120", "--scenes", "room", "--act-s", "0",
            "--ring-spread", "1", "--cd-m2-per-unit", str(LUX_PER_UNIT))  # fmt: skip
    with simulator(folder, *room, *FILM_OPTIONS, *options, firmware=firmware):
        arguments = [f"--source=sim:{folder / 'camera'}", f"--publish={uri}"]
        with daemon.Daemon(arguments, folder / "daemon.log") as probe:
            while not (folder / "probe").exists():
                probe.check()
                time.sleep(0.05)
            yield uri


#: What estimates say until the camera's exposures have settled.
UNSETTLED = EstimateFlag.CLIPPED | EstimateFlag.UNDEREXPOSED | EstimateFlag.STALE
#: Seconds of turning, its rate, and frames a second: simavr leaves a busy machine few of them.
HOST, AVR = ("15", "30", "15"), ("75", "6", "5")


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("firmware", "seconds", "deg_s", "rate_hz"),
    [("host", *HOST), ("avr", *AVR)],
)
def test_the_command_calibrates_a_box_that_is_turned(
    tmp_path: Path, firmware: str, seconds: str, deg_s: str, rate_hz: str
) -> None:
    """Gamma and readings are those of the simulated parts; the daemon takes the file."""
    file, parts = tmp_path / "ring.ini", draw_ring(1.0, 0)[0]
    turning = ("--turn-deg-s", deg_s, "--nod-deg", "15", "--nod-hz", f"{float(deg_s) / 150}",
               "--rate", rate_hz)  # fmt: skip
    with probe_before(tmp_path, *turning, firmware=firmware) as uri:
        with Client(uri, Subscription(smoothing="RAW")) as client:
            assert client.wait_for(lambda c: c.latest() and not c.latest().flags & UNSETTLED, 60)
        words = ("ring", "--from-camera", uri, "--seconds", seconds, "--output", str(file),
                 "--cd-m2-per-unit", str(LUX_PER_UNIT / FILM), "--json")  # fmt: skip
        told = json.loads(calibrate(tmp_path, *words))
    assert max(told["rms"]) < 0.015
    gamma, sigma = np.array(told["gamma"]), np.array(told["gamma_sigma"])
    assert np.all(np.abs(gamma - parts.gamma) < 2 * sigma)
    known = ring.load(file)
    for lux in (500.0, 1000.0):
        level = parts.level(np.full(9, lux))
        off, nominal = (np.log(one.lux(level) / lux)[:8] for one in (known, ring.Ring()))
        # a busy machine takes few pairs: what these leave open is in the file's own sigma
        own = np.hypot(known.sigma_of(level)[:8], 0.01)
        assert np.all(np.abs(off - off.mean()) < 3 * own)
        assert np.std(off) < np.std(nominal)
        assert abs(off.mean()) < 0.2  # the light of the last hour
    (tmp_path / "probe").unlink(missing_ok=True)
    starts(tmp_path, f"mcu:serial:{tmp_path / 'none'}?calibration={file}")


def test_the_command_says_why_it_refuses(tmp_path: Path) -> None:
    """A probe without a scale, and a box that stands still, with the flashed firmware."""
    file = tmp_path / "ring.ini"
    with probe_before(tmp_path, "--median-radiance", "0", "--rate", "5", firmware="avr") as uri:
        words = ("ring", "--from-camera", uri, "--seconds", "6", "--output", str(file))
        assert "scale is relative" in calibrate(tmp_path, *words, status=1)
        said = calibrate(tmp_path, *words, "--cd-m2-per-unit", "60", status=1)
        # simavr leaves a busy machine few frames, so that exposures may still be the first ones
        assert re.search("too little turning: .* 1 of 12 directions|: darkness: switch", said)
    assert not file.exists()


def test_a_camera_that_gives_no_frames_is_named(tmp_path: Path) -> None:
    """And not the microcontroller."""
    uri = f"unix:{tmp_path / 'probe'}"
    arguments = [f"--source=sim:{tmp_path / 'nobody'}", f"--publish={uri}"]
    with Box("host", tmp_path / "mcu"), daemon.Daemon(arguments, tmp_path / "daemon.log"):
        said = calibrate(tmp_path, "ring", "--from-camera", uri, status=1)
    assert "no estimate in 10 s: does its camera give frames?" in said
    assert "unplugged" not in said


def test_ways_exclude_each_other(tmp_path: Path) -> None:
    both = ("ring", "--from-camera", "unix:x", "--levels", "10")
    assert "expected --levels" in calibrate(tmp_path, *both, status=2)
    plot = ("ring", "--levels", "10", "--plot", str(tmp_path / "x.png"))
    assert "--plot: only with --from-camera" in calibrate(tmp_path, *plot, status=2)
