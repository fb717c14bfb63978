"""How right shadows are, from the sheets of docs/users/seen.md, and what SSIM says of their grain.

The shadow is where the table is darker in the truth than in the picture without shadow. Pictures
are smoothed before they are compared there, because renders have grain that no camera or graphics
processor would add. `make seen` calls this; by itself it needs no Mitsuba.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import study
from skimage.metrics import structural_similarity

sys.path.insert(0, str(study.ROOT / "tests/accuracy"))
from page import put

Array = npt.NDArray[np.float64]
NO_SHADOW = "no shadow"
#: Where the table is darker by more, of sRGB's 0…1.
_DARKER = 0.04
_SMOOTH_PX = 2.0
#: Difference between materials, of 255, that tells the object from the table.
_OBJECT = 24


@dataclass(frozen=True)
class Figure:
    """An AR picture beside the truth."""

    material: str
    method: str
    in_shadow: float  # RMSE
    ssim: tuple[float, ...]  # smoothed by 0, 1, 2 pixels


def smoothed(picture: Array, sigma_px: float = _SMOOTH_PX) -> Array:
    """Give it without grain, as from farther away."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px) if sigma_px else picture)


def object_mask(pictures: list[Array]) -> npt.NDArray[np.bool_]:
    """Where pictures of several materials differ that have the same table; one piece, and a rim."""
    spread = np.max([np.abs(one - pictures[0]).max(axis=-1) for one in pictures[1:]], axis=0)
    seen = cv2.morphologyEx(np.uint8(255 * spread > _OBJECT), cv2.MORPH_CLOSE, np.ones((9, 9)))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(seen)
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    return np.asarray(cv2.dilate(np.uint8(labels == largest), np.ones((5, 5))) > 0)


def shadow_mask(
    truth: Array, without: Array, hidden: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Where the object takes light from the table."""
    darker = (smoothed(without) - smoothed(truth)).mean(axis=-1) > _DARKER
    return np.asarray(darker & ~hidden)


def rmse(one: Array, other: Array, where: npt.NDArray[np.bool_]) -> float:
    """Of smoothed pictures."""
    return float(np.sqrt(((smoothed(one) - smoothed(other))[where] ** 2).mean()))


def ssim(one: Array, other: Array, sigma_px: float) -> float:
    """SSIM of smoothed pictures."""
    pair = smoothed(one, sigma_px), smoothed(other, sigma_px)
    return float(structural_similarity(*pair, channel_axis=-1, data_range=1.0))


def figures() -> Iterator[Figure]:
    """Give those of all sheets of the page."""
    materials, methods = study.names()
    for sheet in study.sheets().values():
        pictures = {key: one / 255.0 for key, one in (study.cut(sheet) or {}).items()}
        hidden = object_mask([pictures[material, NO_SHADOW] for material in materials])
        for material in materials:
            truth = pictures[material, study.TRUTH]
            where = shadow_mask(truth, pictures[material, NO_SHADOW], hidden)
            for method in methods:
                one = pictures[material, method]
                alike = tuple(ssim(truth, one, sigma_px) for sigma_px in (0, 1, 2))
                yield Figure(material, method, rmse(truth, one, where), alike)


def parts() -> dict[str, str]:
    """Give the page's tables."""
    materials, methods = study.names()
    found = list(figures())

    def mean(method: str, value: Callable[[Figure], float], material: str = "") -> str:
        chosen = [one for one in found if one.method == method and material in ("", one.material)]
        return f"{np.mean([value(one) for one in chosen]):.3f}"

    shadow = [_row("", *materials, "mean"), _rule(len(materials) + 2)]
    grain = [_row("mean SSIM", "as it is", "smoothed by 1 pixel", "by 2 pixels"), _rule(4)]
    for method in methods:
        cells = [mean(method, lambda one: one.in_shadow, material) for material in (*materials, "")]
        shadow.append(_row(method, *cells))
        alike = [mean(method, lambda one, k=k: one.ssim[k]) for k in range(3)]  # type: ignore[misc]
        grain.append(_row(method, *alike))
    return {"in-shadow": "\n".join(shadow), "grain": "\n".join(grain)}


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _rule(count: int) -> str:
    return "|" + "---|" * count


if __name__ == "__main__":
    put(study.PAGE, parts())
