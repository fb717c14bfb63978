"""A camera's response from pictures of one scene at several exposures.

A place of the scene with radiance E, exposed for t, gives the code z with f(z) = E·t; f is the same
for all places, E for all exposures. Least squares over all of them find f at the 256 codes, and E,
up to one factor (Debevec and Malik 1997). Here with means of small flat blocks instead of pixels,
so that f is wanted between codes, where it is taken as linear:

    Σ w (ln f(z) − ln E − ln t)² + λ Σ ((f(k−1) − 2 f(k) + f(k+1)) / slope(k))²,   f(top) = 1

with w = (f(z) / slope(z))², so that what is made small is the error in codes, whatever the curve.
Gauss and Newton's steps in ln f, each E eliminated in closed form, weights of outliers after
Huber (1964).

What no bracket can tell is the ratio of the channels: each channel's top code is taken for the
same light, as a camera with its white balance held shows white.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array

CHANNELS = ("red", "green", "blue")
#: What the smoothness counts, in observations of one code's accuracy.
_SMOOTHNESS = 1000.0
_MOST_ROUNDS = 15
_SETTLED = 1e-4
_MOST_STEP = 1.0  # of one round, in ln f
_LEAST_LIGHT = 1e-7
_HUBER_CODES = 1.0
#: Slopes are taken over this many codes to each side.
_SLOPE_CODES = 4
#: Codes that must be seen at least: from here, up to here below the top, with no wider gap.
_LOWEST, _BELOW_TOP, _WIDEST_GAP = 16, 16, 24
_LEAST_STEPS = 3
_LEAST_PLACES = 60
#: Of a place in the median of an exposure: so a few that lie are not heard.
_MOST_VOTES = 25.0
#: Twice the light, and more, changes a code by this at least.
_LEAST_CHANGE_CODES = 4.0
_DOES_NOT_FOLLOW = (
    "response: the brightness does not follow the exposures: check with `lightprobe calibrate "
    "exposure` that the camera obeys, and keep light and camera still"
)
#: An exposure whose light is off by more than this from the others' is left out.
MOST_STEP_ERROR = 0.15


class ResponseError(LightprobeError):
    """These pictures do not show the response; says why and what to change."""


@dataclass(frozen=True, eq=False)
class PatchCodes:
    """Mean codes of places of the scene, at each exposure.

    codes: (places, steps, 3), NaN where a place cannot be used (clipped, not flat).
    exposures_us: (steps,), times gain. top: code of full scale, 255 in most cameras.
    """

    codes: Array
    exposures_us: Array
    top: int = 255


@dataclass(frozen=True, eq=False)
class Response:
    """The curve, and how well it explains what was seen."""

    table: Array  # (256, 3) linear light of each code; 1 at the top
    residual_codes: Array  # (3,) RMS of what remains, in codes
    residual_full_scale: Array  # (3,) the same in linear light, of full scale
    step_errors: Array  # (steps,) light seen at this exposure over what it should be, − 1; NaN
    used: NDArray[np.bool_]  # (steps,) exposures that the fit rests on
    observations: int
    top: int
    lowest_code: int  # of what was seen; below, the curve is extrapolated
    highest_code: int


def curve_at(table: Array, codes: Array) -> Array:
    """Linear light of fractional codes by one channel's table (256,)."""
    return np.asarray(np.interp(codes, np.arange(256), table))


def monotone(values: Array) -> Array:
    """Nearest sequence (least squares) that never falls: pool adjacent violators (Barlow 1972)."""
    means: list[float] = []
    counts: list[int] = []
    for value in values:
        means.append(float(value))
        counts.append(1)
        while len(means) > 1 and means[-2] > means[-1]:
            count = counts[-2] + counts[-1]
            means[-2] = (means[-2] * counts[-2] + means[-1] * counts[-1]) / count
            counts[-2] = count
            means.pop()
            counts.pop()
    return np.repeat(means, counts)


