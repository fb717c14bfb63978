"""Checks of the conversation: versions, identity, answers, damaged messages, parameters."""

from __future__ import annotations

import random
from contextlib import suppress

from lightprobe.hil.bench import Bench
from lightprobe.hil.check import Check, Finding, Group, Source, judged
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import CanFrame, McuError, Raw

_ANSWER_S, _TWICE_S = 1.0, 0.15  # for an answer, and for a second one that there must not be
_TRIES = 3
_REPEATS = 3
_WINDOWS_US = {50: 10_000, 60: 8_330}
_SPARE = "hold_max_ds"  # a parameter that changes nothing while the servo is off


# ---------------------------------------------------------------- versions, identity


def _versions(bench: Bench) -> Finding:
    hello = bench.box.greeting
    assert hello is not None
    major, minor = hello.number("protocol_major"), hello.number("protocol_minor")
    ours = (mcu.PROTOCOL_MAJOR, mcu.PROTOCOL_MINOR)
    firmware = ".".join(str(hello[f"firmware_{part}"]) for part in ("major", "minor", "patch"))
    newer = (major, minor) > ours
    step = "install a newer lightprobe" if newer else "flash this release: `lightprobe mcu flash`"
    measured = f"protocol {major}.{minor}, firmware {firmware}"
    return judged((major, minor) == ours, measured, step)


def _identity(bench: Bench) -> Finding:
    facts = bench.box.message("Capabilities")
    params = bench.params()
    window_us = facts.number("window_scans") * facts.number("scan_us")
    wrong = []
    if facts["carrier"] != bench.box.wire.kind:
        wrong.append("the strap at A3 chooses another carrier than the one that is used")
    if facts["ring_sensors"] != 9:
        wrong.append("the firmware reads another number of sensors than nine: flash it again")
    if window_us != _WINDOWS_US.get(params.get("mains_hz", 0)):
        wrong.append("the averaging time does not belong to mains_hz: flash it again")
    wheel = (facts.number("wheel_min_cdeg"), facts.number("wheel_max_cdeg"))
    if wheel != (params.get("wheel_min_cdeg"), params.get("wheel_max_cdeg")):
        wrong.append("the range of the wheel is not that of its parameters: flash it again")
    measured = (
        f"{facts['carrier']}, {facts['ring_sensors']} sensors, {window_us / 1000:g} ms, "
        f"wheel {wheel[0] / 100:g}…{wheel[1] / 100:g}°"
    )
    return judged(not wrong, measured, "; ".join(wrong))


# ---------------------------------------------------------------- answers

#: Requests that change nothing: message, signals, what must answer, and with which result.
_QUERIES: tuple[tuple[str, dict[str, int | str], str, str], ...] = (
    ("HelloRequest", {"protocol_major": 1, "protocol_minor": 0}, "Hello", ""),
    ("TimeRequest", {"count": 77}, "TimeReply", ""),
    ("ParamGet", {"param": 0}, "ParamValue", ""),
    ("StatusRequest", {"count": 0}, "Result", "OK"),
    ("WheelRequest", {"count": 78}, "WheelReply", ""),
    ("ParamGet", {"param": 255}, "Result", "OUT_OF_RANGE"),
    ("ParamSet", {"param": 0, "value": -32768}, "Result", "OUT_OF_RANGE"),
)
#: Messages that are whole but make no sense: what they are, id, payload, the answer.
_NONSENSE = (
    ("an unknown id", 0x3F, b"\1\2\3", "UNKNOWN_ID"),
    ("a message that is too short", 0x02, b"\0", "BAD_LENGTH"),
    ("a message that is too long", 0x06, bytes(8), "BAD_LENGTH"),
    ("an action that there is not", 0x03, bytes([1, 7]), "OUT_OF_RANGE"),
)


