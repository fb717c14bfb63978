"""`lightprobe record` and `lightprobe replay`: work with a probe's light without the probe."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterable, Iterator
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Annotated, Any

import typer
from lightprobe_proto import lightprobe_pb2 as pb

from lightprobe import __version__, recording
from lightprobe.cli import check
from lightprobe.client import DEFAULT_URI, AsyncClient
from lightprobe.errors import LightprobeError, ProbeTimeout
from lightprobe.reflection_map import SIZES
from lightprobe.server import ProbeServer, stamp_now
from lightprobe.wire import Subscription

_PATIENCE_S = 10.0
_DEFAULT_URIS = ["tcp:127.0.0.1:7700", "ws:127.0.0.1:7701"]
#: Pauses in a recording, as of a probe that was away, are not waited out.
_LONGEST_PAUSE_S = 5.0


class _NoMapsError(LightprobeError):
    """Reflection maps are wanted of a probe that sends none."""


def record(
    file: Annotated[
        Path, typer.Argument(callback=check.new_file(".mcap"), help="New file, NAME.mcap.")
    ],
    uri: Annotated[
        str, typer.Option("--from", metavar="URI", help="Address of the probe.")
    ] = DEFAULT_URI,
    seconds: Annotated[
        float | None,
        typer.Option(callback=check.number(0, unit="seconds", above=True), help="Then end."),
    ] = None,
    order: Annotated[int, typer.Option(min=0, max=4, help="Highest SH order.")] = 4,
    lights: Annotated[int, typer.Option(min=0, max=8, help="Maximum number of lamps.")] = 8,
    map_size: Annotated[
        int,
        typer.Option(
            "--reflection-map",
            metavar="16|32|64",
            callback=check.one_of((0, *SIZES)),
            help="Texels of reflection maps, five a second. They are pictures of the room.",
        ),
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Record a probe's messages as they come, until Ctrl-C or for some seconds.

    The file opens in Foxglove, and `lightprobe replay` serves it as a probe.
    Example: lightprobe record room.mcap --seconds 60
    """
    if file.exists():
        raise LightprobeError(f"record: {file}: exists: name a new file")
    started_s = time.monotonic()
    count = 0
    try:
        with recording.Recorder(file) as recorder, suppress(KeyboardInterrupt):
            wish = Subscription(
                sh_order=order, max_lights=lights,
                reflection_map_size=map_size, reflection_map_kind="AMBIENT",
            )  # fmt: skip
            try:
                asyncio.run(_record(uri, wish, recorder, seconds))
            finally:
                count = recorder.messages
    except (ProbeTimeout, _NoMapsError):
        file.unlink(missing_ok=True)  # it holds nothing of use
        raise
    except OSError as error:
        raise LightprobeError(
            f"record: {file}: write: {error.strerror}: {count} messages are in it: free some room, "
            "and record into a new file"
        ) from None
    summary = {"file": str(file), "messages": count, "seconds": time.monotonic() - started_s}
    text = f"written: {file}: {count} messages in {summary['seconds']:.1f} s"
    typer.echo(json.dumps(summary) if as_json else text, err=not as_json)


async def _record(
    uri: str, wish: Subscription, recorder: recording.Recorder, seconds: float | None
) -> None:
    def keep(payload: bytes) -> None:
        recorder.write(payload, time.time_ns())

    async with AsyncClient(uri, wish, on_payload=keep) as client:
        await client.receive(_PATIENCE_S)
        if wish.reflection_map_size and client.hello and not client.hello.max_reflection_map_size:
            raise _NoMapsError(
                f"record: {uri}: reflection maps: the probe sends none: start lightprobed with "
                f"--reflection-map={wish.reflection_map_size}, or record without"
            )
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for _ in client.estimates():
                    pass


def replay(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A recording.")],
    publish: Annotated[
        list[str] | None,
        typer.Option(
            metavar="URI",
            help="tcp:127.0.0.1:PORT or ws:127.0.0.1:PORT; repeat it. Default: ports 7700, 7701.",
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(callback=check.number(0.01, 100), help="Times as fast as recorded.")
    ] = 1.0,
    once: Annotated[bool, typer.Option("--once", help="End with the recording.")] = False,
) -> None:
    """Serve a recording as a probe, again and again, until Ctrl-C.

    Clients connect as to lightprobed. Example: lightprobe replay room.mcap --speed 2
    """
    with suppress(KeyboardInterrupt):
        estimates, map_size = _look_through(file)
        asyncio.run(_replay(file, estimates, map_size, publish or _DEFAULT_URIS, speed, once))


def _look_through(file: Path) -> tuple[int, int]:
    """How many estimates a recording holds, and the size of its largest map; says what is wrong.

    The file is read again in every round, so that it may be larger than the memory.
    """
    notes: list[str] = []
    estimates = map_size = 0
    for one in recording.read(file, notes):
        if one.message.HasField("estimate"):
            estimates += 1
        elif _is_ambient_map(one.message):
            # What was asked for AMBIENT alone can be given to every client.
            map_size = max(map_size, one.message.reflection_map.size)
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    if not estimates:
        raise LightprobeError(f"replay: {file}: holds no estimate")
    return estimates, map_size


async def _replay(
    file: Path, estimates: int, map_size: int, uris: list[str], speed: float, once: bool
) -> None:
    server = ProbeServer(file.stem, f"lightprobe replay {__version__}", map_size)
    async with AsyncExitStack() as stack:
        for uri in uris:
            address = await stack.enter_async_context(server.listening(uri))
            typer.echo(f"replay: {file}: {estimates} estimates on {address}", err=True)
        while True:
            await _once(server, _played(file), speed)
            if once:
                return


def _is_ambient_map(message: Any) -> bool:
    return bool(
        message.HasField("reflection_map")
        and message.reflection_map.kind == pb.SphericalHarmonics.AMBIENT
    )


def _played(file: Path) -> Iterator[recording.Recorded]:
    kinds = ("estimate", "reflection_map")
    read = recording.read(file, [])
    return (one for one in read if one.message.WhichOneof("message") in kinds)


async def _once(server: ProbeServer, played: Iterable[recording.Recorded], speed: float) -> None:
    last_ns: int | None = None
    for one in played:
        pause_s = 0.0 if last_ns is None else max(0, one.time_ns - last_ns) / 1e9 / speed
        last_ns = one.time_ns
        await asyncio.sleep(min(pause_s, _LONGEST_PAUSE_S))
        if one.message.HasField("reflection_map"):
            if _is_ambient_map(one.message):
                reflection_map = pb.ReflectionMap()
                reflection_map.CopyFrom(one.message.reflection_map)
                server.publish_map(reflection_map)
            continue
        estimate: Any = pb.Estimate()
        estimate.CopyFrom(one.message.estimate)
        stamp_now(estimate, estimate.send_delay_us)
        server.publish(estimate)
    await asyncio.sleep(0.05)
