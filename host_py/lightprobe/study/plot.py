"""The picture of `lightprobe study analyse`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from lightprobe.study.analysis import ALL, Findings
from lightprobe.study.report import SIMULATED, plain
from lightprobe.study.statistics import Interval
from lightprobe.study.trials import HIGHEST

_COLOURS = ("#1f6fb2", "#c8591a", "#2e8b57", "#a8323e", "#6a4fa3", "#7a5c3e", "#b8479a", "#59646f")
_MARKS = "oD^vP*X<"
_REAL = "#222222"
_LONGEST = 34


def draw(found: Findings, path: Path) -> None:
    """Draw means of ratings and shares of choices with their intervals, by object."""
    choices = [one for one in found.comparisons if one.kind == "choice"]
    count = bool(found.ratings) + bool(choices)
    methods = max(len({one.method for one in found.ratings}), len(choices))
    figure, axes = plt.subplots(
        1, count, figsize=(6.4 * count, 3.4 + 0.22 * methods), constrained_layout=True,
        squeeze=False,
    )  # fmt: skip
    places = list(axes[0])
    if found.ratings:
        _ratings(places.pop(0), found)
    if choices:
        _choices(places.pop(0), found)
    kind = "simulated participants" if found.simulated else "participants"
    figure.suptitle(f"{_short(found.title, 80)} — {found.people} {kind}", fontsize=10)
    for axis in axes[0] if found.simulated else ():
        axis.text(
            0.5, 0.5, SIMULATED.replace(": ", "\n").replace(", ", ",\n"), ha="center", va="center",
            rotation=20, fontsize=20, color="#c00000", alpha=0.3, zorder=10,
            transform=axis.transAxes,
        )  # fmt: skip
    figure.savefig(path, dpi=200)
    plt.close(figure)


def _short(text: str, longest: int = _LONGEST) -> str:
    """Give a name as it is: dollars are no formula."""
    text = plain(text).replace("\\|", "|").replace("$", r"\$")
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def _ratings(axis: Axes, found: Findings) -> None:
    objects = list(dict.fromkeys(one.object for one in found.ratings))
    methods = list(dict.fromkeys(one.method for one in found.ratings))
    ordered = [one for one in methods if one != found.reference]
    series: list[tuple[str, Sequence[Interval], int | None]] = [
        (
            f"{_short(method)} (real)" if method == found.reference else _short(method),
            [one.rating for one in found.ratings if one.method == method],
            None if method == found.reference else ordered.index(method),
        )
        for method in (found.reference, *ordered)
    ]
    _points(axis, objects, series)
    axis.axhline(HIGHEST / 2, color="#999999", linewidth=0.8, linestyle=":")
    axis.set_ylim(0, HIGHEST)
    axis.set_ylabel(f"mean rating, 0 to {HIGHEST}")


def _choices(axis: Axes, found: Findings) -> None:
    rows = [one for one in found.comparisons if one.kind == "choice"]
    objects = [ALL, *rows[0].objects]
    series: list[tuple[str, Sequence[Interval], int | None]] = []
    for one in rows:
        values = [one.value, *one.objects.values()]
        percent = [Interval(*(_times_100(v) for v in (x.value, x.low, x.high))) for x in values]
        series.append((f"{_short(one.first)} to {_short(one.second, 20)}", percent, len(series)))
    _points(axis, objects, series)
    axis.axhline(50, color="#999999", linewidth=0.8, linestyle=":")
    axis.set_ylim(0, 100)
    axis.set_ylabel("preferred, %")


def _times_100(value: float | None) -> float:
    return float("nan") if value is None else 100 * value


def _points(
    axis: Axes, objects: list[str], series: Sequence[tuple[str, Sequence[Interval], int | None]]
) -> None:
    """Draw each series beside the others at each object, with bars of the intervals.

    A series' number chooses colour and mark; None: the real objects.
    """
    step = 0.8 / max(len(series), 1)
    for k, (name, values, number) in enumerate(series):
        x = [place + (k - (len(series) - 1) / 2) * step for place in range(len(objects))]
        y = [one.value for one in values]
        below = [0.0 if one.low is None else max(one.value - one.low, 0) for one in values]
        above = [0.0 if one.high is None else max(one.high - one.value, 0) for one in values]
        axis.errorbar(
            x, y, (below, above), label=name, markersize=4.5, capsize=2, linewidth=1.2,
            fmt="s" if number is None else _MARKS[number % len(_MARKS)],
            color=_REAL if number is None else _COLOURS[number % len(_COLOURS)],
            markerfacecolor="white" if number is None else None,
        )  # fmt: skip
    axis.set_xticks(range(len(objects)), [_short(one, 16) for one in objects])
    for place in range(1, len(objects)):
        axis.axvline(place - 0.5, color="#eeeeee", linewidth=0.8, zorder=0)
    axis.set_xlim(-0.5, len(objects) - 0.5)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2 if len(series) > 3 else 1,
        fontsize=8, frameon=False,
    )  # fmt: skip
