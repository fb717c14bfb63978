"""The panel of a probe without a screen, in simulated time: patterns, presses, states."""

from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from lightprobe.estimate import EstimateFlag, Fault, Health
from lightprobe.panel.actions import ACTIONS, Action, Done
from lightprobe.panel.button import STUCK_S, ZONES, Button
from lightprobe.panel.core import OFF_S, PROBLEM_S, Core
from lightprobe.panel.patterns import LIT, STATES, Pattern, Player, State
from lightprobe.panel.state import NO_ALARM, STARTING_S, Judged, Seen, judge

STEP_S = 0.02
TIMES = st.floats(0, 1e6)


def runs(levels: list[bool]) -> list[tuple[bool, float]]:
    """Level and seconds of each stretch, without the first and the last, which are cut off."""
    changes = [0, *(i for i in range(1, len(levels)) if levels[i] != levels[i - 1]), len(levels)]
    return [(levels[a], (b - a) * STEP_S) for a, b in pairwise(changes)][1:-1]


def read(levels: list[bool]) -> str:
    """What a person reads who looks for ten seconds: flashes between pauses, and how long."""
    if len(set(levels)) == 1:
        return "lit" if levels[0] else "dark"
    found = runs(levels)
    longest_dark_s = max(s for lit, s in found if not lit)
    longest_lit_s = max(s for lit, s in found if lit)
    if longest_dark_s < 0.7:  # no pause
        if longest_lit_s > 1:
            return "lit with breaks"
        return "fast" if longest_lit_s < 0.25 else "slow"
    counts, count = [], 0
    for lit, seconds in found:
        if lit:
            count += 1
        elif seconds > 0.7:
            counts.append(count)
            count = 0
    return f"{max(counts[1:] or counts)} flashes"


def watch(pattern: Pattern, from_s: float = 0.0) -> list[bool]:
    return [pattern.at(from_s + i * STEP_S)[0] for i in range(round(10 / STEP_S))]


@given(st.floats(0, 100))
def test_every_state_is_told_from_every_other_from_whenever_one_looks(from_s: float) -> None:
    words = {state: read(watch(meaning.pattern, from_s)) for state, meaning in STATES.items()}
    assert len(set(words.values())) == len(State), words
    assert words[State.MEASURING] == "1 flashes"
    assert words[State.NO_NETWORK] == "3 flashes"
    assert words[State.FAULT] == "fast"


def test_the_table_has_every_state_and_the_eye_can_follow() -> None:
    assert set(STATES) == set(State)
    for meaning in STATES.values():
        assert all(step == 0 or step >= 0.1 for step in meaning.pattern.steps)
        assert 0.2 <= meaning.pattern.cycle_s <= 4


def test_where_all_is_well_it_is_dark_nearly_always() -> None:
    """It stands beside an instrument that measures light."""
    levels = watch(STATES[State.MEASURING].pattern)
    assert sum(levels) / len(levels) < 0.05


@given(st.lists(st.tuples(st.sampled_from(list(State)), st.floats(0, 9)), max_size=6))
def test_a_pattern_is_shown_to_its_end_and_the_last_one_comes(changes) -> None:
    now_s, player = 0.0, Player(STATES[State.STARTING].pattern, 0.0)
    for state, wait_s in changes:
        player.show(STATES[state].pattern, now_s)
        now_s += wait_s
        player.level(now_s)
    last = STATES[changes[-1][0]].pattern if changes else STATES[State.STARTING].pattern
    now_s += 5  # longer than any cycle
    levels = []
    for i in range(round(10 / STEP_S)):
        lit, for_s = player.level(now_s + i * STEP_S)
        assert for_s > 0
        levels.append(lit)
    assert read(levels) == read(watch(last))


def test_no_flash_is_cut_off_by_a_change() -> None:
    player = Player(STATES[State.NO_NETWORK].pattern, 0.0)
    player.show(STATES[State.WAITING].pattern, 0.55)
    assert player.level(1.05)[0]  # the third flash
    assert not player.level(1.3)[0]
    player.show(LIT, 1.3, at_once=True)
    assert player.level(1.3)[0]


