"""Parameters of the flashed binary: limits, EEPROM with two copies, power cuts at every byte."""

import random
from collections.abc import Callable

import pytest
from lightprobe.mcu import link as mcu_link
from rig import Rig

COUNT = 27
COPY_STRIDE = 256
COPY_BYTES = 3 + 2 * COUNT + 2
MakeRig = Callable[..., Rig]


def names() -> dict[str, int]:
    signal = mcu_link.database().get_message_by_name("ParamValue").get_signal_by_name("param")
    return {str(name): number for number, name in signal.choices.items()}


def read(rig: Rig, name: str) -> int:
    return int(rig.ask("ParamGet", param=names()[name])["value"])


def save(rig: Rig) -> None:
    assert rig.ask("ParamAction", wait_us=1_000_000, action="SAVE")["result"] == "OK"


def eeprom(rig: Rig) -> bytearray:
    return bytearray.fromhex(rig.command("eeprom"))


def restart(rig: Rig) -> None:
    rig.faults.clear()
    rig.command("reset power")
    rig.run(30_000)
    rig.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    rig.run(30_000)


def test_every_parameter_has_a_name_a_value_and_limits(rig: Rig) -> None:
    assert len(names()) == COUNT
    for name, number in names().items():
        value = rig.ask("ParamGet", param=number)
        assert value["param"] == name
        assert value["count"] == COUNT
        assert value["minimum"] <= value["value"] <= value["maximum"]
    assert rig.ask("ParamGet", param=COUNT)["result"] == "OUT_OF_RANGE"


def test_values_out_of_range_are_refused(rig: Rig) -> None:
    for number in range(COUNT):
        limits = rig.ask("ParamGet", param=number)
        for bad in (limits["minimum"] - 1, limits["maximum"] + 1):
            if not -32768 <= bad <= 32767:
                continue
            answer = rig.ask("ParamSet", param=number, value=bad)
            assert answer["result"] == "OUT_OF_RANGE"
        assert rig.ask("ParamGet", param=number)["value"] == limits["value"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("servo_min_us", 2500),
        ("servo_max_us", 500),
        ("wheel_min_cdeg", 18000),
        ("wheel_max_cdeg", 0),
    ],
)
def test_a_minimum_must_lie_below_its_maximum(rig: Rig, name: str, value: int) -> None:
    before = read(rig, name)
    answer = rig.ask("ParamSet", param=names()[name], value=value)
    assert answer["result"] == "OUT_OF_RANGE"
    assert read(rig, name) == before


def copy_of(values: list[int], generation: int = 1) -> bytes:
    """One copy in the EEPROM, as firmware/params.h says."""
    head = bytes([1, generation, len(values)])
    body = head + b"".join(v.to_bytes(2, "little", signed=True) for v in values)
    return body + mcu_link.crc16(body).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("lag_ms", 41, set()),
        ("lag_ms", 501, {"PARAMS_LOST"}),
        ("servo_min_us", 2600, {"PARAMS_LOST"}),
    ],
)
def test_stored_values_that_are_not_allowed_are_not_used_in_part(
    rig: Rig, name: str, value: int, fault: set[str]
) -> None:
    """A whole copy of a firmware with other limits: all of it or nothing, and said so."""
    values = [int(rig.ask("ParamGet", param=n)["value"]) for n in range(COUNT)]
    defaults = dict(zip(names(), values, strict=True))
    values[names()["settle_ms"]] = 150
    values[names()[name]] = value
    rig.command("eeprom " + copy_of(values).hex())
    restart(rig)
    assert set(rig.faults) == fault
    expected = defaults if fault else defaults | {"settle_ms": 150, name: value}
    assert {n: read(rig, n) for n in ("settle_ms", name)} == {
        n: expected[n] for n in ("settle_ms", name)
    }
    restart_faults = set(rig.faults)
    rig.clear_faults()
    rig.ask("ParamAction", action="RELOAD")
    rig.run(30_000)
    assert set(rig.faults) == restart_faults


def stored_values(rig: Rig, copy: int) -> list[int]:
    """All values of one copy in the EEPROM, also those that this firmware does not know."""
    content = eeprom(rig)[copy * COPY_STRIDE :]
    values = content[3 : 3 + 2 * content[2]]
    body = content[: 3 + len(values)]
    assert content[len(body) : len(body) + 2] == mcu_link.crc16(bytes(body)).to_bytes(2, "little")
    return [
        int.from_bytes(values[k : k + 2], "little", signed=True) for k in range(0, len(values), 2)
    ]


