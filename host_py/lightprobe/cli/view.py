"""Estimates for the eye: a dashboard for terminals, one plain line for everything else."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from lightprobe import drawn
from lightprobe.client import Client
from lightprobe.colour import linear_to_srgb, luminance
from lightprobe.estimate import FLAG_WORDS, Estimate, Health, Light, flag_names
from lightprobe.geometry import Array

#: Angles of polarization with a larger sigma are not shown.
_KNOWN_ANGLE_DEG = 20.0


def console() -> Console:
    """Console for stdout; wide where nobody folds lines (a pipe, a file)."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=200)


def swatch(rgb: Array, width: int = 4) -> Text:
    """Block of the hue of a linear colour, at full brightness."""
    brightest = float(np.max(rgb))
    encoded = linear_to_srgb(np.maximum(rgb, 0) / brightest) if brightest > 0 else np.zeros(3)
    red, green, blue = (round(255 * float(v)) for v in encoded)
    return Text("█" * width, style=f"rgb({red},{green},{blue})")


def number(value: float | None, digits: int = 3) -> str:
    """Short number; a dash when unknown."""
    return "–" if value is None else f"{value:.{digits}g}"


def sigma_percent(light: Light) -> float | None:
    """Relative uncertainty of a light's irradiance, in percent; None when unknown."""
    brightness = float(luminance(light.irradiance))
    if light.irradiance_sigma is None or brightness <= 0:
        return None
    return 100 * float(luminance(light.irradiance_sigma)) / brightness


def polarization_words(light: Light) -> tuple[str, str]:
    """How a light is polarized, and how likely it is that it is a mirror image; dashes: unknown."""
    degree = "–"
    if light.dolp is not None and light.dolp_sigma is not None:
        degree = f"{100 * light.dolp:.0f}±{number(100 * light.dolp_sigma, 2)}%"
        if light.aolp_deg is not None and (light.aolp_sigma_deg or 90) < _KNOWN_ANGLE_DEG:
            degree += f" {light.aolp_deg:.0f}±{number(light.aolp_sigma_deg, 2)}°"
    return degree, "–" if light.reflection is None else f"{100 * light.reflection:.0f}%"


def distance_words(light: Light) -> str:
    """How far away a light is, or at least is; a dash when unknown."""
    if light.distance_m is not None:
        sigma = light.distance_sigma
        return f"{light.distance_m:.2f} m" + ("" if sigma is None else f" ±{100 * sigma:.2g}%")
    return "–" if light.nearest_m is None else f"> {light.nearest_m:.1f} m"


def lights_table(estimate: Estimate) -> Table:
    """One row per lamp, strongest first; distance and polarization where the probe tells them."""
    lights = (*estimate.lights, *filter(None, [estimate.key]))
    has_distance = any(light.distance_m or light.nearest_m for light in lights)
    has_film = any(light.reflection is not None for light in lights)
    table = Table(expand=True, box=None, header_style="bold", pad_edge=False)
    for name in (
        "lamp",
        "azimuth",
        "elevation",
        "±",
        "irradiance R G B",
        "±",
        "",
        "across",
        "shadow",
    ):
        table.add_column(name, justify="left" if name in ("lamp", "") else "right", no_wrap=True)
    for name in [*(["distance"] * has_distance), *(["polarized", "mirrored"] * has_film)]:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("flags", overflow="fold")
    for light in lights:
        percent = sigma_percent(light)
        table.add_row(
            f"#{light.id}" if light.id else "key",
            f"{light.azimuth_deg:+7.2f}°",
            f"{light.elevation_deg:+6.2f}°",
            f"{number(light.direction_sigma_deg, 2)}°",
            " ".join(number(float(v)) for v in light.irradiance),
            "–" if percent is None else f"{percent:.2g}%",
            swatch(light.irradiance),
            f"{2 * light.angular_radius_deg:.2f}°",
            "–" if light.shadow_strength is None else f"{100 * light.shadow_strength:.0f}%",
            *([distance_words(light)] * has_distance),
            *(polarization_words(light) if has_film else ()),
            " ".join(flag_names(light.flags)).lower(),
        )
    return table