# ---------------------------------------------------------------- the button


@given(st.floats(0.001, 100), TIMES)
def test_how_long_it_is_held_decides(held_s: float, at_s: float) -> None:
    assume(all(abs(held_s - zone.from_s) > 1e-6 for zone in ZONES))
    button = Button(False, at_s)
    assert button.edge(True, at_s) is None
    wanted = [zone for zone in ZONES if zone.from_s <= held_s][-1]
    assert button.zone(at_s + held_s) == wanted
    assert button.edge(False, at_s + held_s) == wanted.action
    assert button.zone(at_s + held_s) is None


@given(st.lists(st.tuples(st.booleans(), st.floats(0, 5)), max_size=40))
def test_whatever_edges_come_nothing_happens_without_a_press(edges) -> None:
    """Doubled and lost edges: an action comes with a release that follows a press, and no other."""
    now_s, down, button = 0.0, False, Button(False, 0.0)
    for pressed, wait_s in edges:
        now_s += wait_s
        action = button.edge(pressed, now_s)
        assert action is None or (down and not pressed)
        down = pressed
        assert button.pressed == down


@given(st.floats(0, 200))
def test_one_that_is_down_at_the_start_counts_when_it_was_let_go(held_s: float) -> None:
    button = Button(True, 0.0)
    assert button.zone(held_s) is None
    assert button.stuck(held_s) == (held_s >= STUCK_S)
    assert button.edge(False, held_s) is None
    button.edge(True, held_s + 1)
    assert button.edge(False, held_s + 2) == "pair"


def test_every_press_has_a_command_and_every_zone_its_own_look() -> None:
    assert {zone.action for zone in ZONES} == {None, *ACTIONS}
    for one, next_one in pairwise(ZONES):
        assert one.from_s < next_one.from_s
        assert one.pattern != next_one.pattern
    assert ZONES[-1].action is None, "a button that is stuck must do nothing"


# ---------------------------------------------------------------- states


def health(state: str = "STREAMING", *faults: str) -> Health:
    return Health(
        1000, state, 1, 0, 0, 0, 1, 10.0, 1, 1, 1, 1, 0, 0, 1.0, 1, "balanced",
        tuple(Fault(name, f"{name}: words") for name in faults),
    )  # fmt: skip


OK = EstimateFlag(0)


@pytest.mark.parametrize(
    ("seen", "state", "why"),
    [
        (Seen(False, 0, "refused"), State.STARTING, "refused"),
        (Seen(False, STARTING_S, "refused"), State.FAULT, "refused"),
        (Seen(True), State.STARTING, "health"),
        (Seen(True, health=health("WAITING", "source-waiting")), State.WAITING, "source-waiting"),
        (Seen(True, health=health(), flags=OK), State.MEASURING, ""),
        (Seen(True, health=health(), flags=OK, network=False), State.NO_NETWORK, "address"),
        (Seen(True, health=health(), flags=EstimateFlag.STALE), State.WAITING, "streaming"),
        (Seen(True, health=health(), flags=EstimateFlag.NO_LIGHT), State.WAITING, "black"),
        (Seen(True, health=health(), flags=EstimateFlag.WHEEL_FAULT), State.FAULT, "WHEEL_FAULT"),
        (Seen(True, health=health("STALLED", "source-stalled")), State.FAULT, "source-stalled"),
        (Seen(True, health=health("DOWN")), State.FAULT, "configured"),
        (Seen(True, health=health("STREAMING", "WHEEL_STUCK"), network=False), State.FAULT,
         "WHEEL_STUCK"),
    ],
)  # fmt: skip
def test_the_state_of_a_probe(seen: Seen, state: State, why: str) -> None:
    judged = judge(seen)
    assert judged.state is state
    assert why in judged.why


@given(st.sets(st.sampled_from(sorted(NO_ALARM))))
def test_faults_that_call_nobody_do_not_blink(names: set[str]) -> None:
    seen = Seen(True, health=health("STREAMING", *names), flags=OK)
    assert judge(seen).state is State.MEASURING


# ---------------------------------------------------------------- all together


