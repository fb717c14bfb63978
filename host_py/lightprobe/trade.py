"""The trade of processor time and bytes for accuracy: which settings suffice for what is drawn.

All figures are those that `make trade` measured on simulated scenes, and are kept in trade.json:

* measuring: presets of the daemon at widths of the picture; processor time of a frame, in plain
  decodes of a picture of 1920 × 960 pixels.
* sights: what sees the light: a camera of any exposure, as in all other figures; a webcam, whose
  shortest exposure is too long for many lamps; a webcam with the ring of light sensors.
* models: what a packet holds (SH order, lamps, area lights); bytes of a packet.
* maps: texels along an edge of a reflection map; bytes and processor time of a map.

An app may leave the choice of models and maps to the probe: Subscription.draws (lightprobe.drawn).

Errors are of what an app draws (DRAWS), median and worst over the scenes; those of models and maps
are what these leave out of the light as measured. Errors add up as variances.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from lightprobe.wire import Subscription

TABLE = Path(__file__).parent / "trade.json"
#: Blur of what a surface shows, degrees, 1 sigma of each axis.
GLOSSY_DEG, MIRROR_DEG = 15.0, 1.5
#: What an app may draw, and what its error is.
DRAWS = {
    "diffuse": "light on matt surfaces, of its mean",
    "shadows": "light in the shadow of a ball, of the open light",
    "glossy": f"what a surface of {GLOSSY_DEG:g}° blur shows, of white on a screen",
    "mirrors": f"what a surface of {MIRROR_DEG:g}° blur shows, of white on a screen",
}
SIGHTS = ("any exposure", "webcam", "webcam and ring")
#: Estimates and maps a second that are tried, and at most what was asked for.
RATES_HZ = (60.0, 30.0, 15.0, 10.0, 5.0, 2.0, 1.0)
#: Settings whose error is so little larger than the least one are as good: the cheapest is taken.
AS_GOOD = 1.1
#: A step of an 8-bit picture is not seen: less error is no better.
_LEAST_ERROR = 0.004
#: Bytes of TCP and IP that go with every packet.
HEADER_BYTES = 52

Error = tuple[float, float]  # median and worst over the scenes


@dataclass(frozen=True)
class Need:
    """What a user has and wants. `draws`: of DRAWS; `error`: the most of any of them; None: least.

    `cpu`: share of a processor core; `bytes_per_s`: of the network; None: no bound. `decode_ms`:
    what a plain decode of a picture of 1920 × 960 pixels takes on the probe's processor.
    """

    draws: tuple[str, ...]
    decode_ms: float
    sight: str = "webcam and ring"  # of SIGHTS
    rate_hz: float = 30.0
    map_rate_hz: float = 5.0
    cpu: float | None = None
    bytes_per_s: float | None = None
    error: float | None = None


@dataclass(frozen=True)
class Choice:
    """Settings, what they cost and how exact they are."""

    preset: str
    width_px: int  # of an equirectangular picture
    rate_hz: float  # of frames and estimates
    sh_order: int
    max_lights: int
    area_lights: bool
    map_size: int  # texels; 0: no map
    map_rate_hz: float
    cpu: float  # share of a core
    bytes_per_s: float
    errors: dict[str, Error]  # by what is drawn

    def subscription(self) -> Subscription:
        """Give what a client asks for."""
        return Subscription(
            rate_hz=self.rate_hz, sh_order=self.sh_order, max_lights=self.max_lights,
            area_lights=self.area_lights, reflection_map_size=self.map_size,
            reflection_map_rate_hz=self.map_rate_hz,
        )  # fmt: skip

    def median(self) -> float:
        """Give the largest median error of what is drawn."""
        return max(error[0] for error in self.errors.values())


@dataclass(frozen=True)
class Advice:
    """The choice; and what could not be had."""

    choice: Choice
    unmet: tuple[str, ...] = ()  # of "cpu", "bytes_per_s", "error"


@cache
def table() -> dict[str, Any]:
    """Give trade.json."""
    found: dict[str, Any] = json.loads(TABLE.read_text())
    return found


def _with_measurement(left_out: Error, by: Error, by_any: Error, by_sight: Error) -> Error:
    """Add to what a model leaves out what measures and what sees; `by` measured with any exposure.

    In the median all are independent, and what any exposure brings counts once. The worst scenes
    of two may be the same one: there the larger counts.
    """
    median = left_out[0] ** 2 + by[0] ** 2 + max(0.0, by_sight[0] ** 2 - by_any[0] ** 2)
    worst = left_out[1] ** 2 + max(by[1], by_sight[1]) ** 2
    return math.sqrt(median), math.sqrt(worst)


def _errors(
    need: Need, measuring: dict[str, Any], model: dict[str, Any], map_: dict[str, Any]
) -> dict[str, Error]:
    by_sight = {row["sight"]: row["errors"] for row in table()["sights"]}
    found = {}
    for name in need.draws:
        by_map = map_["size"] and name in ("glossy", "mirrors")
        found[name] = _with_measurement(
            (map_ if by_map else model)["errors"][name], measuring["errors"][name],
            by_sight[SIGHTS[0]][name], by_sight[need.sight][name],
        )  # fmt: skip
    return found


def _rates(asked_hz: float) -> list[float]:
    return [asked_hz, *(rate for rate in RATES_HZ if rate < asked_hz)]


def choices(need: Need) -> Iterator[Choice]:
    """Give every combination of settings that can serve what is drawn."""
    no_map = {"size": 0, "bytes": 0, "decodes": 0.0}
    mirrors = any(name in ("glossy", "mirrors") for name in need.draws)
    found = table()
    for measuring, model, map_ in product(
        found["measuring"], found["models"], [no_map, *found["maps"]] if mirrors else [no_map]
    ):
        errors = _errors(need, measuring, model, map_)
        for rate, map_rate in product(
            _rates(need.rate_hz), _rates(need.map_rate_hz) if map_["size"] else [need.map_rate_hz]
        ):
            if map_rate > rate:
                continue
            decodes = rate * measuring["decodes"] + map_rate * map_["decodes"]
            sent = rate * (model["bytes"] + HEADER_BYTES)
            if map_["size"]:
                sent += map_rate * (map_["bytes"] + HEADER_BYTES)
            yield Choice(
                measuring["preset"], measuring["width_px"], rate, model["sh_order"],
                model["max_lights"], model["area_lights"], map_["size"], map_rate,
                decodes * need.decode_ms / 1e3, sent, errors,
            )  # fmt: skip


def _cost(need: Need, choice: Choice) -> float:
    """What is taken of what there is; where nothing bounds it, of a core and of 1 Mbit/s."""
    return choice.cpu / (need.cpu or 1.0) + choice.bytes_per_s / (need.bytes_per_s or 125e3)


def _within(need: Need, every: list[Choice]) -> tuple[list[Choice], list[str]]:
    """Keep what the budgets allow; of one that nothing keeps, the cheapest, and its name."""
    unmet = []
    for name, most in (("cpu", need.cpu), ("bytes_per_s", need.bytes_per_s)):
        if most is None:
            continue
        least = min(getattr(one, name) for one in every)
        if least > most:
            unmet.append(name)
        every = [one for one in every if getattr(one, name) <= max(most, least)]
    return every, unmet


def _as_good(need: Need, some: list[Choice]) -> list[Choice]:
    """Keep those that are nearly the best for all that is drawn."""
    best = {
        name: max(min(one.errors[name][0] for one in some), _LEAST_ERROR) for name in need.draws
    }

    def worse(one: Choice) -> float:
        return max(max(one.errors[name][0], _LEAST_ERROR) / best[name] for name in need.draws)

    most = AS_GOOD * min(worse(one) for one in some)
    return [one for one in some if worse(one) <= most]


def advise(need: Need) -> Advice:
    """Choose within the budgets: the rate that was asked for, and with it the cheapest settings
    that are exact enough; a lower rate only where the budgets, or `error`, ask for it.

    Exact enough is what `error` says, or what is nearly as good as the best. Where nothing is,
    budgets come first, and what is not met is named.
    """
    every, unmet = _within(need, list(choices(need)))
    fits = [one for one in every if need.error is None or one.median() <= need.error]
    if not fits:
        unmet.append("error")
    rate = max(one.rate_hz for one in fits or every)
    at_rate = [one for one in fits or every if one.rate_hz == rate]
    exact = at_rate if fits and need.error is not None else _as_good(need, at_rate)
    map_rate = max(one.map_rate_hz for one in exact)
    exact = [one for one in exact if one.map_rate_hz == map_rate]
    return Advice(min(exact, key=lambda one: _cost(need, one)), tuple(unmet))
