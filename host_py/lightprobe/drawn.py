"""What an app draws, and how exact that must be: words and numbers of subscriptions and packets.

A subscription says what is drawn and the most error of each; the probe sends the least that
suffices, and with every packet the error to expect (docs/users/conventions.md, "What is drawn").
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from lightprobe.errors import UsageError

#: What an app may draw; as fields of the wire, NAME_permille.
THINGS = ("diffuse", "shadows", "glossy", "mirrors")
#: Other words for it.
WORDS = {"matt": "diffuse", "metal": "glossy", "chrome": "mirrors", "reflections": "mirrors"}
#: Of a subscription that says what is drawn, where nothing else bounds them.
MOST_ORDER, MOST_LIGHTS, MOST_MAP = 4, 8, 64
_ERROR = re.compile(r"(\d+(?:\.\d+)?)\s*%$")


def thing(word: str, command: str) -> str:
    """Give the name of what a word of `--draws` means."""
    name = WORDS.get(word.strip(), word.strip())
    if name not in THINGS:
        raise UsageError(f"{command}: --draws {name}: expected {', '.join(THINGS)}, by comma")
    return name


def parse(text: str, command: str) -> dict[str, float]:
    """Read `diffuse:2%,shadows:5%,chrome:10%`: errors as shares."""
    found = {}
    for part in text.split(","):
        word, _, error = part.partition(":")
        name, number = thing(word, command), _ERROR.match(error.strip())
        if number is None or not 0 < float(number[1]) <= 100:
            raise UsageError(f"{command}: --draws {part.strip()}: expected {word.strip()}:N%")
        found[name] = float(number[1]) / 100
    return found


def check(draws: Mapping[str, float]) -> str | None:
    """Say what is wrong with the errors that a subscription allows; None: nothing is."""
    for name, error in draws.items():
        if name not in THINGS:
            return f"draws = {name!r}: expected {', '.join(THINGS)}"
        if not 0.001 <= error <= 1:  # NaN fails too
            return f"draws = {name!r}: {error!r}: expected an error of 0.001…1"
    return None


def is_mirrored(draws: Mapping[str, float]) -> bool:
    """Whether a reflection map may be needed."""
    return "glossy" in draws or "mirrors" in draws


def write(draws: Mapping[str, float], message: Any) -> None:
    """Put errors into a Drawn."""
    message.SetInParent()
    for name, error in draws.items():
        setattr(message, f"{name}_permille", round(1000 * error))


def read(message: Any) -> dict[str, float]:
    """Give the errors of a Drawn that are known."""
    names = [name for name in THINGS if message.HasField(f"{name}_permille")]
    return {name: getattr(message, f"{name}_permille") / 1000 for name in names}


def unmet(draws: Mapping[str, float], drawn: Mapping[str, float]) -> tuple[str, ...]:
    """Name what is not as exact as was asked, or not known to be."""
    return tuple(name for name, error in draws.items() if not drawn.get(name, 2.0) <= error)


def words(draws: Mapping[str, float], drawn: Mapping[str, float]) -> str:
    """Put the errors to expect into words, with what was asked where that is not met."""
    missed = unmet(draws, drawn)
    parts = []
    for name, error in draws.items():
        found = f"{100 * drawn[name]:.1f} %" if name in drawn else "unknown"
        asked = f" (asked: {100 * error:g} %)" if name in missed else ""
        parts.append(f"{name} {found}{asked}")
    return ", ".join(parts)
