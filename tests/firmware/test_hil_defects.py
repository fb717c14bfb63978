"""`lightprobe hil`: each defect of a box is named by the check that should find it, by no other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hil_wire import Message, RigWire, greeted, replaced
from lightprobe.hil import run as hil
from lightprobe.hil.bench import Bench
from lightprobe.hil.check import Finding, Group, Verdict
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import Raw
from rig import Rig, param_number

MakeRig = Callable[..., Rig]
EVERYTHING = (Group.READ, Group.MOVES, Group.COVER)
SECONDS = 2.0
SPARE = param_number("hold_max_ds")
LUX, COVERED = 300.0, 2.0


@dataclass(frozen=True)
class Defect:
    """What is broken, and which check finds it."""

    name: str
    found_by: str
    make: Callable[[RigWire], None]
    words: str = ""  # that stand in the finding or its next step
    target: str = "host"  # what knows of such a defect: the sources as a process, or the chip alone


def box(**numbers: float) -> Callable[[RigWire], None]:
    """Numbers of the simulated box, from the start."""
    return lambda wire: wire.rig.set(**numbers)


def wire(**numbers: float) -> Callable[[RigWire], None]:
    """What goes wrong on the way."""

    def make(broken: RigWire) -> None:
        for name, value in numbers.items():
            assert hasattr(broken, name)
            setattr(broken, name, value)

    return make


def told(name: str, **signals: int | str) -> Callable[[RigWire], None]:
    """The box says something else."""

    def make(broken: RigWire) -> None:
        broken.change = replaced(name, **signals)

    return make


def at_the_move(number: int, **numbers: float) -> Callable[[RigWire], None]:
    """The box breaks 0.2 s after the host has sent so many moves."""

    def make(broken: RigWire) -> None:
        state = {"moves": 0, "due_us": 0}

        def repair(raw: Raw) -> Raw:
            envelope = mcu_link.cobs_decode(raw[:-1]) if isinstance(raw, bytes) else None
            if envelope and envelope[0] == mcu.encode("WheelMove", token=0, target_cdeg=0,
                                                      slew_ddeg_s=0, hold_ds=0)[0]:  # fmt: skip
                state["moves"] += 1
                if state["moves"] == number:
                    state["due_us"] = broken.now_us() + 200_000
            return raw

        def meanwhile(now_us: int) -> None:
            if state["due_us"] and now_us >= state["due_us"]:
                state["due_us"] = 0
                broken.rig.set(**numbers)

        broken.repair, broken.meanwhile = repair, meanwhile

    return make


def repaired_on_the_way(broken: RigWire) -> None:
    """As if the firmware did not look at the CRC: a wrong one comes right."""

    def repair(raw: Raw) -> Raw:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        if envelope and len(envelope) == 5 and mcu_link.unpack_envelope(envelope) is None:
            return mcu_link.serial_frame(envelope[0], envelope[1:2])
        return raw

    broken.repair = repair


def silent_about_unknown_ids(broken: RigWire) -> None:
    def change(message: Message) -> Message | None:
        found = mcu.decode(*message)
        return None if found.signals.get("result") == "UNKNOWN_ID" else message

    broken.change = change


def answers_twice(broken: RigWire) -> None:
    """Every answer to ParamGet comes again, as from a wire with an echo of the request."""

    def repair(raw: Raw) -> Raw:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        return raw + raw if envelope and envelope[:2] == b"\x07\x00" else raw

    broken.repair = repair


def other_values_each_time(broken: RigWire) -> None:
    """A parameter that reads differently each time."""
    state = {"times": 0}

    def change(message: Message) -> Message:
        found = mcu.decode(*message)
        if found.name == "ParamValue" and found["param"] == "lag_ms":
            state["times"] += 1
            return mcu.encode("ParamValue", **(found.signals | {"value": 30 + state["times"] % 2}))
        return message

    broken.change = change


def takes_no_value(broken: RigWire) -> None:
    """ParamSet has no effect: it arrives as ParamGet."""

    def repair(raw: Raw) -> Raw:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        message = mcu_link.unpack_envelope(envelope) if envelope else None
        if message and mcu.decode(*message).name == "ParamSet" and message[1][0] == SPARE:
            return mcu_link.serial_frame(*mcu.encode("ParamGet", param=message[1][0]))
        return raw

    broken.repair = repair


def reset_after(us: int, why: str) -> Callable[[RigWire], None]:
    """It starts again in the middle, and its boot loader passes the cause on."""

    def make(broken: RigWire) -> None:
        broken.rig.set(boot_loader=4)
        state = {"done": False}

        def meanwhile(now_us: int) -> None:
            if not state["done"] and now_us >= us:
                state["done"] = True
                broken.rig.command(f"reset {why}")

        broken.meanwhile = meanwhile

    return make


def cut_after(us: int) -> Callable[[RigWire], None]:
    """The cable is pulled."""

    def make(broken: RigWire) -> None:
        def repair(raw: Raw) -> Raw | None:
            return raw if broken.now_us() < us else None

        broken.repair = repair
        broken.change = lambda message: message if broken.now_us() < us else None

    return make


def never_releases(broken: RigWire) -> None:
    def repair(raw: Raw) -> Raw:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        message = mcu_link.unpack_envelope(envelope) if envelope else None
        if message and mcu.decode(*message).signals.get("action") == "RELEASE":
            same = mcu_link.serial_frame(*mcu.encode("Rates", ring_scans=0, wheel_ms=20,
                                                     counters_ms=0))  # fmt: skip
            broken.change = replaced("Result", request=message[0])
            return same
        return raw

    broken.repair = repair


def deaf_feedback(broken: RigWire) -> None:
    """A feedback that was fitted and calibrated, and whose wire breaks off."""
    broken.rig.run(30_000)
    broken.rig.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    broken.rig.fit_feedback()
    at_the_move(17, feedback_forced=0)(broken)


def other_moves(
    change: Callable[[dict[str, int | str]], dict[str, int | str]],
) -> Callable[[RigWire], None]:
    """The box does another move than the one it was told."""

    def make(broken: RigWire) -> None:
        def repair(raw: Raw) -> Raw:
            assert isinstance(raw, bytes)
            envelope = mcu_link.cobs_decode(raw[:-1])
            message = mcu_link.unpack_envelope(envelope) if envelope else None
            found = mcu.decode(*message) if message else None
            if not found or found.name != "WheelMove":
                return raw
            return mcu_link.serial_frame(*mcu.encode("WheelMove", **change(found.signals)))

        broken.repair = repair

    return make


def exchanged(a: int, b: int) -> Callable[[RigWire], None]:
    """The wires of two sensors: the finger on one darkens the other."""

    def make(broken: RigWire) -> None:
        broken.seats[a], broken.seats[b] = b, a

    return make


DEFECTS = (
    Defect("older firmware", "versions", told("Hello", protocol_minor=2), "mcu flash"),
    Defect("firmware of another protocol", "versions", told("Hello", protocol_major=2), "newer"),
    Defect("another strap", "identity", told("Capabilities", carrier="CAN"), "strap"),
    Defect("fewer sensors", "identity", told("Capabilities", ring_sensors=8), "nine"),
    Defect("unknown ids are not refused", "queries", silent_about_unknown_ids, "an unknown id"),
    Defect("two answers to one request", "queries", answers_twice, "ParamGet"),
    Defect("CRC is not looked at", "framing", repaired_on_the_way, "wrong CRC: taken as good"),
    Defect("a parameter that changes", "parameters", other_values_each_time, "lag_ms"),
    Defect("a parameter that cannot be set", "settings", takes_no_value, "hold_max_ds"),
    Defect("bytes change on the wire", "line", wire(noise=0.002), "bytes change"),
    Defect("messages are lost", "line", wire(lost=0.02), "whole messages are lost"),
    Defect("the cable is pulled", "line", cut_after(4_000_000), "fell silent"),
    Defect("answers are slow", "latency", wire(late_us=130_000), "the way is slow"),
    Defect("its clock runs 3 % fast", "clock", wire(drift=0.03), "resonator"),
    Defect("a dead sensor", "ring-alive", box(ldr3_forced=0), "sensor 3: its wires"),
    Defect("a shorted sensor", "ring-alive", box(ldr6_forced=1), "sensor 6: solder"),
    Defect("a sensor at its upper end", "ring-range", box(ldr2_lux=90000, ldr1_lux=2000,
                                                          ldr3_lux=2000), "sensor 2"),
    Defect("a noisy sensor", "ring-noise", box(ldr5_noise=0.2), "sensor 5: a loose contact"),
    Defect("a stuck select line", "ring-select", box(select_stuck=2), "S1, PD5"),
    Defect("sensors exchanged", "ring-order", exchanged(1, 6), "sensor 1 and sensor 6"),
    Defect("a sensor that stays as it is", "ring-order", box(ldr4_lux=-1, ldr4_mv=2000),
           "sensor 4: its wires"),
    Defect("a weak supply", "supply", box(supply_mv=3500), "too low"),
    Defect("sensor A of the comb is dead", "wheel-home", box(index_a_forced=0), "INDEX_PATTERN"),
    Defect("a wheel that never turned", "wheel-home", box(stuck=1), "INDEX_"),
    Defect("the wheel gets stuck", "wheel-angles", at_the_move(3, stuck=1), "WHEEL_STUCK"),
    Defect("a slow servo", "wheel-time", at_the_move(2, slow=0.25), "WHEEL_SLOW"),
    Defect("it turns faster than told", "wheel-sweep", other_moves(
        lambda move: move | {"slew_ddeg_s": int(move["slew_ddeg_s"]) * 11 // 10}), "calibrate"),
    Defect("it goes beyond its ends", "wheel-ends", other_moves(
        lambda move: move | {"target_cdeg": min(max(int(move["target_cdeg"]), 0), 18000)}),
        "it took -0.01°; it took 180.01°"),
    Defect("the wheel slips", "wheel-repeat", at_the_move(4, slip_deg=30), "WHEEL_SLIP"),
    Defect("the feedback's wire breaks off", "feedback", deaf_feedback, "FEEDBACK_OPEN"),
    Defect("it does not let the servo go", "wheel-stop", never_releases, "pulses go on"),
    Defect("a brown-out", "starts", reset_after(6_000_000, "brownout"), "supply breaks down",
           "avr"),
    Defect("a reset while the wheel moves", "starts", reset_after(14_000_000, "external"),
           "started again once", "avr"),
)  # fmt: skip


def checked(wire: RigWire, groups: tuple[Group, ...] = EVERYTHING) -> dict[str, Finding]:
    """All checks of a box in an uneven light, whose sensors a finger covers when asked to."""
    rig = wire.rig
    light = {k: rig.get(f"ldr{k}_lux") for k in range(9)}
    light = {k: LUX * (1 + 0.3 * k) if lux == 0 else lux for k, lux in light.items()}

    def cover(sensor: int) -> None:
        rig.set(**{f"ldr{k}_lux": lux for k, lux in light.items()})
        under = wire.seats[sensor] if sensor >= 0 else -1
        if under >= 0 and light[under] > 0:
            rig.set(**{f"ldr{under}_lux": COVERED})

    cover(-1)
    rig.command("run 1500000")
    bench = Bench(greeted(wire), SECONDS, cover)
    return hil.run(bench, hil.choose(groups), lambda check, finding: None)


@pytest.fixture
def make_wire(make_rig: MakeRig) -> Callable[..., RigWire]:
    """A chip on a carrier, without light as yet."""

    def make(carrier: str = "serial", target: str = "avr") -> RigWire:
        rig = make_rig(hello=False, carrier=carrier, target=target)
        rig.set(**{f"ldr{k}_lux": 0 for k in range(9)})
        return RigWire(rig)

    return make


def failed(findings: dict[str, Finding]) -> dict[str, str]:
    return {
        name: f"{one.measured} → {one.next_step}" for name, one in findings.items()
        if one.verdict is Verdict.FAIL
    }  # fmt: skip


@pytest.mark.parametrize("carrier", ["serial", "i2c", "can"])
def test_a_healthy_box_passes_every_check_on_every_carrier(
    make_wire: Callable[..., RigWire], carrier: str
) -> None:
    findings = checked(make_wire(carrier))
    assert failed(findings) == {}
    left_out = {name for name, one in findings.items() if one.verdict is Verdict.SKIPPED}
    assert left_out == {"feedback"}  # none is fitted
    assert list(findings) == [one.name for one in hil.ALL]


def named(wire: RigWire, defect: Defect) -> None:
    defect.make(wire)
    found = failed(checked(wire))
    assert set(found) == {defect.found_by}, found
    assert defect.words in found[defect.found_by]


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda one: one.name)
def test_a_defect_is_named_by_its_check_and_by_no_other(
    make_wire: Callable[..., RigWire], defect: Defect
) -> None:
    named(make_wire(target=defect.target), defect)


@pytest.mark.nightly
@pytest.mark.parametrize("defect", [d for d in DEFECTS if d.target == "host"], ids=lambda d: d.name)
def test_the_same_on_the_flashed_binary(make_wire: Callable[..., RigWire], defect: Defect) -> None:
    named(make_wire(), defect)


@pytest.mark.parametrize("carrier", ["i2c", "can"])
@pytest.mark.parametrize("name", ["a brown-out", "messages are lost"])
def test_other_carriers_tell_of_losses_and_starts_too(
    make_wire: Callable[..., RigWire], carrier: str, name: str
) -> None:
    named(make_wire(carrier), next(one for one in DEFECTS if one.name == name))


def test_every_check_finds_a_defect() -> None:
    """`faults` judges what no other check does: see the next test."""
    assert {one.found_by for one in DEFECTS} | {"faults"} == {one.name for one in hil.ALL}


def test_a_fault_of_the_wheel_is_told_without_moving_it(make_wire: Callable[..., RigWire]) -> None:
    wire = make_wire(target="host")
    wire.rig.run(30_000)
    wire.rig.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    wire.rig.home()
    wire.rig.set(stuck=1)
    wire.rig.move(90)
    found = failed(checked(wire, (Group.READ,)))
    assert set(found) == {"faults"}
    assert "free it" in found["faults"]
    assert wire.rig.phase() == "FAULT"  # nobody has cleared it
