"""What is called a mirror image among panes, varnished floors, LCD screens and windows.

Judges the lights of an estimate of a room of lightprobe.sim.glossy_rooms: what stands where each of
them is listed, and what the daemon says of it. See polarization.py.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, Light, LightFlag
from lightprobe.geometry import Array
from lightprobe.sim.glossy import GlossyRoom, Image, Panel
from recording import markdown

#: A light is what stands no further from it than this and its own radius.
_NEAR_DEG = 2.0
#: Light that is less polarized than this may be a lamp's.
TELLING_DOLP = 0.1
NOT = 0.1  # below it, and with known polarization, it is said to be none

#: What may be listed.
LAMP, SCREEN, SKY = "lamps", "LCD screens", "windows on a blue sky"
UPRIGHT, DIM_UPRIGHT = "lamps in upright glass, DoLP ≥ 0.1", "lamps in upright glass, DoLP < 0.1"
FLOOR, DIM_FLOOR = (
    "lamps in a varnished floor, DoLP ≥ 0.1",
    "lamps in a varnished floor, DoLP < 0.1",
)
MIRRORED = "screens and windows in a mirror"
OTHER = "nothing of these"
KINDS = (LAMP, SCREEN, SKY, UPRIGHT, DIM_UPRIGHT, FLOOR, DIM_FLOOR, MIRRORED, OTHER)

#: What is said of it. Without its polarization, little probability is no statement.
CALLED, UNSURE, NONE, UNKNOWN = "image", "unsure", "none", "unknown"
VERDICTS = (CALLED, UNSURE, NONE, UNKNOWN)
Key = tuple[str, str]  # what it is, and what is said of it


@dataclass(frozen=True)
class Found:
    """Lights of some rooms' newest estimates; and how many estimates contradict their room."""

    lights: Counter[Key]
    estimates: int = 0
    wrong_estimates: int = 0
    lamps: int = 0
    lost: int = 0  # lamps that are not listed
    film_turned: int = 0  # estimates that say so

    def __add__(self, other: Found) -> Found:
        """Sum of both."""
        return Found(
            self.lights + other.lights,
            *(
                getattr(self, field.name) + getattr(other, field.name)
                for field in fields(Found)
                if field.name != "lights"
            ),
        )


def verdict(light: Light) -> str:
    """What the daemon says of a light."""
    if light.flags & LightFlag.REFLECTION:
        return CALLED
    if light.reflection is not None and light.reflection >= NOT:
        return UNSURE
    return UNKNOWN if light.dolp is None else NONE


def _kind_of_image(image: Image) -> str:
    if abs(float(image.mirror.panel.normal[1])) < 0.5:
        return UPRIGHT if image.dolp >= TELLING_DOLP else DIM_UPRIGHT
    return FLOOR if image.dolp >= TELLING_DOLP else DIM_FLOOR


def _shown(panels: Sequence[Panel], origin: Array, direction: Array) -> int | None:
    """Which panel a ray meets first."""
    far = [float(panel.hit(origin[None], direction[None])[0]) for panel in panels]
    return int(np.argmin(far)) if far and np.isfinite(min(far)) else None


def kind(room: GlossyRoom, direction: Array) -> str:
    """What stands where a light is listed, in the room's own frame."""
    discs = [(lamp, LAMP) for lamp in room.lamps]
    discs += [(image.lamp, _kind_of_image(image)) for image in room.images]
    off = [
        (float(geometry.angle_deg(lamp.direction, direction)) - lamp.radius_deg, name)
        for lamp, name in discs
    ]
    nearest, name = min(off)
    if nearest < _NEAR_DEG:
        return name
    lights = [*((one.panel, SCREEN) for one in room.screens),
              *((one.panel, SKY) for one in room.windows)]  # fmt: skip
    panels = [panel for panel, _ in lights]
    first = _shown([*panels, *(one.panel for one in room.mirrors)], np.zeros(3), direction)
    if first is None:
        return OTHER
    if first < len(lights):
        return lights[first][1]
    mirror = room.mirrors[first - len(lights)]
    point = direction * float(mirror.panel.hit(np.zeros((1, 3)), direction[None])[0])
    second = _shown(panels, point, mirror.towards(direction))
    return OTHER if second is None else MIRRORED


def lights(room: GlossyRoom, estimate: Estimate, turn: Array | None = None) -> Counter[Key]:
    """What is listed; `turn` (3, 3): from the estimate's frame to the room's."""
    listed: Counter[Key] = Counter()
    for light in estimate.lights:
        direction = light.direction if turn is None else turn @ light.direction
        listed[kind(room, direction), verdict(light)] += 1
    return listed


#: What contradicts the room. Of what is hardly polarized, nothing is sure.
NEVER = {(LAMP, CALLED), (SCREEN, CALLED), (SKY, CALLED), (UPRIGHT, NONE), (FLOOR, NONE)}


def found(
    room: GlossyRoom, estimates: Sequence[Estimate], turns: Sequence[Array] | None = None
) -> Found:
    """Judge the estimates of one room; `turns` (3, 3): see :func:`lights`."""
    frames = turns or [np.eye(3)] * len(estimates)
    listed = [lights(room, one, turn) for one, turn in zip(estimates, frames, strict=True)]
    seen = [frames[-1] @ light.direction for light in estimates[-1].lights]
    lamps = [lamp.direction for lamp in room.lamps]
    return Found(
        listed[-1],
        len(estimates),
        sum(bool(NEVER & one.keys()) for one in listed),
        len(lamps),
        len(lamps) - len(geometry.match_directions(lamps, seen)),
        sum(bool(one.flags & EstimateFlag.FILM_TURNED) for one in estimates),
    )


def table(sums: dict[str, Found]) -> str:
    """Rows of Markdown, by way to look; and what contradicts the rooms."""
    rows, words = [], []
    for name, one in sums.items():
        for what in KINDS:
            listed = [one.lights[what, verdict] for verdict in VERDICTS]
            if sum(listed):
                rows.append([name, what, f"{sum(listed)}", *(f"{number}" for number in listed)])
        words.append(
            f"{name}: {one.lost} of {one.lamps} lamps not listed; of {one.estimates} estimates, "
            f"{one.wrong_estimates} contradict their room, {one.film_turned} take the film for "
            "turned."
        )
    head = ["seen", "what is listed", "lights", "called a mirror image", "unsure", "called none",
            "polarization not known"]  # fmt: skip
    return "\n\n".join([markdown(head, rows), "\n".join(words)])
