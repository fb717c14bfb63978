"""`lightprobe mcu`: talk to the microcontroller with wheel and ring, for bring-up and repair."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.table import Table

from lightprobe.calibrate import ring
from lightprobe.cli import check, mcu_flash, view
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.mcu import faults as mcu_faults
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import McuError
from lightprobe.mcu.session import DEFAULT_PORT, ENVIRONMENT, Session, home, move
from lightprobe.mcu.session import session as conversation

Port = Annotated[
    str,
    typer.Option(
        "--port", "-p", envvar=ENVIRONMENT, metavar="URI",
        help="serial:DEVICE[?baud=N], i2c:DEVICE[?address=N] or can:CHANNEL.",
    ),
]  # fmt: skip
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Calibration = Annotated[
    Path | None, typer.Option(metavar="FILE", help="File written by `calibrate ring`.")
]

#: Less than the least hold_max_ds, after which the firmware lets go by itself.
_PULSE_AGAIN_S = 0.05

app = typer.Typer(
    help="Talk to the microcontroller: over serial, I2C or CAN. lightprobed must not be using it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
params_app = typer.Typer(
    help="Parameters of the firmware; without a command: list all.", rich_markup_mode=None
)
app.add_typer(params_app, name="params")
app.command("flash")(mcu_flash.command)


def plain(event: object) -> dict[str, Any]:
    """An event as JSON has it."""
    assert is_dataclass(event)
    assert not isinstance(event, type)
    if isinstance(event, mcu.Message):
        return {"message": event.name, **event.signals}
    values = asdict(event, dict_factory=lambda items: {k: _plain(v) for k, v in items})
    return {"message": type(event).__name__, **values}


def _plain(value: Any) -> Any:
    return value.value if isinstance(value, Enum) else value


def wheel_words(state: mcu.WheelState) -> str:
    """One line about the wheel."""
    if state.measured_deg is None or state.sigma_deg is None:
        return f"wheel {state.phase.value}, angle unknown"
    words = f"wheel {state.phase.value} at {state.measured_deg:.2f}° ± {state.sigma_deg:.2f}°"
    return words + (
        f", commanded {state.commanded_deg:.2f}°" if state.commanded_deg is not None else ""
    )


def protocol_words(greeting: mcu.Message) -> str:
    """One line about the protocols of both sides; the next step where they differ."""
    theirs = greeting.number("protocol_minor")
    words = f"protocol {greeting['protocol_major']}.{theirs}"
    if theirs == mcu.PROTOCOL_MINOR:
        return words
    step = "a newer lightprobe" if theirs > mcu.PROTOCOL_MINOR else "`lightprobe mcu flash`"
    return (
        f"{words}, this program {mcu.PROTOCOL_MAJOR}.{mcu.PROTOCOL_MINOR}: "
        f"what both know works; the rest needs {step}"
    )


def fault_words(name: str) -> str:
    """One line about a fault."""
    return f"{name}: {mcu_faults.words(name)}"


def latched(status: dict[str, mcu.Event]) -> list[str]:
    """Names of the faults in a status."""
    state = status["FaultState"]
    assert isinstance(state, mcu.Message)
    names = mcu.fault_names()
    bits = state.number("latched")
    return [names.get(k, f"fault {k}") for k in range(32) if bits >> k & 1]


@app.command("info")
def info(port: Port = DEFAULT_PORT, as_json: AsJson = False) -> None:
    """Show versions, wheel, faults and counters."""
    with conversation(port) as link:
        status = link.status()
        faults = latched(status)
        greeting = link.greeting
    if as_json:
        messages = [plain(greeting), *map(plain, status.values())]
        everything = {message.pop("message"): message for message in messages}
        print(json.dumps({"port": port, "faults": faults, **everything}, indent=2))
        return
    version = ".".join(str(greeting[f"firmware_{part}"]) for part in ("major", "minor", "patch"))
    print(f"{port}: firmware {version} on {greeting['board']}")
    print(protocol_words(greeting))
    print(f"started {greeting['boot_count']} times, last by {greeting['reset_cause']}")
    state = status["WheelState"]
    assert isinstance(state, mcu.WheelState)
    print(wheel_words(state))
    for name in ("Capabilities", "CountersLink", "CountersWork"):
        message = status[name]
        assert isinstance(message, mcu.Message)
        print(f"{name}: " + ", ".join(f"{key} {value}" for key, value in message.signals.items()))
    print("\n".join(map(fault_words, faults)) or "no faults")


@app.command("watch")
def watch(
    port: Port = DEFAULT_PORT,
    calibration: Calibration = None,
    rate_hz: Annotated[
        float,
        typer.Option(
            "--rate", callback=check.number(0.5, 100, "rings a second"), help="Samples a second."
        ),
    ] = 10.0,
    seconds: Annotated[
        float | None,
        typer.Option(callback=check.number(0, 1e9, "seconds"), help="Seconds after which to end."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON line per message.")
    ] = False,
) -> None:
    """Show wheel, ring and faults as they come. Ends on Ctrl-C."""
    sensors = ring.Ring() if calibration is None else ring.load(calibration)
    with conversation(port) as link, suppress(KeyboardInterrupt):
        link.rates(ring_scans=round(min(800 / rate_hz, 255)), wheel_ms=500, counters_ms=0)
        for event in link.listen(seconds if seconds is not None else 1e9):
            if as_json:
                print(json.dumps(plain(event)), flush=True)
            elif text := event_words(event, sensors):
                print(text, flush=True)


def event_words(event: mcu.Event, sensors: ring.Ring) -> str:
    """One line about an event; empty for what only machines want to know."""
    if isinstance(event, mcu.WheelState):
        return wheel_words(event)
    if isinstance(event, mcu.Fault):
        return fault_words(event.name) if event.active else f"{event.name}: cleared"
    if isinstance(event, mcu.Ring):
        lux = sensors.lux(event.levels)
        return "ring " + " ".join(
            "dead" if d else f"{v:.4g}" for v, d in zip(lux, event.dead, strict=True)
        )
    if isinstance(event, mcu.Message) and event.name == "Hello":
        return f"it has started again, by {event['reset_cause']}"
    return ""


@app.command("home")
def home_command(port: Port = DEFAULT_PORT, as_json: AsJson = False) -> None:
    """Find the zero of the wheel. Needed once after every start; ends when the wheel is homed."""
    with conversation(port) as link:
        _print_state(home(link), as_json)


@app.command("move")
def move_command(
    angle_deg: Annotated[
        float,
        typer.Argument(callback=check.number(-327, 327, "degrees"), help="Angle in degrees."),
    ],
    port: Port = DEFAULT_PORT,
    slew_deg_s: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 6553, "degrees a second"),
            help="Speed, 3°/s or more for 180°; 0: as fast as allowed.",
        ),
    ] = 0,
    hold_s: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 6553, "seconds"),
            help="Seconds to keep the servo powered after the move.",
        ),
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Turn the wheel; ends when it has arrived, or says why it did not."""
    with conversation(port) as link:
        _print_state(move(link, angle_deg, slew_deg_s, hold_s), as_json)


