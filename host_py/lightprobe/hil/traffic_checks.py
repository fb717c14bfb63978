"""Checks of some seconds of traffic: what is lost, how late answers are, how clocks agree."""

from __future__ import annotations

import numpy as np

from lightprobe.hil.bench import Bench
from lightprobe.hil.check import CannotTellError, Check, Finding, Source, judged
from lightprobe.hil.recording import Recording

#: Share of messages that a wire as short as a box's may damage or lose: one in 2000.
_LOSS = 0.0005
_LATENCY_MS = 100.0
_QUANTILE = 99.0
#: A Nano has a ceramic resonator (0.5 %), and a serial line bears 2 % of both sides together.
_CLOCK_PPM = 10_000.0
_STEP_US = 150.0
_SHORT_S = 2.0  # too little to compare clocks
_LINK_FAULTS = ("CAN_ABSENT", "CAN_BUS_OFF", "I2C_BUS")


def _line(bench: Bench) -> Finding:
    found = bench.recording()
    latched = [name for name in bench.box.latched() if name in _LINK_FAULTS]
    messages = 3 * len(found.levels) + 2 * len(found.exchanges)
    bad_box = found.counters["rx_bad"] + found.counters["rx_overrun"]
    dropped = found.counters["tx_dropped"] + found.counters["ring_dropped"]
    lost = found.rings_lost + found.unanswered
    damaged = found.bad_here + bad_box
    trouble = damaged + dropped + lost
    measured = (
        f"of {messages} messages in {found.seconds:g} s: {found.bad_here} came damaged, the box "
        f"dropped {bad_box} of ours and {dropped} of its own, {lost} rings or answers are missing"
    )
    if latched:
        measured += f"; {', '.join(latched)}"
    if damaged:
        step = (
            "bytes change on the wire: shorter cable, common ground, away from the servo's wires; "
            "on I2C the pull-ups, on CAN the terminators"
        )
    elif dropped:
        step = "the host reads too slowly: end other programs that use the port, or the processor"
    else:
        step = "whole messages are lost: plug, USB hub, or another program that reads the port"
    enough = len(found.levels) > 0 and not latched
    return judged(
        enough and trouble <= _LOSS * messages, measured, step,
        damaged=damaged, dropped=dropped, lost=lost, messages=messages,
    )  # fmt: skip


def _latency(bench: Bench) -> Finding:
    found = bench.recording()
    times_ms = found.latencies_ms
    if not len(times_ms):
        raise CannotTellError("no question was answered")
    bench.series["latency_ms"] = times_ms.tolist()
    middle, late = np.percentile(times_ms, [50, _QUANTILE])
    inside_ms = max(one.turnaround_us for one in found.exchanges) / 1000
    measured = (
        f"median {middle:.1f} ms, {_QUANTILE:g} % within {late:.1f} ms, longest "
        f"{times_ms.max():.1f} ms, of which the firmware took {inside_ms:.1f} ms at most"
    )
    step = (
        "the firmware itself is slow: flash it again" if inside_ms > late / 2
        else "the way is slow: a USB adapter's latency timer, a hub, or a busy host"
    )  # fmt: skip
    return judged(
        bool(late <= _LATENCY_MS), measured, step,
        median_ms=float(middle), p99_ms=float(late), longest_ms=float(times_ms.max()),
    )  # fmt: skip


def _clock(bench: Bench) -> Finding:
    found = bench.recording()
    if found.seconds < _SHORT_S:
        raise CannotTellError(f"that takes {_SHORT_S:g} s or more: --seconds")
    ppm = drift_ppm(found)
    steps_us = np.diff(found.t_us)
    windows = np.rint(steps_us / found.window_us) if found.window_us else steps_us
    off_us = float(np.max(np.abs(steps_us - windows * found.window_us))) if len(steps_us) else 0.0
    forward = bool(np.all(steps_us > 0))
    measured = (
        f"the box's clock differs by {ppm / 1e4:+.2f} % from the host's; rings are "
        f"{off_us:.0f} µs off their period at most"
    )
    if not forward:
        measured += "; time stamps went back"
    if abs(ppm) > _CLOCK_PPM:
        step = "the Nano's resonator is off: another Nano; angles and times are wrong by as much"
    else:
        step = "the firmware takes rings too late: `lightprobe mcu flash`"
    passed = abs(ppm) <= _CLOCK_PPM and off_us <= _STEP_US and forward
    return judged(passed, measured, step, drift_ppm=ppm, worst_step_us=off_us)


def drift_ppm(found: Recording) -> float:
    """How much faster the box's clock runs, by the quickest exchanges of both ends."""
    stamped = [one for one in found.exchanges if one.received_ns and one.t_rx_us is not None]
    half = len(stamped) // 3
    if half < 2:
        raise CannotTellError("too few answers were stamped")
    ends = []
    for part in (stamped[:half], stamped[-half:]):
        best = min(part, key=lambda one: (one.received_ns or 0) - one.sent_ns)
        ends.append((best.sent_ns / 1000, float(best.t_rx_us or 0)))
    (host_0, box_0), (host_1, box_1) = ends
    return 1e6 * (((box_1 - box_0) % (1 << 32)) / (host_1 - host_0) - 1)


CHECKS = (
    Check(
        "line", "Are messages damaged, dropped or lost?",
        f"at most one in {round(1 / _LOSS)}",
        Source("proto/mcu.md", "The CRC alone detects all bursts of up to 16"), _line,
        needs=("versions",), faults=_LINK_FAULTS,
    ),
    Check(
        "latency", "How long does an answer take?",
        f"{_QUANTILE:g} % within {_LATENCY_MS:g} ms",
        Source("proto/mcu.md", "the host repeats a request that was not answered"), _latency,
        needs=("versions",),
    ),
    Check(
        "clock", "Does the box's clock run as the host's, and do rings come in step?",
        f"within {_CLOCK_PPM / 1e4:g} %; steps within {_STEP_US:g} µs",
        Source("firmware/README.md", "The firmware offers one sample per period"), _clock,
        needs=("versions",),
    ),
)  # fmt: skip
