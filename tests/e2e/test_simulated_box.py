"""Camera, wheel, ring and firmware of the simulator as one: what each tells must fit the others."""

import contextlib
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from box import until
from harness import Daemon
from lightprobe.calibrate import ring
from lightprobe.client import Client
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag
from lightprobe.imaging import camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.sim import control, scenes
from lightprobe.sim.world import World
from lightprobe.wire import Subscription
from test_simulator import Camera

pytestmark = pytest.mark.many_frames

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
ADC_OFFSET = 0.05  # what two counts make of the illuminance, from 10 to 1000 lx
PATIENCE_S = 60.0
SIZE = (64, 32)
OPTIONS = ["--size", "64x32", "--act-s", "0", "--rate", "10"]


@dataclass
class Running:
    """A simulator with a box."""

    folder: Path
    process: subprocess.Popen[str]

    def control(self, line: str) -> str:
        return control.send(self.folder / "control", line)

    def status(self) -> dict:
        return json.loads(self.control("status"))

    def connect(self) -> mcu.Mcu:
        link = mcu.Mcu(mcu_link.open_carrier(f"serial:{self.folder / 'mcu'}"))
        link.hello(timeout_s=PATIENCE_S)
        return link


@contextlib.contextmanager
def simulator(folder: Path, *options: str, firmware: str = "host") -> Iterator[Running]:
    command = [LIGHTPROBE, "simulate", "--socket", folder / "camera", "--pty", folder / "mcu",
               "--control", folder / "control", "--firmware", firmware, "--truth",
               folder / "truth", *OPTIONS, *options]  # fmt: skip
    with open(folder / "log", "w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, text=True)
    try:
        deadline = time.monotonic() + PATIENCE_S
        while "microcontroller" not in (folder / "log").read_text():
            assert process.poll() is None, (folder / "log").read_text()
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield Running(folder, process)
        assert process.poll() is None, (folder / "log").read_text()
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)
    assert "Traceback" not in (folder / "log").read_text()
    assert not (folder / "mcu").is_symlink()
    assert not (folder / "control").exists()


def settle(link: mcu.Mcu, token: int) -> mcu.WheelState:
    state = until(
        link, lambda e: isinstance(e, mcu.WheelState) and e.token == token
        and e.phase in (mcu.Phase.SETTLED, mcu.Phase.FAULT),
    )  # fmt: skip
    assert isinstance(state, mcu.WheelState)
    assert state.phase is mcu.Phase.SETTLED
    return state


def settled_frame(running: Running, eye: Camera) -> tuple[float, np.ndarray]:
    """A frame taken from now on, and the true angle of the wheel in it."""
    end = time.monotonic_ns()
    while True:
        header, payload = eye.frame()
        if header["t_start_ns"] > end:
            break
    lines = [json.loads(line) for line in (running.folder / "truth").read_text().splitlines()]
    line = next(line for line in lines if line["sequence"] == header["sequence"])
    return line["wheel_deg"], np.frombuffer(payload, "<f4").reshape(SIZE[1], SIZE[0], 3)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("firmware", ["host", "avr"])
def test_the_wheel_shapes_the_frames(tmp_path: Path, firmware: str) -> None:
    """Firmware's word, the box's truth and the picture's Malus law agree at every angle."""
    scene = World(scenes.load(["sky"]), None, 30.0).scenes[0]
    layers = scene.render(*SIZE)
    polarizer = Polarizer(Sheet(), camera.equirect(), SIZE)
    options = ("--scenes", "sky", "--format", "RGBF")
    with simulator(tmp_path, *options, firmware=firmware) as running:
        link = running.connect()
        link.rates(wheel_ms=50)
        settle(link, link.home())
        with Camera(tmp_path / "camera") as eye:
            seen = []
            for target in (0.0, 45.0, 120.0):
                state = settle(link, link.move(target, hold_s=0.1))
                true_deg, frame = settled_frame(running, eye)
                assert abs(true_deg - state.measured_deg) <= 3 * state.sigma_deg
                assert true_deg == pytest.approx(float(running.control("get wheel_deg")), abs=0.6)
                expected = polarizer.through(
                    layers.compose([1]), layers.compose_polarized([1]), (true_deg,)
                )
                assert frame == pytest.approx(expected, rel=1e-3, abs=1e-4)
                seen.append(frame)
        assert not np.allclose(seen[0], seen[1], rtol=0.05)
        link.close()


