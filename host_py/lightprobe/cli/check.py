"""Checks of options: before any work is done, so that no minute of it is lost to a typing error.

Each function gives a callback for `typer.Option(callback=…)`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from lightprobe.errors import UsageError

T = TypeVar("T")
Check = Callable[[typer.Context, typer.CallbackParam, T], T]


def refuse(context: typer.Context, option: typer.CallbackParam, value: object, want: str) -> None:
    """Raise :class:`UsageError` that names command, option, value, and what it may be."""
    command = context.command_path.removeprefix("lightprobe").strip()
    named = f"{option.opts[-1]} {value}"
    source = context.get_parameter_source(option.name or "")
    if source is not None and source.name == "DEFAULT_MAP":  # of a file (cli/scenario.py)
        key = option.opts[-1].lstrip("-").replace("-", "_")
        named = f"{context.meta['scenario']}: {key} = {value}"
    raise UsageError(f"{command}: {named}: expected {want}")


def number(
    low: float = -math.inf, high: float = math.inf, unit: str = "", *, above: bool = False
) -> Check[float | None]:
    """Want a finite number from `low` (or above it) to `high`; None passes."""
    words = " ".join(part for part in (_range(low, high, above), unit) if part)

    def check(
        context: typer.Context, option: typer.CallbackParam, value: float | None
    ) -> float | None:
        if value is None or context.resilient_parsing:
            return value
        inside = low < value <= high if above else low <= value <= high
        if not (inside and math.isfinite(value)):
            refuse(context, option, f"{value:g}", words)
        return value

    return check


def _range(low: float, high: float, above: bool) -> str:
    if math.isinf(low) and math.isinf(high):
        return "a finite number"
    start = f"more than {low:g}" if above else f"{low:g}"
    if math.isinf(high):
        return start if above else f"{start} or more"
    return f"{start}, at most {high:g}" if above else f"{start}…{high:g}"


def one_of(known: Collection[T]) -> Check[T]:
    """Want one of some words, or numbers."""

    def check(context: typer.Context, option: typer.CallbackParam, value: T) -> T:
        if value not in known and not context.resilient_parsing:
            refuse(context, option, value, ", ".join(map(str, known)))
        return value

    return check


def new_file(*suffixes: str, makes_folders: bool = False) -> Check[Path | None]:
    """Want the path of a file that can be written; with `suffixes`, of one of these kinds.

    `makes_folders`: the command makes the folders that the path names.
    """

    def check(
        context: typer.Context, option: typer.CallbackParam, value: Path | None
    ) -> Path | None:
        if value is None or context.resilient_parsing:
            return value
        if suffixes and value.suffix.lower() not in suffixes:
            refuse(context, option, value, f"a name that ends in {', '.join(suffixes)}")
        if reason := why_not_writable(value, makes_folders):
            refuse(context, option, value, f"a file that can be written: {reason}")
        return value

    return check


def plot(means: str) -> Any:
    """Give the option of a command that draws a plot; `means`: its help."""
    return typer.Option(metavar="FILE", callback=new_file(".png", ".svg", ".pdf"), help=means)


def new_folder(
    context: typer.Context, option: typer.CallbackParam, value: Path | None
) -> Path | None:
    """Want a folder that files can be put into, there or to be made."""
    if value is not None and not context.resilient_parsing:
        place = _nearest(value)
        if not place.is_dir():
            refuse(context, option, value, f"a folder: {place} is not one")
        if not os.access(place, os.W_OK | os.X_OK):
            refuse(context, option, value, f"a folder that can be written: {place} cannot be")
    return value


def new_socket(
    context: typer.Context, option: typer.CallbackParam, value: Path | None
) -> Path | None:
    """Want a path where a socket, or a link to a pty, can be made."""
    if value is not None and not context.resilient_parsing:
        if value.is_dir() or not value.parent.is_dir():
            refuse(context, option, value, "a path in a folder that exists")
        if not os.access(value.parent, os.W_OK | os.X_OK):
            refuse(
                context, option, value, f"a folder that can be written: {value.parent} cannot be"
            )
    return value


def why_not_writable(path: Path, makes_folders: bool = False) -> str:
    """Say why a file cannot be written, or made in its folder; empty when it can."""
    if path.is_dir():
        return "it is a folder"
    if path.exists():
        return "" if os.access(path, os.W_OK) else "permission denied"
    folder = _nearest(path.parent) if makes_folders else path.parent
    if not folder.is_dir():
        return f"{folder} is not a folder" if folder.exists() else f"there is no folder {folder}"
    return "" if os.access(folder, os.W_OK | os.X_OK) else f"{folder}: permission denied"


def _nearest(path: Path) -> Path:
    """The path itself, or the nearest part of it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


#: Options of commands that go on until Ctrl-C; None: for ever.
Seconds = Annotated[
    float | None,
    typer.Option(
        callback=number(0, unit="seconds", above=True), help="Seconds after which to end."
    ),
]
Count = Annotated[int | None, typer.Option(min=1, help="Number of estimates after which to end.")]
