"""`lightprobe simulate --osc`: a RICOH THETA on the network."""

from __future__ import annotations

import json
import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import typer

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.sim.control import Control, Handler
from lightprobe.sim.osc import models
from lightprobe.sim.osc.announce import announced
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.server import OscServer
from lightprobe.sim.world import World

MODELS = tuple(models.MODELS)


def serve(
    world: World,
    model: str,
    address: tuple[str, int],
    password_file: Path | None,
    *,
    faults: str,
    seconds: float | None,
    truth: Path | None,
    control: Path | None,
    as_json: bool,
    **about: Any,
) -> None:
    """Serve a camera until Ctrl-C, or for some seconds; prints counters."""
    merged = OscFaults().merged(faults)
    login = read_login(password_file) if password_file else None
    ending = threading.Event()
    with ExitStack() as stack:
        log = stack.enter_context(open(truth, "w", encoding="utf-8")) if truth else None
        camera = OscCamera(world, model, faults=merged, truth=log, **about)
        if merged.playback:
            camera.press("playback")
        server = stack.enter_context(OscServer(camera, address, login))
        if control is not None:
            stack.enter_context(Control(control, handlers(camera)))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ending.set())
        typer.echo(
            f"simulate: {camera.model.name} on port {server.port}: "
            f"waiting for lightprobed --source=osc:{address[0] or 'localhost'}:{server.port}",
            err=True,
        )
        try:
            name = stack.enter_context(announced(camera.serial, address[0], server.port))
        except LightprobeError as error:
            typer.echo(f"note: {error}: `lightprobe find --cameras` will not find it", err=True)
        else:
            typer.echo(f"simulate: announced as {name}", err=True)
        ending.wait(seconds)
    counters = {"frames": camera.frames, "commands": camera.commands}
    text = f"simulate: {', '.join(f'{value} {key}' for key, value in counters.items())}"
    typer.echo(json.dumps(counters) if as_json else text)


def refuse_others(firmware: str, polarizer: str | None, lens: str, pixel_format: str) -> None:
    """Raise UsageError for what a THETA on the network cannot be together with."""
    for option, is_used in (
        (f"--firmware {firmware}", firmware != "none"),
        (f"--polarizer {polarizer}", polarizer is not None),
        (f"--camera {lens}", lens != "equirect"),
        (f"--format {pixel_format}", pixel_format.upper() != "MJPG"),
    ):
        if is_used:
            raise UsageError(
                f"simulate: {option}: the camera of --osc is a THETA, which sends MJPEG "
                "equirectangular, without wheel or ring: leave one of the two out"
            )


def read_login(path: Path) -> tuple[str, str]:
    """User and password from the first line of a file; raises UsageError."""
    try:
        line = path.read_text(encoding="utf-8").partition("\n")[0]
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"simulate: --osc-password-file {path}: read: {error}") from None
    user, colon, password = line.strip().partition(":")
    if not (user and colon and password):
        raise UsageError(f"simulate: --osc-password-file {path}: line 1: expected USER:PASSWORD")
    return user, password


def handlers(camera: OscCamera) -> dict[str, Handler]:
    """Commands of `lightprobe control` by their first words (proto/sim.md)."""

    def misbehave(query: str) -> str:
        camera.misbehave(query)
        return "ok"

    def press(button: str) -> str:
        camera.press(button)
        return "ok"

    def status(_: str) -> str:
        names = ("captureMode", "exposureProgram", "shutterSpeed", "iso", "whiteBalance",
                 "_colorTemperature", "sleepDelay", "offDelay")  # fmt: skip
        options = {name: camera.options.get(name) for name in names}
        if camera.model.formats:
            options["previewFormat"] = camera.options.get("previewFormat")
        return json.dumps({"frames": camera.frames, "commands": camera.commands,
                           "asleep": camera.is_asleep(), "options": options})  # fmt: skip

    return {"faults": misbehave, "press": press, "status": status}
