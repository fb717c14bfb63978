"""Checks of the wheel. They move it: only with --moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightprobe.hil.bench import Bench
from lightprobe.hil.check import CannotTellError, Check, Finding, Group, Source, judged
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import McuError
from lightprobe.mcu.session import HOMING_S

_WHEEL_FAULTS = ("WHEEL", "INDEX", "FEEDBACK", "SUPPLY")
_STATIONS = (45.0, 90.0, 135.0, 180.0, 60.0, 0.0)
_REPEATED = (90.0, 180.0, 90.0, 45.0, 90.0)
_SIGMA_DEG = 1.2
_AT_DEG = 1.5  # of `measured` from the target: the feedback's error and the comb's
_TIME_S = 0.15
_SWEEP_DEG_S = 60.0
_SWEEP_SHARE = 0.03
_REPEAT_DEG = 1.5
_STOP_S = 0.2
_LATE_S = 0.4
_STILL_EDGES = 1
_WAKE_S = 0.1
_REPORT_MS = 20
_OTHER_TOKEN = 0
_MS, _CDEG = 1e-3, 1e-2


@dataclass(frozen=True)
class Drive:
    """One move that has come to rest."""

    start_deg: float
    target_deg: float
    expected_s: float
    took_s: float
    state: mcu.WheelState
    pulse_us: float
    edges: int


def _ready(bench: Bench) -> None:
    """Home the wheel, once, and again when it has been lost."""
    box = bench.box
    box.rates(wheel_ms=_REPORT_MS)
    reply = box.request("WheelRequest", count=1)
    if bench.homed and reply["phase"] == "SETTLED":
        return
    if reply["phase"] == "FAULT":
        numbers = {name: number for number, name in mcu.fault_names().items()}
        bits = sum(1 << k for name, k in numbers.items() if name.startswith(_WHEEL_FAULTS))
        box.clear_faults(bits)
    bench.homed = True
    box.settle(box.home(), HOMING_S)


def _move(bench: Bench, target_deg: float, slew_deg_s: float = 0.0) -> Drive:
    box, params = bench.box, bench.params()
    before = box.wheel
    start_deg = before.commanded_deg if before and before.commanded_deg is not None else 0.0
    woken = bool(before and before.servo_on)
    events = box.settle(box.move(target_deg, slew_deg_s), HOMING_S + 400 / (slew_deg_s or 400))
    times = [one for one in events if isinstance(one, mcu.WheelTime)]
    begun = next((one for one in times if one.phase is mcu.Phase.MOVING), None)
    ended = times[-1]
    took_s = ((ended.t_phase_us - begun.t_phase_us) % (1 << 32)) / 1e6 if begun else 0.0
    _plot(bench, events)
    servo = box.message("WheelServo")
    assert box.wheel is not None
    return Drive(
        start_deg, target_deg, _expected_s(params, start_deg, target_deg, woken), took_s,
        box.wheel, servo.number("pulse_hus") / 2, servo.number("edges"),
    )  # fmt: skip


def _expected_s(params: dict[str, int], start_deg: float, target_deg: float, woken: bool) -> float:
    """Travel to below the target, creep, lag, rest: firmware/README.md, with these parameters."""
    approach_deg = params["approach_cdeg"] * _CDEG
    travel_s = abs(target_deg - approach_deg - start_deg) / (params["slew_max_ddeg_s"] / 10)
    creep_s = approach_deg / (params["creep_ddeg_s"] / 10)
    rest_s = (params["lag_ms"] * 2 + params["settle_ms"]) * _MS
    return travel_s + creep_s + rest_s + (0.0 if woken else _WAKE_S)


def _plot(bench: Bench, events: list[mcu.Event]) -> None:
    """Keep the angle against the box's time, of states with the time that belongs to them."""
    states = {}
    points = bench.series.setdefault("wheel", [])
    for one in events:
        if isinstance(one, mcu.WheelState):
            states[one.counter] = one
        elif isinstance(one, mcu.WheelTime) and one.counter in states:
            state = states.pop(one.counter)
            t_s = (one.t_phase_us + 1000 * one.age_ms) / 1e6
            points.append((t_s, state.measured_deg, state.commanded_deg))
    if points:
        points.append((points[-1][0], None, None))  # nobody looked until the next move


def _drives(bench: Bench) -> list[Drive]:
    """Go to all stations; once for all checks that judge it."""
    if "drives" not in bench.kept:
        _ready(bench)
        bench.kept["drives"] = [_move(bench, target) for target in _stations(bench)]
    drives: list[Drive] = bench.kept["drives"]
    return drives


def _stations(bench: Bench) -> list[float]:
    params = bench.params()
    low, high = params["wheel_min_cdeg"] * _CDEG, params["wheel_max_cdeg"] * _CDEG
    return [one for one in _STATIONS if low <= one <= high]