@app.command("release")
def release(port: Port = DEFAULT_PORT) -> None:
    """Switch the servo off; the comb still measures the wheel."""
    with conversation(port) as link:
        link.release()


@app.command("pulse")
def pulse_command(
    pulse_us: Annotated[
        float,
        typer.Argument(callback=check.number(300, 2700, "µs"), help="Width of the pulses in µs."),
    ],
    port: Port = DEFAULT_PORT,
    seconds: Annotated[
        float,
        typer.Option(
            callback=check.number(0.1, 600, "seconds"), help="So long, then the servo is let go."
        ),
    ] = 20,
) -> None:
    """Hold the servo at a pulse, to set its gear, as a servo tester does; Ctrl-C ends it.

    Not beyond the parameters servo_min_us and servo_max_us. The wheel has to be homed afterwards.
    """
    end = time.monotonic() + seconds
    with conversation(port) as link:
        link.pulse(pulse_us)
        print(f"servo at {pulse_us:g} µs for {seconds:g} s", flush=True)
        try:
            while (left_s := end - time.monotonic()) > 0:
                link.pulse(pulse_us)
                time.sleep(min(left_s, _PULSE_AGAIN_S))
        finally:
            link.release()
    print("servo let go")


@app.command("clear")
def clear(port: Port = DEFAULT_PORT, as_json: AsJson = False) -> None:
    """Clear latched faults; the exit code is 1 when one comes back."""
    with conversation(port) as link:
        link.clear_faults()
        time.sleep(0.3)
        left = latched(link.status())
    print(json.dumps({"faults": left}) if as_json else "\n".join(map(fault_words, left)) or "none")
    raise typer.Exit(1 if left else 0)


def _print_state(state: mcu.WheelState, as_json: bool) -> None:
    print(json.dumps(plain(state)) if as_json else wheel_words(state))


