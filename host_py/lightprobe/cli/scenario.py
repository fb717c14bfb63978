"""A file with options of a command that has many: `lightprobe simulate --scenario FILE`.

TOML; each key is an option (`turn_deg_s` is `--turn-deg-s`), in tables or not. An option that has
names of its own (`--processing sharpen=0.7`) may be a table of them. What stands on the command
line counts before what the file says.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlencode

import typer

from lightprobe.errors import UsageError

#: Options that are about this run, and not about what is simulated.
_NOT_IN_FILES = {"scenario", "help", "json"}
#: How --help writes the value of an option that has names of its own.
NAMED = "K=V&…"


def keys(command: Any) -> dict[str, Any]:
    """Give the options of click's `command` that a file may have, by their keys."""
    found = {}
    for option in command.params:
        key = option.opts[-1].lstrip("-").replace("-", "_")
        if key not in _NOT_IN_FILES and not key.startswith("help_"):
            found[key] = option
    return found


def hide(command: Any, shown: Collection[str]) -> None:
    """Leave all options but `shown` out of --help; they stay options."""
    for key, option in keys(command).items():
        option.hidden = key not in shown


def read(context: typer.Context, path: Path | None) -> Path | None:
    """Take a file's values as the defaults of the options; UsageError for what is none."""
    if path is None or context.resilient_parsing:
        return path
    known = keys(context.command)
    try:
        table = tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise _refusal(context, f"{path}: {reason}") from None
    values = dict(_flat(table, known))
    for key in values:
        if key not in known:
            raise _refusal(context, f"{path}: {key}: no such key: see --help-scenario")
    context.meta["scenario"] = path
    context.default_map = {
        known[key].name: _text(value, known[key]) for key, value in values.items()
    }
    return path


def show(context: typer.Context, wanted: bool) -> None:
    """Print a file with all keys, their defaults and what they mean, and end."""
    if not wanted or context.resilient_parsing:
        return
    typer.echo(template(context.command, context.command_path))
    raise typer.Exit


def template(command: Any, path: str) -> str:
    """Give a file with every key, commented out, as it is by default."""
    tables = _tables()
    lines = [
        f"# A scenario: save it, change it, {path} --scenario FILE.",
        "# A key is an option, too: act_s is --act-s, which counts before the file.",
    ]
    known = keys(command)
    for key, option in known.items():
        if key not in tables:
            lines += ["", f"# {option.help}", f"#{key} = {_toml(option.default)}"]
    for key in sorted(known.keys() & tables.keys()):
        lines += ["", f"# {known[key].help}", f"#[{key}]"]
        for name, (default, means) in tables[key].items():
            lines += [f"# {means}", f"#{name} = {_toml(default)}"]
    return "\n".join(lines)


def _refusal(context: typer.Context, reason: str) -> UsageError:
    name = context.command_path.removeprefix("lightprobe").strip()
    return UsageError(f"{name}: --scenario {reason}")


def _tables() -> dict[str, dict[str, tuple[float, str]]]:
    """Options that are printed as tables: each name in them, its default and what it means."""
    from lightprobe.sim.lens_defects import LensDefects
    from lightprobe.sim.pixel_defects import PixelDefects
    from lightprobe.sim.processing import Processing

    kinds: dict[str, Any] = {
        "processing": Processing, "lens_defects": LensDefects, "pixel_defects": PixelDefects,
    }  # fmt: skip
    return {
        key: {one.name: (cast(float, one.default), one.metadata["means"]) for one in fields(kind)}
        for key, kind in kinds.items()
    }


def _flat(table: dict[str, Any], known: dict[str, Any]) -> Any:
    """Give keys and values, of tables too; a table of an option's own names becomes its value."""
    for name, value in table.items():
        key = name.replace("-", "_")
        if not isinstance(value, dict):
            yield key, value
        elif key in known and known[key].metavar == NAMED:
            yield key, urlencode({one.replace("-", "_"): value[one] for one in value})
        else:
            yield from _flat(value, known)


def _text(value: Any, option: Any) -> Any:
    """Give a value as the command line would: several as a list, or joined by commas."""
    if isinstance(value, list):
        words = [str(one) for one in value]
        return words if option.multiple else ",".join(words)
    if isinstance(value, bool):
        return value
    return [str(value)] if option.multiple else str(value)


def _toml(default: Any) -> str:
    if isinstance(default, list | tuple):
        return "[" + ", ".join(_toml(one) for one in default) + "]"
    if default is None:
        return '""'
    return f"{default}" if isinstance(default, int | float) else f'"{default}"'
