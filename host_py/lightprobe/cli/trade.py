"""`lightprobe trade`: the settings that suffice for what is drawn, and what they cost."""

from __future__ import annotations

import json
import re
import time
from dataclasses import asdict
from typing import Annotated

import cv2
import numpy as np
import typer

from lightprobe import drawn
from lightprobe.cli import check
from lightprobe.errors import UsageError
from lightprobe.sim.room import Room
from lightprobe.sim.sensor import Sensor, encode_jpeg
from lightprobe.trade import DRAWS, SIGHTS, Advice, Choice, Need, advise, table

_SIZE_PX = (1920, 960)
_DECODES = 25
_NUMBER = re.compile(r"(\d+(?:\.\d+)?)\s*(%|k|M|)$")
_FACTORS = {"%": 0.01, "k": 1e3, "M": 1e6, "": 1.0}
_UNMET = {
    "cpu": "no settings need less of the processor",
    "bytes_per_s": "no settings send fewer bytes",
    "error": "no settings within the budgets are as exact",
}


def command(
    draws: Annotated[
        str,
        typer.Option(
            metavar="WORD,…",
            help=f"What the app draws: {', '.join(DRAWS)} (chrome is mirrors, metal is glossy).",
        ),
    ] = "diffuse,shadows",
    cpu: Annotated[
        str | None, typer.Option(metavar="N%", help="Most of one processor core.")
    ] = None,
    send: Annotated[
        str | None, typer.Option("--bytes", metavar="N[k|M]", help="Most bytes a second.")
    ] = None,
    error: Annotated[
        str | None,
        typer.Option(metavar="N%", help="Largest median error of what is drawn; default: least."),
    ] = None,
    sight: Annotated[
        str,
        typer.Option(
            metavar="|".join(word.replace(" ", "-") for word in SIGHTS),
            help="What sees the light. A webcam exposes 100 µs at least: many lamps clip.",
        ),
    ] = "webcam-and-ring",
    rate: Annotated[
        float, typer.Option(callback=check.number(1, 1000, "Hz"), help="Estimates a second.")
    ] = 30.0,
    map_rate: Annotated[
        float, typer.Option(callback=check.number(0.1, 30, "Hz"), help="Reflection maps a second.")
    ] = 5.0,
    decode_ms: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, 1e4, "milliseconds", above=True),
            help="What the probe's processor takes to decode a JPEG of 1920 x 960; default: "
            "measured on this machine.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Choose settings: how exact, for how much processor time and how many bytes.

    Figures were measured on simulated scenes (docs/users/trade.md).
    """
    need = Need(
        _things(draws), decode_ms or measured_decode_ms(), _sight(sight), rate,
        min(map_rate, rate),
        _value("--cpu", cpu), _value("--bytes", send), _value("--error", error),
    )  # fmt: skip
    advice = advise(need)
    if as_json:
        typer.echo(json.dumps(asdict(advice) | {"decode_ms": need.decode_ms}, indent=1))
    else:
        typer.echo("\n".join(words(need, advice, decode_ms is None)))
    if advice.unmet:
        raise typer.Exit(1)


def _things(text: str) -> tuple[str, ...]:
    return tuple(drawn.thing(word, "trade") for word in text.split(","))


def _sight(text: str) -> str:
    found = text.replace("-", " ")
    if found not in SIGHTS:
        wanted = ", ".join(word.replace(" ", "-") for word in SIGHTS)
        raise UsageError(f"trade: --sight {text}: expected {wanted}")
    return found


def _value(option: str, text: str | None) -> float | None:
    if text is None:
        return None
    match = _NUMBER.fullmatch(text.strip())
    if not match or not float(match[1]) > 0:
        raise UsageError(f"trade: {option} {text}: expected a number above 0, as 10%, 20k or 0.1")
    return float(match[1]) * _FACTORS[match[2]]


def measured_decode_ms() -> float:
    """Give the least processor time of a plain decode of the simulated room's picture here."""
    radiance = Room().render(*_SIZE_PX).compose(np.ones(len(Room().lamps)))
    codes = Sensor(*_SIZE_PX, seed=0).capture(radiance, 0.25e6 / float(np.median(radiance)))
    jpeg = np.frombuffer(encode_jpeg(codes), np.uint8)
    cv2.setNumThreads(1)
    times_ns = []
    for _ in range(_DECODES):
        begin_ns = time.thread_time_ns()
        cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
        times_ns.append(time.thread_time_ns() - begin_ns)
    return min(times_ns) / 1e6


def words(need: Need, advice: Advice, here: bool) -> list[str]:
    """Give the answer in lines."""
    one = advice.choice
    where = "measured here" if here else "as stated"
    lines = [f"not met: {_UNMET[name]}; this is the nearest" for name in advice.unmet]
    lines += [
        f"probe    lightprobed --preset={one.preset}{_map_option(one)}",
        f"camera   {one.width_px} × {one.width_px // 2} pixels, {one.rate_hz:g} frames a second",
        f"app      {_subscription(one)}",
        f"costs    {100 * one.cpu:.1f} % of a core (a plain decode takes {need.decode_ms:.1f} ms, "
        f"{where}), {one.bytes_per_s / 1e3:.1f} kB a second",
    ]
    lines += [
        f"{name:8} {_percent(median)} median, {_percent(worst)} worst: {DRAWS[name]}"
        for name, (median, worst) in one.errors.items()
    ]
    scenes = table()["scenes"]
    return [*lines, f"Errors: simulated, {scenes} scenes, {need.sight}, a probe that stands still."]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _map_option(one: Choice) -> str:
    return f" --reflection-map={one.map_size}" if one.map_size else ""


def _subscription(one: Choice) -> str:
    parts = [f"rate_hz={one.rate_hz:g}", f"sh_order={one.sh_order}", f"max_lights={one.max_lights}"]
    if one.area_lights:
        parts.append("area_lights=True")
    if one.map_size:
        parts += [f"reflection_map_size={one.map_size}",
                  f"reflection_map_rate_hz={one.map_rate_hz:g}"]  # fmt: skip
    return f"Subscription({', '.join(parts)})"
