"""The button: what is asked for, by how long it is held. One table; the LED says when to let go."""

from __future__ import annotations

from dataclasses import dataclass

from lightprobe.panel.patterns import DARK, FAST, LIT, SLOW, Pattern


@dataclass(frozen=True)
class Zone:
    """What happens if the button is let go so long after it was pressed, and later."""

    from_s: float
    action: str | None  # of actions.ACTIONS; None: nothing happens
    pattern: Pattern  # of the LED meanwhile


#: In order; the last one is for whoever leans on it, and for a button that is stuck.
ZONES = (
    Zone(0.0, "pair", LIT),
    Zone(1.5, None, DARK),
    Zone(3.0, "access-point", SLOW),
    Zone(7.0, "shut-down", FAST),
    Zone(15.0, None, DARK),
)
#: No person holds it for so long.
STUCK_S = 30.0


class Button:
    """Classifies presses. Times are of the edges, so that a busy machine changes nothing."""

    def __init__(self, pressed: bool, now_s: float) -> None:
        """Take how it is now; one that is pressed already counts once it has been let go."""
        self._since_s: float | None = now_s if pressed else None
        self._counts = not pressed

    @property
    def pressed(self) -> bool:
        """Whether it is down."""
        return self._since_s is not None

    def edge(self, pressed: bool, at_s: float) -> str | None:
        """It has been pressed or let go; gives what is asked for now. The same again is nothing."""
        if pressed:
            if self._since_s is None:
                self._since_s = at_s
            return None
        zone = self.zone(at_s)
        self._since_s, self._counts = None, True
        return zone.action if zone else None

    def zone(self, now_s: float) -> Zone | None:
        """Where letting go now would be; None while it is not pressed, or does not count."""
        if self._since_s is None or not self._counts:
            return None
        held_s = max(now_s - self._since_s, 0.0)
        return next(zone for zone in reversed(ZONES) if held_s >= zone.from_s)

    def next_zone_s(self, now_s: float) -> float | None:
        """Seconds until another zone begins; None while none will."""
        if self._since_s is None:
            return None
        held_s = now_s - self._since_s
        return next((zone.from_s - held_s for zone in ZONES if zone.from_s > held_s), None)

    def stuck(self, now_s: float) -> bool:
        """Whether it has been down for longer than a person holds it."""
        return self._since_s is not None and now_s - self._since_s >= STUCK_S
