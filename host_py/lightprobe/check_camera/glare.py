"""How much light does a lens spread over its picture? A lamp is hidden, and its veil goes too.

The method of the shade disk of pyranometers: somebody hides a lamp with a small card, and what
grows darker elsewhere is the veil of the light that was hidden. Of the light x a picture shows
(1 - even - around) x + even (mean of x) + around (x, spread by (1 + (angle / width)²)^-1.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.check_camera.exposure import OBEYS
from lightprobe.check_camera.response import RESPONSE, TONE, Power
from lightprobe.check_camera.scene import MOST_FLICKER, gather
from lightprobe.check_camera.shade import Shaded, shaded
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera, Glare

QUESTION = "glare"
#: Share of all light, spread, from which on a lens has a veil.
NOTICED = 0.005
#: The share must be known so well: of itself, or of what is noticed.
_LEAST_KNOWN, _LEAST_KNOWN_SHARE = 0.3, 0.5
_WIDTHS_DEG = (10.0, 5.0, 7.0, 14.0, 20.0, 30.0)  # the first is kept unless another fits better
_BETTER, _AS_GOOD = 0.99, 0.97  # of the residual's square
#: At first so much around the lamp is left out; the card is smaller.
_CARD_DEG, _LAMP_DEG = 16.0, 6.0
_ROUNDS, _OUTLIER, _HIDDEN = 5, 4.0, 0.3
#: Light that was hidden, of all; the change of all other light; cells that show something.
_LEAST_HIDDEN, _MOST_CHANGE, _LEAST_CELLS, _MOST_LEFT_OUT = 0.01, 0.015, 100, 0.35
#: Of what no veil explains, in sigmas.
_MOST_RESIDUAL = 2.5
#: What of a share is never known better, 1 sigma.
_MODEL_SIGMA = 0.08
_BALANCING, _BALANCED = 40, 1e-3
_BIN_DEG = 5.0
_STEADY = "daylight, or lamps on direct current; many LED lamps flicker when dimmed"
_AGAIN = "hide the lamp again while nothing else moves or changes"


@dataclass(frozen=True)
class Veil:
    """Veiling glare, as the camera file states it, and how well it is known."""

    glare: Glare
    sigma: float  # of even + around
    hidden: float  # share of all light that was hidden
    change: float  # of all other light, relative
    left_out: float  # share of cells that changed otherwise
    residual: float  # of the others, RMS, in sigmas
    by_angle: Array  # (k, 3) degrees from the lamp; light that went there; what the fit says. NaN:
    # no such cell was used. Of the mean light before.

    @property
    def share(self) -> float:
        """Share of all light that is spread."""
        return self.glare.even + self.glare.around


@dataclass(frozen=True, eq=False)
class _Fit:
    """One way to explain what changed."""

    even: float
    around: float
    change: float
    width_deg: float
    way: int
    veil: Array  # (n,)
    residual: Array  # (n,) in sigmas
    scale: float  # robust size of that
    sigma: float


def hindrance(answers: Sequence[Answer]) -> str:
    """Say what of a lit scene's answers forbids to compare light; empty: nothing does."""
    for one in answers:
        if one.question == OBEYS and one.outcome is not Outcome.FINE and not one.is_found:
            return "nobody knows whether exposures are obeyed"
        if one.question in (OBEYS, TONE, RESPONSE) and one.outcome is Outcome.UNFIT:
            return f"of {one.words}"
        if one.question in (TONE, RESPONSE) and one.outcome is Outcome.UNKNOWN:
            return f"nobody knows about {one.question}"
    return ""


def table_of(answers: Sequence[Answer], power: Power | None, stated: Array) -> Array:
    """Give the response (256, 3) that was measured, where it differs from the stated one."""
    differs = any(one.question == RESPONSE and one.is_found for one in answers)
    fitted = power.fitted if differs and power is not None else None
    return stated if fitted is None else fitted.table