@app.command("ring")
def ring_command(
    port: Port = DEFAULT_PORT,
    calibration: Calibration = None,
    seconds: Annotated[
        float,
        typer.Option(callback=check.number(0.05, 1e5, "seconds"), help="Average over so long."),
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Read the nine light sensors: level, resistance, illuminance."""
    sensors = ring.Ring() if calibration is None else ring.load(calibration)
    with conversation(port) as link:
        levels, dead, supply_v = read_ring(link, seconds)
    lux, sigma = (np.where(dead, np.nan, f(levels)) for f in (sensors.lux, sensors.sigma_of))
    ohm = np.where(np.isnan(lux), np.nan, sensors.ldr_ohm(np.maximum(levels, 1)))
    if as_json:
        rows = {"level": levels, "ohm": ohm, "lux": lux, "sigma": sigma}
        numbers = {k: [None if np.isnan(x) else float(x) for x in v] for k, v in rows.items()}
        print(json.dumps(numbers | {"dead": dead.tolist(), "supply_v": supply_v}))
        return
    table = Table("sensor", "looks", "level", "ohm", "lux", box=None)
    for k, look in enumerate(ring.directions()):
        where = "up" if k == 8 else f"{45 * k}° from +X"
        state = f"{lux[k]:.3g} ± {100 * sigma[k]:.0f} %"
        if np.isnan(lux[k]):
            state = "dead" if dead[k] else "dark"
        table.add_row(
            str(k), f"{where} {look.round(2)}", f"{levels[k]:.1f}", f"{ohm[k]:.0f}", state
        )
    view.console().print(table)
    print(f"supply {supply_v:.2f} V" if supply_v else "supply unknown")


def read_ring(link: Session, seconds: float) -> tuple[Array, NDArray[np.bool_], float | None]:
    """Mean levels (9,), sensors that are dead (9,), and the mean supply."""
    link.rates(ring_scans=8)
    rings = [event for event in link.listen(seconds + 0.1) if isinstance(event, mcu.Ring)]
    link.rates()
    if not rings:
        raise McuError(f"mcu: {link.uri}: ring: no sample came in {seconds:g} s")
    levels = np.mean([one.levels for one in rings], axis=0)
    supplies = [one.supply_v for one in rings if one.supply_v is not None]
    supply_v = float(np.mean(supplies)) if supplies else None
    return levels, np.any([one.dead for one in rings], axis=0), supply_v


# ---------------------------------------------------------------- parameters


@params_app.callback(invoke_without_command=True)
def params(context: typer.Context, port: Port = DEFAULT_PORT, as_json: AsJson = False) -> None:
    """List all parameters with their limits."""
    if context.invoked_subcommand is not None:
        return
    with conversation(port) as link:
        _print_params(link.params(), as_json)


@params_app.command("get")
def params_get(
    name: Annotated[str, typer.Argument(help="Name, as `params` lists it.")],
    port: Port = DEFAULT_PORT,
    as_json: AsJson = False,
) -> None:
    """Read one parameter."""
    with conversation(port) as link:
        _print_params([link.param(param_number(name))], as_json)


@params_app.command("set")
def params_set(
    name: Annotated[str, typer.Argument(help="Name, as `params` lists it.")],
    value: Annotated[int, typer.Argument(help="Value, in the unit that the name states.")],
    port: Port = DEFAULT_PORT,
    save: Annotated[bool, typer.Option("--save", help="Also write it to the EEPROM.")] = False,
    as_json: AsJson = False,
) -> None:
    """Set one parameter. After a change of the wheel's geometry, home it again."""
    number = param_number(name)
    with conversation(port) as link:
        now = link.param(number)
        if not now.minimum <= value <= now.maximum:
            raise UsageError(f"mcu: {name} = {value}: expected {now.minimum}…{now.maximum}")
        _print_params([link.param(number, value)], as_json)
        if save:
            link.save_params()


@params_app.command("save")
def params_save(port: Port = DEFAULT_PORT) -> None:
    """Write all parameters to the EEPROM."""
    with conversation(port) as link:
        link.save_params()


@params_app.command("reload")
def params_reload(port: Port = DEFAULT_PORT) -> None:
    """Use the saved parameters again."""
    with conversation(port) as link:
        link.request("ParamAction", action="RELOAD")


@params_app.command("defaults")
def params_defaults(port: Port = DEFAULT_PORT) -> None:
    """Use the built-in parameters; `params save` keeps them."""
    with conversation(port) as link:
        link.request("ParamAction", action="DEFAULTS")


def param_number(name: str) -> int:
    """Number of a parameter; UsageError names those there are."""
    numbers = {text: number for number, text in mcu.param_names().items()}
    if name not in numbers:
        raise UsageError(f"mcu: params: {name}: unknown; known are {', '.join(numbers)}")
    return numbers[name]


def _print_params(values: list[mcu.Param], as_json: bool) -> None:
    if as_json:
        print(json.dumps([asdict(value) for value in values]))
        return
    for value in values:
        print(f"{value.name} = {value.value}  ({value.minimum}…{value.maximum})")
