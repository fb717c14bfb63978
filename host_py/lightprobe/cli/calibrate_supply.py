"""`lightprobe calibrate supply`: the reference that the microcontroller measures its supply by."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lightprobe.calibrate.files import CalibrationError
from lightprobe.cli import calibrate, check
from lightprobe.cli.mcu import Port, param_number, read_ring
from lightprobe.mcu.session import DEFAULT_PORT, Session, session

_SECONDS = 1.0
_PARAM = "bandgap_mv"


def command(
    volts: Annotated[
        float,
        typer.Argument(
            callback=check.number(2.7, 5.5, "volts"), help="What a multimeter shows from 5V to GND."
        ),
    ],
    port: Port = DEFAULT_PORT,
    save: Annotated[bool, typer.Option("--save", help="Set bandgap_mv; in EEPROM.")] = False,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find the chip's own reference voltage, from its supply as a multimeter shows it.

    The reference (1.1 V) differs by up to 10 % from chip to chip, and so does the supply that the
    microcontroller reports until this is done. Measure between the pins 5V and GND of the board
    while it runs. Example: lightprobe calibrate supply 4.68 --save
    """
    with session(port) as link:
        before = link.param(param_number(_PARAM))
        told_v = _supply_v(link)
        after_mv = round(before.value * volts / told_v)
        if not before.minimum <= after_mv <= before.maximum:
            raise CalibrationError(
                f"calibrate: supply: {link.uri}: {_PARAM} would be {after_mv}, limits "
                f"{before.minimum}…{before.maximum}: it reports {told_v:.2f} V: is {volts:g} V the "
                "voltage between its pins 5V and GND?"
            )
        if save:
            link.param(before.number, after_mv)
            link.save_params()
    if as_json:
        told = {"reported_v": told_v, "before_mv": before.value, "after_mv": after_mv}
        print(json.dumps(told | {"saved": save}))
        return
    print(f"reported {told_v:.2f} V, measured {volts:.2f} V")
    done = "saved" if save else "not saved (--save)"
    print(f"{done}: {_PARAM} {before.value} → {after_mv}")


def _supply_v(link: Session) -> float:
    """What the microcontroller reports, on average."""
    _, _, supply_v = read_ring(link, _SECONDS)
    if supply_v is None:
        raise CalibrationError(f"calibrate: supply: {link.uri}: it reports no supply: try again")
    return supply_v