def settled(state: State, now_s: float = 0.0) -> Core:
    core = Core(now_s)
    core.see(Judged(state, "why"), now_s)
    core.see(Judged(state, "why"), now_s + 3)
    assert core.shown(now_s + 3).state is state
    return core


def test_a_fault_of_a_moment_is_not_shown() -> None:
    core = settled(State.MEASURING)
    for now_s in range(10, 30):
        core.see(Judged(State.FAULT if now_s % 2 else State.MEASURING, ""), now_s)
        assert core.shown(now_s).state is State.MEASURING
    core.see(Judged(State.FAULT, ""), 31)
    core.see(Judged(State.FAULT, ""), 33)
    assert core.shown(33).state is State.FAULT


@given(st.sampled_from(list(State)), st.floats(0.05, 60))
def test_the_led_says_what_letting_go_does(state: State, held_s: float) -> None:
    assume(all(abs(held_s - zone.from_s) > 0.05 for zone in ZONES))
    core = settled(state)
    core.edge(True, 20.0)
    now_s, end_s = 20.0, 20.0 + held_s
    while now_s < end_s:  # as the loop does: wakes when something may change
        _, for_s = core.led(now_s)
        assert for_s > 0
        now_s += min(max(for_s, 1e-4), 0.5)
    zone = [zone for zone in ZONES if zone.from_s <= held_s][-1]
    if held_s < STUCK_S:
        in_zone_s = held_s - zone.from_s
        about = {zone.pattern.at(max(in_zone_s + early_s, 0))[0] for early_s in (-1e-3, 1e-3)}
        assert core.led(end_s)[0] in about
    else:
        assert core.shown(end_s).state in (State.FAULT, State.STOPPING, State.PAIRING)
        assert zone.action is None
    action = core.edge(False, end_s)
    assert (action.name if action else None) == zone.action


def press(core: Core, at_s: float, held_s: float) -> Action:
    assert core.edge(True, at_s) is None
    action = core.edge(False, at_s + held_s)
    assert action is not None
    core.started(action)
    return action


def test_pairing_is_shown_as_long_as_it_is_open_and_opens_once() -> None:
    core = settled(State.MEASURING)
    action = press(core, 10, 0.2)
    assert core.shown(11).state is State.PAIRING
    core.edge(True, 12)
    assert core.edge(False, 12.2) is None, "a second window at the same port"
    core.ended(Done(action, ""), 20)
    assert core.shown(20).state is State.MEASURING


def test_a_command_that_fails_is_a_fault_for_a_while() -> None:
    core = settled(State.MEASURING)
    action = press(core, 10, 4)
    assert action.name == "access-point"
    core.ended(Done(action, "panel: access point on or off: nmcli: …"), 20)
    assert core.shown(20 + PROBLEM_S / 2).why.startswith("panel: access point")
    assert core.shown(20 + PROBLEM_S).state is State.MEASURING


def test_the_access_point_is_shown_until_it_ends() -> None:
    core = settled(State.WAITING)
    core.ended(Done(press(core, 10, 4), "", is_on=True), 15)
    assert core.shown(16).state is State.ACCESS_POINT
    core.ended(Done(press(core, 20, 4), "", is_on=False), 25)
    assert core.shown(26).state is State.WAITING


def test_shutting_down_counts_before_all_else() -> None:
    core = settled(State.FAULT)
    press(core, 10, 0.2)
    action = press(core, 12, 8)
    assert core.shown(21).state is State.STOPPING
    core.ended(Done(action, ""), 22)  # the command ends at once, the machine takes longer
    assert core.shown(22).state is State.STOPPING
    assert core.shown(22 + OFF_S).state is not State.STOPPING


def test_a_stuck_button_is_a_fault_and_the_state_is_shown_again_when_it_is_let_go() -> None:
    core = settled(State.MEASURING)
    core.edge(True, 10)
    assert core.shown(10 + STUCK_S).state is State.FAULT
    assert "stuck" in core.shown(10 + STUCK_S).why
    assert core.edge(False, 10 + STUCK_S) is None
    assert core.shown(11 + STUCK_S).state is State.MEASURING