@pytest.mark.parametrize("more", [1, 30])
def test_parameters_of_a_newer_firmware_are_used_as_far_as_known_and_all_kept(
    rig: Rig, more: int
) -> None:
    """After a downgrade: the calibration holds, and a save does not take the rest away."""
    values = [int(rig.ask("ParamGet", param=n)["value"]) for n in range(COUNT)]
    values[names()["lag_ms"]] = 41
    newer = list(range(7, 7 + more))
    rig.command("eeprom " + copy_of([*values, *newer]).hex())
    restart(rig)
    assert not rig.faults
    assert read(rig, "lag_ms") == 41
    for copy, lag_ms in ((1, 42), (0, 43), (1, 44)):
        rig.param("lag_ms", lag_ms)
        save(rig)
        values[names()["lag_ms"]] = lag_ms
        assert stored_values(rig, copy) == [*values, *newer]
    restart(rig)
    assert not rig.faults
    assert read(rig, "lag_ms") == 44
    rig.ask("ParamAction", action="DEFAULTS")
    save(rig)
    assert len(stored_values(rig, 0)) == COUNT


def test_a_blank_chip_has_defaults_and_no_fault(rig: Rig) -> None:
    rig.run(50_000)
    assert not rig.faults
    assert read(rig, "lag_ms") == 30


def test_saved_values_survive_a_power_cycle_and_unsaved_do_not(rig: Rig) -> None:
    rig.param("lag_ms", 41)
    save(rig)
    rig.param("lag_ms", 42)
    restart(rig)
    assert read(rig, "lag_ms") == 41
    assert not rig.faults
    assert rig.status()["CountersWork"]["params_generation"] == 1


def test_reload_and_defaults(rig: Rig) -> None:
    rig.param("lag_ms", 41)
    save(rig)
    rig.param("lag_ms", 42)
    rig.ask("ParamAction", action="RELOAD")
    assert read(rig, "lag_ms") == 41
    rig.ask("ParamAction", action="DEFAULTS")
    assert read(rig, "lag_ms") == 30


def test_changing_the_geometry_makes_the_wheel_unknown(homed: Rig) -> None:
    homed.param("comb_first_cdeg", -1650)
    homed.run(50_000)
    assert homed.phase() == "UNKNOWN"
    assert homed.start_move(90) == "NOT_HOMED"


def test_set_while_saving_is_refused(rig: Rig) -> None:
    rig.param("lag_ms", 41)
    rig.send("ParamAction", action="SAVE")
    rig.run(20_000)
    answer = rig.ask("ParamSet", param=names()["lag_ms"], value=50)
    assert answer["result"] == "BUSY"
    rig.run(500_000)
    restart(rig)
    assert read(rig, "lag_ms") == 41


def test_the_wheel_and_the_link_go_on_while_saving(homed: Rig) -> None:
    homed.param("settle_ms", 80)
    homed.home()
    homed.send("ParamAction", action="SAVE")
    homed.move(90)
    assert homed.phase() == "SETTLED"


@pytest.mark.parametrize("generation", [1, 2])
def test_a_power_cut_at_any_byte_leaves_all_old_or_all_new(
    make_rig: MakeRig, generation: int
) -> None:
    """Cut while each byte of a save is being written; that byte is then garbage."""
    rig = make_rig()
    for saves in range(generation):
        rig.param("lag_ms", 40 + saves)
        rig.param("settle_ms", 140 + saves)
        save(rig)
    old = (40 + generation - 1, 140 + generation - 1)
    new = (77, 177)
    before = eeprom(rig)
    start = COPY_STRIDE * (generation % 2)
    rig.param("lag_ms", new[0])
    rig.param("settle_ms", new[1])
    save(rig)
    after = eeprom(rig)
    written = [k for k in range(len(after)) if after[k] != before[k]]
    assert set(written) <= set(range(start, start + COPY_BYTES))
    assert len(written) > (50 if generation == 1 else 4)
    for address in written:
        rig.command("eeprom " + before.hex())
        restart(rig)
        rig.param("lag_ms", new[0])
        rig.param("settle_ms", new[1])
        rig.send("ParamAction", action="SAVE")
        rig.command(f"cut {address}")
        rig.faults.clear()
        rig.run(30_000)
        rig.ask("Rates", ring_scans=0, wheel_ms=0, counters_ms=0)
        rig.run(30_000)
        values = (read(rig, "lag_ms"), read(rig, "settle_ms"))
        assert values in (old, new), f"cut at byte {address}"
        assert set(rig.faults) <= {"PARAMS_COPY_LOST"}


