"""Some seconds of the box's life: rings at full rate, and questions for the time in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightprobe.geometry import Array
from lightprobe.hil.box import Box
from lightprobe.mcu import messages as mcu

_ASK_EVERY_NS = 20_000_000
_LATE_S = 0.5
_U32 = 1 << 32


@dataclass
class Exchange:
    """One TimeRequest; `received_ns` is None while no answer has come."""

    count: int
    sent_ns: int
    received_ns: int | None = None
    t_rx_us: int | None = None  # None: it was not stamped
    turnaround_us: int = 0


@dataclass(frozen=True)
class Recording:
    """What came within these seconds."""

    seconds: float
    t_us: Array  # (n,) of the MCU's clock, unwrapped
    levels: Array  # (n, 9)
    dead: tuple[int, ...]  # sensors that were marked as dead in any ring
    supplies_v: Array
    exchanges: tuple[Exchange, ...]
    rings_lost: int
    bad_here: int  # broken frames that the host dropped
    counters: dict[str, int]  # of the box, as they rose meanwhile
    window_us: int

    @property
    def latencies_ms(self) -> Array:
        """From sending a question to its answer, of those that were answered."""
        return np.array(
            [(one.received_ns - one.sent_ns) / 1e6 for one in self.exchanges if one.received_ns]
        )

    @property
    def unanswered(self) -> int:
        """Questions without an answer."""
        return sum(one.received_ns is None for one in self.exchanges)


def record(box: Box, seconds: float) -> Recording:
    """Let rings stream for so long, and ask for the time fifty times a second."""
    before = box.status()
    bad_before = box.wire.bad
    capabilities = before["Capabilities"]
    assert isinstance(capabilities, mcu.Message)
    window = capabilities.number("window_scans")
    rings: list[mcu.Ring] = []
    exchanges: list[Exchange] = []
    box.rates(ring_scans=window)
    for _ in box.listen(_LATE_S):  # until all of before has come, and rings come in step
        pass
    lost_before = box.rings_lost
    end_ns = box.now_ns() + round(1e9 * seconds)
    while (left_ns := end_ns - box.now_ns()) > 0:
        exchanges.append(Exchange(len(exchanges) & 0xFF, box.now_ns()))
        box.send("TimeRequest", count=exchanges[-1].count)
        for event in box.listen(min(left_ns, _ASK_EVERY_NS) / 1e9):
            _take(event, box.now_ns(), rings, exchanges)
    rings_lost = box.rings_lost - lost_before
    for event in box.listen(_LATE_S):
        _take(event, box.now_ns(), [], exchanges)
    box.rates()
    bad_here = box.wire.bad - bad_before
    after = box.status()
    t_us = np.array([ring.t_us for ring in rings], dtype=np.float64)
    t_us += _U32 * np.concatenate([[0], np.cumsum(np.diff(t_us) < -_U32 / 2)])[: len(t_us)]
    return Recording(
        seconds=seconds,
        t_us=t_us,
        levels=np.array([ring.levels for ring in rings], dtype=np.float64).reshape(-1, 9),
        dead=tuple(k for k in range(9) if any(ring.dead[k] for ring in rings)),
        supplies_v=np.array([ring.supply_v for ring in rings if ring.supply_v is not None]),
        exchanges=tuple(exchanges),
        rings_lost=rings_lost,
        bad_here=bad_here,
        counters=risen(before, after),
        window_us=window * capabilities.number("scan_us"),
    )


def risen(before: dict[str, mcu.Event], after: dict[str, mcu.Event]) -> dict[str, int]:
    """How far each of the box's counters has risen between two answers to StatusRequest."""
    rises = {}
    for name in ("CountersLink", "CountersWork"):
        first, last = before[name], after[name]
        assert isinstance(first, mcu.Message)
        assert isinstance(last, mcu.Message)
        for key in first.signals:
            bits = 8 if key in ("rx_overrun", "rx_unknown", "index_errors") else 16
            rises[key] = (last.number(key) - first.number(key)) % (1 << bits)
    return rises


def _take(event: mcu.Event, now_ns: int, rings: list[mcu.Ring], exchanges: list[Exchange]) -> None:
    if isinstance(event, mcu.Ring):
        rings.append(event)
    elif isinstance(event, mcu.Message) and event.name == "TimeReply":
        for one in reversed(exchanges):
            if one.count == event["count"] and one.received_ns is None:
                one.received_ns = now_ns
                one.t_rx_us = event.number("t_rx_us") if event["stamped"] else None
                one.turnaround_us = event.number("turnaround_us")
                return
