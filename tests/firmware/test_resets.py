"""Resets of the flashed binary: what caused them, and that nothing is assumed after one."""

from collections.abc import Callable

import pytest
from lightprobe.mcu import messages as mcu
from rig import BOOT_US, RELATIVE_JUMP_TO_ITSELF, Rig, symbols

MakeRig = Callable[..., Rig]
NONE, ATMEGABOOT, OPTIBOOT_4_4, OPTIBOOT_4_6, OPTIBOOT_7 = range(5)  # board/host/boot.h
MAIN_LOOP = "board_index"  # called in every round of it, and by no interrupt


def hellos(rig: Rig, us: int) -> list[mcu.Message]:
    events = [item.event for item in rig.run(us)]
    return [e for e in events if isinstance(e, mcu.Message) and e.name == "Hello"]


def test_hello_every_second_until_the_host_has_set_rates(make_rig: MakeRig) -> None:
    rig = make_rig(hello=False)
    assert len(hellos(rig, 3_500_000)) == 4
    rig.ask("Rates", ring_scans=0, wheel_ms=0, counters_ms=0)
    assert hellos(rig, 2_500_000) == []
    rig.set(boot_loader=NONE)
    rig.command("reset external")
    (hello,) = hellos(rig, 500_000)
    assert hello["reset_cause"] == "EXTERNAL"
    assert hello["boot_count"] == 2


def test_nothing_streams_after_a_reset(rig: Rig) -> None:
    rig.ask("Rates", ring_scans=2, wheel_ms=10, counters_ms=100)
    assert len(rig.run(100_000)) > 20
    seen = rig.reset() + rig.run(900_000)
    names = {getattr(item.event, "name", type(item.event).__name__) for item in seen}
    assert names == {"Hello"}


def hang(rig: Rig, function: str) -> None:
    """Let a function of the program become an endless loop until the watchdog bites; mend it."""
    where = symbols()[function]
    resets = rig.command("resets")
    was = rig.command(f"flash {where} {RELATIVE_JUMP_TO_ITSELF}")
    for _ in range(3000):
        rig.command("run 100")
        if rig.command("resets") != resets:
            break
    else:
        raise AssertionError("the watchdog did not bite within 300 ms")
    rig.command(f"flash {where} {was}")


@pytest.mark.parametrize("loader", [NONE, OPTIBOOT_4_4, OPTIBOOT_4_6, OPTIBOOT_7])
def test_watchdog_bites_a_program_that_hangs(homed: Rig, loader: int) -> None:
    homed.set(boot_loader=loader)
    homed.start_move(180)
    homed.run(200_000)
    hang(homed, MAIN_LOOP)
    homed.faults.clear()
    assert homed.get("powered") == 0
    hello, *_ = hellos(homed, 50_000)
    assert hello["reset_cause"] == "WATCHDOG"
    homed.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    homed.run(50_000)
    assert set(homed.faults) == {"RESET_WATCHDOG"}
    assert homed.phase() == "UNKNOWN"
    homed.clear_faults()
    homed.home()
    assert homed.phase() == "SETTLED"


def test_the_servo_is_released_long_before_the_watchdog_resets(homed: Rig) -> None:
    homed.start_move(180)
    homed.run(200_000)
    homed.command(f"flash {symbols()[MAIN_LOOP]} {RELATIVE_JUMP_TO_ITSELF}")
    resets = homed.command("resets")
    homed.command("run 140000")
    assert homed.get("powered") == 0
    assert homed.command("resets") == resets


def test_a_hang_with_interrupts_off_ends_too_though_nobody_knows_why(homed: Rig) -> None:
    homed.start_move(180)
    homed.run(200_000)
    hang(homed, "board_time_us")  # interrupts call it
    assert homed.get("powered") == 0
    hello, *_ = hellos(homed, 50_000)
    assert hello["reset_cause"] == "UNKNOWN"


def test_the_watchdog_does_not_bite_a_busy_program(homed: Rig) -> None:
    homed.ask("Rates", ring_scans=1, wheel_ms=5, counters_ms=10)
    resets = homed.command("resets")
    homed.ask("ParamAction", wait_us=1_000_000, action="SAVE")
    homed.move(180)
    homed.run(1_000_000)
    assert homed.command("resets") == resets


