"""LED and button on GPIO lines of the kernel (libgpiod): found by name, requested, read."""

from __future__ import annotations

import errno
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import gpiod
from gpiod.line import Bias, Clock, Direction, Edge, Value

from lightprobe.errors import LightprobeError, UsageError

_CONSUMER = "lightprobe panel"
_DEBOUNCE = timedelta(milliseconds=20)
_NAMED = re.compile(r"(?:(?P<chip>gpiochip\d+|/dev/\S+):)?(?P<line>[\w.+/-]+)")


@dataclass(frozen=True)
class Wanted:
    """A line as the user names it: NAME, CHIP:NAME or CHIP:NUMBER."""

    what: str  # LED, button
    name: str
    active_low: bool

    def fail(self, stage: str, words: str) -> LightprobeError:
        """Give the error: object, stage, reason and next step."""
        return LightprobeError(f"panel: {self.what} {self.name}: {stage}: {words}")


@dataclass(frozen=True)
class Found:
    """Where a line is."""

    chip: str
    offset: int


class Led:
    """The LED's line, dark at the start; dark again when it is closed."""

    def __init__(self, wanted: Wanted, found: Found) -> None:
        """Request the line; raises LightprobeError."""
        self._offset, self._lit, self._wanted = found.offset, False, wanted
        settings = gpiod.LineSettings(
            direction=Direction.OUTPUT, output_value=Value.INACTIVE, active_low=wanted.active_low
        )
        self._request = _request(wanted, found, settings)

    def set(self, lit: bool) -> None:
        """Light it, or not; raises LightprobeError."""
        if lit == self._lit:
            return
        try:
            self._request.set_value(self._offset, Value.ACTIVE if lit else Value.INACTIVE)
        except OSError as error:
            raise self._wanted.fail("set", f"{error.strerror}: is its chip still there?") from None
        self._lit = lit

    def close(self) -> None:
        """Dark, and free for others."""
        try:
            self.set(False)
        finally:
            self._request.release()


class Push:
    """The button's line; the kernel takes its bouncing away."""

    def __init__(self, wanted: Wanted, found: Found) -> None:
        """Request the line; raises LightprobeError."""
        self._offset, self._wanted = found.offset, wanted
        self._settings = gpiod.LineSettings(
            direction=Direction.INPUT, edge_detection=Edge.BOTH, active_low=wanted.active_low,
            bias=Bias.PULL_UP if wanted.active_low else Bias.PULL_DOWN,
            debounce_period=_DEBOUNCE, event_clock=Clock.MONOTONIC,
        )  # fmt: skip
        self._request = _request(wanted, found, self._settings)

    def pressed(self) -> bool:
        """Whether it is down now; raises LightprobeError."""
        try:
            return self._request.get_value(self._offset) is Value.ACTIVE
        except OSError as error:
            raise self._wanted.fail("read", f"{error.strerror}: is its chip still there?") from None

    def edges(self, wait_s: float) -> Iterator[tuple[bool, float]]:
        """Wait so long at most; each edge as (pressed, seconds of time.monotonic()).

        In the end how it is now, in case edges have been lost. Raises LightprobeError.
        """
        try:
            if self._request.wait_edge_events(max(wait_s, 0.0)):
                for event in self._request.read_edge_events():
                    rising = event.event_type is event.Type.RISING_EDGE
                    yield rising, event.timestamp_ns / 1e9
        except OSError as error:
            raise self._wanted.fail("read", f"{error.strerror}: is its chip still there?") from None
        if not self._request.wait_edge_events(0.0):
            yield self.pressed(), time.monotonic()

    def close(self) -> None:
        """Free for others."""
        self._request.release()


def find(wanted: Wanted) -> Found:
    """Find a line of this machine; raises LightprobeError that says what there is."""
    match = _NAMED.fullmatch(wanted.name)
    if not match:
        raise UsageError(
            f"panel: {wanted.what} {wanted.name!r}: no name of a line: GPIO27, gpiochip0:27 or "
            "gpiochip0:NAME (gpioinfo lists them)"
        )
    line = match["line"]
    if match["chip"]:
        path = match["chip"] if match["chip"].startswith("/") else f"/dev/{match['chip']}"
        return _on(wanted, path, int(line) if line.isdecimal() else line)
    return _anywhere(wanted, line)


def _anywhere(wanted: Wanted, line: str) -> Found:
    chips = sorted(str(path) for path in Path("/dev").glob("gpiochip*"))
    if not chips:
        raise wanted.fail(
            "find", "this machine has no /dev/gpiochip*: is it one with a GPIO header?"
        )
    found = [offset for chip in chips if (offset := _offset(wanted, chip, line)) is not None]
    if len(found) == 1:
        return found[0]
    if found:
        where = ", ".join(f"{Path(one.chip).name}:{one.offset}" for one in found)
        raise wanted.fail("find", f"{len(found)} lines have this name: name one of {where}")
    names = ", ".join(Path(chip).name for chip in chips)
    raise wanted.fail("find", f"no line of {names} has this name: gpioinfo lists them")


def _offset(wanted: Wanted, chip: str, line: str) -> Found | None:
    try:
        return _on(wanted, chip, line)
    except _NoSuchLineError:
        return None


class _NoSuchLineError(LightprobeError):
    pass


def _on(wanted: Wanted, path: str, line: str | int) -> Found:
    with _chip(wanted, path) as chip:
        try:
            return Found(path, chip.line_offset_from_id(line))
        except (OSError, ValueError):
            words = f"{path} has no line {line}: gpioinfo lists them"
            raise _NoSuchLineError(str(wanted.fail("find", words))) from None


def _chip(wanted: Wanted, path: str) -> gpiod.Chip:
    try:
        return gpiod.Chip(path)
    except FileNotFoundError:
        words = f"no {path}: gpiodetect lists the chips"
    except PermissionError:
        words = f"{path}: not allowed: run it as root, or in the group gpio"
    except OSError as error:
        words = f"{path}: {error.strerror}: gpiodetect lists the chips"
    raise wanted.fail("open", words)


def _request(wanted: Wanted, found: Found, settings: gpiod.LineSettings) -> gpiod.LineRequest:
    try:
        return gpiod.request_lines(found.chip, consumer=_CONSUMER, config={found.offset: settings})
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise wanted.fail(
                "request", f"{_user(found)} uses it: end that, or name another line"
            ) from None
        raise wanted.fail(
            "request", f"{error.strerror}: can this line do that? (gpioinfo)"
        ) from None


def _user(found: Found) -> str:
    try:
        with gpiod.Chip(found.chip) as chip:
            return chip.get_line_info(found.offset).consumer or "something"
    except OSError:
        return "something"


def open_both(led: Wanted | None, button: Wanted | None) -> tuple[Led | None, Push | None]:
    """Request what is wanted; raises LightprobeError, UsageError where both are one line."""
    at = [find(wanted) if wanted else None for wanted in (led, button)]
    if led and button and at[0] == at[1]:
        raise UsageError(
            f"panel: button {button.name}: is the LED's line, too: name another --button"
        )
    light = Led(led, at[0]) if led and at[0] else None
    try:
        return light, Push(button, at[1]) if button and at[1] else None
    except LightprobeError:
        if light:
            light.close()
        raise
