"""`lightprobe panel`: a probe without a screen, with one LED and one button."""

from __future__ import annotations

import json
from types import ModuleType
from typing import Annotated

import typer

from lightprobe.client import DEFAULT_URI
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.installation import install_extras
from lightprobe.panel import loop
from lightprobe.panel.probe import Probe
from lightprobe.panel.state import Judged

_NONE = "none"


def command(
    uri: Annotated[str, typer.Argument(help="Address of the probe to show.")] = DEFAULT_URI,
    led: Annotated[
        str,
        typer.Option(
            envvar="LIGHTPROBE_LED",
            help="Line of the LED: NAME, gpiochip0:NAME or gpiochip0:27; none: there is none.",
        ),
    ] = "GPIO27",
    button: Annotated[
        str, typer.Option(envvar="LIGHTPROBE_BUTTON", help="Line of the button; or none.")
    ] = "GPIO22",
    led_low: Annotated[
        bool, typer.Option("--led-low", help="The LED is lit while its line is low.")
    ] = False,
    button_high: Annotated[
        bool,
        typer.Option("--button-high", help="The button connects its line to 3.3 V, not to ground."),
    ] = False,
    network: Annotated[
        bool, typer.Option(help="Show when there is no network; --no-network: none is wanted.")
    ] = True,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print each new state as a line of JSON.")
    ] = False,
) -> None:
    """Show how the probe is by an LED, and take presses of a button.

    Press: a client may pair. Hold 3 s: access point on or off. Hold 7 s: shut down. While it is
    held the LED says when to let go. Wiring: hw/guide.md; patterns: docs/users/panel.md.
    Example: sudo lightprobe panel --led GPIO27 --button GPIO22
    """
    if led == button == _NONE and not as_json:
        raise UsageError("panel: neither LED nor button: name one, or say --json")
    probe = Probe(uri, network)
    light = push = None
    if (led, button) != (_NONE, _NONE):
        lines = _lines()
        light, push = lines.open_both(
            None if led == _NONE else lines.Wanted("LED", led, led_low),
            None if button == _NONE else lines.Wanted("button", button, not button_high),
        )
    try:
        with probe:
            loop.run(light, push, probe, _tell_json if as_json else _tell)
    finally:
        if push:
            push.close()
        if light:
            light.close()


def _lines() -> ModuleType:
    """The GPIO lines of Linux; LightprobeError where they cannot be had."""
    try:
        from lightprobe.panel import lines
    except ModuleNotFoundError as error:
        raise LightprobeError(
            f"panel: LED and button: need Linux and {error.name}: {install_extras('panel')}; "
            "without them: --led none --button none --json"
        ) from None
    return lines


def _tell(judged: Judged) -> None:
    print(f"panel: {judged.state}{judged.why and ': ' + judged.why}", flush=True)


def _tell_json(judged: Judged) -> None:
    print(json.dumps({"state": judged.state, "why": judged.why}), flush=True)
