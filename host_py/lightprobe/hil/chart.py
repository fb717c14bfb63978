"""Plots as SVG, drawn without any library: a report must open everywhere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape

_WIDTH, _HEIGHT = 960.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 110.0, 12.0, 44.0
_BINS = 40
_COLOURS = (
    "#1f6fb2", "#c8591a", "#2e8b57", "#a8323e", "#6a4fa3", "#7a5c3e", "#b8479a", "#59646f",
    "#8a8a13",
)  # fmt: skip
_LABEL_PX = 14.0

Point = tuple[float, float | None]


def nice_ticks(low: float, high: float, most: int = 7) -> list[float]:
    """Give round numbers from `low` to `high`."""
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(one * power for one in (1, 2, 5, 10) if one * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]


class _Frame:
    """Axes from data to the picture."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.x_low, self.x_high = x if x[1] > x[0] else (x[0], x[0] + 1)
        self.y_low, self.y_high = y if y[1] > y[0] else (y[0] - 1, y[0] + 1)

    def x(self, value: float) -> float:
        share = (value - self.x_low) / (self.x_high - self.x_low)
        return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        share = (value - self.y_low) / (self.y_high - self.y_low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    def axes(self, x_words: str, y_words: str) -> Iterator[str]:
        """Draw grid, numbers and titles."""
        right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
        for tick in nice_ticks(self.y_low, self.y_high, 5):
            y = self.y(tick)
            yield f'<path d="M{_LEFT} {y:.1f}H{right}" stroke="#e3e8ee"/>'
            yield f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>'
        for tick in nice_ticks(self.x_low, self.x_high):
            x = self.x(tick)
            yield f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{tick:g}</text>'
        yield f'<path d="M{_LEFT} {bottom}H{right}" stroke="#8793a0"/>'
        middle = (_LEFT + right) / 2
        yield f'<text x="{middle}" y="{_HEIGHT - 6}" text-anchor="middle">{escape(x_words)}</text>'
        y = (_TOP + bottom) / 2
        yield (
            f'<text transform="translate(14 {y}) rotate(-90)" text-anchor="middle">'
            f"{escape(y_words)}</text>"
        )


def _svg(parts: Iterator[str] | Sequence[str], words: str) -> str:
    return (
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{escape(words)}" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="#3d4854">{"".join(parts)}</svg>'
    )


def histogram(values: Sequence[float], x_words: str, y_words: str) -> str:
    """Draw how often which value came."""
    high = max(nice_ticks(0, max(*values, 1e-3) * 1.25, 4)[-1], max(values))
    counts = [0] * _BINS
    for value in values:
        counts[min(int(value / high * _BINS), _BINS - 1)] += 1
    frame = _Frame((0, high), (0, max(counts) * 1.05))
    parts = list(frame.axes(x_words, y_words))
    for k, count in enumerate(counts):
        if count:
            left, right = frame.x(k * high / _BINS), frame.x((k + 1) * high / _BINS)
            top, bottom = frame.y(count), frame.y(0)
            parts.append(
                f'<rect x="{left + 0.5:.1f}" y="{top:.1f}" width="{right - left - 1:.1f}" '
                f'height="{bottom - top:.1f}" fill="{_COLOURS[0]}"><title>{count}</title></rect>'
            )
    return _svg(parts, f"histogram of {x_words}")


def lines(series: Mapping[str, Sequence[Point]], x_words: str, y_words: str) -> str:
    """Draw lines with their names at their right ends; a value None leaves a gap."""
    xs = [x for points in series.values() for x, _ in points]
    ys = [y for points in series.values() for _, y in points if y is not None]
    if not ys:
        return ""
    margin = 0.05 * (max(ys) - min(ys)) or 1.0
    frame = _Frame((min(xs), max(xs)), (min(ys) - margin, max(ys) + margin))
    parts = list(frame.axes(x_words, y_words))
    ends = []
    for k, (name, points) in enumerate(series.items()):
        colour = _COLOURS[k % len(_COLOURS)]
        dash = ' stroke-dasharray="5 4"' if name == "commanded" else ""
        path = _path(frame, points)
        parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5"{dash}/>')
        last = next((y for _, y in reversed(points) if y is not None), None)
        if last is not None:
            ends.append((frame.y(last), name, colour))
    parts += _labels(ends)
    return _svg(parts, f"{y_words} against {x_words}")


def _path(frame: _Frame, points: Sequence[Point]) -> str:
    parts, down = [], False
    for x, y in points:
        if y is None:
            down = False
            continue
        parts.append(f"{'L' if down else 'M'}{frame.x(x):.1f} {frame.y(y):.1f}")
        down = True
    return "".join(parts)


def _labels(ends: list[tuple[float, str, str]]) -> Iterator[str]:
    """Place names one below the other, each as near to its line as there is room."""
    lowest = _HEIGHT - _BOTTOM
    placed: list[float] = []
    for y, _, _ in sorted(ends):
        placed.append(max(y, placed[-1] + _LABEL_PX) if placed else y)
    over = max(placed[-1] - lowest, 0) if placed else 0
    for at, (_, name, colour) in zip(placed, sorted(ends), strict=True):
        yield (
            f'<text x="{_WIDTH - _RIGHT + 8}" y="{at - over + 4:.1f}" fill="{colour}">'
            f"{escape(name)}</text>"
        )
