"""The microcontroller's faults in words: proto/mcu_faults.toml, packed with this package."""

import importlib.resources
import tomllib
from functools import cache


@cache
def _table() -> dict[str, dict[str, str]]:
    text = importlib.resources.files("lightprobe_proto").joinpath("mcu_faults.toml").read_text()
    return tomllib.loads(text)


def words(name: str) -> str:
    """Say what a fault means and what to do about it."""
    fault = _table().get(name)
    if fault is None:
        return "this fault belongs to newer firmware: install a newer lightprobe to see its meaning"
    return f"{fault['means']}: {fault['next_step']}"