def look(camera: Camera, before: ExposureSeries, after: ExposureSeries, table: Array) -> Veil | str:
    """Compare brackets (:data:`~lightprobe.check_camera.shade.SHADE_US`) before and after.

    `table` (256, 3): linear light of each code. Flicker in step with the pictures is the same in
    both. Gives the veil; or why it cannot be told.
    """
    for series in (before, after):
        scene = gather(series, table)
        if not scene.steps or scene.is_dark:
            return "the room is dark"
        if scene.flickers > MOST_FLICKER:
            return "the light flickers"
    return measure(shaded(camera, before, after, table))


def measure(pair: Shaded | None) -> Veil | str:
    """Fit the veil; or why that cannot be told."""
    if pair is None:
        return "pictures are missing"
    usable = np.isfinite(pair.before) & np.isfinite(pair.after)
    if usable.sum() < _LEAST_CELLS:
        return "the room is dark, or all of it clips"
    if not np.median(pair.before[usable] / pair.sigma[usable]) > 10:
        return "the room is dark"
    lost = np.where(usable, pair.before - pair.after, 0) * pair.cells.solid_angle_sr
    total = float((np.where(usable, pair.before, 0) * pair.cells.solid_angle_sr).sum())
    covered = usable & (pair.after < 0.7 * pair.before)
    lamp = int(np.argmax(np.where(covered, lost, -np.inf)))
    off_deg = _angles_deg(pair.cells.directions, pair.cells.directions[lamp : lamp + 1])[:, 0]
    # What clips as before, and elsewhere, is left out: another lamp, or a stuck pixel.
    near = off_deg < _LAMP_DEG
    if (pair.clipped != pair.still).any() or (pair.clipped & near).any():
        return "a lamp clips in the shortest exposure"
    hidden = float(lost[off_deg < _LAMP_DEG].sum()) / total
    if not covered.any() or hidden < _LEAST_HIDDEN:
        return "no lamp was hidden"
    return _fitted(pair, usable, off_deg, total)


def _fitted(pair: Shaded, usable: NDArray[np.bool_], off_deg: Array, total: float) -> Veil | str:
    spreads = _Spreads(pair)
    out = ~usable | (off_deg < _CARD_DEG)
    best: _Fit | None = None
    for _ in range(_ROUNDS):
        if (~out & usable).sum() < _LEAST_CELLS:
            return "too much of the picture is hidden"
        flux = _hidden_flux(pair, usable & out, best)
        tried = [
            _fit(pair, spreads, flux, ~out, width, way)
            for way in range(len(pair.cells.lenses))
            for width in _WIDTHS_DEG
        ]
        best = _chosen(tried)
        found = _others(pair, best, usable)
        found |= off_deg < _LAMP_DEG
        now = ~usable | _wider(found, pair)
        if np.array_equal(now, out):
            break
        out = now
    if best is None:
        return "too much of the picture is hidden"
    left_out = float((out & usable).sum() / usable.sum())
    glare = Glare(best.even, best.around, best.width_deg)
    hidden = float(_hidden_flux(pair, usable & out, best).sum()) / total
    # What explains it about as well may be true, too.
    others = [one for one in tried if one.scale < best.scale / np.sqrt(_AS_GOOD)]
    spread = float(np.std([_share(one) for one in (*others, best)]))
    sigma = float(np.sqrt(best.sigma**2 + spread**2 + (_MODEL_SIGMA * _share(best)) ** 2))
    by_angle = _by_angle(pair, best, ~out & usable, off_deg)
    return Veil(glare, sigma, hidden, best.change, left_out, best.scale, by_angle)


def _by_angle(pair: Shaded, fit: _Fit, used: NDArray[np.bool_], off_deg: Array) -> Array:
    weight = np.where(used, pair.cells.solid_angle_sr, 0)
    before = np.where(used, pair.before, 0)
    went = np.where(used, pair.before - pair.after, 0) - fit.change * before
    which = (off_deg / _BIN_DEG).astype(int)
    sums = [
        np.bincount(which, weight * of, round(180 / _BIN_DEG))
        for of in (used, off_deg, went, fit.veil)
    ]
    mean = max(float((weight * before).sum() / max(weight.sum(), 1e-12)), 1e-30)
    with np.errstate(invalid="ignore"):
        return np.stack(sums[1:], axis=1) / sums[0][:, None] / [1, mean, mean]


def _share(fit: _Fit) -> float:
    return fit.even + fit.around