def fit(patches: PatchCodes) -> Response:
    """Fit the response of every channel; raises :class:`ResponseError`.

    Exposures that contradict the others (a camera that did not follow, a lamp that flickered) are
    left out one by one, the worst first.
    """
    _check_follows(patches)
    used = np.ones(len(patches.exposures_us), bool)
    while True:
        response = _fit_used(patches, used)
        wrong = np.where(used, np.abs(response.step_errors), 0.0)
        worst = int(np.argmax(np.nan_to_num(wrong)))
        if not wrong[worst] > MOST_STEP_ERROR:
            return response
        used = used.copy()
        used[worst] = False
        if np.count_nonzero(used) < max(_LEAST_STEPS, (len(used) + 1) // 2):
            raise ResponseError(_DOES_NOT_FOLLOW)


def _check_follows(patches: PatchCodes) -> None:
    """Raise :class:`ResponseError` when places look the same whatever the exposure."""
    exposures = patches.exposures_us[None, :, None]
    seen = np.isfinite(patches.codes)
    shortest = np.where(seen, exposures, np.inf).argmin(axis=1, keepdims=True)
    longest = np.where(seen, exposures, -np.inf).argmax(axis=1, keepdims=True)
    ratio = np.take_along_axis(exposures, longest, 1) / np.take_along_axis(exposures, shortest, 1)
    change = np.take_along_axis(patches.codes, longest, 1) - np.take_along_axis(
        patches.codes, shortest, 1
    )
    telling = (ratio >= 2) & (np.take_along_axis(patches.codes, longest, 1) > 2 * _LOWEST)
    if telling.any() and np.median(change[telling]) < _LEAST_CHANGE_CODES:
        raise ResponseError(_DOES_NOT_FOLLOW)


def step_errors(patches: PatchCodes, table: Array) -> Array:
    """Light seen at each exposure over what the others and the table say, minus 1; NaN: unseen."""
    ratios = []
    for channel in range(3):
        light = curve_at(table[:, channel], patches.codes[..., channel])
        slope = _slope_at(table[:, channel], patches.codes[..., channel])
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(light > 0, light / patches.exposures_us, np.nan)
            weight = np.nan_to_num((light / slope) ** 2) * np.isfinite(relative)
        relative = np.log(np.where(weight > 0, relative, 1.0))
        ratios.append(_offsets(relative, weight))
    known = np.array(ratios)
    seen = np.isfinite(known).any(axis=0)
    errors = np.full(known.shape[1], np.nan)
    errors[seen] = np.expm1(np.nanmedian(known[:, seen], axis=0))
    return errors


def _offsets(values: Array, weight: Array) -> Array:
    """Offset (steps,) of each column from what its rows have in common; their median is 0.

    Alternates row means and column medians: additive two-way fit (Tukey 1977, median polish).
    """
    offsets = np.zeros(values.shape[1])
    enough = (weight > 0) & ((weight > 0).sum(axis=1, keepdims=True) > 1)
    for _ in range(8):
        total = np.where(enough, weight, 0).sum(axis=1, keepdims=True)
        row = (np.where(enough, weight, 0) * (values - offsets)).sum(axis=1, keepdims=True)
        left = values - row / np.where(total > 0, total, 1)
        for step in range(values.shape[1]):
            mine = enough[:, step]
            offsets[step] = (
                _weighted_median(left[mine, step], np.minimum(weight[mine, step], _MOST_VOTES))
                if mine.sum() >= _LEAST_PLACES
                else np.nan
            )
        offsets -= np.nanmedian(offsets) if np.isfinite(offsets).any() else 0.0
        # A step that nothing is known of says nothing on its rows.
        enough &= np.isfinite(offsets)
        offsets = np.nan_to_num(offsets)
        if not enough.any():
            break
    return np.where(enough.sum(axis=0) >= _LEAST_PLACES, offsets, np.nan)


def _weighted_median(values: Array, weight: Array) -> float:
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


# ---------------------------------------------------------------- one channel


def _fit_used(patches: PatchCodes, used: NDArray[np.bool_]) -> Response:
    some = replace(patches, codes=patches.codes[:, used], exposures_us=patches.exposures_us[used])
    fits = [_fit_channel(some, channel) for channel in range(3)]
    table = np.stack([part.table for part in fits], axis=1)
    return Response(
        table=table,
        residual_codes=np.array([part.residual_codes for part in fits]),
        residual_full_scale=np.array([part.residual_full_scale for part in fits]),
        step_errors=step_errors(patches, table),
        used=used,
        observations=sum(part.observations for part in fits),
        top=patches.top,
        lowest_code=max(part.lowest for part in fits),
        highest_code=min(part.highest for part in fits),
    )


@dataclass(frozen=True, eq=False)
class _Channel:
    table: Array
    residual_codes: float
    residual_full_scale: float
    observations: int
    lowest: int
    highest: int


@dataclass(frozen=True, eq=False)
class _Observations:
    """One channel's usable codes in a list."""

    place: NDArray[np.intp]
    code: Array
    exposure: Array
    places: int


def _fit_channel(patches: PatchCodes, channel: int) -> _Channel:
    seen = _observations(patches, channel)
    _check_coverage(seen, patches.top, CHANNELS[channel])
    table = _start(patches.top)
    for _ in range(_MOST_ROUNDS):
        size = np.abs(_residuals(seen, table)[0])
        limit = max(_HUBER_CODES, 1.5 * float(np.median(size)))
        better = _solve(seen, table, np.minimum(1.0, limit / np.maximum(size, 1e-9)), patches.top)
        change, table = float(np.abs(better - table).max()), better
        if change < _SETTLED:
            break
    error_codes, error_linear = _residuals(seen, table)
    freedom = max(1, len(seen.code) - seen.places)
    return _Channel(
        table=_finished(table, patches.top),
        residual_codes=float(np.sqrt(np.sum(error_codes**2) / freedom)),
        residual_full_scale=float(np.sqrt(np.sum(error_linear**2) / freedom)),
        observations=len(seen.code),
        lowest=int(np.floor(seen.code.min())),
        highest=int(np.ceil(seen.code.max())),
    )


def _finished(table: Array, top: int) -> Array:
    """Never falling, 0 where it reaches the floor, 1 from the top on."""
    curve = np.ones(256)
    curve[:top] = np.clip(monotone(table[:top]), 0.0, 1.0)
    curve[curve <= _LEAST_LIGHT] = 0.0
    return curve


def _start(top: int) -> Array:
    return np.asarray(np.clip(np.arange(256) / top, 1e-3, 1.0) ** 2.2)


def _observations(patches: PatchCodes, channel: int) -> _Observations:
    """Places that are usable at two exposures or more."""
    codes = patches.codes[..., channel]
    usable = np.isfinite(codes)
    usable &= usable.sum(axis=1, keepdims=True) >= 2
    place, step = np.nonzero(usable)
    _, number = np.unique(place, return_inverse=True)
    exposure = patches.exposures_us / patches.exposures_us.max()
    return _Observations(
        place=number,
        code=codes[place, step],
        exposure=exposure[step],
        places=int(number.max(initial=-1)) + 1,
    )


def _check_coverage(seen: _Observations, top: int, name: str) -> None:
    """Raise :class:`ResponseError` unless every part of the scale has been seen."""
    if seen.places < _LEAST_PLACES:
        raise ResponseError(
            f"response: {name}: only {seen.places} places are flat and unclipped in two "
            f"exposures: point the camera at large even surfaces, bright and dark"
        )
    codes = np.unique(np.rint(seen.code))
    gaps = np.diff(codes)
    widest = int(np.argmax(gaps)) if len(gaps) else 0
    if codes[-1] < top - _BELOW_TOP:
        raise ResponseError(
            f"response: {name}: too dark: nothing brighter than code {codes[-1]:.0f} of {top} can "
            f"be used: add light, or use longer exposures"
        )
    if codes[0] > _LOWEST:
        raise ResponseError(
            f"response: {name}: too bright: nothing darker than code {codes[0]:.0f} can be used: "
            f"use shorter exposures, or put something dark in view"
        )
    if len(gaps) and gaps[widest] > _WIDEST_GAP:
        raise ResponseError(
            f"response: {name}: no place shows codes {codes[widest]:.0f} to "
            f"{codes[widest + 1]:.0f}: use a scene with more shades, or exposures closer together"
        )


def _solve(seen: _Observations, table: Array, robust: Array, top: int) -> Array:
    """One Gauss-Newton step from a table to a better one."""
    low = np.minimum(np.floor(seen.code).astype(np.intp), top - 1)
    part = seen.code - low
    light = curve_at(table, seen.code)
    weight = robust * (light / _slope_at(table, seen.code)) ** 2
    # d ln f(z) / d ln f(k) of the two codes around z
    below, above = (1 - part) * table[low] / light, part * table[low + 1] / light
    error = np.log(light / seen.exposure)
    normal, right = np.zeros((256, 256)), np.zeros(256)
    for i, a in ((low, below), (low + 1, above)):
        np.add.at(right, i, -weight * a * error)
        for k, b in ((low, below), (low + 1, above)):
            np.add.at(normal, (i, k), weight * a * b)
    # Radiances eliminated: ln E is the weighted mean of its place's ln f − ln t.
    total = np.bincount(seen.place, weight, seen.places)
    mean = np.bincount(seen.place, weight * error, seen.places) / total
    share = np.zeros((seen.places, 256))
    np.add.at(share, (seen.place, low), weight * below)
    np.add.at(share, (seen.place, low + 1), weight * above)
    normal -= share.T @ (share / total[:, None])
    right += share.T @ mean
    bend = _bend(table, top)
    normal += _SMOOTHNESS * bend.T @ bend
    right -= _SMOOTHNESS * bend.T @ bend.sum(axis=1)
    step = np.zeros(256)
    step[:top] = np.linalg.solve(normal[:top, :top] + 1e-9 * np.eye(top), right[:top])
    better = np.ones(256)
    better[:top] = table[:top] * np.exp(np.clip(step[:top], -_MOST_STEP, _MOST_STEP))
    return np.asarray(np.clip(better, _LEAST_LIGHT, 1.0))


def _bend(table: Array, top: int) -> Array:
    """Second differences (top − 1, 256) over the slope, by the logarithm of each value."""
    bend = np.zeros((top - 1, 256))
    middle = np.arange(1, top)
    for offset, factor in ((-1, 1.0), (0, -2.0), (1, 1.0)):
        bend[middle - 1, middle + offset] = factor * table[middle + offset]
    return np.asarray(bend / _slope(table)[middle, None])


def _slope(table: Array) -> Array:
    """Slope (256,) of a table per code, never 0."""
    at = np.arange(256)
    low, high = np.maximum(at - _SLOPE_CODES, 0), np.minimum(at + _SLOPE_CODES, 255)
    return np.asarray(np.maximum((table[high] - table[low]) / (high - low), 1e-6))


def _slope_at(table: Array, codes: Array) -> Array:
    return curve_at(_slope(table), codes)


def _residuals(seen: _Observations, table: Array) -> tuple[Array, Array]:
    """What remains of each observation, in codes and in linear light."""
    slope, light = _slope_at(table, seen.code), curve_at(table, seen.code)
    weight = (light / slope) ** 2
    relative = np.log(light / seen.exposure)
    total = np.bincount(seen.place, weight, seen.places)
    radiance = np.bincount(seen.place, weight * relative, seen.places) / total
    error = light - np.exp(radiance[seen.place]) * seen.exposure
    return error / slope, error


def residuals(patches: PatchCodes, response: Response, channel: int) -> tuple[Array, Array]:
    """Codes of one channel's observations, and what the fit leaves of each, in codes."""
    some = replace(
        patches,
        codes=patches.codes[:, response.used],
        exposures_us=patches.exposures_us[response.used],
    )
    seen = _observations(some, channel)
    table = np.maximum(response.table[:, channel], _LEAST_LIGHT)
    return seen.code, _residuals(seen, table)[0]
