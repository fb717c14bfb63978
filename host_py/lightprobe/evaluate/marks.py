"""What a picture says of each listed lamp: which true one it is, or in which bright area it lies.

Scenes of lamps know their lamps. A panorama is known as pixels alone: what of it is a lamp is
nobody's to say, and a sky may be listed as several lamps. There lamps are named by bright areas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import wrapped_regions

#: An area is bright above this many means of the sphere.
_BRIGHT = 2.0
#: Areas are told apart at this size: leaves before a sky do not divide it.
_GRID_PX = (256, 128)
_NEAR_DEG = 2.0
_EXTRA = "extra"


@dataclass(frozen=True, eq=False)
class Marks:
    """Marks of one estimate's lamps, in its order, and what is known of them as a whole."""

    names: tuple[str, ...]  # beside each lamp; "": its area is named beside another
    rows: tuple[str, ...]  # a line each
    lamps: tuple[Lamp, ...] = ()  # true ones, to be circled
    areas: NDArray[np.bool_] | None = None  # (H, W) true bright ones, to be outlined
    summary: str = ""
    figures: dict[str, float] = field(default_factory=dict)

    def is_extra(self, index: int) -> bool:
        """Whether nothing true is where this lamp is."""
        return self.names[index] == _EXTRA


def of_packet(estimate: Estimate) -> Marks:
    """Marks where nothing true is known."""
    rows = [
        f"#{light.id}: {_place(light.azimuth_deg, light.elevation_deg)}, "
        f"{2 * light.angular_radius_deg:.1f}° across"
        for light in estimate.lights
    ]
    return Marks(tuple(f"#{light.id}" for light in estimate.lights), tuple(rows))


def of_lamps(estimate: Estimate, lamps: Sequence[Lamp]) -> Marks:
    """Marks in a scene of lamps."""
    lights = estimate.lights
    pairs = geometry.match_directions(
        [lamp.direction for lamp in lamps], [light.direction for light in lights]
    )
    names, rows = [_EXTRA] * len(lights), []
    for i, j, angle_deg in pairs:
        names[j] = f"{i + 1}"
        ratio = float(luminance(lights[j].irradiance)) / float(luminance(lamps[i].irradiance))
        rows.append(f"lamp {i + 1}: {angle_deg:.2f}° off, irradiance {100 * (ratio - 1):+.0f}%")
    missed = set(range(len(lamps))) - {i for i, *_ in pairs}
    rows += [f"lamp {i + 1}: not listed" for i in sorted(missed)]
    figures: dict[str, float] = {"lamps": len(lamps), "found": len(pairs)}
    summary = f"lamps: {len(pairs)} of {len(lamps)} found, {names.count(_EXTRA)} extra"
    if pairs:
        rmse_deg = float(np.sqrt(np.mean([angle_deg**2 for *_, angle_deg in pairs])))
        figures["direction_rmse_deg"] = rmse_deg
        summary += f", direction RMSE {rmse_deg:.2f}°"
    return _with_extra(estimate, names, rows, summary, figures, lamps=tuple(lamps))


def of_map(estimate: Estimate, radiance: NDArray[np.float32]) -> Marks:
    """Marks in a scene that is known as a map (H, 2H, 3): by the bright area they lie in."""
    labels = _bright_areas(radiance)
    found = [_area_of(labels, light) for light in estimate.lights]
    areas = list(dict.fromkeys(label for label in found if label))  # the strongest lamp's first
    names, rows = [_EXTRA if not label else "" for label in found], []
    for number, label in enumerate(areas, 1):
        names[found.index(label)] = f"{number}"
        inside = [k for k in range(len(found)) if found[k] == label]
        lights = [estimate.lights[k] for k in inside]
        centre = np.sum([luminance(x.irradiance) * x.direction for x in lights], axis=0)
        place = _place(*map(float, geometry.angles_from_direction(centre)))
        rows.append(f"area {number}: {place}, as {_count(len(lights), 'lamp')}")
    listed = len(found) - names.count(_EXTRA)
    summary = f"{_count(listed, 'lamp')} in {_count(len(areas), 'bright area')}"
    figures: dict[str, float] = {"areas": len(areas), "listed": listed}
    return _with_extra(estimate, names, rows, summary, figures, areas=np.isin(labels, areas))


def _with_extra(
    estimate: Estimate, names: list[str], rows: list[str], summary: str,
    figures: dict[str, float], *, lamps: tuple[Lamp, ...] = (),
    areas: NDArray[np.bool_] | None = None,
) -> Marks:  # fmt: skip
    extra = [x for x, name in zip(estimate.lights, names, strict=True) if name == _EXTRA]
    rows = rows + [f"extra: {_place(x.azimuth_deg, x.elevation_deg)}" for x in extra]
    figures = figures | {"extra": len(extra)}
    return Marks(tuple(names), tuple(rows), lamps, areas, summary, figures)


def _bright_areas(radiance: NDArray[np.float32]) -> NDArray[np.int32]:
    """Label (128, 256) connected areas far above the mean of the sphere; 0: not bright."""
    small = cv2.resize(radiance, _GRID_PX, interpolation=cv2.INTER_AREA)
    brightness = luminance(small.astype(np.float64))
    mean = np.average(brightness.ravel(), weights=_solid_angles())
    return wrapped_regions(np.asarray(brightness > _BRIGHT * mean))


def _solid_angles() -> Array:
    width, height = _GRID_PX
    return np.repeat(geometry.equirect_solid_angles(width, height), width)


def _area_of(labels: NDArray[np.int32], light: Light) -> int:
    """The area that most of what is bright near a lamp belongs to; 0: nothing is bright there."""
    cosine = geometry.equirect_directions(*_GRID_PX).reshape(-1, 3) @ light.direction
    near = cosine > np.cos(np.radians(light.angular_radius_deg + _NEAR_DEG))
    votes = np.bincount(labels.ravel()[near], weights=_solid_angles()[near], minlength=2)
    return int(np.argmax(votes[1:]) + 1) if votes[1:].any() else 0


def _place(azimuth_deg: float, elevation_deg: float) -> str:
    return f"az {azimuth_deg:+6.1f}° el {elevation_deg:+5.1f}°"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
