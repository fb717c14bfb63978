"""The sub-commands of `lightprobe`, each loaded when it is called.

The table is all that `lightprobe --help` needs, so it answers at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

from lightprobe import __version__
from lightprobe.cli import scenario
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.installation import install_extras


@dataclass(frozen=True)
class Entry:
    """Where a sub-command lives."""

    home: str  # MODULE:NAME in lightprobe.cli; NAME is a function, or a Typer with sub-commands
    help: str  # its first line in --help
    extra: str = "cli"  # of the package, that brings what it needs
    shown: tuple[str, ...] = ()  # options in its --help, where a scenario file has all of them

    def load(self, name: str) -> Any:
        """Import the command (click's); LightprobeError when what it needs is not installed."""
        module, _, attribute = self.home.partition(":")
        try:
            target = getattr(import_module(f"lightprobe.cli.{module}"), attribute)
        except ModuleNotFoundError as error:
            raise LightprobeError(
                f"{name}: needs {error.name}, which is not installed: {install_extras(self.extra)}"
            ) from None
        if not isinstance(target, typer.Typer):
            target = _alone(target)
        command = typer.main.get_command(target)
        command.name = name
        if self.shown:
            scenario.hide(command, self.shown)
        return command


def _alone(function: Callable[..., Any]) -> typer.Typer:
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command()(function)
    return alone


class LazyGroup(TyperGroup):
    """A group that imports a sub-command when it is called, not to list it."""

    entries: ClassVar[dict[str, Entry]]

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the table."""
        return list(self.entries)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import one."""
        entry = self.entries.get(cmd_name)
        return entry.load(cmd_name) if entry else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List all from the table."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in self.entries.items()])


class Calibrate(LazyGroup):
    """`lightprobe calibrate`."""

    entries: ClassVar[dict[str, Entry]] = {
        "exposure": Entry(
            "calibrate_exposure:command", "Measure how a camera obeys exposure commands.",
            "calibrate",
        ),
        "response": Entry(
            "calibrate_response:command", "Measure a camera's response curve from a bracket.",
            "calibrate",
        ),
        "lens": Entry(
            "calibrate_lens:command", "Find a fisheye lens with pictures of a printed board.",
            "calibrate",
        ),
        "rig": Entry(
            "calibrate_rig:command", "Find how cameras are turned in one box.", "calibrate"
        ),
        "roll-off": Entry(
            "calibrate_roll_off:command", "Find how much darker a lens is towards its rim.",
            "calibrate",
        ),
        "wheel": Entry(
            "calibrate_wheel:command", "Measure the servo that turns the polarizer wheel.",
            "calibrate",
        ),
        "ring": Entry(
            "calibrate_ring:command", "Measure the nine light sensors of the ring.", "calibrate"
        ),
        "scale": Entry(
            "calibrate_scale:command", "Measure lux and cd/m² per unit of light.", "calibrate"
        ),
        "polarizer": Entry(
            "calibrate_polarizer:command", "Measure the polarizing film on the wheel.", "calibrate"
        ),
        "supply": Entry(
            "calibrate_supply:command", "Measure the chip's voltage reference with a multimeter.",
            "calibrate",
        ),
    }  # fmt: skip


class Align(LazyGroup):
    """`lightprobe align`."""

    entries: ClassVar[dict[str, Entry]] = {
        "poses": Entry(
            "align_poses:command", "By how head and probe turn while you look around.", "align"
        ),
        "marker": Entry(
            "align_marker:command", "By a printed marker that the head's camera sees.", "align"
        ),
        "lamps": Entry("align_lamps:command", "By lamps that both know.", "align"),
    }


align = typer.Typer(
    cls=Align,
    help="Find how the probe sits on a head or device: the rotation from probe to head.",
    no_args_is_help=True,
    rich_markup_mode=None,
    add_completion=False,
)


@align.callback()
def _align() -> None:
    """Find how the probe sits on a head or device: the rotation from probe to head."""


calibrate = typer.Typer(
    cls=Calibrate,
    help="Calibrate camera (exposure, response), polarizer wheel, ring of light sensors.",
    no_args_is_help=True,
    rich_markup_mode=None,
    add_completion=False,
)


@calibrate.callback()
def _calibrate() -> None:
    """Calibrate camera (exposure, response), polarizer wheel, ring of light sensors."""


#: Options of `simulate` that are not in its scenario file alone.
SIMULATE = (
    "socket", "scenes", "turn_deg_s", "path", "switch_s", "camera", "size", "rate", "seed",
    "firmware", "pty", "osc", "faults", "control", "truth", "truth_publish", "seconds",
)  # fmt: skip


class Root(LazyGroup):
    """`lightprobe`."""

    entries: ClassVar[dict[str, Entry]] = {
        "watch": Entry("watch:command", "Watch a probe: lamps, SH, rate, latency, health."),
        "still": Entry("still:command", "Have a camera for stills take a set now."),
        "doctor": Entry("doctor:command", "Check installation, devices and a running probe."),
        "find": Entry("find:command", "List the probes or cameras in the network.", "find"),
        "export": Entry("export:command", "Write a probe's light as .hdr, .exr or .glb.", "sim"),
        "bake": Entry("bake:command", "Light a mesh that shades itself by a probe.", "bake"),
        "estimate": Entry("estimate:command", "Estimate the light in pictures.", "sim"),
        "net": Entry("net:command", "Draw the net of a probe of paper, to print.", "calibrate"),
        "polarization": Entry("polarization:command", "Show how pictures are polarized.", "sim"),
        "demo": Entry("demo:command", "Show the whole path: a simulated room or a camera.", "sim"),
        "simulate": Entry(
            "simulate:command", "Simulate camera, wheel, ring and firmware.", "sim", SIMULATE
        ),
        "control": Entry("control:app", "Steer a running simulator: faults, light, status."),
        "evaluate": Entry("evaluate:command", "Measure accuracy against the exact truth.", "sim"),
        "trade": Entry(
            "trade:command", "Choose settings: how exact, for how much time and bytes.", "sim"
        ),
        "calibrate": Entry("main:calibrate", "Calibrate camera, polarizer wheel and ring."),
        "check-camera": Entry(
            "check_camera:command", "Check what a camera does to its pictures: fit or not.",
            "calibrate",
        ),
        "align": Entry("main:align", "Find how the probe sits on a head."),
        "field": Entry("field:command", "Join probes at known places: how far lamps are.", "sim"),
        "record": Entry("record:record", "Record a probe's messages (MCAP).", "record"),
        "replay": Entry("record:replay", "Serve a recording as a probe.", "record"),
        "setup": Entry("setup:command", "Serve a page to set up this probe in a browser.", "setup"),
        "update": Entry("update:command", "Update a probe that runs from a card."),
        "wifi": Entry("wifi:app", "List Wi-Fi networks, join one, forget one.", "setup"),
        "panel": Entry("panel:command", "Show the probe by an LED, and take a button.", "panel"),
        "pair": Entry("pair:command", "Make key, certificate and token for wss:.", "pair"),
        "study": Entry("study:app", "Ask people which pictures look real.", "study"),
        "hil": Entry("hil:command", "Check a box, and write down that it works.", "mcu"),
        "mcu": Entry("mcu:app", "Talk to the microcontroller of wheel and ring.", "mcu"),
    }  # fmt: skip


app = typer.Typer(
    cls=Root,
    help="Measure real light for augmented reality: client, simulator and tool box of the probe.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lightprobe {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Take options that stand before the sub-command."""


def run() -> int:
    """Run the command line of this process; gives its exit status.

    Raises :class:`UsageError` for options that cannot be, KeyboardInterrupt for Ctrl-C.
    """
    try:
        status = app(prog_name="lightprobe", standalone_mode=False)
    except Exception as error:  # typer brings click's errors under a name that depends on its age
        kind = type(error).__name__
        if kind == "Abort":
            raise KeyboardInterrupt from None
        if not hasattr(error, "format_message"):
            raise
        if kind == "NoArgsIsHelpError":
            error.show()  # type: ignore[attr-defined]
            return 2
        raise UsageError(_usage(error)) from None
    return status if isinstance(status, int) else 0


def _usage(error: Any) -> str:
    """Which command, what is wrong with its options, and the next step."""
    path = error.ctx.command_path if getattr(error, "ctx", None) else "lightprobe"
    text = error.format_message().rstrip(".")
    return f"{path.removeprefix('lightprobe').strip() or 'command line'}: {text} ({path} --help)"