# ---------------------------------------------------------------- the checks


def _home(bench: Bench) -> Finding:
    bench.homed = False
    _ready(bench)
    state = bench.box.wheel
    assert state is not None
    measured = f"settled at {state.measured_deg} ± {state.sigma_deg:.2f}°"
    ok = state.measured_deg is not None and abs(state.measured_deg) <= _AT_DEG
    return judged(ok, measured, "sensors A and B on the comb: push them as hw/guide.md says")


def _angles(bench: Bench) -> Finding:
    params = bench.params()
    worst_deg, worst_sigma, wrong = 0.0, 0.0, []
    for one in _drives(bench):
        off = abs((one.state.measured_deg or 0.0) - one.target_deg)
        sigma = one.state.sigma_deg if one.state.sigma_deg is not None else np.inf
        below = (one.target_deg - params["comb_first_cdeg"] * _CDEG) / (
            params["comb_pitch_cdeg"] * _CDEG
        )
        worst_deg, worst_sigma = max(worst_deg, off), max(worst_sigma, sigma)
        near = abs(one.edges - 0.5 - below) <= 1
        if off > _AT_DEG or sigma > _SIGMA_DEG or not near:
            wrong.append(f"{one.target_deg:g}°")
    measured = (
        f"{len(_drives(bench))} angles, at most {worst_deg:.2f}° off, sigma up to "
        f"{worst_sigma:.2f}°" + (f"; wrong: {', '.join(wrong)}" if wrong else "")
    )
    step = "the comb's parameters are not those of this wheel: `lightprobe mcu params`"
    return judged(not wrong, measured, step, worst_deg=worst_deg)


def _time(bench: Bench) -> Finding:
    lines = [
        f"{one.start_deg:g}→{one.target_deg:g}° {one.took_s:.2f} s ({one.expected_s:.2f})"
        for one in _drives(bench)
    ]
    late = max(abs(one.took_s - one.expected_s) for one in _drives(bench))
    step = "the servo is slower than its parameters, or the gear drags: turn it by hand"
    return judged(late <= _TIME_S, ", ".join(lines), step, worst_s=late)


def _sweep(bench: Bench) -> Finding:
    _ready(bench)
    low, high = min(_stations(bench)), max(_stations(bench))
    _move(bench, low)
    start = len(bench.series["wheel"])
    _move(bench, high, _SWEEP_DEG_S)
    points = [
        (t_s, deg) for t_s, deg, _ in bench.series["wheel"][start:]
        if deg is not None and low + 20 <= deg <= high - 20
    ]  # fmt: skip
    if len(points) < 10:
        raise CannotTellError("too few angles were reported on the way")
    t_s, deg = np.array(points).T
    rate = float(np.polyfit(t_s - t_s[0], deg, 1)[0])
    measured = f"{rate:.1f}°/s where {_SWEEP_DEG_S:g}°/s were asked for"
    step = "gain of the servo or pitch of the comb: `lightprobe calibrate wheel`"
    return judged(abs(rate / _SWEEP_DEG_S - 1) <= _SWEEP_SHARE, measured, step, deg_s=rate)


def _repeat(bench: Bench) -> Finding:
    _ready(bench)
    gain = abs(bench.params()["servo_gain_ns_deg"]) / 1000 or 1.0
    pulses = [
        one.pulse_us for one in (_move(bench, target) for target in _REPEATED)
        if one.target_deg == _REPEATED[0]
    ]  # fmt: skip
    spread = (max(pulses) - min(pulses)) / gain
    measured = f"{_REPEATED[0]:g}° reached {len(pulses)} times, servo within {spread:.2f}°"
    step = "play of gear or horn, or a loose wheel: hw/guide.md, Calibrate, step 1"
    return judged(spread <= _REPEAT_DEG, measured, step, spread_deg=spread)


def _ends(bench: Bench) -> Finding:
    _ready(bench)
    params = bench.params()
    low, high = params["wheel_min_cdeg"], params["wheel_max_cdeg"]
    wrong = []
    for cdeg in (low - 1, high + 1):
        try:
            bench.box.request(
                "WheelMove", token=_OTHER_TOKEN, target_cdeg=cdeg, slew_ddeg_s=0, hold_ds=0
            )
            wrong.append(f"it took {cdeg * _CDEG:g}°")
            bench.box.settle(_OTHER_TOKEN, HOMING_S)
        except McuError as error:
            if "OUT_OF_RANGE" not in str(error):
                raise
    for _ in bench.box.listen(_LATE_S):  # a late refusal is not the next move's
        pass
    pulses = [_move(bench, cdeg * _CDEG).pulse_us for cdeg in (low, high)]
    for pulse_us in pulses:
        if not params["servo_min_us"] <= pulse_us <= params["servo_max_us"]:
            wrong.append(f"a pulse of {pulse_us:g} µs lies outside of the servo's range")
    measured = "; ".join(wrong) or (
        f"{(low - 1) * _CDEG:g}° and {(high + 1) * _CDEG:g}° refused; pulses "
        f"{min(pulses):.0f}…{max(pulses):.0f} µs"
    )
    return judged(not wrong, measured, "the firmware is damaged: `lightprobe mcu flash`")