def test_a_moving_wheel_smears_a_long_exposure(tmp_path: Path) -> None:
    options = ("--scenes", "sky", "--format", "RGBF", "--exposure-us", "90000")
    with simulator(tmp_path, *options) as running:
        link = running.connect()
        link.rates(wheel_ms=50)
        settle(link, link.home())
        token = link.move(180, slew_deg_s=60)
        with Camera(tmp_path / "camera") as eye:
            angles = [settled_frame(running, eye)[0] for _ in range(8)]
        settle(link, token)
        link.close()
    assert all(-25 < deg < 185 for deg in angles)
    assert len({round(deg, 1) for deg in angles}) > 4
    assert max(np.diff(angles)) < 60 * 1.0  # no jump: it goes its way as fast as it was told


def test_the_scenes_light_is_on_the_ring(tmp_path: Path) -> None:
    with simulator(tmp_path, "--scenes", "procedural:3") as running:
        link = running.connect()
        link.rates(ring_scans=8)
        lux = running.status()["ring_lux"]
        series = [float(running.control(f"get ldr{k}_mux_ohm")) for k in range(9)]
        sensors = ring.Ring(series_ohm=np.array(series))

        def fits(event: mcu.Event) -> bool:
            if not isinstance(event, mcu.Ring):
                return False
            return sensors.lux(event.levels) == pytest.approx(lux, rel=ADC_OFFSET)

        until(link, fits)
        assert max(lux) > 1.2 * min(lux)
        for level_lux in (10.0, 1000.0):
            assert running.control(f"light {level_lux}") == "ok"
            lux = [level_lux] * 9
            until(link, fits)
        assert running.control("light scene") == "ok"
        lux = running.status()["ring_lux"]
        until(link, fits)
        link.close()


def test_ldrs_that_differ_read_differently(tmp_path: Path) -> None:
    with simulator(tmp_path, "--scenes", "procedural:1", "--ring-spread", "1") as running:
        running.control("light 100")
        assert running.control("faults temperature_c=25&ldr_memory=0") == "ok"
        link = running.connect()
        link.rates(ring_scans=8)
        r10 = [float(running.control(f"get ldr{k}_r10_ohm")) for k in range(9)]
        gamma = [float(running.control(f"get ldr{k}_gamma")) for k in range(9)]
        assert np.std(np.log(r10)) > 0.08
        series = [float(running.control(f"get ldr{k}_mux_ohm")) for k in range(9)]
        own = ring.Ring(np.array(r10), np.array(gamma), np.array(series))
        until(
            link, lambda e: isinstance(e, mcu.Ring)
            and own.lux(e.levels) == pytest.approx(100, rel=ADC_OFFSET),
        )  # fmt: skip
        running.control("faults temperature_c=60")  # R grows by e^(0.005 * 35)
        warm = 100 * np.exp(-0.175 / np.array(gamma))
        until(
            link, lambda e: isinstance(e, mcu.Ring)
            and own.lux(e.levels) == pytest.approx(warm, rel=ADC_OFFSET),
        )  # fmt: skip
        link.close()


def test_faults_at_run_time_get_their_names(tmp_path: Path) -> None:
    with simulator(tmp_path, "--scenes", "procedural:1") as running:
        link = running.connect()
        link.rates(ring_scans=80, wheel_ms=100)
        settle(link, link.home())

        def fault(name: str) -> Callable[[mcu.Event], bool]:
            return lambda e: isinstance(e, mcu.Fault) and e.name == name and e.active

        running.control("faults stuck=1&drop=0.5")
        link.move(135)
        until(link, fault("WHEEL_STUCK"))
        assert running.status()["faults"]["drop"] == 0.5
        running.control("faults ldr3_forced=0")
        open_sensor = until(link, fault("LDR_OPEN"))
        assert open_sensor.detail == 1 << 3
        running.control("faults stuck=0&ldr3_forced=-1&drop=0")
        time.sleep(0.3)
        link.clear_faults()
        settle(link, link.home())
        running.control("faults reset=1")
        hello = until(link, lambda e: isinstance(e, mcu.Message) and e.name == "Hello")
        assert hello["reset_cause"] == "EXTERNAL"
        link.close()


