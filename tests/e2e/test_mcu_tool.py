"""`lightprobe mcu` as a user types it, against the firmware; `flash` through the real avrdude."""

import json
import os
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from lightprobe.calibrate import ring
from lightprobe.mcu.messages import PROTOCOL_MINOR
from lightprobe.sim.box import Box

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
FIRMWARE = Path(__file__).resolve().parents[2] / "build" / "firmware"


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Box]:
    """The firmware, at serial:<tmp_path>/mcu."""
    with Box("host", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as running:
        yield running


def mcu(folder: Path, *words: str, status: int = 0) -> str:
    """Output of a command; its errors when it ends with another status than 0."""
    environment = {**os.environ, "LIGHTPROBE_MCU": f"mcu:serial:{folder / 'mcu'}"}
    done = subprocess.run(
        [LIGHTPROBE, "mcu", *words], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr if status else done.stdout


@pytest.mark.usefixtures("box")
def test_info(tmp_path: Path) -> None:
    told = json.loads(mcu(tmp_path, "info", "--json"))
    assert told["Hello"]["board"] == "HOST"
    assert told["Capabilities"]["ring_sensors"] == 9
    assert told["WheelState"]["phase"] == "UNKNOWN"
    assert told["WheelState"]["measured_deg"] is None
    assert told["faults"] == []
    words = mcu(tmp_path, "info")
    assert "on HOST" in words
    assert "angle unknown" in words
    assert "no faults" in words
    assert f"\nprotocol 1.{PROTOCOL_MINOR}\n" in words


def test_home_move_release(tmp_path: Path, box: Box) -> None:
    assert "NOT_HOMED (detail 0): `lightprobe mcu home` first" in mcu(
        tmp_path, "move", "90", status=1
    )
    assert "SETTLED at 0.00°" in mcu(tmp_path, "home")
    state = json.loads(mcu(tmp_path, "move", "90", "--slew-deg-s", "120", "--json"))
    assert state["phase"] == "SETTLED"
    assert abs(box.get("wheel_deg") - state["measured_deg"]) <= 3 * state["sigma_deg"]
    assert state["measured_deg"] == pytest.approx(90, abs=1)
    assert box.get("powered") == 1
    mcu(tmp_path, "release")
    assert box.get("powered") == 0
    assert "OUT_OF_RANGE" in mcu(tmp_path, "move", "200", status=1)
    assert "expected -327…327 degrees" in mcu(tmp_path, "move", "400", status=2)


def test_pulse_holds_the_servo_and_lets_it_go(tmp_path: Path, box: Box) -> None:
    """Longer than the firmware would by itself; also when the tool is interrupted."""
    mcu(tmp_path, "params", "set", "hold_max_ds", "5")
    command = [LIGHTPROBE, "mcu", "pulse", "1234.5", "--port", f"serial:{tmp_path / 'mcu'}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    assert process.stdout.readline() == "servo at 1234.5 µs for 20 s\n"
    for _ in range(4):
        time.sleep(0.4)
        assert box.get("pulse_us") == pytest.approx(1234.5, abs=0.1)
        assert box.get("powered") == 1
    process.send_signal(signal.SIGINT)
    process.wait(30)
    process.stdout.close()
    assert box.get("powered") == 0
    assert mcu(tmp_path, "pulse", "800", "--seconds", "0.2").endswith("servo let go\n")
    assert box.get("powered") == 0
    assert "OUT_OF_RANGE" in mcu(tmp_path, "pulse", "2600", status=1)
    assert "expected 300…2700 µs" in mcu(tmp_path, "pulse", "80", status=2)


def test_what_the_eeprom_does_not_keep_is_no_success(tmp_path: Path, box: Box) -> None:
    mcu(tmp_path, "params", "set", "lag_ms", "41", "--save")
    box.command("worn 277 255")  # of the other copy
    words = mcu(tmp_path, "params", "set", "lag_ms", "42", "--save", status=1)
    assert "ParamAction refused: NOT_STORED (detail 277): that cell of the EEPROM is worn" in words
    mcu(tmp_path, "params", "reload")
    assert json.loads(mcu(tmp_path, "params", "get", "lag_ms", "--json"))[0]["value"] == 41


@pytest.mark.usefixtures("box")
def test_only_the_first_command_resets_the_microcontroller(tmp_path: Path) -> None:
    """Opening a Nano's port resets it, unless the one who closed it has left DTR alone."""
    boots = [json.loads(mcu(tmp_path, "info", "--json"))["Hello"]["boot_count"] for _ in range(3)]
    assert boots == [2, 2, 2]  # once for the power, once for the first opening
    mcu(tmp_path, "home")
    assert "SETTLED at 90.00°" in mcu(tmp_path, "move", "90")
    with serial.Serial(str(tmp_path / "mcu")) as port:  # somebody else's program
        settings = termios.tcgetattr(port.fileno())
        settings[2] |= termios.HUPCL
        termios.tcsetattr(port.fileno(), termios.TCSANOW, settings)
    assert "NOT_HOMED" in mcu(tmp_path, "move", "45", status=1)  # so that the test can fail


def test_a_stuck_wheel_is_named_with_the_next_step(tmp_path: Path, box: Box) -> None:
    mcu(tmp_path, "home")
    box.set(stuck=1)
    words = mcu(tmp_path, "move", "135", status=1)
    assert "wheel: FAULT: WHEEL_STUCK: the wheel does not follow" in words
    assert "mcu clear" in words
    assert "WHEEL_STUCK: the wheel does not follow: free it" in mcu(tmp_path, "info")
    box.set(stuck=0)
    assert mcu(tmp_path, "clear").strip() == "none"
    mcu(tmp_path, "home")


def test_ring(tmp_path: Path, box: Box) -> None:
    lux = [5, 10, 50, 100, 200, 500, 1000, 2000, 5000]
    box.set(supply_mv=4640, bandgap_mv=1100, adc_offset_lsb=0)
    box.set(**{f"ldr{k}_mux_ohm": 85 for k in range(9)})
    box.set(**{f"ldr{k}_lux": value for k, value in enumerate(lux)})
    mcu(tmp_path, "ring", "--seconds", "1")  # the LDRs have followed
    told = json.loads(mcu(tmp_path, "ring", "--json"))
    assert told["lux"] == pytest.approx(lux, rel=0.03)
    assert told["dead"] == [False] * 9
    assert told["supply_v"] == pytest.approx(4.64, abs=0.05)
    file = tmp_path / "ring.ini"
    file.write_text(ring.Ring(gamma=ring.Ring().gamma - 0.1).text())
    other = json.loads(mcu(tmp_path, "ring", "--json", "--calibration", str(file)))
    assert other["lux"][0] == pytest.approx(10 * (5 / 10) ** (0.7 / 0.6), rel=0.05)
    assert "sensor" in mcu(tmp_path, "ring")
    box.set(ldr3_forced=0)
    mcu(tmp_path, "ring", "--seconds", "1")
    assert json.loads(mcu(tmp_path, "ring", "--json"))["lux"][3] is None


def test_params(tmp_path: Path, box: Box) -> None:
    everything = json.loads(mcu(tmp_path, "params", "--json"))
    assert len(everything) == 27
    assert "mains_hz = 50  (50…60)" in mcu(tmp_path, "params")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    assert json.loads(mcu(tmp_path, "params", "set", "lag_ms", "40", "--json"))[0]["value"] == 40
    mcu(tmp_path, "params", "reload")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    mcu(tmp_path, "params", "set", "lag_ms", "45", "--save")
    box.set(reset=1)
    assert "OUT_OF_RANGE" in mcu(tmp_path, "params", "set", "servo_min_us", "2600", status=1)
    assert "lag_ms = 45" in mcu(tmp_path, "params", "get", "lag_ms")
    mcu(tmp_path, "params", "defaults")
    assert "lag_ms = 30" in mcu(tmp_path, "params", "get", "lag_ms")
    assert "expected 0…500" in mcu(tmp_path, "params", "set", "lag_ms", "900", status=2)
    assert "known are servo_zero_us" in mcu(tmp_path, "params", "get", "colour", status=2)


def test_watch(tmp_path: Path, box: Box) -> None:
    lines = mcu(tmp_path, "watch", "--json", "--seconds", "2", "--rate", "20").splitlines()
    kinds = [json.loads(line)["message"] for line in lines]
    assert kinds.count("Ring") >= 10
    assert "WheelState" in kinds
    assert "ring " in mcu(tmp_path, "watch", "--seconds", "1")


@pytest.mark.parametrize(
    ("port", "words", "status"),
    [
        ("serial:/dev/ttyNONE", "open: No such file or directory: is it plugged in?", 1),
        ("i2c:/dev/i2c-99", "open: No such file or directory: is it plugged in?", 1),
        ("can:can99", r"mcu: can:can99: open: ", 1),
        ("usb:1", "unknown carrier; use serial:DEVICE", 1),
        ("serial:/dev/tty0?speed=9", "speed=9: expected baud=NUMBER", 1),
        ("can:can0?baud=9", "baud=9: expected no option", 1),
    ],
)
def test_ports_that_are_not_there(tmp_path: Path, port: str, words: str, status: int) -> None:
    assert words in mcu(tmp_path, "info", "--port", port, status=status)


def test_a_port_in_use_and_a_device_that_is_silent(tmp_path: Path, box: Box) -> None:
    with serial.Serial(str(tmp_path / "mcu"), exclusive=True):
        assert "open: in use: is lightprobed or another" in mcu(tmp_path, "info", status=1)
    box.set(line_cut=1)
    assert "HelloRequest: no answer in 4 s" in mcu(tmp_path, "info", status=1)


# ---------------------------------------------------------------- flash


def test_flash_mends_a_chip_whose_program_is_destroyed(tmp_path: Path) -> None:
    """By avrdude through the boot loader, into the simulated chip; then it runs and greets."""
    with Box("avr", tmp_path / "mcu") as box:
        box.command("flash 0 ffcf")  # the reset vector: a jump to itself
        assert "firmware 0.1.0 answers" in mcu(tmp_path, "flash")
        assert "SETTLED at 0.00°" in mcu(tmp_path, "home")


def test_flash_puts_the_former_firmware_back(tmp_path: Path) -> None:
    """When the new one does not answer: here its reset vector jumps to itself."""
    dead = tmp_path / "dead.hex"
    dead.write_text(":02000000FFCF30\n:00000001FF\n")
    with Box("avr", tmp_path / "mcu"):
        words = mcu(tmp_path, "flash", "--hex", str(dead), status=1)
        assert "the new firmware does not answer" in words
        assert "the former one is back, and firmware 0.1.0 answers" in words
        assert "SETTLED at 0.00°" in mcu(tmp_path, "home")


def fake_avrdude(folder: Path, script: str) -> dict[str, str]:
    """An environment in which avrdude is this shell script; $REAL is the real one."""
    fake = folder / "bin" / "avrdude"
    fake.parent.mkdir()
    fake.write_text(f"#!/bin/sh\nREAL={shutil.which('avrdude')}\n{script}")
    fake.chmod(0o755)
    return {**os.environ, "PATH": f"{fake.parent}:{os.environ['PATH']}"}


def test_a_write_that_fails_puts_back_what_was_read_before_it(tmp_path: Path) -> None:
    """Reading is not repeated when writing is: what is half written would be read."""
    counts = f'echo "$*" >>{tmp_path}/calls\n'
    fails = 'case "$*" in *flash:w:*dead.hex*) exit 1;; esac\nexec $REAL "$@"\n'
    (tmp_path / "dead.hex").write_text(":02000000FFCF30\n:00000001FF\n")
    with Box("avr", tmp_path / "mcu"):
        done = subprocess.run(
            [LIGHTPROBE, "mcu", "flash", "--port", f"serial:{tmp_path / 'mcu'}",
             "--hex", tmp_path / "dead.hex"],
            capture_output=True, text=True, env=fake_avrdude(tmp_path, counts + fails), timeout=300,
        )  # fmt: skip
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [sum(f"flash:{way}:" in call for call in calls) for way in "rw"] == [1, 4]
    assert done.returncode == 1
    assert "the former one is back, and firmware 0.1.0 answers" in done.stderr


def test_a_chip_without_a_program_has_nothing_to_be_put_back(tmp_path: Path) -> None:
    """What cannot be put back is not said to be back."""
    read = tmp_path / "read.hex"  # with a boot loader, as boards are sold
    read.write_text(":02000000FFFF00\n:027E00001234EE\n:00000001FF\n")
    empty = f'case "$*" in *flash:r:*) f="${{*##*flash:r:}}"; cp {read} "${{f%:i}}";;\n'
    empty += "*) exit 1;; esac\n"
    with Box("avr", tmp_path / "mcu"):
        done = subprocess.run(
            [LIGHTPROBE, "mcu", "flash", "--port", f"serial:{tmp_path / 'mcu'}"],
            capture_output=True, text=True, env=fake_avrdude(tmp_path, empty), timeout=300,
        )  # fmt: skip
    assert done.returncode == 1
    assert "there was no former firmware: try again" in done.stderr


def test_ctrl_c_waits_until_the_firmware_is_whole(tmp_path: Path) -> None:
    slow = 'case "$*" in *flash:w:*) touch "$0.writes"; $REAL "$@" && sleep 3; exit $?; esac\n'
    slow += 'exec $REAL "$@"\n'
    environment = fake_avrdude(tmp_path, slow)
    with Box("avr", tmp_path / "mcu"):
        process = subprocess.Popen(
            [LIGHTPROBE, "mcu", "flash", "--port", f"serial:{tmp_path / 'mcu'}"],
            stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True,
        )  # fmt: skip
        while not (tmp_path / "bin/avrdude.writes").exists():
            assert process.poll() is None
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        assert "firmware 0.1.0 answers" in process.communicate(timeout=300)[0]
        assert process.returncode == 130


def test_flash_that_misses_the_boot_loader_resets_the_chip_again(tmp_path: Path) -> None:
    """As on a busy machine: the boot loader has stopped listening before avrdude speaks."""
    late = tmp_path / "bin" / "avrdude"
    late.parent.mkdir()
    late.write_text(
        f"""#!/bin/sh
[ -e "{tmp_path}/called" ] || {{ touch "{tmp_path}/called"; sleep 3; exit 1; }}
exec {shutil.which("avrdude")} "$@"
"""
    )
    late.chmod(0o755)
    environment = {**os.environ, "PATH": f"{late.parent}:{os.environ['PATH']}"}
    with Box("avr", tmp_path / "mcu"):
        done = subprocess.run(
            [LIGHTPROBE, "mcu", "flash", "--port", f"serial:{tmp_path / 'mcu'}"],
            capture_output=True, text=True, env=environment, timeout=300,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "attempt 1 of 3: avrdude ended with status 1" in done.stderr
    assert "firmware 0.1.0 answers" in done.stdout


def test_the_flashed_binarys_box_answers_and_keeps_its_eeprom(tmp_path: Path) -> None:
    """As the firmware built for this machine does; the file need not be there."""
    for value in (40, 55):
        with Box("avr", tmp_path / "mcu", eeprom=tmp_path / "eeprom") as box:
            assert [box.get("dtr_resets") for _ in range(3)] == [1, 1, 1]
            former = json.loads(mcu(tmp_path, "params", "get", "lag_ms", "--json"))[0]["value"]
            mcu(tmp_path, "params", "set", "lag_ms", str(value), "--save")
    assert former == 40


def test_dtr_falls_when_the_last_of_several_programs_closes_the_line(tmp_path: Path) -> None:
    """Two that close it at once, as avrdude and the tool around it do, are two."""
    path = str(tmp_path / "mcu")
    with Box("avr", Path(path), lock_step=True) as box:
        before = int(box.command("resets"))
        for times in (1, 2, 3):
            users = []
            for _ in range(3):
                users.append(os.open(path, os.O_RDWR | os.O_NOCTTY))
                box.run(1000)
            for user in users:
                os.close(user)
            box.run(1000)
            assert int(box.command("resets")) == before + times


def test_flash_keeps_off_a_port_in_use(tmp_path: Path, box: Box) -> None:
    with serial.Serial(str(tmp_path / "mcu"), exclusive=True):
        words = mcu(tmp_path, "flash", status=1)
    assert "open: in use: is lightprobed or another program using it? stop that first" in words


@pytest.mark.usefixtures("box")
def test_flash_warns_of_a_boot_loader_that_hangs(tmp_path: Path) -> None:
    done = subprocess.run(
        [LIGHTPROBE, "mcu", "flash", "--boot-baud=57600", "--port", f"serial:{tmp_path / 'mcu'}"],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert "warning: this boot loader (ATmegaBOOT) hangs after a watchdog reset" in done.stderr


def test_flash_says_what_is_wrong(tmp_path: Path) -> None:
    assert "on the serial line" in mcu(tmp_path, "flash", "--port", "can:can0", status=2)
    words = mcu(tmp_path, "flash", "--hex", str(tmp_path / "none.hex"), status=2)
    assert "build it with `make firmware`" in words
    words = mcu(tmp_path, "flash", "--port", "serial:/dev/ttyNONE", status=1)
    assert "open: No such file or directory: is it plugged in?" in words
