"""`lightprobe field`: several probes with known places, joined: how far away each lamp is."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress
from typing import Annotated, Any

import numpy as np
import typer
from lightprobe_proto import lightprobe_pb2 as pb

from lightprobe import __version__, geometry
from lightprobe.async_client import AsyncClient
from lightprobe.box_fit import BoxFit
from lightprobe.cli import check
from lightprobe.errors import ProbeTimeout, UsageError
from lightprobe.estimate import Estimate, Light
from lightprobe.field import Joined, Station, join, with_room
from lightprobe.geometry import Array
from lightprobe.server import ProbeServer, stamp_now
from lightprobe.wire import Subscription, fill_room

_PATIENCE_S = 10.0
_WANTED = "ADDRESS@X,Y,Z or ADDRESS@X,Y,Z,YAW, in metres and degrees"


def command(
    probes: Annotated[
        list[str],
        typer.Argument(
            metavar="PROBE...",
            help="ADDRESS@X,Y,Z[,YAW] of two probes or more: metres in a room, +Y up; how far its "
            "-Z is turned to the left, in degrees. The light of the first one is given.",
        ),
    ],
    publish: Annotated[
        list[str] | None,
        typer.Option(
            metavar="URI",
            help="Serve the light with distances as a probe: tcp:127.0.0.1:PORT or "
            "ws:127.0.0.1:PORT; repeat it.",
        ),
    ] = None,
    place_sigma: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 10, "metres"), help="1 sigma of the places, metres, each axis."
        ),
    ] = 0.01,
    yaw_sigma: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 45, "degrees"),
            help="1 sigma of each YAW, degrees; lamps that both see tell it better.",
        ),
    ] = 3.0,
    level_sigma: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 45, "degrees"), help="1 sigma of how upright each is, degrees."
        ),
    ] = 0.5,
    rate_hz: Annotated[
        float,
        typer.Option(
            "--rate", callback=check.number(0, 100, above=True), help="Most estimates a second."
        ),
    ] = 2.0,
    seconds: check.Seconds = None,
    count: check.Count = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON line per estimate.")] = False,
) -> None:
    """Join probes that stand at known places, level: give the first one's lamps their distances.

    A lamp that two probes see has a place: `Estimate.at` of the clients gives its light anywhere
    near (docs/users/places.md). Ends on Ctrl-C. The exit code is 1 when no estimate came.
    Example: lightprobe field tcp:10.0.0.7:7700@0,1.2,0 tcp:10.0.0.8:7700@1,1.2,0,-90
    """
    stations = [_station(text, place_sigma, yaw_sigma, level_sigma) for text in probes]
    if len(stations) < 2:
        raise UsageError(f"field: {probes[0]}: one probe: expected two or more, {_WANTED}")
    for i, station in enumerate(stations):
        for other in stations[i + 1 :]:
            if np.linalg.norm(station.place_m - other.place_m) <= 3 * place_sigma:
                raise UsageError(
                    f"field: {station.uri} and {other.uri} stand at the same place: put them apart"
                )
    with suppress(KeyboardInterrupt):
        asyncio.run(_run(stations, publish or [], rate_hz, seconds, count, as_json))


def _station(
    text: str, place_sigma_m: float, yaw_sigma_deg: float, level_sigma_deg: float
) -> Station:
    uri, at, numbers = text.rpartition("@")
    try:
        values = [float(number) for number in numbers.split(",")]
    except ValueError:
        values = []
    if not at or not uri or len(values) not in (3, 4) or not all(map(math.isfinite, values)):
        raise UsageError(f"field: {text}: expected {_WANTED}")
    yaw_deg = values[3] if len(values) == 4 else 0.0
    place_m = np.array(values[:3])
    return Station(uri, place_m, yaw_deg, place_sigma_m, yaw_sigma_deg, level_sigma_deg)


class Still:
    """Tells whether a probe still stands as it did: one that was turned was moved."""

    _MOST_DEG = 1.0  # a map of bare walls tells the turn within this

    def __init__(self) -> None:
        """Begin with the first estimate that tells how the probe is turned."""
        self._start: tuple[int, Any] | None = None
        self.is_turned = False

    def look(self, estimate: Estimate | None) -> Estimate | None:
        """Give the estimate; None where the probe is turned otherwise than at first."""
        if estimate is None or estimate.orientation is None:
            return estimate
        x, y, z, w = estimate.orientation
        if self._start is None or self._start[0] != estimate.boot_id:
            self._start = estimate.boot_id, (w, x, y, z)
        way = geometry.turn_after(geometry.inverse(self._start[1]), (w, x, y, z))
        turned_deg = 2 * math.degrees(math.atan2(float(np.linalg.norm(way[1:])), abs(way[0])))
        self.is_turned = turned_deg > self._MOST_DEG
        return None if self.is_turned else estimate


class _Messages:
    """Estimates as they came, so that what is published differs in distances alone."""

    _KEPT = 16

    def __init__(self) -> None:
        self._estimates: dict[int, Any] = {}

    def take(self, payload: bytes) -> None:
        """Keep a message as it came, if it is an estimate."""
        message = pb.FromProbe.FromString(payload)
        if message.HasField("estimate"):
            self._estimates[message.estimate.sequence] = message.estimate
            while len(self._estimates) > self._KEPT:
                del self._estimates[next(iter(self._estimates))]

    def of(self, estimate: Estimate) -> Any:
        """Give a copy of a pb.Estimate, with the distances of this estimate."""
        message = pb.Estimate()
        message.CopyFrom(self._estimates[estimate.sequence])
        for wire, light in zip(message.lights, estimate.lights, strict=True):
            if light.distance_m is not None and light.distance_sigma is not None:
                wire.distance_m = light.distance_m
                wire.distance_sigma_permille = math.ceil(1000 * light.distance_sigma)
            elif light.nearest_m is not None:
                wire.nearest_m = light.nearest_m
        if estimate.room is not None and not message.HasField("room"):
            fill_room(message.room, estimate.room)
        return message


async def _run(
    stations: list[Station], publish: list[str], rate_hz: float, seconds: float | None,
    count: int | None, as_json: bool,
) -> None:  # fmt: skip
    # All that a client of ours may want is in it: it is cut for each (server.py).
    wish = Subscription(rate_hz=rate_hz, sh_order=4, max_lights=8, area_lights=True)
    messages = _Messages()
    server = ProbeServer("field", f"lightprobe field {__version__}")
    async with AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(
                AsyncClient(station.uri, wish, None if i else messages.take)
            )
            for i, station in enumerate(stations)
        ]
        for uri in publish:
            address = await stack.enter_async_context(server.listening(uri))
            typer.echo(f"field: {len(stations)} probes on {address}", err=True)
        stills = [Still() for _ in stations]
        search = BoxFit()
        said_s, given = 0.0, 0
        async for estimate in _estimates(clients[0], seconds):
            others = [
                still.look(client.latest())
                for still, client in zip(stills[1:], clients[1:], strict=True)
            ]
            if stills[0].look(estimate) is None:
                others = [None] * len(others)
            joined = await asyncio.to_thread(_joined, stations, estimate, others, search)
            message = messages.of(joined.estimate)
            stamp_now(message, round(1000 * max(0.0, clients[0].age_ms() or 0.0)))
            server.publish(message)
            given += 1
            if as_json:
                print(json.dumps(_json(stations, joined)), flush=True)
            elif time.monotonic() >= said_s + 1:
                said_s = time.monotonic()
                print(_words(stations, joined) + _troubles(clients, stills, joined), flush=True)
            if given == count:
                return
        if not given:
            raise ProbeTimeout(clients[0].last_error or f"{stations[0].uri}: no estimate came")


def _joined(
    stations: list[Station], estimate: Estimate, others: list[Estimate | None], search: BoxFit
) -> Joined:
    return with_room(stations, join(stations, estimate, others), others, search)


async def _estimates(client: AsyncClient, seconds: float | None) -> AsyncIterator[Estimate]:
    """Give the estimates of a time; ProbeTimeout where the first one does not come."""
    ends_s = math.inf if seconds is None else time.monotonic() + seconds
    yield await client.receive(min(_PATIENCE_S, ends_s - time.monotonic()))
    while (left_s := ends_s - time.monotonic()) > 0:
        with suppress(ProbeTimeout):
            yield await client.receive(min(1.0, left_s))


def _place_m(first: Station, joined: Joined, light: Light) -> list[float] | None:
    """Where a lamp is in the room; None: not known."""
    if light.distance_m is None:
        return None
    towards = geometry.rotate(joined.turns_wxyz[0], light.direction)
    place: list[float] = (first.place_m + light.distance_m * towards).tolist()
    return place


def _yaw_deg(turn_wxyz: Array) -> float:
    """How far a turned −Z is to the left of the room's."""
    ahead = geometry.rotate(turn_wxyz, [0, 0, -1])
    return math.degrees(math.atan2(-float(ahead[0]), -float(ahead[2])))