def talk(link: mcu.Mcu, seconds: float) -> None:
    """Ask and listen; what comes is of no interest."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        link.carrier.send(*mcu.encode("HelloRequest", protocol_major=1, protocol_minor=0))
        list(link.events(0.1))


def test_the_line_can_be_noisy_cut_and_unplugged(tmp_path: Path) -> None:
    with simulator(tmp_path, "--scenes", "procedural:1") as running:
        link = running.connect()
        link.rates(ring_scans=8)
        running.control("faults line_noise=0.02")
        carrier = link.carrier
        assert isinstance(carrier, mcu_link.SerialCarrier)
        deadline = time.monotonic() + PATIENCE_S
        while carrier.decoder.bad < 5:
            assert time.monotonic() < deadline
            for event in link.events(0.05):  # what passes is right
                assert not isinstance(event, mcu.Ring) or len(event.levels) == 9
                if carrier.decoder.bad >= 5:
                    break
        running.control("faults line_noise=0&line_cut=1")
        time.sleep(0.2)
        list(link.events(0.1))
        assert not list(link.events(0.5))
        running.control("faults line_cut=0&line_unplugged=1")
        with pytest.raises(OSError, match=r"(?i)device|input/output"):
            talk(link, 10)
        assert not (tmp_path / "mcu").exists()
        link.close()
        running.control("faults line_unplugged=0")
        while not (tmp_path / "mcu").exists():
            assert time.monotonic() < deadline + PATIENCE_S
            time.sleep(0.02)
        again = running.connect()
        again.close()


def test_parameters_are_kept(tmp_path: Path) -> None:
    for expected in (7407, 7500):
        with simulator(
            tmp_path, "--scenes", "procedural:1", "--eeprom", str(tmp_path / "eeprom")
        ) as running:
            link = running.connect()
            assert link.param(1).value == expected
            link.param(1, 7500)
            link.save_params()
            link.close()


def test_a_polarizer_set_by_hand_needs_no_firmware(tmp_path: Path) -> None:
    command = [LIGHTPROBE, "simulate", "--socket", tmp_path / "camera", *OPTIONS, "--scenes",
               "sky", "--format", "RGBF", "--polarizer", "30"]  # fmt: skip
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        with Camera(tmp_path / "camera") as eye:
            frame = np.frombuffer(eye.frame()[1], "<f4").reshape(SIZE[1], SIZE[0], 3)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)
    layers = World(scenes.load(["sky"]), None, 30.0).scenes[0].render(*SIZE)
    polarizer = Polarizer(Sheet(), camera.equirect(), SIZE)
    expected = polarizer.through(layers.compose([1]), layers.compose_polarized([1]), (30.0,))
    assert frame == pytest.approx(expected, rel=1e-5)


def test_a_firmware_that_dies_ends_the_simulator_with_its_words(tmp_path: Path) -> None:
    program = tmp_path / "lightprobe-mcu-host"
    program.write_text(
        "#!/bin/sh\nread names; echo stuck; read any; echo broken servo >&2; exit 7\n"
    )
    program.chmod(0o755)
    done = run("--firmware", "host", folder=tmp_path)
    assert done.returncode == 1
    assert "firmware: ended with status 7: broken servo" in done.stderr


def run(*options: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [LIGHTPROBE, "simulate", "--socket", folder / "camera", "--pty", folder / "mcu",
               *OPTIONS, "--scenes", "procedural:1", "--seconds", "20", *options]  # fmt: skip
    environment = {"LIGHTPROBE_FIRMWARE": str(folder), "PATH": "/usr/bin:/bin"}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--firmware", "arm"], "expected host, avr, none"),
        (["--firmware", "host"], "no lightprobe-mcu-host in .*make firmware-host"),
        (["--firmware", "avr"], "no lightprobe-mcu-simavr in .*make firmware-avr"),
        (["--firmware", "host", "--polarizer", "3"], "the wheel of --firmware turns"),
        (["--faults", "stuck=1"], "unknown option stuck"),
    ],
)
def test_bad_options_say_what_to_do(tmp_path: Path, options: list[str], message: str) -> None:
    done = run(*options, folder=tmp_path)
    assert done.returncode in (1, 2)
    assert re.search(message, done.stderr), done.stderr
    assert "Traceback" not in done.stderr


def control_command(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([LIGHTPROBE, "control", *words], capture_output=True, text=True)


def test_control_names_what_is_wrong(tmp_path: Path) -> None:
    done = control_command("status", tmp_path / "none")
    assert done.returncode == 1
    assert "none: No such file or directory: is lightprobe simulate --control=" in done.stderr
    with simulator(tmp_path, "--scenes", "procedural:1") as running:
        socket = tmp_path / "control"
        for words, message in [
            (("inject-fault", socket, "explode=1"), "unknown option explode"),
            (("light", socket, "dark"), "expected lux, or scene"),
            (("get", socket, "nothing"), "no number nothing"),
            (("scene", socket, "2"), "scene 2: expected 1…1, or all"),
        ]:
            done = control_command(*words)
            assert done.returncode == 2
            assert message in done.stderr
        with pytest.raises(
            UsageError, match="unknown command: known are card, faults, get, light, scene, status"
        ):
            running.control("dance")
        assert control_command("scene", socket, "1").stdout == "ok\n"
        assert control_command("inject-fault", socket, "drop=0.5").stdout == "ok\n"
        assert running.status()["faults"]["drop"] == 0.5
        assert running.status()["counters"]["connections"] == 0


def sigmas_off(estimate: Estimate, true_ratio: float) -> float | None:
    """By how many of its sigmas the ratio of the two strongest lamps errs; None: one is a bound."""
    lamps = [one for one in estimate.lights if not one.flags & LightFlag.REFLECTION]
    strongest = sorted(lamps, key=lambda lamp: float(lamp.irradiance[1]), reverse=True)[:2]
    sigmas = [
        float(lamp.irradiance_sigma[1] / lamp.irradiance[1])
        for lamp in strongest
        if lamp.irradiance_sigma is not None
    ]
    if len(sigmas) < 2:
        return None
    ratio = float(strongest[1].irradiance[1] / strongest[0].irradiance[1])
    return abs(float(np.log(ratio / true_ratio))) / float(np.hypot(*sigmas))


@pytest.mark.nightly_rows
@pytest.mark.parametrize("turn_deg_s", ["0", "30"])
def test_a_sweep_tells_reflections_from_lamps(tmp_path: Path, turn_deg_s: str) -> None:
    """Firmware, wheel, film and brackets; what a varnished floor mirrors is called so."""
    (scene,) = scenes.load(["polished:room"])
    strongest = sorted((float(lamp.irradiance[1]) for lamp in scene.lamps), reverse=True)
    options = ("--scenes", "polished:room", "--size", "960x480", "--turn-deg-s", turn_deg_s)
    off: list[float] = []
    with (
        simulator(tmp_path, *options),
        Daemon(
            f"--source=sim:{tmp_path / 'camera'}", f"--rotator=mcu:serial:{tmp_path / 'mcu'}",
            "--polarizer=sweep", variant="release",
        ) as daemon,
        Client(f"unix:{daemon.socket}", Subscription(max_lights=8, smoothing="RAW")) as client,
    ):  # fmt: skip

        def told(client: Client) -> bool:
            latest = client.latest()
            if latest is None or latest.flags & EstimateFlag.CLIPPED:
                return False
            sigmas = sigmas_off(latest, strongest[1] / strongest[0])
            off.extend([] if sigmas is None else [sigmas])
            images = [one for one in latest.lights if one.flags & LightFlag.REFLECTION]
            return (
                not latest.flags & EstimateFlag.POLARIZATION_UNKNOWN
                and sigmas is not None
                and len(images) >= 2
                and all(one.dolp for one in images)
            )

        assert client.wait_for(told, 2 * PATIENCE_S)
        estimate = client.latest()
        assert estimate is not None
    lamps = [one for one in estimate.lights if not one.flags & LightFlag.REFLECTION]
    images = [one for one in estimate.lights if one.flags & LightFlag.REFLECTION]
    assert all(one.elevation_deg < 0 for one in images)
    assert all(one.dolp is None or one.dolp < 0.2 for one in lamps[:3])
    assert max(off) < 3.5  # of all packets that do not say that some lamp is only a lower bound


def test_a_running_probe_shows_how_its_light_is_polarized(tmp_path: Path) -> None:
    """The whole way of `lightprobe polarization`: a sweep on request, then a coarse picture."""
    options = ("--scenes", "polished:room", "--size", "480x240")
    with (
        simulator(tmp_path, *options),
        Daemon(
            f"--source=sim:{tmp_path / 'camera'}", f"--rotator=mcu:serial:{tmp_path / 'mcu'}",
            "--polarizer=sweep", "--publish-polarization", variant="release",
        ) as daemon,
    ):  # fmt: skip
        with Client(f"unix:{daemon.socket}") as client:
            assert client.wait_for(lambda one: one.health is not None, PATIENCE_S)
            assert client.hello is not None
            assert client.hello.polarization_map
            ready = ("SETTLED", "MOVING")
            assert client.wait_for(
                lambda one: (
                    bool(one.health and one.health.wheel) and one.health.wheel.phase in ready
                ),
                PATIENCE_S,
            )
        command = [LIGHTPROBE, "polarization", f"unix:{daemon.socket}", "--sweep", "--json",
                   "--wait", "120", "--out", tmp_path / "out"]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        with Client(f"unix:{daemon.socket}") as client:
            assert client.wait_for(lambda one: one.health is not None, PATIENCE_S)
            assert client.health is not None
            assert client.health.polarization_maps_sent == 1
    summary = json.loads(done.stdout)
    assert summary["sweeps"] >= 1
    assert 0.55 < summary["known_share"] < 0.65
    stokes = np.load(tmp_path / "out" / "stokes.npz")["S"]
    assert stokes.shape == (60, 120, 4, 3)
    floor = stokes[38:44, 45:75]  # near Brewster's angle, ahead
    assert np.median(floor[:, :, 1]) > 0  # horizontal