def _queries(bench: Bench) -> Finding:
    asked, wrong = 0, []
    for name, signals, answer, result in _QUERIES:
        message_id, payload = mcu.encode(name, **signals)
        asked += 1
        if not _answered_once(bench, message_id, payload, answer, result):
            wrong.append(name if not result or result == "OK" else f"{name} out of range")
    for what, message_id, payload, result in _NONSENSE:
        asked += 1
        if not _answered_once(bench, message_id, payload, "Result", result):
            wrong.append(what)
    measured = f"{asked - len(wrong)} of {asked} answered exactly once, and right"
    if wrong:
        measured += f"; not: {', '.join(wrong)}"
    step = "the firmware is not that of this release, or damaged: `lightprobe mcu flash`"
    return judged(not wrong, measured, step)


def _answered_once(bench: Bench, message_id: int, payload: bytes, answer: str, result: str) -> bool:
    """Send once, and again where nothing came: the wire may have lost it, or the host slept."""
    box = bench.box

    def answers(one: mcu.Event) -> bool:
        return isinstance(one, mcu.Message) and (
            one.name == answer or (one.name == "Result" and one["request"] == message_id)
        )

    for sent in range(1, _TRIES + 1):
        box.put(message_id, payload)
        first = next((one for one in box.listen(_ANSWER_S) if answers(one)), None)
        if first is None:
            continue
        more = [one for one in box.listen(_TWICE_S) if answers(one)]
        assert isinstance(first, mcu.Message)
        is_right = first.name == answer and (not result or first["result"] == result)
        return is_right and 1 + len(more) <= sent
    return False


# ---------------------------------------------------------------- damage


def damaged(kind: str) -> list[tuple[str, Raw]]:
    """Messages that the box must drop and count, by what is wrong with them."""
    message_id, payload = mcu.encode("TimeRequest", count=99)
    if kind == "CAN":
        identifier = mcu_link.CAN_BASE + message_id
        return [("remote frame", CanFrame(identifier, b"", remote=True))]
    envelope = mcu_link.pack_envelope(message_id, payload)
    body, crc = envelope[:-2], envelope[-2:]
    other_sum = body[:-1] + bytes([body[-1] ^ 0x55])
    wrong = [
        ("wrong CRC", body + bytes([crc[0] ^ 1, crc[1]])),
        ("wrong sum, right CRC", other_sum + mcu_link.crc16(other_sum).to_bytes(2, "little")),
        ("cut", envelope[:-2]),
        ("garbage", random.Random(1).randbytes(9)),
    ]
    if kind == "I2C":
        good = mcu_link.i2c_mail(message_id, payload)
        raw: list[tuple[str, Raw]] = [(name, bytes([len(one)]) + one) for name, one in wrong]
        lengths = [
            ("shorter than it says", good[:-1]), ("longer than it says", good + b"\0"),
            ("another length", bytes([good[0] + 1]) + good[1:]), ("no length", b"\0"),
            ("length beyond the longest", b"\xff" * 13),
        ]  # fmt: skip
        return [*raw, *lengths]
    raw = [(name, mcu_link.cobs_encode(one) + b"\0") for name, one in wrong]
    return [*raw, ("oversized", b"\1" * 60 + b"\0"), ("a block that overruns", b"\x09\1\2\0")]


def _framing(bench: Bench) -> Finding:
    box = bench.box
    kinds = damaged(box.wire.kind)
    wrong = []
    for name, raw in kinds:
        before = box.message("CountersLink").number("rx_bad")
        taken = False
        for _ in range(_REPEATS):  # the wire may damage, or lose, one of them itself
            with suppress(OSError):  # a slave need not acknowledge what it does not want
                box.wire.send_raw(raw)
            events = list(box.listen(0.03))
            taken |= any(isinstance(e, mcu.Message) and e.name == "TimeReply" for e in events)
        if not box.answers():
            wrong.append(f"{name}: deaf after it")
            break
        counted = (box.message("CountersLink").number("rx_bad") - before) % 65536
        if taken:
            wrong.append(f"{name}: taken as good")
        elif not counted:
            wrong.append(f"{name}: not counted")
    measured = f"{len(kinds)} kinds of damage, {_REPEATS} times each: " + (
        "; ".join(wrong) or "all dropped and counted"
    )
    step = "the firmware is not that of this release, or damaged: `lightprobe mcu flash`"
    return judged(not wrong, measured, step)


# ---------------------------------------------------------------- parameters


