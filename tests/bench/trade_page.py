"""The generated parts of docs/users/trade.md, from trade.json."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from lightprobe.cli.main import app
from lightprobe.trade import DRAWS, SIGHTS, Choice, Need, choices, table
from matplotlib.axes import Axes
from typer.testing import CliRunner

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))
from generated import put  # noqa: E402

PAGE, PLOT = ROOT / "docs/users/trade.md", ROOT / "docs/users/trade.png"
#: What a daemon and a client take who are asked nothing.
_DEFAULT = {
    "preset": "balanced", "width_px": 1920, "sh_order": 2, "max_lights": 4,
    "area_lights": False, "map_size": 0,
}  # fmt: skip
#: What a plain decode of 1920 × 960 pixels takes on a slow board, for the examples.
BOARD_MS = 20.0
USERS = {
    "a headset on battery, matt things with shadows": "--cpu 10% --bytes 20k",
    "a tripod on mains, chrome": "--draws diffuse,shadows,chrome --bytes 2M",
    "a page on a phone, brushed metal": "--draws diffuse,metal --bytes 50k",
    "a film set, as exact as can be": "--draws diffuse,shadows,metal,chrome --sight any-exposure",
    "a microcontroller that wants a colour": "--draws diffuse --rate 5 --error 10%",
    "a webcam alone, matt things": "--draws diffuse,shadows --sight webcam",
    "one of a hundred apps behind a probe, chrome": "--draws diffuse,chrome --bytes 100k",
}


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _errors(row: dict[str, Any]) -> list[str]:
    return [f"{100 * row['errors'][name][0]:.2g} ({100 * row['errors'][name][1]:.2g})"
            for name in DRAWS]  # fmt: skip


def _answer(words: list[str]) -> str:
    result = CliRunner().invoke(app, words)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


def parts() -> dict[str, str]:
    """Give the tables by name."""
    found = table()
    head = [f"{name}, %" for name in DRAWS]
    measuring = _markdown(
        ["preset", "picture", "processor time, decodes", *head],
        [[row["preset"], f"{row['width_px']}×{row['width_px'] // 2}", f"{row['decodes']:.2f}",
          *_errors(row)] for row in found["measuring"]],
    )  # fmt: skip
    sights = _markdown(
        ["what sees the light", *head],
        [[row["sight"], *_errors(row)] for row in found["sights"]],
    )
    models = _markdown(
        ["SH order", "lamps", "area lights", "bytes", *head],
        [[str(row["sh_order"]), str(row["max_lights"]), "yes" if row["area_lights"] else "",
          str(row["bytes"]), *_errors(row)] for row in found["models"]
         if row["max_lights"] in (0, 1, 4, 8) and row["sh_order"] in (1, 2, 4)],
    )  # fmt: skip
    maps = _markdown(
        ["texels", "bytes a map", "processor time, decodes", "glossy, %", "mirrors, %"],
        [[str(row["size"]), str(row["bytes"]), f"{row['decodes']:.2f}", *_errors(row)[2:]]
         for row in found["maps"]],
    )  # fmt: skip
    users = "\n".join(
        f"{name}: `lightprobe {' '.join(words)}`\n\n```\n{_answer(words)}```\n"
        for name, words in (
            (name, ["trade", *said.split(), "--decode-ms", f"{BOARD_MS:g}"])
            for name, said in USERS.items()
        )
    )
    return {
        "sights": sights,
        "measuring": measuring,
        "models": models,
        "maps": maps,
        "users": users,
    }


def draw() -> None:
    """Plot error against bytes, and against processor time: every choice, and those worth it."""
    mpl.use("Agg")
    figure, axes = plt.subplots(2, len(DRAWS), figsize=(15, 7), sharey="col")
    for (above, below), name in zip(axes.T, DRAWS, strict=True):
        every = [
            one for one in choices(Need((name,), BOARD_MS, SIGHTS[0]))
            if one.rate_hz == 30.0 and one.map_rate_hz == 5.0
        ]  # fmt: skip
        _draw(above, name, every, [one.bytes_per_s / 1e3 for one in every])
        _draw(below, name, every, [100 * one.cpu for one in every])
        above.set(title=name, xlabel="kB a second")
        below.set(xlabel=f"% of a core that decodes in {BOARD_MS:g} ms")
    for axis in axes[:, 0]:
        axis.set_ylabel("median error, %")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle(
        "What each choice costs and brings: 30 estimates and 5 maps a second; simulated"
    )
    figure.tight_layout()
    figure.savefig(PLOT, dpi=80)


def _draw(axis: Axes, name: str, every: list[Choice], costs: list[float]) -> None:
    error, cost = (
        np.array([100 * one.errors[name][0] for one in every]),
        np.array(costs),
    )
    standard = next(
        k for k, one in enumerate(every)
        if all(getattr(one, key) == value for key, value in _DEFAULT.items())
    )  # fmt: skip
    order = np.lexsort((error, cost))
    best = np.minimum.accumulate(error[order])
    axis.plot(cost, error, ".", color="0.75", ms=3, label="every choice")
    axis.step(cost[order], best, where="post", color="C0", label="the best for its cost")
    axis.plot(cost[standard], error[standard], "o", color="C3", label="default")
    axis.set(xscale="log", yscale="log")


def write() -> None:
    """Write tables and plot."""
    put(PAGE, parts())
    draw()
