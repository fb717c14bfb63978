"""What the LED shows and what the button starts, at a time that the caller says. No I/O here."""

from __future__ import annotations

from lightprobe.panel.actions import ACTIONS, Action, Done
from lightprobe.panel.button import STUCK_S, Button
from lightprobe.panel.patterns import STATES, Player, State
from lightprobe.panel.state import Judged

#: How long a command that went wrong is shown as a fault.
PROBLEM_S = 10.0
#: How long the machine may take to end after the command to shut down has; then it has not.
OFF_S = 120.0
#: A fault that comes and goes is not shown: the LED would mean nothing.
_SETTLED_S = 2.0
_ORDER = list(STATES)


class Core:
    """LED and button as a whole."""

    def __init__(self, now_s: float, pressed: bool = False) -> None:
        """Begin: the probe starts. A button that is pressed already does not count yet."""
        self.button = Button(pressed, now_s)
        self.access_point = False
        self._running: dict[str, Action] = {}
        self._problem: tuple[str, float] | None = None  # and until when
        self._off_s = now_s  # until then it shuts down
        self._judged = self._candidate = Judged(State.STARTING, "the panel starts")
        self._candidate_s = now_s
        self._player = Player(STATES[State.STARTING].pattern, now_s)
        self._held = False

    def edge(self, pressed: bool, at_s: float) -> Action | None:
        """The button has moved; gives what is to be started."""
        name = self.button.edge(pressed, at_s)
        if name is None or name in self._running:
            return None
        return ACTIONS[name]

    def started(self, action: Action) -> None:
        """It runs."""
        self._running[action.name] = action

    def ended(self, done: Done, now_s: float) -> None:
        """It has ended."""
        if not done.asked:
            self._running.pop(done.action.name, None)
        if done.is_on is not None:
            self.access_point = done.is_on
        if done.action.shown is State.STOPPING and not done.problem:
            self._off_s = now_s + OFF_S
        if done.problem:
            self._problem = (done.problem, now_s + PROBLEM_S)

    def see(self, judged: Judged, now_s: float) -> None:
        """How the probe is. Only a state that stays is shown."""
        if judged.state is not self._candidate.state:
            self._candidate_s = now_s
        self._candidate = judged
        same = judged.state is self._judged.state
        if same or now_s - self._candidate_s >= _SETTLED_S:
            self._judged = judged

    def shown(self, now_s: float) -> Judged:
        """Give the state that counts most, and why."""
        holding = [self._judged]
        holding += [
            Judged(action.shown, action.title) for action in self._running.values() if action.shown
        ]
        if now_s < self._off_s:
            holding.append(Judged(State.STOPPING, "the system shuts down"))
        if self._problem and now_s < self._problem[1]:
            holding.append(Judged(State.FAULT, self._problem[0]))
        if self.button.stuck(now_s):
            words = f"panel: button: pressed for {STUCK_S:g} s and longer: is it stuck, or shorted?"
            holding.append(Judged(State.FAULT, words))
        if self.access_point:
            holding.append(Judged(State.ACCESS_POINT, "its own network is open"))
        return min(holding, key=lambda judged: _ORDER.index(judged.state))

    def led(self, now_s: float) -> tuple[bool, float]:
        """Whether the LED is lit now, and the seconds until it may change."""
        zone = None if self.button.stuck(now_s) else self.button.zone(now_s)
        pattern = zone.pattern if zone else STATES[self.shown(now_s).state].pattern
        # What a hand does is answered at once; else a pattern is shown to its end.
        at_once = zone is not None or self._held
        self._held = zone is not None
        self._player.show(pattern, now_s, at_once)
        lit, for_s = self._player.level(now_s)
        next_s = self.button.next_zone_s(now_s)
        return lit, for_s if next_s is None else min(for_s, next_s)
