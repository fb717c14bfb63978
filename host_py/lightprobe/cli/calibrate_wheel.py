"""`lightprobe calibrate wheel`: gain, zero and backlash of the wheel's servo."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from lightprobe.calibrate import files as calibration
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.wheel_fit import Crossing, Reading, WheelCalibration, crossings, fit
from lightprobe.cli import calibrate, check
from lightprobe.cli.mcu import Port, param_number
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.session import DEFAULT_PORT, HOMING_S, Session, home, session

#: Fast enough to have a way to slower and be done soon, slow enough for fine readings.
SPEEDS_DEG_S = (40.0, 15.0)


def command(
    port: Port = DEFAULT_PORT,
    save: Annotated[
        bool, typer.Option("--save", help="Set servo_zero_us and servo_gain_ns_deg; in EEPROM.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=check.new_file(makes_folders=True),
            help="Keep the result as a file, too.",
        ),
    ] = None,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find the servo's gain, zero and backlash by sweeping the wheel over its comb.

    Takes about a minute; nothing may touch the wheel. lightprobed must not be using the port.
    Example: lightprobe calibrate wheel --port serial:/dev/ttyUSB0 --save
    """
    with session(port) as link:
        home(link)
        found = fit(list(sweeps(link)))
        before = {name: value for name, (value, _) in wanted(link, found).items()}
        if save:
            store(link, found)
            home(link)
        after = {name: value for name, (_, value) in wanted(link, found).items()}
    text = ini(found, before, after)
    if output is not None:
        calibration.save(output, text)
    if as_json:
        told = {"found": asdict(found), "before": before, "after": after, "saved": save}
        print(json.dumps(told, indent=2))
        return
    print(f"gain      {found.gain_us_deg:.4f} ± {found.gain_sigma_us_deg:.4f} µs/°")
    print(f"zero      {found.zero_us:.1f} ± {found.zero_sigma_us:.1f} µs")
    print(f"backlash  {found.backlash_deg:.2f} ± {found.backlash_sigma_deg:.2f}°")
    print(f"lag       {1000 * found.lag_s:.0f} ms")
    print(f"residual  {found.rms_deg:.2f}° (rms over {found.crossings} edges)")
    names = ", ".join(f"{name} {before[name]} → {after[name]}" for name in after)
    print(f"saved: {names}" if save else f"not saved (--save): {names}")


def sweeps(link: Session) -> Iterator[Crossing]:
    """Sweep up and down at each speed."""
    values = {param.name: param.value for param in link.params()}
    low, high = values["wheel_min_cdeg"] / 100, values["wheel_max_cdeg"] / 100
    first, pitch = values["comb_first_cdeg"] / 100, values["comb_pitch_cdeg"] / 100
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("sweeps", total=2 * len(SPEEDS_DEG_S))
        for speed in SPEEDS_DEG_S:
            for way, target in ((1, high), (-1, low)):
                readings = sweep(link, target, speed)
                yield from crossings(readings, first, pitch, way * speed)
                bar.advance(task)


def sweep(link: Session, target_deg: float, speed_deg_s: float) -> list[Reading]:
    """Move, and read pulse and comb all the way; only what belongs to this direction."""
    link.rates()
    token = link.move(target_deg, speed_deg_s)
    readings: list[Reading] = []
    end = time.monotonic() + HOMING_S + 400 / speed_deg_s
    while True:
        status = link.status()
        servo, state = status.get("WheelServo"), status["WheelState"]
        assert isinstance(state, mcu.WheelState)
        if not isinstance(servo, mcu.Message):
            raise CalibrationError(
                f"calibrate: wheel: {link.uri}: the firmware does not report its servo pulses: "
                f"flash the firmware of this release (`lightprobe mcu flash`)"
            )
        readings.append(Reading(servo.number("pulse_hus") / 2, servo.number("edges")))
        if state.phase is not mcu.Phase.MOVING or time.monotonic() > end:
            link.settle_or_raise(state, token)
            return readings


def wanted(link: Session, found: WheelCalibration) -> dict[str, tuple[int, int]]:
    """Parameters as they are and as they should be; CalibrationError for what no servo is."""
    new = {
        "servo_zero_us": round(found.zero_us),
        "servo_gain_ns_deg": round(1000 * found.gain_us_deg),
    }
    both = {}
    for name, value in new.items():
        now = link.param(param_number(name))
        if not now.minimum <= value <= now.maximum:
            raise CalibrationError(
                f"calibrate: wheel: {name} would be {value}, limits {now.minimum}…{now.maximum}: "
                "is the horn on the right spline? (docs/builders/bring_up.md)"
            )
        both[name] = (now.value, value)
    return both


def store(link: Session, found: WheelCalibration) -> None:
    """Set the parameters and write them to the EEPROM."""
    for name, (_, value) in wanted(link, found).items():
        link.param(param_number(name), value)
    link.save_params()


def ini(found: WheelCalibration, before: dict[str, int], after: dict[str, int]) -> str:
    """The result as a file."""
    lines = [f"; {calibrate.remark('lightprobe calibrate wheel')}", "[wheel]", "version = 1"]
    lines += [f"{name} = {value:.6g}" for name, value in asdict(found).items()]
    lines += [f"{name} = {value}" for name, value in after.items()]
    lines += [f"former_{name} = {value}" for name, value in before.items()]
    return "\n".join(lines) + "\n"