def _stop(bench: Bench) -> Finding:
    _ready(bench)
    box = bench.box
    low, high = min(_stations(bench)), max(_stations(bench))
    _move(bench, low)
    box.move(high, _SWEEP_DEG_S)
    for _ in box.listen(1.0):
        pass
    box.release()
    for _ in box.listen(_STOP_S):
        pass
    first = box.message("WheelServo")
    for _ in box.listen(_STOP_S):
        pass
    last = box.message("WheelServo")
    went = abs(last.number("edges") - first.number("edges"))
    is_off = first["pulse_hus"] == 0 and last["pulse_hus"] == 0
    moving = box.request("WheelRequest", count=2)["phase"] == "MOVING"
    measured = (
        f"after {_STOP_S:g} s: {'no pulses' if is_off else 'pulses go on'}, then {went} edges "
        f"passed in {_STOP_S:g} s"
    )
    passed = is_off and not moving and went <= _STILL_EDGES
    return judged(passed, measured, "the supply switch of the servo (A2, Q1), or the firmware")


def _feedback(bench: Bench) -> Finding:
    if not bench.box.message("Capabilities")["feedback"]:
        raise CannotTellError("none is fitted (parameter feedback_ddeg_fs is 0)")
    _ready(bench)
    sigma = max(one.state.sigma_deg or np.inf for one in (_move(bench, 91.0), _move(bench, 17.0)))
    limit = bench.params()["feedback_error_cdeg"] * _CDEG / 3
    measured = f"comb and feedback agree; sigma {sigma:.2f}°"
    step = "feedback_zero_level and feedback_ddeg_fs are not those of this servo"
    return judged(sigma <= limit + 0.01, measured, step, sigma_deg=sigma)


_HOMED = ("wheel-home",)
_DRIVEN = ("wheel-home", "wheel-angles")
_README = "firmware/README.md"
CHECKS = (
    Check(
        "wheel-home", "Does the wheel find its comb and stop at 0°?", f"0° ± {_AT_DEG:g}°",
        Source(_README, "checks\ntheir distances, derives the servo's zero from them, and goes to"),
        _home, Group.MOVES, ("versions", "supply"),
        ("INDEX_NEVER", "INDEX_ALWAYS", "INDEX_PATTERN", "INDEX_NOISE"),
    ),
    Check(
        "wheel-angles", "Does the wheel reach each angle?",
        f"within {_AT_DEG:g}°, sigma up to {_SIGMA_DEG:g}°, and the edges that belong to it",
        Source(_README, "sigma is 0.6°; elsewhere it is up to 1.2°"), _angles, Group.MOVES, _HOMED,
        ("WHEEL_STUCK", "WHEEL_TOO_FAST"),
    ),
    Check(
        "wheel-time", "Does it settle in the time that its parameters say?",
        f"within {_TIME_S:g} s",
        Source(_README, "45° take 0.6 s; 180° back to 0° take 1.2 s"), _time, Group.MOVES, _HOMED,
        ("WHEEL_SLOW",),
    ),
    Check(
        "wheel-sweep", "Does it turn as fast as it was told?", f"within {100 * _SWEEP_SHARE:g} %",
        Source(_README, "the wheel travels at the slew limit"), _sweep, Group.MOVES, _DRIVEN,
    ),
    Check(
        "wheel-repeat", "Does it come back to the same place, from either side?",
        f"the servo stands within {_REPEAT_DEG:g}° of the wheel",
        Source(_README, "At least two of these edges must agree within 1°"), _repeat, Group.MOVES,
        _HOMED, ("WHEEL_SLIP",),
    ),
    Check(
        "wheel-ends", "Does it stay within its ends?", "beyond them refused; pulses within limits",
        Source("proto/mcu.md", "a value out of range with a `Result` that says so"), _ends,
        Group.MOVES, _DRIVEN,
    ),
    Check(
        "wheel-stop", "Does it stop when it is told to?",
        f"no pulses {_STOP_S:g} s later, and no more than {_STILL_EDGES} edge after that",
        Source("proto/mcu.dbc", "RELEASE lets the servo go"), _stop, Group.MOVES, _DRIVEN,
    ),
    Check(
        "feedback", "Do the feedback voltage and the comb agree?", "sigma of feedback_error_cdeg",
        Source(_README, "comb and feedback must agree"), _feedback, Group.MOVES, _DRIVEN,
        ("FEEDBACK_OPEN",),
    ),
)  # fmt: skip
