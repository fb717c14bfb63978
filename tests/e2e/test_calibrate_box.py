"""`lightprobe calibrate wheel` and `ring`, against a box whose numbers are known."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lightprobe import daemon
from lightprobe.calibrate import ring
from lightprobe.sim import ldr
from lightprobe.sim.box import Box
from test_simulated_box import simulator

pytestmark = pytest.mark.many_frames

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


def calibrate(folder: Path, *words: str, status: int = 0, stdin: str = "") -> str:
    """Output of a command; its errors when it ends with another status than 0."""
    environment = {**os.environ, "LIGHTPROBE_MCU": f"serial:{folder / 'mcu'}"}
    done = subprocess.run(
        [LIGHTPROBE, "calibrate", *words], capture_output=True, text=True, env=environment,
        input=stdin, timeout=280,
    )  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr if status else done.stdout


def test_wheel(tmp_path: Path) -> None:
    """Gain, zero and backlash of a crooked box; kept, and good for moving with."""
    with Box("host", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as box:
        box.set(servo_zero_us=815, servo_gain_us_deg=7.55, backlash_deg=1.5)
        told = json.loads(
            calibrate(tmp_path, "wheel", "--save", "--json", "--output", str(tmp_path / "w.ini"))
        )
        found, dead_band_deg = told["found"], 0.2
        assert found["gain_us_deg"] == pytest.approx(7.55, rel=0.005)
        assert found["zero_us"] == pytest.approx(815, abs=7.55 * 0.5)
        assert 1.5 - 0.2 <= found["backlash_deg"] <= 1.5 + 2 * dead_band_deg + 0.2
        assert told["after"]["servo_gain_ns_deg"] == pytest.approx(7550, rel=0.005)
        assert "[wheel]\nversion = 1\n" in (tmp_path / "w.ini").read_text()
        box.set(reset=1)
        environment = {**os.environ, "LIGHTPROBE_MCU": f"serial:{tmp_path / 'mcu'}"}
        mcu = [LIGHTPROBE, "mcu"]
        kept = subprocess.run(
            [*mcu, "params", "get", "servo_gain_ns_deg", "--json"], env=environment,
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert json.loads(kept.stdout)[0]["value"] == told["after"]["servo_gain_ns_deg"]


def test_a_wheel_that_does_not_turn_is_named(tmp_path: Path) -> None:
    with Box("host", tmp_path / "mcu") as box:
        box.set(stuck=1)
        words = calibrate(tmp_path, "wheel", status=1)
    assert "INDEX_ALWAYS: a sensor always sees a tooth" in words  # it stands on one, at 37°
    assert "does the wheel turn?" in words
    assert "mcu clear" in words


@pytest.mark.nightly_rows
@pytest.mark.parametrize("bandgap_mv", [1010, 1190])
def test_supply(tmp_path: Path, bandgap_mv: float) -> None:
    """The multimeter's reading makes the reported supply right, also after a reset."""
    with Box("host", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as box:
        box.set(supply_mv=4610, bandgap_mv=bandgap_mv)
        words = calibrate(tmp_path, "supply", "4.61")
        assert "not saved (--save): bandgap_mv 1100 → " in words
        told = json.loads(calibrate(tmp_path, "supply", "4.61", "--save", "--json"))
        assert told["after_mv"] == pytest.approx(bandgap_mv, abs=12)
        box.set(reset=1)
        told = json.loads(calibrate(tmp_path, "supply", "4.61", "--json"))
        assert told["reported_v"] == pytest.approx(4.61, abs=0.05)
        words = calibrate(tmp_path, "supply", "3.3", status=1)
        assert "is 3.3 V the voltage between its pins 5V and GND?" in words


def test_ring_at_known_levels(tmp_path: Path) -> None:
    """Somebody sets the light and presses Enter; the file gives back every sensor's own curve."""
    rng = np.random.default_rng(3)
    r10, gamma = 14000 * np.exp(0.2 * rng.standard_normal(9)), rng.uniform(0.62, 0.78, 9)
    file = tmp_path / "ring.ini"
    levels = (10, 100, 1000, 20_000)
    with Box("host", tmp_path / "mcu") as box:
        for k in range(9):
            box.set(**{f"ldr{k}_r10_ohm": r10[k], f"ldr{k}_gamma": gamma[k]})
        series = [box.get(f"ldr{k}_mux_ohm") for k in range(9)]
        environment = {**os.environ, "LIGHTPROBE_MCU": f"serial:{tmp_path / 'mcu'}"}
        process = subprocess.Popen(
            [LIGHTPROBE, "calibrate", "ring", "--levels", ",".join(map(str, levels)),
             "--output", file, "--json"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=environment, bufsize=0,
        )  # fmt: skip
        said = ""
        for number, level in enumerate(levels, 1):
            while f"{number}/4: {level:g} lux" not in said:
                letter = process.stderr.read(1)
                assert letter, said
                said += letter
            box.set(**{f"ldr{k}_lux": level for k in range(9)})
            process.stdin.write("\n")
        out, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert json.loads(out)["pairs"] == 4
    found = ring.load(file)
    assert found.r10_ohm == pytest.approx(r10, rel=0.04)
    assert found.gamma == pytest.approx(gamma, abs=0.02)
    assert found.series_ohm == pytest.approx(series, abs=15)
    lit = ring.Ring(r10, gamma, np.array(series))
    for lux in (10.0, 300.0, 10_000.0):
        seen = lit.level(np.full(9, lux))
        assert np.all(np.abs(found.lux(seen) / lux - 1) < found.total_sigma_of(seen))


def every(seconds: float, act: Callable[[], None], stop: threading.Event) -> threading.Thread:
    def run() -> None:
        while not stop.wait(seconds):
            act()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


@pytest.mark.nightly
def test_ring_against_the_camera(tmp_path: Path) -> None:
    """The probe's own estimates are the light meter; lamps are switched meanwhile."""
    options = ("--size", "960x480", "--rate", "20", "--scenes", "procedural:5", "--act-s", "4",
               "--ring-spread", "1", "--median-radiance", "0", "--film", "0.84,500,0,1",
               "--cd-m2-per-unit", "40")  # fmt: skip
    uri = f"unix:{tmp_path / 'probe'}"
    polarizer = 0.42  # the film's surfaces would take other light than the ring's: it has none
    with simulator(tmp_path, *options) as running:
        arguments = [f"--source=sim:{tmp_path / 'camera'}", f"--publish={uri}"]
        with daemon.Daemon(arguments, tmp_path / "daemon.log") as probe:
            while not (tmp_path / "probe").exists():
                probe.check()
                time.sleep(0.05)
            calibrate(
                tmp_path, "ring", "--against", uri, "--seconds", "40", "--cd-m2-per-unit",
                str(40.0 / polarizer), "--output", str(tmp_path / "ring.ini"),
            )  # fmt: skip
        r10 = [float(running.control(f"get ldr{k}_r10_ohm")) for k in range(9)]
        gamma = [float(running.control(f"get ldr{k}_gamma")) for k in range(9)]
        series = [float(running.control(f"get ldr{k}_mux_ohm")) for k in range(9)]
        warm = ldr.drift(1.0, float(running.control("get temperature_c")))
    found = ring.load(tmp_path / "ring.ini")
    true = ring.Ring(warm * np.array(r10), np.array(gamma), np.array(series))
    for lux in (100.0, 300.0):
        levels = true.level(np.full(9, lux))
        nominal = np.log(ring.Ring().lux(levels) / lux)
        calibrated = np.log(found.lux(levels) / lux)
        # What the resin reflects of light from aside they all have in common: `true` is of light
        # from the front.
        assert np.std(calibrated) < 0.08
        assert np.std(calibrated) < 0.5 * np.std(nominal)
        assert abs(np.median(calibrated)) < 0.2


def test_bad_requests_say_what_to_do(tmp_path: Path) -> None:
    assert "expected --levels LUX,LUX,… or --against" in calibrate(tmp_path, "ring", status=2)
    both = ("ring", "--levels", "1", "--against", "unix:x")
    assert "expected --levels" in calibrate(tmp_path, *both, status=2)
    with Box("host", tmp_path / "mcu") as box:
        assert "like 10,100,1000" in calibrate(tmp_path, "ring", "--levels", "dark", status=2)
        words = calibrate(tmp_path, "ring", "--levels", "10,20", status=1)
        assert "input ended" in words
        box.set(ldr2_forced=0, **{f"ldr{k}_lux": 50 for k in range(9)})
        one_level = ("ring", "--levels", "50", "--output")
        words = calibrate(tmp_path, *one_level, str(tmp_path / "new/x.ini"), stdin="\n", status=1)
        assert "sensor 2: no usable reading" in words
        box.set(ldr2_forced=-1)
        (tmp_path / "file").write_text("")
        words = calibrate(tmp_path, *one_level, str(tmp_path / "file/x.ini"), stdin="\n", status=2)
        assert f"{tmp_path / 'file'} is not a folder" in words  # before anybody sets a light
        assert calibrate(tmp_path, *one_level, str(tmp_path / "new/x.ini"), stdin="\n", status=0)
        assert (tmp_path / "new" / "x.ini").is_file()
