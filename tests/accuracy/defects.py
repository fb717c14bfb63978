"""What cameras do to their pictures, and lenses to light: conditions of live.py --defects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from kinds import KINDS

if TYPE_CHECKING:
    from judge import Coverage
    from live import Live


@dataclass(frozen=True)
class Defects:
    """What differs from a camera that leaves its pictures alone, as `simulate` has it."""

    words: str
    processing: str = ""
    lens_defects: str = ""
    quality: int = 85
    stated: str = ""  # sections of the camera file, beside [camera]
    response: str | None = None  # that the daemon does not know of; None: as it takes it for


#: By name; strengths as measured of cheap cameras.
DEFECTS = {
    "none": Defects("no defect"),
    "quality": Defects("JPEG quality 60", quality=60),
    "rate": Defects("JPEG rate control, 15 kB", "jpeg_kb=15"),
    "sharpening": Defects("sharpening, 0.7 at 1.3 px", "sharpen=0.7&sharpen_px=1.3"),
    "tone": Defects("local tone mapping, 1 EV", "tone_ev=1"),
    "tone-curve": Defects("local tone mapping, 1 EV, to middle grey", "tone_ev=1&tone_aim=0.18"),
    "tone-sharp": Defects(
        "local tone mapping, 1 EV, sharpening, quality 60",
        "tone_ev=1&sharpen=0.7&sharpen_px=1.3", quality=60,
    ),
    "white": Defects("white balance drifts, 6 % in 20 s", "white_drift=0.06&white_drift_s=20"),
    "adapting": Defects("white balance adapts, in 2 s", "white_adapt=1"),
    "saturation": Defects("colours, 1.3 times", "saturation=1.3"),
    "denoise": Defects(
        "noise reduction, spatial and temporal", "denoise=6&denoise_px=2&denoise_time=0.7"
    ),
    "response": Defects("response of power 1.04", response="srgb:1.04"),
    "stitching": Defects("stitching, 3 %, doubled by 0.7°", "stitch_gain=0.03&stitch_deg=0.7"),
    "tearing": Defects("exposure tears, a third of the rows", "exposure_tear=0.33"),
    "glare": Defects("veiling glare, 2 %", lens_defects="glare=0.02"),
    "glare-known": Defects(
        "veiling glare, 2 %, stated", lens_defects="glare=0.02",
        stated="[glare]\neven = 0.01\naround = 0.01\nwidth_deg = 10\n",
    ),
    "glare-strong": Defects("veiling glare, 20 %", lens_defects="glare=0.2"),
    "glare-strong-known": Defects(
        "veiling glare, 20 %, stated", lens_defects="glare=0.2",
        stated="[glare]\neven = 0.1\naround = 0.1\nwidth_deg = 10\n",
    ),
    "ghosts": Defects("ghosts, 1 %", lens_defects="ghost=0.01"),
    "fringes": Defects("purple fringes, 3 %", lens_defects="fringe=0.03"),
    "blur": Defects("point spread of 0.5°", lens_defects="point_spread_deg=0.5"),
    "dirt": Defects("dirt, 8 spots of 30 %", lens_defects="dirt=0.3"),
    "drops": Defects("6 drops of water", lens_defects="drops=6"),
}  # fmt: skip

HEAD = [
    "the camera", "scene", "it turns", "relighting error, median", "of 90 % of the packets",
    "wrong and healthy", "births per second", "AMBIENT's step", "relighting within 1σ, 3σ",
    "flags, share of the packets",
]  # fmt: skip


def defect_rows(found: Sequence[Live]) -> list[list[str]]:
    """Table of what clients get that ask for nothing: a row for each defect, scene and motion."""
    some = [one for one in found if one.subscription == "default"]
    order = {name: number for number, name in enumerate(DEFECTS)}
    some.sort(key=lambda one: (one.cameras, order[one.defects], one.scene, one.motion))
    table = []
    for one in some:
        figures = one.figures
        flags = (f"`{name}` {100 * share:.0f} %" for name, share in figures.flags.items())
        table.append([
            _words(one), one.scene, one.motion, f"{figures.error_median:.3f}",
            f"{figures.error_p90:.3f}", _percent(figures.wrong_and_healthy),
            f"{figures.births_per_s:.1f}", f"{100 * figures.ambient_step:.1f} %",
            _covered(figures.relighting), ", ".join(flags) or "–",
        ])  # fmt: skip
    return table


def _words(one: Live) -> str:
    return "; ".join(filter(None, [KINDS[one.cameras].words, DEFECTS[one.defects].words]))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if np.isfinite(share) else "–"


def _covered(coverage: Coverage) -> str:
    if coverage.within_1 is None or coverage.within_3 is None:
        return "–"
    return f"{_percent(coverage.within_1)}, {_percent(coverage.within_3)}"