def sh_table(estimate: Estimate) -> Table:
    """SH coefficients, one row per band, luminance; the mean as a swatch."""
    table = Table(expand=True, box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    values = luminance(estimate.sh.coefficients)
    for degree in range(estimate.sh.order + 1):
        band = values[degree**2 : (degree + 1) ** 2]
        colour = swatch(estimate.sh.coefficients[0]) if degree == 0 else Text("")
        table.add_row(f"l = {degree}", colour, "  ".join(f"{value:+.4g}" for value in band))
    return table


def flag_lines(names: Iterable[str]) -> list[str]:
    """Flags in words."""
    return [f"{name}: {FLAG_WORDS.get(name, 'unknown to this version')}" for name in names]


def box_words(estimate: Estimate | None, health: Health | None) -> str:
    """Wheel and ring in words; empty without either."""
    words = []
    if health is not None and health.wheel is not None:
        wheel = health.wheel
        words.append(f"wheel {wheel.phase.lower()}")
        if estimate is not None and estimate.wheel_deg is not None:
            words[-1] += f" {estimate.wheel_deg:.1f}°±{number(estimate.wheel_sigma_deg, 2)}°"
    if health is not None and health.ring is not None:
        lux = " ".join(number(value) for value in health.ring.illuminance_lux)
        words.append(f"ring {lux} lux")
    return "  ".join(words)


def room_words(estimate: Estimate) -> str:
    """How large the room is, along its own axes, and what that is worth; empty: not known."""
    if (room := estimate.room) is None:
        return ""
    size = " × ".join(f"{one:.1f}" for one in room.size_m)
    return f"room {size} m, ambient light off by {number(100 * room.error_per_m, 2)} % a metre away"


def plain(estimate: Estimate) -> str:
    """One line for logs and pipes."""
    lamps = "; ".join(
        f"#{light.id} az {light.azimuth_deg:+.2f} el {light.elevation_deg:+.2f} "
        f"E {' '.join(number(float(v)) for v in light.irradiance)} "
        f"across {2 * light.angular_radius_deg:.2f}"
        for light in estimate.lights
    )
    flags = ",".join(flag_names(estimate.flags)) or "-"
    mean = " ".join(number(float(v)) for v in estimate.sh.coefficients[0])
    line = f"{estimate.sequence} lamps {len(estimate.lights)} [{lamps}] sh0 {mean} flags {flags}"
    return f"{line} {room_words(estimate)}".rstrip()


def drawn_words(client: Client) -> str:
    """What to expect of what is drawn, and what of it is more than was asked; "": nothing is."""
    estimate = client.latest()
    if estimate is None or estimate.drawn is None:
        return ""
    draws = client.subscription.draws or {}
    map_ = client.reflection_map
    size = f", map of {map_.size}" if map_ is not None else ""
    return f"draws {drawn.words(draws, estimate.drawn)}; order {estimate.sh.order}{size}"


class RateMeter:
    """Estimates per second over the last two seconds."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        self._seen: deque[tuple[float, int]] = deque()

    def rate_hz(self, count: int) -> float:
        """Note a counter's value now; give its rate."""
        now = time.monotonic()
        self._seen.append((now, count))
        while now - self._seen[0][0] > 2:
            self._seen.popleft()
        first_s, first = self._seen[0]
        return (count - first) / (now - first_s) if now > first_s else 0.0


def dashboard(client: Client, rate_hz: float, note: str = "") -> RenderableType:
    """Everything that a client knows, on one screen."""
    parts: list[RenderableType] = [_status(client, rate_hz)]
    estimate = client.latest()
    if estimate is None:
        why = client.last_error or "waiting for the first estimate"
        parts.append(Panel(Text(why, style="yellow"), title="no light", title_align="left"))
    else:
        flags = flag_lines(flag_names(estimate.flags))
        parts.append(Panel(_lamps(estimate), title="lamps", title_align="left"))
        kind = f"SH of radiance, order {estimate.sh.order}, {estimate.sh.kind}, luminance"
        parts.append(Panel(sh_table(estimate), title=kind, title_align="left"))
        for words in (room_words(estimate), drawn_words(client)):
            if words:
                parts.append(Text(words))
        if flags:
            parts.append(Text("\n".join(flags), style="yellow"))
    parts.append(_health(client))
    if note:
        parts.append(Text(note, style="dim"))
    return Group(*parts)


def _lamps(estimate: Estimate) -> RenderableType:
    return lights_table(estimate) if estimate.lights else Text("none: all light is in the SH")


def _status(client: Client, rate_hz: float) -> Text:
    """Line of who, how fast, how old."""
    hello, estimate = client.hello, client.latest()
    if hello is None:
        return Text(f"{client.uri}: connecting …", style="bold yellow")
    words = [f"{hello.software} at {client.uri}", f"source {hello.source}", f"{rate_hz:.1f}/s"]
    if estimate is not None:
        model = f"order {estimate.sh.order}, {len(estimate.lights)} lamps"
        words.append(f"captured {client.age_ms() or 0:.0f} ms ago")
        words.append(f"exposures {estimate.exposure_count}")
        if estimate.predicted_error is not None:
            model += f", leaves out {100 * estimate.predicted_error:.1f}%"
        words.append(model)
    if hello.processing:
        words.append(f"camera alters the light: {', '.join(hello.processing)}")
    return Text("  ·  ".join(words), style="bold")


def _health(client: Client) -> RenderableType:
    """Counters of the daemon, and its faults."""
    health, mine = client.health, client.statistics
    if health is None:
        return Text("")
    state = Text(f"{health.source_state.lower()}  ", style=_state_style(health.source_state))
    state.append(
        f"frames {health.frames_received} received, {health.frames_dropped} dropped, "
        f"{health.frames_rejected} rejected  ·  latency p50 {health.latency_p50_us / 1000:.1f} ms, "
        f"p99 {health.latency_p99_us / 1000:.1f} ms  ·  cpu {health.cpu_percent:.0f}%, "
        f"{health.rss_kib / 1024:.0f} MiB  ·  clients {health.clients}  ·  "
        f"reconnections {max(mine.connections - 1, 0)}",
        style="dim",
    )
    faults = [Text(f"{fault.id}: {fault.text}", style="red") for fault in health.faults]
    box = [Text(words) for words in [box_words(client.latest(), health)] if words]
    return Group(*box, state, *faults)


def _state_style(state: str) -> str:
    return {"STREAMING": "green", "ENDED": "dim"}.get(state, "red")