#: Its header, a value, the last byte of its CRC.
PLACES = [0, 1, 2, 3 + 2 * 9, COPY_BYTES - 1]


@pytest.mark.parametrize("place", PLACES)
def test_a_save_that_a_worn_cell_spoils_is_told_and_the_other_copy_stays(
    rig: Rig, place: int
) -> None:
    rig.param("lag_ms", 41)
    save(rig)
    before = eeprom(rig)
    address = COPY_STRIDE + place
    assert before[address] == 0xFF  # all bits are worn: it stays erased
    rig.command(f"worn {address} 255")
    rig.param("lag_ms", 42)
    for _ in range(2):
        answer = rig.ask("ParamAction", wait_us=1_000_000, action="SAVE")
        assert (answer["result"], answer["detail"]) == ("NOT_STORED", address)
        assert eeprom(rig)[:COPY_STRIDE] == before[:COPY_STRIDE]
        rig.run(30_000)
        assert set(rig.faults) == {"PARAMS_COPY_LOST"}
        assert rig.status()["CountersWork"]["params_generation"] == 1
    assert read(rig, "lag_ms") == 42  # until the next start
    restart(rig)
    assert read(rig, "lag_ms") == 41


def test_a_save_on_a_blank_chip_goes_on_to_the_copy_whose_cells_are_sound(rig: Rig) -> None:
    rig.command("worn 21 1")
    rig.param("lag_ms", 40)
    rig.param("settle_ms", 140)
    answer = rig.ask("ParamAction", wait_us=1_000_000, action="SAVE")
    assert (answer["result"], answer["detail"]) == ("NOT_STORED", 21)
    save(rig)
    restart(rig)
    assert (read(rig, "lag_ms"), read(rig, "settle_ms")) == (40, 140)


def test_one_corrupt_byte_anywhere_costs_at_most_one_copy(rig: Rig) -> None:
    rng = random.Random(8)
    for value in (41, 42):
        rig.param("lag_ms", value)
        save(rig)
    whole = eeprom(rig)
    for copy, other_value in ((0, 42), (1, 41)):
        for at in rng.sample(range(COPY_BYTES), 12):
            broken = bytearray(whole)
            broken[copy * COPY_STRIDE + at] ^= rng.randrange(1, 256)
            rig.command("eeprom " + broken.hex())
            restart(rig)
            assert set(rig.faults) == {"PARAMS_COPY_LOST"}, (copy, at)
            assert read(rig, "lag_ms") == other_value


def test_both_copies_corrupt_is_a_named_fault_with_defaults(rig: Rig) -> None:
    for value in (41, 42):
        rig.param("lag_ms", value)
        save(rig)
    broken = eeprom(rig)
    broken[5] ^= 1
    broken[COPY_STRIDE + 5] ^= 1
    rig.command("eeprom " + broken.hex())
    restart(rig)
    assert set(rig.faults) == {"PARAMS_LOST"}
    assert read(rig, "lag_ms") == 30
    rig.home()  # the comb proves the angle all the same
    assert rig.phase() == "SETTLED"
    save(rig)
    restart(rig)
    assert set(rig.faults) <= {"PARAMS_COPY_LOST"}


def test_wrong_parameters_never_give_a_wrong_angle(rig: Rig) -> None:
    """A gain that is 15 % off, as after a mix-up of boards: a fault, or the truth."""
    rig.param("servo_gain_ns_deg", 6300)
    rig.home()
    for target in (45, 90, 180):
        if rig.phase() != "SETTLED":
            break
        rig.move(target)
        if rig.phase() == "SETTLED":
            off = abs(rig.get("wheel_deg") - rig.wheel.measured_deg)
            assert off <= 3 * rig.wheel.sigma_deg
    assert rig.phase() == "FAULT"
    assert set(rig.faults) <= {"WHEEL_SLOW", "WHEEL_SLIP", "WHEEL_STUCK", "INDEX_PATTERN"}