def _parameters(bench: Bench) -> Finding:
    found = [name for name in bench.box.latched() if name.startswith("PARAMS")]
    names = bench.params()
    first, second = bench.box.params(), bench.box.params()
    differ = [
        one.name for one, other in zip(first, second, strict=True)
        if one != other or names.get(one.name) != one.value
    ]  # fmt: skip
    outside = [one.name for one in first if not one.minimum <= one.value <= one.maximum]
    measured = f"{len(first)} parameters read three times"
    steps = []
    if found:
        measured += f"; {', '.join(found)}"
        steps.append("the stored ones were lost: calibrate and save again, or keep the defaults")
    if differ:
        measured += f"; not the same each time: {', '.join(differ)}"
        steps.append("the chip's memory is unsafe: measure the supply, then replace the Nano")
    if outside:
        measured += f"; outside of their limits: {', '.join(outside)}"
        steps.append("`lightprobe mcu params defaults`, then calibrate and save again")
    known = len(mcu.param_names())
    if len(first) != known:
        measured += f"; this program knows {known}"
        steps.append("flash this release: `lightprobe mcu flash`")
    return judged(not steps, measured, "; ".join(steps))


def _settings(bench: Bench) -> Finding:
    number = {name: k for k, name in mcu.param_names().items()}[_SPARE]
    before = bench.box.param(number)
    other = before.value - 1 if before.value > before.minimum else before.value + 1
    wrong = []
    try:
        bench.change(number, other)
        if bench.box.param(number).value != other:
            wrong.append("it does not keep what it was told")
        bench.change(number, before.value)
        if bench.box.param(number).value != before.value:
            wrong.append("it does not go back")
        try:
            bench.change(number, before.maximum + 1)
            wrong.append("it takes a value above its limit")
        except McuError as error:
            if "OUT_OF_RANGE" not in str(error):
                raise
    except McuError as error:
        if "no answer" not in str(error):
            raise
        wrong.append("no answer told the value that was set")
    measured = f"{_SPARE} {before.value} → {other} → {before.value}" + (
        f": {'; '.join(wrong)}" if wrong else ", read back each time"
    )
    return judged(not wrong, measured, "the firmware is damaged: `lightprobe mcu flash`")


_ONE_ANSWER = Source("proto/mcu.md", "Every request gets exactly one `Result`, `ParamValue`")
CHECKS = (
    Check(
        "versions", "Do firmware and this program speak the same protocol?",
        f"protocol {mcu.PROTOCOL_MAJOR}.{mcu.PROTOCOL_MINOR}",
        Source("proto/mcu.dbc", "Host's version. Answer: Hello, Capabilities."), _versions,
    ),
    Check(
        "identity", "Is it the box that it should be: carrier, sensors, averaging, range?",
        "carrier as used, 9 sensors, one period of the lamps' flicker, range of the parameters",
        Source("proto/mcu.dbc", "Scans averaged: one period of the lamps' flicker."), _identity,
        needs=("versions",),
    ),
    Check(
        "queries", "Is every request answered once, and nonsense refused?",
        "one answer each", _ONE_ANSWER, _queries, needs=("versions",),
    ),
    Check(
        "framing", "Are damaged messages dropped and counted, and does it go on after each?",
        "all dropped, all counted, an answer after each",
        Source("proto/mcu.md", "A receiver accepts a message only if CRC, sum, id and length"),
        _framing, needs=("versions",),
    ),
    Check(
        "parameters", "Are all parameters within their limits, and the same at each reading?",
        "the same three times, within their limits",
        Source("firmware/README.md", "Names, limits and defaults: `params.h`."), _parameters,
        needs=("versions",), faults=("PARAMS_LOST", "PARAMS_COPY_LOST"),
    ),
)  # fmt: skip
SETTING = (
    Check(
        "settings", "Does a parameter take a value, keep it, and refuse one beyond its limit?",
        "what was set is read back",
        Source("proto/mcu.dbc", "Refused outside ParamValue.minimum..maximum"), _settings,
        Group.MOVES, needs=("parameters",),
    ),
)  # fmt: skip
