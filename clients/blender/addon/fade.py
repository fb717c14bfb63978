"""Lamps and world come and go over a while, and never pop.

The daemon's list already moves light slowly between lamps and SH. This fade is for what happens
between packets: the probe is lost, comes back, or was started again with other ids.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from .suns import Sun

#: From nothing to full strength, and back.
FADE_S = 0.3
#: After a pause of Blender a fade goes on from where it was: one step is never longer.
MOST_STEP_S = 0.1

#: Of which boot of the probe, and which id in it: ids start again when the probe does.
LampKey = tuple[int, int]


@dataclass(frozen=True, eq=False)
class ShownLamp:
    """A lamp as it is to be drawn now."""

    key: LampKey
    sun: Sun  # the newest that is known of it
    gain: float  # 0…1


@dataclass
class Fader:
    """What is shown now. Not thread-safe."""

    world_gain: float = 0.0  # 0…1
    _lamps: dict[LampKey, ShownLamp] = field(default_factory=dict)

    def step(self, elapsed_s: float, boot_id: int | None, suns: Iterable[Sun]) -> None:
        """Go on by `elapsed_s`, towards the lamps of a fresh packet.

        `boot_id` None: there is no fresh light, so that everything fades out.
        """
        change = elapsed_s / FADE_S
        wanted = {} if boot_id is None else {(boot_id, sun.id): sun for sun in suns}
        for key, sun in wanted.items():
            gain = self._lamps[key].gain if key in self._lamps else 0.0
            self._lamps[key] = ShownLamp(key, sun, min(1.0, gain + change))
        for key in self._lamps.keys() - wanted.keys():
            lamp = self._lamps.pop(key)
            if lamp.gain > change:
                self._lamps[key] = ShownLamp(key, lamp.sun, lamp.gain - change)
        target = 0.0 if boot_id is None else 1.0
        self.world_gain += min(change, max(-change, target - self.world_gain))

    @property
    def lamps(self) -> list[ShownLamp]:
        """What is to be drawn; a lamp that has faded out is no longer in it."""
        return list(self._lamps.values())