def _json(stations: list[Station], joined: Joined) -> dict[str, Any]:
    """As every command's estimates, each lamp with its place in the room; and the probes."""
    shape = joined.estimate.to_json()
    for light, values in zip(joined.estimate.lights, shape["lights"], strict=True):
        place_m = _place_m(stations[0], joined, light)
        values["place_m"] = place_m and [round(value, 4) for value in place_m]
    shape["probes"] = [
        {"uri": station.uri, "yaw_deg": round(_yaw_deg(turn), 3), "yaw_sigma_deg": round(sigma, 3)}
        for station, turn, sigma in zip(
            stations, joined.turns_wxyz, joined.yaw_sigma_deg, strict=True
        )
    ]
    shape["contradicts"] = joined.contradicts
    return shape


def _words(stations: list[Station], joined: Joined) -> str:
    lamps = []
    for light in joined.estimate.lights:
        place_m = _place_m(stations[0], joined, light)
        if place_m is not None:
            sigma_m = (light.distance_sigma or 0.0) * (light.distance_m or 0.0)
            numbers = ", ".join(f"{value:.2f}" for value in place_m)
            lamps.append(f"{light.id}: ({numbers}) ± {sigma_m:.2g} m")
        elif light.nearest_m is not None:
            lamps.append(f"{light.id}: beyond {light.nearest_m:.1f} m")
        else:
            lamps.append(f"{light.id}: ?")
    yaws = ", ".join(
        f"{_yaw_deg(turn):.1f} ± {sigma:.2g}°"
        for turn, sigma in zip(joined.turns_wxyz, joined.yaw_sigma_deg, strict=True)
    )
    return f"{'; '.join(lamps) or 'no lamps'}  (yaw {yaws})"


def _troubles(clients: list[AsyncClient], stills: list[Still], joined: Joined) -> str:
    silent = [client.uri for client in clients[1:] if client.latest() is None]
    turned = [client.uri for client, still in zip(clients, stills, strict=True) if still.is_turned]
    words = f"  (no light from {', '.join(silent)})" if silent else ""
    if turned:
        words += f"  (turned since the start: {', '.join(turned)}: measure its place again)"
    if joined.contradicts:
        words += "  (lamps contradict the places: measure them again, or widen the sigmas)"
    return words
