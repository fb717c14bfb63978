"""A file with options of a command that has many: `lightprobe simulate --scenario FILE`.

TOML; each key is an option (`turn_deg_s` is `--turn-deg-s`), in tables or not. What stands on the
command line counts before what the file says.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import typer

from lightprobe.errors import UsageError

#: Options that are about this run, and not about what is simulated.
_NOT_IN_FILES = {"scenario", "help", "json"}


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
    values = dict(_flat(table))
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
    lines = [
        f"# A scenario: save it, change it, {path} --scenario FILE.",
        "# A key is an option, too: act_s is --act-s, which counts before the file.",
    ]
    for key, option in keys(command).items():
        lines += ["", f"# {option.help}", f"#{key} = {_toml(option.default)}"]
    return "\n".join(lines)


def _refusal(context: typer.Context, reason: str) -> UsageError:
    name = context.command_path.removeprefix("lightprobe").strip()
    return UsageError(f"{name}: --scenario {reason}")


def _flat(table: dict[str, Any]) -> Any:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value)
        else:
            yield key.replace("-", "_"), value


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
