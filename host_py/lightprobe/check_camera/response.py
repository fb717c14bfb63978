"""Is a picture linear in exposure, everywhere, by the response of the camera file?

Places that have one code at an exposure must have one code at any other, whatever the response.
Where they do not, and all places of a region differ alike, in comparisons that share no picture,
regions are treated differently: local tone mapping. What all places do together is the response.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate import flat_patches
from lightprobe.calibrate import response_curve as curves
from lightprobe.calibrate.response_curve import Response, ResponseError
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.check_camera.scene import GREEN, LOWEST_CODE, SceneSeries
from lightprobe.geometry import Array

TONE, RESPONSE = "tone mapping", "response"
#: Codes by which regions differ for each factor e of exposure, from which on they do.
#: Between the two it may be so.
NOTICED_CODES, FAINT_CODES = 0.25, 0.2
#: Powers and shares of full scale by which a response differs from the one of the camera file.
NOTICED_POWER, NOTICED_SHARE = 0.01, 0.012
#: Exposures of these ratios are compared; regions are so large, and comparisons so near.
_LEAST_RATIO, _MOST_RATIO, _REGION_DEG, _NEAR = 1.9, 5.0, 7.0, 1.2
_BIN_CODES, _LEAST_IN_BIN, _LEAST_PLACES, _OUTLIER = 6, 30, 200, 6 * 1.48
_LEAST_COMPARED = 20000
#: Regions must differ by so many stops among themselves for a treatment of regions to show.
_LEAST_VARIETY_STOPS = 0.35
_MOST_RESIDUAL_CODES = 1.5
#: Of an exposure's light, from what was commanded.
NOTICED_STEP = 0.06


@dataclass(frozen=True, eq=False)
class Regions:
    """How differently regions are treated."""

    codes: float  # per factor e of exposure
    compared: int
    variety_stops: float
    map_codes: Array  # (rows, columns) mean difference, per factor e


@dataclass(frozen=True, eq=False)
class Power:
    """The response against that of the camera file."""

    power: float  # light is that of the file to this power
    fitted: Response | None
    difference: float  # RMS of the two tables, of full scale; NaN: no fit
    steps: Array  # (steps,) light of each exposure against the others', relative; NaN: unseen


def regions(scene: SceneSeries) -> Regions:
    """Compare regions over all pairs of exposures."""
    codes, exposures = scene.codes[..., GREEN], scene.exposures_us
    rows, columns = codes.shape[1:]
    sigma = columns * _REGION_DEG / 360
    maps: list[tuple[int, int, Array, NDArray[np.bool_]]] = []
    order: list[int] = np.argsort(exposures, kind="stable").tolist()
    for i in order:
        for j in range(len(exposures)):
            ratio = exposures[j] / exposures[i]
            if not _LEAST_RATIO < ratio < _MOST_RATIO:
                continue
            found = _residual(codes[i], codes[j])
            if found is not None:
                residual, weight = found
                near = _wide(weight, sigma)
                smooth = _wide(residual * weight, sigma) / np.maximum(near, 1e-6)
                maps.append((i, j, smooth / np.log(ratio), (weight > 0) & (near > 0.3)))
    common, compared = 0.0, 0
    for a, (i, j, first, seen) in enumerate(maps):
        for k, m, second, seen_too in maps[a + 1 :]:
            if len({i, j, k, m}) == 4 and abs(np.log(exposures[i] / exposures[k])) < _NEAR:
                both = seen & seen_too
                common += float((first[both] * second[both]).sum())
                compared += int(both.sum())
    size = float(np.sign(common) * np.sqrt(abs(common) / max(compared, 1)))
    total, count = np.zeros((rows, columns)), np.zeros((rows, columns))
    for _, _, one, seen in maps:
        total += np.where(seen, one, 0)
        count += seen
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return Regions(size, compared, _variety_stops(scene, sigma), mean)


def _residual(before: Array, after: Array) -> tuple[Array, Array] | None:
    """What places have more at another exposure than those of the same code, and which count."""
    good = np.isfinite(before) & np.isfinite(after) & (before > LOWEST_CODE)
    if good.sum() < _LEAST_PLACES:
        return None
    x, y = before[good], after[good]
    left, counts = np.zeros(len(x)), np.zeros(len(x), bool)
    for one in np.unique(x // _BIN_CODES):
        here = x // _BIN_CODES == one
        if here.sum() < _LEAST_IN_BIN:
            continue
        line = np.stack([np.ones(here.sum()), x[here] - x[here].mean()], axis=1)
        left[here] = y[here] - line @ np.linalg.lstsq(line, y[here], rcond=None)[0]
        counts[here] = True
    if not counts.any():
        return None
    limit = _OUTLIER * float(np.median(np.abs(left[counts])))
    residual, weight = np.zeros(before.shape), np.zeros(before.shape)
    residual[good], weight[good] = np.clip(left, -limit, limit), counts
    return residual, weight


def _wide(values: Array, sigma: float) -> Array:
    """Blur; panoramas go on at their sides."""
    side = min(int(3 * sigma) + 1, values.shape[1])
    padded = np.concatenate([values[:, -side:], values, values[:, :side]], axis=1)
    blurred = cv2.GaussianBlur(padded, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred[:, side:-side], dtype=np.float64)


def _variety_stops(scene: SceneSeries, sigma: float) -> float:
    """Spread of the brightness of regions (1 sigma)."""
    codes = scene.codes[..., GREEN]
    seen = np.isfinite(codes)
    light = np.log2(np.nan_to_num(codes, nan=1.0).clip(1) / 255) * 2.2
    light = np.where(seen, light - np.log2(scene.exposures_us)[:, None, None], 0)
    count = seen.sum(axis=0)
    brightness = light.sum(axis=0) / np.maximum(count, 1)
    weight = (count > 0).astype(np.float64)
    near = _wide(weight, sigma)
    smooth = _wide(brightness * weight, sigma) / np.maximum(near, 1e-6)
    some = smooth[(count > 0) & (near > 0.3)]
    return float(np.std(some)) if len(some) else 0.0


def judge_regions(found: Regions) -> Answer:
    """Say whether there is local tone mapping."""
    numbers = {"codes_per_e": found.codes, "compared": float(found.compared)}
    if found.compared < _LEAST_COMPARED:
        return Answer(
            TONE, Outcome.UNKNOWN, "because too few even places are seen at several exposures",
            "point the camera at a lit room with large even surfaces, bright and dark", numbers,
        )  # fmt: skip
    if found.codes >= NOTICED_CODES:
        return Answer(
            TONE, Outcome.UNFIT, "local tone mapping (what a place looks like depends on its "
            f"surroundings, by {found.codes:.2f} codes for each factor e of exposure)",
            "switch wide dynamic range, HDR and backlight compensation off (v4l2-ctl -c "
            "wide_dynamic_range=0, backlight_compensation=0; processing=neutral does); if it "
            "stays, take another camera",
            numbers,
        )  # fmt: skip
    if found.codes >= FAINT_CODES:
        return Answer(
            TONE, Outcome.UNKNOWN, f"because its signs are faint ({found.codes:.2f} codes for each "
            "factor e of exposure)",
            "keep people and things still, and try before a scene with more contrast", numbers,
        )  # fmt: skip
    if found.variety_stops < _LEAST_VARIETY_STOPS:
        return Answer(
            TONE, Outcome.UNKNOWN, "because all parts of the picture are about as bright",
            "have dark and bright parts in view, such as a lamp and a dark corner", numbers,
        )  # fmt: skip
    return Answer(TONE, Outcome.FINE, "all regions are treated alike", numbers=numbers)


# ---------------------------------------------------------------- what all places do together


def power(scene: SceneSeries, stated: Array, *, with_fit: bool = True) -> Power | None:
    """Compare with the response (256, 3) of the camera file; None: too little is seen."""
    fitted = _fitted(scene) if with_fit else None
    rate_and_steps = against(scene, stated)
    if rate_and_steps is None:
        return None
    rate, steps = rate_and_steps
    difference = np.nan
    if fitted is not None:
        some = slice(int(LOWEST_CODE), 236)
        difference = float(np.sqrt(np.mean((fitted.table - stated)[some, GREEN] ** 2)))
        by_fit = against(scene, fitted.table)
        steps = steps if by_fit is None else by_fit[1]
    return Power(1 / rate, fitted, difference, steps)


def against(
    scene: SceneSeries, table: Array, least_places: int = _LEAST_PLACES
) -> tuple[float, Array] | None:
    """Power of exposure by which light grows by a response, and what is left of each exposure."""
    codes, exposures = scene.codes[..., GREEN], scene.exposures_us
    log_t = np.log(exposures)[:, None, None]
    good = np.isfinite(codes) & (codes > LOWEST_CODE)
    good &= good.sum(axis=0) >= 2
    if good.sum() < least_places:
        return None
    curve = np.maximum(table[:, GREEN], 1e-7)
    filled = np.where(good, codes, 128)
    light = np.log(curves.curve_at(curve, filled))
    slope = np.gradient(np.log(curve))
    weight = np.where(good, np.minimum(1 / curves.curve_at(slope, filled), 40) ** 2, 0)
    total = np.maximum(weight.sum(axis=0), 1e-12)
    from_t = log_t - (weight * log_t).sum(axis=0) / total
    from_light = light - (weight * light).sum(axis=0) / total
    rate = float((weight * from_t * from_light).sum() / (weight * from_t**2).sum())
    steps = np.full(len(exposures), np.nan)
    for k in range(len(exposures)):
        mine = good[k]
        if mine.sum() >= least_places:
            steps[k] = np.expm1(np.median((from_light / rate - from_t)[k][mine]))
    return rate, steps


def _fitted(scene: SceneSeries) -> Response | None:
    """The response as `calibrate response` finds it, where it is found well."""
    try:
        chosen, _ = flat_patches.collect(scene.steps)
        fitted = curves.fit(chosen)
    except ResponseError:
        return None
    return fitted if fitted.residual_codes.max() < _MOST_RESIDUAL_CODES else None


def untold(question: str, found: Power | None, regional: Answer, mapped: str) -> Answer:
    """Say why exposures cannot be compared; `mapped`: reason where there is local tone mapping."""
    why = "too few even places are seen at several exposures"
    if regional.outcome is Outcome.UNFIT:
        why = mapped
    elif found is not None:
        why = "nobody knows whether there is local tone mapping"
    return Answer(question, Outcome.UNKNOWN, f"because {why}", regional.next_step)


def judge_power(found: Power | None, regional: Answer, of_file: bool) -> Answer:
    """Say whether the response is that of the camera file, or sRGB without one."""
    if found is None or regional.outcome is not Outcome.FINE:
        why = "there is no single one with local tone mapping"
        return untold(RESPONSE, found, regional, why)
    name = "that of the camera file" if of_file else "sRGB"
    numbers = {"power": found.power, "difference": found.difference}
    numbers = {key: value for key, value in numbers.items() if np.isfinite(value)}
    off = abs(found.power - 1) > NOTICED_POWER
    if not off and not found.difference > NOTICED_SHARE:
        words = f"is {name} (power {found.power:.3f})"
        return Answer(RESPONSE, Outcome.FINE, words, numbers=numbers)
    words = f"a response other than {name} (light is its power {found.power:.3f})"
    if not off:
        words = f"a response other than {name} ({100 * found.difference:.1f} % of full scale off)"
    if found.fitted is None:
        step = "lightprobe calibrate response SOURCE --output FILE.camera, with more shades in view"
        return Answer(RESPONSE, Outcome.UNFIT, words, step, numbers)
    step = "--output FILE.camera writes the measured one, as lightprobe calibrate response does"
    return Answer(RESPONSE, Outcome.DEFECT, words, step, numbers)