def _chosen(tried: list[_Fit]) -> _Fit:
    """The best; of those that are nearly as good the first."""
    least = min(one.scale for one in tried)
    return next(one for one in tried if one.scale**2 * _BETTER <= least**2)


def _hidden_flux(pair: Shaded, where: NDArray[np.bool_], known: _Fit | None) -> Array:
    """Light (n,) that was hidden, radiance times solid angle, before any of it was spread."""
    lost = np.where(where, pair.before - pair.after, 0)
    if known is not None:
        expected = known.veil + known.change * np.where(where, pair.before, 0)
        lost = np.where(where, lost - expected, 0) / max(1 - _share(known), 0.1)
    return np.asarray(lost * pair.cells.solid_angle_sr)


def _others(pair: Shaded, fit: _Fit, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that changed by something other than the veil: the card, a hand, somebody."""
    limit = np.maximum(_OUTLIER * max(fit.scale, 1.0), _HIDDEN * fit.veil / pair.sigma)
    return usable & (np.abs(fit.residual) > limit)


def _wider(found: NDArray[np.bool_], pair: Shaded) -> NDArray[np.bool_]:
    """And the cells beside them."""
    grid = found.reshape(pair.cells.rows, pair.cells.columns).astype(np.uint8)
    kind = cv2.BORDER_WRAP if pair.cells.wraps else cv2.BORDER_CONSTANT
    padded = cv2.copyMakeBorder(grid, 0, 0, 1, 1, kind)
    wide = cv2.dilate(padded, np.ones((3, 3), np.uint8))[:, 1:-1]
    return np.asarray(wide.reshape(-1) > 0)


def _fit(
    pair: Shaded,
    spreads: _Spreads,
    flux: Array,
    keep: NDArray[np.bool_],
    width_deg: float,
    way: int,
) -> _Fit:
    even, around = spreads.of(flux, width_deg, way)
    lost, before = pair.before - pair.after, pair.before
    weight = 1 / pair.sigma[keep]
    columns = np.stack([even[keep], around[keep], before[keep], -before[keep]], axis=1)
    columns *= weight[:, None]
    wanted = lost[keep] * weight
    robust = np.ones(len(wanted))
    left, answer, scale = wanted, np.zeros(4), 1.0
    for _ in range(3):
        answer, _ = nnls(columns * robust[:, None], wanted * robust)
        left = wanted - columns @ answer
        scale = 1.48 * float(np.median(np.abs(left)))
        robust = np.sqrt(np.minimum(1, 2 * max(scale, 1e-9) / np.maximum(np.abs(left), 1e-30)))
    # The share is what the two make together; neighbours are not independent.
    both = np.stack([columns[:, 0], columns[:, 1], columns[:, 2]], axis=1) * robust[:, None]
    used = np.array([True, answer[1] > 0, True])
    covariance = np.linalg.pinv(both[:, used].T @ both[:, used]) * max(scale, 0.3) ** 2
    one = np.array([1.0, 1.0, 0.0])[used]
    sigma = 2 * float(np.sqrt(max(one @ covariance @ one, 0)))
    change = float(answer[2] - answer[3])
    veil = answer[0] * even + answer[1] * around
    residual = (lost - veil - change * before) / pair.sigma
    residual = np.where(np.isfinite(residual), residual, 0)
    rms = float(np.sqrt(np.mean(np.minimum(np.abs(left), 3 * max(scale, 1e-9)) ** 2)))
    return _Fit(
        float(answer[0]), float(answer[1]), change, width_deg, way, veil, residual, rms, sigma
    )


class _Spreads:
    """Spreads light over the cells, as the two parts of a veil do."""

    def __init__(self, pair: Shaded) -> None:
        cells = pair.cells
        self._cells = cells
        self._angle_deg = _angles_deg(cells.directions, cells.directions).astype(np.float32)
        self._weight = np.where(cells.seen, cells.solid_angle_sr, 0)
        self._kernels: dict[float, NDArray[np.float32]] = {}
        self._scales: dict[tuple[float, int], list[Array]] = {}

    def of(self, flux: Array, width_deg: float, way: int) -> tuple[Array, Array]:
        """Radiance (n,) of flux (n,), all of it spread evenly, and all of it around."""
        shares = self._cells.lenses[way]
        if width_deg not in self._kernels:
            square = (self._angle_deg / np.float32(width_deg)) ** 2
            self._kernels[width_deg] = (1 + square) ** np.float32(-1.5)
        kernel = self._kernels[width_deg]
        if (width_deg, way) not in self._scales:
            self._scales[width_deg, way] = [
                _balance(kernel, np.asarray(self._weight * share)) for share in shares.T
            ]
        even, around = np.zeros(len(flux)), np.zeros(len(flux))
        sources = np.flatnonzero(flux)
        for share, scale in zip(shares.T, self._scales[width_deg, way], strict=True):
            mine = flux[sources] * share[sources]
            even += share * mine.sum() / max((self._weight * share).sum(), 1e-12)
            spread = kernel[:, sources] @ (scale[sources] * mine)
            around += share * scale * spread
        return even, around


def _balance(kernel: NDArray[np.float32], weight: Array) -> Array:
    """Factors (n,) of what enters and of what comes out: even light stays even, none is lost."""
    scale: NDArray[np.float32] = np.ones(len(weight), np.float32)
    of = weight.astype(np.float32)
    for _ in range(_BALANCING):
        taken = scale * (kernel @ (of * scale))
        scale = np.asarray(scale / np.sqrt(np.maximum(taken, 1e-30)), dtype=np.float32)
        if np.ptp(taken[of > 0]) < _BALANCED:
            break
    return scale.astype(np.float64)


def _angles_deg(first: Array, second: Array) -> Array:
    """Angles (n, m) between directions (n, 3) and (m, 3)."""
    return np.asarray(np.degrees(np.arccos(np.clip(first @ second.T, -1, 1))))


def judge(found: Veil | str) -> Answer:
    """Say whether the lens lays a veil over its picture."""
    if isinstance(found, str):
        return Answer(QUESTION, Outcome.UNKNOWN, f"because {found}", _NEXT.get(found, _AGAIN))
    glare = found.glare
    numbers = {
        "even": glare.even, "around": glare.around, "width_deg": glare.width_deg,
        "sigma": found.sigma, "hidden": found.hidden, "change": found.change,
    }  # fmt: skip
    unknown = Answer(QUESTION, Outcome.UNKNOWN, "", _AGAIN, numbers)
    if found.left_out > _MOST_LEFT_OUT:
        return replace(unknown, words="because too much changed besides the lamp")
    if found.residual > _MOST_RESIDUAL:
        return replace(unknown, words="because places changed as no veil changes them")
    if abs(found.change) > _MOST_CHANGE:
        words = f"because the light changed meanwhile, by {100 * found.change:.1f} %"
        return replace(unknown, words=words)
    if found.sigma > max(_LEAST_KNOWN * found.share, _LEAST_KNOWN_SHARE * NOTICED):
        return replace(
            unknown, words=f"because what was hidden is too little to tell (the veil is "
            f"{100 * found.share:.1f} ± {100 * found.sigma:.1f} %)",
            next_step="hide the brightest lamp, with dark places in view beside it",
        )  # fmt: skip
    if found.share < NOTICED:
        words = f"no veil ({100 * found.share:.1f} ± {100 * found.sigma:.1f} %)"
        return Answer(QUESTION, Outcome.FINE, words, numbers=numbers)
    return Answer(
        QUESTION, Outcome.DEFECT, f"veiling glare of {100 * found.share:.1f} %",
        "clean the lens; --output FILE.camera writes [glare], and the daemon takes it off", numbers,
    )  # fmt: skip


_NEXT = {
    "no lamp was hidden": "hide the brightest lamp with a thumb or card, at arm's length",
    "a lamp clips in the shortest exposure": "hide a weaker lamp, and keep the sun out of view",
    "the light flickers": _STEADY,
    "pictures are missing": "try again; the machine may be busy",
    "the room is dark": "switch lamps on, or choose a brighter room",
    "the room is dark, or all of it clips": "switch lamps on, or choose another room",
    "too much of the picture is hidden": "hide the lamp with less: a thumb, or a small card",
}