def test_a_stack_that_grows_into_the_data_resets_and_says_so(homed: Rig) -> None:
    guard = symbols()["__heap_start"]
    homed.start_move(180)
    homed.run(200_000)
    homed.command(f"ram {guard + 15} =00")
    hello, *_ = hellos(homed, 400_000)
    assert hello["reset_cause"] == "STACK"
    homed.faults.clear()
    homed.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    homed.run(50_000)
    assert set(homed.faults) == {"RESET_STACK"}
    assert homed.get("powered") == 0
    assert homed.phase() == "UNKNOWN"


@pytest.mark.parametrize(
    ("loader", "external"),
    [
        (NONE, "EXTERNAL"),
        (ATMEGABOOT, "EXTERNAL"),
        (OPTIBOOT_4_4, "UNKNOWN"),
        (OPTIBOOT_4_6, "UNKNOWN"),
        (OPTIBOOT_7, "EXTERNAL"),
    ],
)
def test_no_boot_loader_makes_the_firmware_name_a_wrong_cause(
    make_rig: MakeRig, loader: int, external: str
) -> None:
    """What the loader leaves in MCUSR and r2, garbage included, is believed where it must be."""
    allowed = {"power": {"POWER_ON"}, "external": {external}, "brownout": {"BROWN_OUT", "UNKNOWN"}}
    for seed in range(6):  # of the garbage
        rig = make_rig(hello=False, seed=seed)
        rig.set(boot_loader=loader)
        for why, causes in allowed.items():
            if why == "brownout":
                rig.set(supply_mv=3300)  # what a stalled servo makes of it
                rig.run(20_000)
                rig.set(supply_mv=4700)
            rig.command(f"reset {why}")
            hello, *_ = hellos(rig, BOOT_US)
            assert hello["reset_cause"] in causes, (why, seed)
        rig.close()


@pytest.mark.parametrize("loader", [NONE, OPTIBOOT_7])
def test_brown_out_and_power_on_are_told_apart(rig: Rig, loader: int) -> None:
    rig.set(boot_loader=loader)
    for why, cause in (("brownout", "BROWN_OUT"), ("power", "POWER_ON")):
        rig.command(f"reset {why}")
        hello, *_ = hellos(rig, 50_000)
        assert hello["reset_cause"] == cause


def test_brown_out_by_r2_is_believed_when_the_supply_was_low(rig: Rig) -> None:
    rig.set(boot_loader=OPTIBOOT_4_6)
    for supply_mv, cause in ((4700, "UNKNOWN"), (3300, "BROWN_OUT")):
        rig.set(supply_mv=supply_mv)
        rig.run(20_000)
        rig.command("reset brownout")
        hello, *_ = hellos(rig, 50_000)
        assert hello["reset_cause"] == cause


def test_the_old_boot_loader_never_comes_back_from_the_watchdog(rig: Rig) -> None:
    """Why the bill of materials and `lightprobe mcu flash` warn of it."""
    rig.set(boot_loader=ATMEGABOOT)
    rig.send("Reset", key=mcu.RESET_KEY)
    assert hellos(rig, 5_000_000) == []
    rig.command("reset power")
    assert hellos(rig, 2_000_000)


def test_a_boot_loader_leaves_when_no_programmer_speaks(rig: Rig) -> None:
    """The daemon's bytes look like a programmer's first words, and go on otherwise."""
    rig.set(boot_loader=OPTIBOOT_7)
    rig.command("reset external")
    rig.run(10_000)
    rig.send_bytes(b"0 ")
    rig.run(10_000)
    rig.send_bytes(b"ab")
    assert hellos(rig, 100_000)


def test_reset_on_request_needs_its_key(homed: Rig) -> None:
    assert homed.ask("Reset", key=0xB006)["result"] == "OUT_OF_RANGE"
    assert homed.phase() == "SETTLED"
    homed.send("Reset", key=mcu.RESET_KEY)
    hello, *_ = hellos(homed, 400_000)
    assert hello["reset_cause"] == "REQUESTED"
    assert not homed.faults
    assert homed.get("powered") == 0


@pytest.mark.parametrize(("major", "refused"), [(1, False), (0, True), (2, True)])
def test_another_protocol_version_is_answered_with_ours(
    rig: Rig, major: int, refused: bool
) -> None:
    rig.send("HelloRequest", protocol_major=major, protocol_minor=7)
    events = [item.event for item in rig.run(20_000)]
    (hello,) = [e for e in events if isinstance(e, mcu.Message) and e.name == "Hello"]
    assert hello["protocol_major"] == 1
    results = [e["result"] for e in events if isinstance(e, mcu.Message) and e.name == "Result"]
    assert results == (["BAD_VERSION"] if refused else [])
