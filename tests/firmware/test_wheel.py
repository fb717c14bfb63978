"""The wheel as the flashed binary turns it: arrival, every fault by its name, safe state."""

import random
from collections.abc import Callable

import pytest
from campaign import Campaign
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from rig import Rig

STATIONS = (45, 90, 135, 180, 60, 0)
MakeRig = Callable[..., Rig]


def test_after_reset_the_angle_is_unknown_and_nothing_moves(rig: Rig) -> None:
    rig.run(300_000)
    assert rig.phase() == "UNKNOWN"
    assert rig.wheel.measured_deg is None
    assert rig.wheel.commanded_deg is None
    assert rig.start_move(90) == "NOT_HOMED"
    assert rig.command("servo").split()[0] == "0"
    assert rig.get("wheel_deg") == 37  # where the box happens to be


def test_homing_finds_the_comb_and_stops_at_zero(homed: Rig) -> None:
    assert homed.wheel.measured_deg == pytest.approx(0)
    assert homed.get("wheel_deg") == pytest.approx(0, abs=1)


@pytest.mark.parametrize("offset_us", [-30, 30])
def test_homing_finds_a_servo_horn_that_sits_some_degrees_off(rig: Rig, offset_us: float) -> None:
    rig.set(servo_zero_us=800 + offset_us)
    rig.home()
    assert rig.phase() == "SETTLED"
    rig.move(90)
    assert rig.get("wheel_deg") == pytest.approx(90, abs=1.2)


def test_moves_arrive_within_their_sigma(homed: Rig) -> None:
    for station in STATIONS:
        homed.move(station)
        assert homed.phase() == "SETTLED", homed.faults
        off = abs(homed.get("wheel_deg") - homed.wheel.measured_deg)
        assert off <= 3 * homed.wheel.sigma_deg
        assert homed.wheel.sigma_deg <= 0.61
        assert homed.wheel.commanded_deg == pytest.approx(station)


def test_times_of_moves_are_as_the_readme_says(homed: Rig) -> None:
    for target, seconds in ((45, 0.6), (90, 0.6), (180, 0.8), (0, 1.2)):
        before_us = int(homed.command("time"))
        homed.move(target)
        took_s = (int(homed.command("time")) - before_us) / 1e6
        print(f"to {target} degrees: {took_s:.2f} s")
        assert took_s == pytest.approx(seconds, abs=0.1)


def test_targets_that_the_comb_cannot_prove_are_refused(homed: Rig) -> None:
    homed.param("wheel_min_cdeg", -2000)
    homed.param("wheel_max_cdeg", 20000)
    homed.home()
    for target in (-15, 190):
        assert homed.start_move(target) == "OUT_OF_RANGE"
    homed.move(-10)
    assert homed.phase() == "SETTLED", homed.faults
    assert homed.get("wheel_deg") == pytest.approx(-10, abs=1.2)


def test_feedback_makes_sigma_smaller_anywhere(rig: Rig) -> None:
    rig.fit_feedback()
    rig.home()
    for target in (17.3, 91.2):
        rig.move(target)
        assert rig.phase() == "SETTLED", rig.faults
        assert rig.wheel.sigma_deg <= 0.34
        off = abs(rig.get("wheel_deg") - rig.wheel.measured_deg)
        assert off <= 3 * rig.wheel.sigma_deg


#: Those that begin the sampling anew.
RING_PARAMETERS = [("mains_hz", 60), ("bandgap_mv", 1090), ("supply_min_mv", 3800)]


@pytest.mark.parametrize(("name", "value"), RING_PARAMETERS)
def test_the_rings_parameters_do_not_disturb_a_wheel_with_feedback(
    rig: Rig, name: str, value: int
) -> None:
    """At rest and on the way, at any moment: no fault, and the angle stays known and true."""
    rig.fit_feedback()
    rig.home()
    rig.move(40)
    rng = random.Random(4)
    former = rig.param_value(name)
    for target in (None, 120, 50):
        if target is not None:
            assert rig.start_move(target) == "OK"
        for k in range(16):
            rig.param(name, (value, former)[k % 2])
            rig.run(rng.randrange(1_000, 30_000))
        rig.run_until(rig.ended, 5_000_000)
        assert rig.phase() == "SETTLED", (target, rig.faults)
        off = abs(rig.get("wheel_deg") - rig.wheel.measured_deg)
        assert off <= 3 * rig.wheel.sigma_deg
    assert not rig.faults


@pytest.mark.parametrize("crooked_deg", [0, 2])
def test_arrival_is_from_below_whatever_the_servo_and_gear(rig: Rig, crooked_deg: float) -> None:
    """With backlash, a wheel that comes from below rests on the lower flank: wheel = shaft."""
    rig.set(backlash_deg=2, servo_crooked_deg=crooked_deg)
    rig.home()
    for target in (90, 45, 180, 135, 30):
        rig.move(target)
        assert rig.phase() == "SETTLED", rig.faults
        assert rig.get("wheel_deg") == pytest.approx(rig.get("shaft_deg"), abs=0.05)
        assert rig.get("wheel_deg") == pytest.approx(target, abs=1.5)


def test_motion_is_slew_limited(homed: Rig) -> None:
    assert homed.start_move(180, slew_deg_s=100) == "OK"
    before = homed.get("wheel_deg")
    for _ in range(10):
        homed.run(100_000)
        after = homed.get("wheel_deg")
        assert after - before < 100 * 0.1 + 3
        before = after
    homed.run_until(homed.ended, 5_000_000)
    assert homed.phase() == "SETTLED"


def test_time_of_settling_is_reported_on_the_mcus_clock(homed: Rig) -> None:
    times: list[mcu.WheelTime] = []
    homed.on_seen = lambda item: (
        times.append(item.event) if isinstance(item.event, mcu.WheelTime) else None
    )
    homed.move(45)
    settled = next(t for t in times if t.phase is mcu.Phase.SETTLED and t.token == homed.token)
    now_us = int(homed.command("time"))
    assert 0 < now_us - settled.t_phase_us < 20_000
    homed.run(500_000)
    last = times[-1]
    assert last.t_phase_us == settled.t_phase_us
    assert last.age_ms == pytest.approx(500, abs=40)


def test_servo_is_released_after_its_hold_and_the_angle_stays_known(homed: Rig) -> None:
    assert homed.start_move(90, hold_s=0.5) == "OK"
    homed.run_until(homed.ended, 5_000_000)
    assert homed.wheel.servo_on
    homed.run(700_000)
    assert not homed.wheel.servo_on
    assert homed.get("powered") == 0
    assert homed.phase() == "SETTLED"
    assert homed.wheel.measured_deg == pytest.approx(90)
    homed.command("servo")
    homed.run(200_000)
    assert homed.command("servo").split()[0] == "0"
    homed.move(135)  # and it goes on from there
    assert homed.get("wheel_deg") == pytest.approx(135, abs=1.2)


@pytest.mark.parametrize("wake_ms", [60, 95])
def test_a_servo_that_wakes_late_is_no_fault(homed: Rig, wake_ms: float) -> None:
    """Its switch is slow so that it draws no surge, and its own controller has to start."""
    homed.set(servo_wake_ms=wake_ms)
    for target_deg in (170, 0, 90, 45, 180, 135):
        assert homed.start_move(target_deg, hold_s=0.1) == "OK"
        homed.run_until(homed.ended, 5_000_000)
        homed.run(500_000)
        assert homed.get("powered") == 0
        assert homed.phase() == "SETTLED"
        assert not homed.faults


def test_a_released_wheel_that_is_pushed_away_is_noticed(homed: Rig) -> None:
    homed.ask("WheelAction", token=9, action="RELEASE")
    homed.set(slip_deg=4)
    homed.run(100_000)
    assert set(homed.faults) == {"WHEEL_SLIP"}


def test_release_during_a_move_leaves_the_wheel_unknown(homed: Rig) -> None:
    homed.start_move(180)
    homed.run(200_000)
    homed.ask("WheelAction", token=9, action="RELEASE")
    homed.run(50_000)
    assert homed.phase() == "UNKNOWN"
    assert homed.get("powered") == 0


@pytest.mark.parametrize("target", ["avr", "host"])
def test_the_host_puts_the_servo_to_a_pulse_without_a_comb(make_rig: MakeRig, target: str) -> None:
    """To set the gear on its horn: the pulse is held for hold_max_ds, from the last time on."""
    rig = make_rig(target=target)
    rig.set(index_a_forced=0, index_b_forced=0)
    rig.param("hold_max_ds", 5)
    rig.param("servo_min_us", 600)
    for pulse_us in (600, 800, 2500, 1234.5):
        assert rig.pulse(pulse_us) == "OK"
        rig.run(400_000)
        assert rig.get("pulse_us") == pytest.approx(pulse_us, abs=0.1)
        assert (rig.phase(), rig.wheel.servo_on) == ("UNKNOWN", True)
        assert rig.wheel.measured_deg is None
        assert rig.status()["WheelServo"]["pulse_hus"] == 2 * pulse_us
    for pulse_us in (599.5, 2500.5, 0, 32767):
        assert rig.pulse(pulse_us) == "OUT_OF_RANGE"
    assert rig.pulse(800) == "OK"
    rig.run(450_000)
    assert rig.get("powered") == 1
    rig.run(100_000)
    assert rig.get("powered") == 0
    assert not rig.wheel.servo_on
    assert not rig.faults


def test_a_pulse_of_the_hosts_ends_by_release_and_home(homed: Rig) -> None:
    assert homed.pulse(1000) == "OK"
    homed.run(50_000)
    assert homed.start_move(90) == "NOT_HOMED"
    homed.ask("WheelAction", token=9, action="RELEASE")
    assert homed.get("powered") == 0
    assert homed.pulse(1000) == "OK"
    homed.home()
    assert homed.phase() == "SETTLED"
    assert homed.get("wheel_deg") == pytest.approx(0, abs=1.2)


def test_a_pulse_of_the_hosts_waits_for_moves_and_faults(homed: Rig) -> None:
    assert homed.start_move(90) == "OK"
    assert homed.pulse(1000) == "BUSY"
    homed.run_until(homed.ended, 5_000_000)
    assert homed.phase() == "SETTLED"
    assert homed.pulse(1000) == "OK"
    homed.set(supply_mv=3500)
    homed.run(200_000)
    assert homed.get("powered") == 0
    assert homed.pulse(1000) == "IN_FAULT"


def test_pulses_are_exact_without_runts_or_gaps(rig: Rig) -> None:
    """From the first to the last pulse of homing and moves: width in range, period 20 ms."""
    rig.home()
    rig.command("servo")
    for target in (180, 0, 90):
        rig.move(target)
    count, least, most, period_us, first_us, last_us = rig.command("servo").split()
    assert float(period_us) == pytest.approx(20_000, abs=0.1)
    assert float(least) >= 500
    assert float(most) <= 2500
    assert (int(last_us) - int(first_us)) / 20_000 == pytest.approx(int(count) - 1, abs=0.2)


def test_commands_out_of_range_are_refused_and_change_nothing(homed: Rig) -> None:
    for target in (-0.01, 180.01, 300, -300):
        assert homed.start_move(target) == "OUT_OF_RANGE"
    assert homed.start_move(90, slew_deg_s=240.1) == "OUT_OF_RANGE"
    assert homed.start_move(90, hold_s=10.1) == "OUT_OF_RANGE"
    homed.send_bytes(mcu_link.serial_frame(0x03, bytes([1, 7])))  # WheelAction: no such action
    answers = [item.event for item in homed.run(20_000) if isinstance(item.event, mcu.Message)]
    assert [a["result"] for a in answers if a.name == "Result"] == ["OUT_OF_RANGE"]
    homed.run(200_000)
    assert homed.phase() == "SETTLED"
    assert homed.get("wheel_deg") == pytest.approx(0, abs=1)


def test_a_second_move_while_moving_is_refused(homed: Rig) -> None:
    assert homed.start_move(90) == "OK"
    token = homed.token
    assert homed.start_move(45) == "BUSY"
    homed.run(2_000_000)
    assert homed.wheel.token == token
    assert homed.get("wheel_deg") == pytest.approx(90, abs=1.2)


@pytest.mark.parametrize("target", ["avr", "host"])
@pytest.mark.parametrize(("slew_deg_s", "answer"), [(1, "OUT_OF_RANGE"), (4, "OK")])
def test_a_move_that_lasts_longer_than_the_clock_is_refused(
    make_rig: MakeRig, target: str, slew_deg_s: float, answer: str
) -> None:
    """At 1 degree/s the command would jump back to its start after 64 s."""
    rig = make_rig(target=target)
    rig.home()
    assert rig.start_move(180, slew_deg_s=slew_deg_s) == answer
    if answer == "OK":
        before = rig.get("wheel_deg")
        while not rig.ended():
            rig.run(1_000_000)
            after = rig.get("wheel_deg")
            assert before - 1 <= after <= before + slew_deg_s + 3
            before = after
        assert rig.phase() == "SETTLED", rig.faults
        assert rig.get("wheel_deg") == pytest.approx(180, abs=1.2)
    else:
        rig.run(100_000)
        assert rig.phase() == "SETTLED"


def test_a_creep_that_lasts_longer_than_the_clock_is_refused(homed: Rig) -> None:
    """The way down is short, so that the creep is the longest part."""
    homed.move(9)
    assert homed.start_move(18, slew_deg_s=0.1) == "OUT_OF_RANGE"


def test_the_same_move_repeated_is_answered_and_starts_nothing(homed: Rig) -> None:
    """As a host does whose answer was lost (proto/mcu.md)."""
    signals = {"token": 200, "target_cdeg": 9000, "slew_ddeg_s": 0, "hold_ds": 0}
    homed.token = 200
    assert homed.ask("WheelMove", **signals)["result"] == "OK"
    homed.run(100_000)
    assert homed.ask("WheelMove", **signals)["result"] == "OK"
    assert homed.ask("WheelMove", **(signals | {"target_cdeg": 4500}))["result"] == "BUSY"
    assert homed.ask("WheelMove", **(signals | {"token": 201}))["result"] == "BUSY"
    homed.run_until(homed.ended, 5_000_000)
    homed.command("servo")
    assert homed.ask("WheelMove", **signals)["result"] == "OK"  # done already
    homed.run(500_000)
    assert homed.phase() == "SETTLED"
    _, least_us, most_us, *_ = homed.command("servo").split()
    assert least_us == most_us


def test_homing_repeated_while_it_runs_is_not_begun_anew(rig: Rig) -> None:
    rig.token = 77
    for _ in range(20):
        assert rig.ask("WheelAction", token=77, action="HOME")["result"] == "OK"
        rig.run(100_000)
    rig.run_until(rig.ended, 4_000_000)
    assert rig.phase() == "SETTLED"
    assert rig.ask("WheelAction", token=77, action="HOME")["result"] == "OK"
    rig.run(50_000)
    assert rig.phase() == "HOMING"  # after it: somebody wants it again


def test_one_small_message_says_where_the_wheel_is(homed: Rig) -> None:
    homed.move(90)
    homed.send("WheelRequest", count=41)
    seen = [item.event for item in homed.run(5_000)]
    (reply,) = [e for e in seen if isinstance(e, mcu.Message) and e.name == "WheelReply"]
    assert len([e for e in seen if isinstance(e, mcu.Message)]) == 1
    assert reply.signals == {
        "count": 41, "phase": "SETTLED", "servo_on": 1, "token": homed.token,
        "measured_cdeg": 9000, "sigma_cdeg": round(100 * homed.wheel.sigma_deg),
    }  # fmt: skip
    homed.send("WheelAction", token=9, action="HOME")
    homed.run(50_000)
    reply = homed.ask("WheelRequest", count=42)
    assert (reply["phase"], reply["measured_cdeg"]) == ("HOMING", -32768)


# --- faults ------------------------------------------------------------------------------------


def at_rest(rig: Rig, **numbers: float) -> None:
    rig.set(**numbers)
    rig.run(100_000)
    if rig.phase() == "SETTLED":
        rig.start_move(135)
        rig.run_until(rig.ended, 5_000_000)


def while_moving(rig: Rig, **numbers: float) -> None:
    rig.start_move(135)
    rig.run(200_000)
    rig.set(**numbers)
    rig.run_until(rig.ended, 5_000_000)


def lying(rig: Rig, **numbers: float) -> None:
    """The wheel stands; its sensors say that it has gone the whole way in 27 ms."""
    rig.set(stuck=1)
    rig.start_move(135)
    rig.run(6_000)
    rig.set(**numbers)
    rig.run_until(rig.ended, 5_000_000)


@pytest.mark.parametrize("feedback", [False, True], ids=["comb", "feedback"])
@pytest.mark.parametrize(
    ("how", "numbers", "name"),
    [
        (at_rest, {"stuck": 1}, "WHEEL_STUCK"),
        (while_moving, {"stuck": 1}, "WHEEL_STUCK"),
        (at_rest, {"slow": 0.25}, "WHEEL_SLOW"),
        (while_moving, {"slow": 0.1}, "WHEEL_SLOW"),
        (at_rest, {"slip_deg": 5}, "WHEEL_SLIP"),
        (at_rest, {"slip_deg": -5}, "WHEEL_SLIP"),
        (while_moving, {"slip_deg": 30}, "WHEEL_SLIP"),
        (while_moving, {"slip_deg": -30}, "WHEEL_SLIP"),
        (lying, {"lie_deg": 135}, "WHEEL_TOO_FAST"),
        (at_rest, {"index_glitches": 40}, "INDEX_NOISE"),
        (while_moving, {"index_glitches": 40}, "INDEX_NOISE"),
        (at_rest, {"supply_mv": 3500}, "SUPPLY_LOW"),
        (while_moving, {"supply_mv": 3500}, "SUPPLY_LOW"),
    ],
)
def test_fault_of_wheel_or_supply(
    rig: Rig,
    how: Callable[..., None],
    numbers: dict[str, float],
    name: str,
    feedback: bool,
) -> None:
    if feedback:
        rig.fit_feedback()
    rig.home()
    how(rig, **numbers)
    assert set(rig.faults) == {name}
    assert rig.phase() == "FAULT"
    assert not rig.wheel.servo_on
    assert rig.wheel.measured_deg is None
    assert rig.get("powered") == 0
    rig.run(100_000)
    rig.command("servo")
    rig.run(200_000)
    assert rig.command("servo").split()[0] == "0", "pulses go on in FAULT"
    assert rig.ask("WheelAction", token=1, action="HOME")["result"] == "IN_FAULT"


@pytest.mark.parametrize(
    ("numbers", "name"),
    [
        ({"index_a_forced": 0, "index_b_forced": 0}, "INDEX_NEVER"),
        ({"index_a_forced": 1, "index_b_forced": 1}, "INDEX_ALWAYS"),
        ({"index_a_forced": 0}, "INDEX_PATTERN"),
        ({"index_b_forced": 1}, "INDEX_PATTERN"),
        ({"comb_pitch_deg": 5.5}, "INDEX_PATTERN"),
        ({"servo_zero_us": 855}, "INDEX_PATTERN"),  # more than seven degrees off
        ({"index_glitches": 1e9}, "INDEX_NOISE"),
    ],
)
def test_homing_names_what_is_wrong_with_the_comb(
    rig: Rig, numbers: dict[str, float], name: str
) -> None:
    rig.set(**numbers)
    rig.home()
    assert set(rig.faults) == {name}
    assert rig.get("powered") == 0


def test_homing_tells_a_stuck_wheel_from_dead_sensors_by_the_feedback(rig: Rig) -> None:
    rig.fit_feedback()
    rig.set(stuck=1)
    rig.home()
    assert set(rig.faults) == {"WHEEL_STUCK"}


@pytest.mark.parametrize(("share", "level"), [(0, 0), (1, 4092)])
def test_feedback_open_or_shorted(rig: Rig, share: float, level: int) -> None:
    rig.fit_feedback()
    rig.home()
    rig.set(feedback_forced=share)
    rig.run(50_000)
    assert set(rig.faults) == {"FEEDBACK_OPEN"}
    assert rig.faults["FEEDBACK_OPEN"].detail == pytest.approx(level, abs=12)  # the ADC's offset


def test_single_disturbances_of_a_sensor_are_no_fault(homed: Rig) -> None:
    for target in (45, 135):
        homed.set(index_glitches=2)  # one pulse of 0.1 ms
        homed.start_move(target)
        for _ in range(10):
            homed.run(50_000)
            homed.set(index_glitches=2)
        homed.run_until(homed.ended, 5_000_000)
        assert homed.phase() == "SETTLED", homed.faults
        assert homed.get("wheel_deg") == pytest.approx(target, abs=1.2)


def test_a_fault_stays_until_it_is_cleared_and_recovery_needs_no_reset(homed: Rig) -> None:
    homed.set(stuck=1)
    homed.move(90)
    homed.set(stuck=0)
    homed.run(1_000_000)
    assert set(homed.faults) == {"WHEEL_STUCK"}
    assert homed.status()["FaultState"]["latched"] == 1 << 1
    homed.clear_faults()
    assert not homed.faults
    assert homed.phase() == "UNKNOWN"
    homed.home()
    homed.move(90)
    assert homed.phase() == "SETTLED"
    assert homed.get("wheel_deg") == pytest.approx(90, abs=1.2)


def test_a_fault_whose_cause_remains_comes_back(homed: Rig) -> None:
    homed.set(supply_mv=3500)
    homed.run(100_000)
    homed.clear_faults()
    homed.run(200_000)
    assert set(homed.faults) == {"SUPPLY_LOW"}


@pytest.mark.parametrize("why", ["external", "brownout"])
def test_reset_in_the_middle_of_a_move(homed: Rig, why: str) -> None:
    homed.set(boot_loader=4)
    homed.start_move(180)
    homed.run(300_000)
    homed.reset(why)
    assert homed.get("powered") == 0
    homed.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    homed.run(50_000)
    assert homed.phase() == "UNKNOWN"
    assert homed.wheel.measured_deg is None
    assert set(homed.faults) == ({"RESET_BROWN_OUT"} if why == "brownout" else set())
    homed.home()
    homed.move(180)
    assert homed.get("wheel_deg") == pytest.approx(180, abs=1.2)


# --- random ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seed", "feedback"), [pytest.param(1, False, marks=pytest.mark.nightly), (2, True)]
)
def test_random_moves_with_random_faults(seed: int, feedback: bool) -> None:
    """The flashed binary; `make test-firmware-long` makes 10 000 moves."""
    campaign = Campaign(seed, "avr", feedback, fault_share=0.2)
    with campaign.rig:
        campaign.run(60)
    assert campaign.settled_states > 60
    assert campaign.worst_sigmas <= 3


@pytest.mark.parametrize(("seed", "feedback"), [(3, False), (4, True)])
def test_random_moves_of_the_same_sources_under_sanitizers(seed: int, feedback: bool) -> None:
    campaign = Campaign(seed, "host", feedback, fault_share=0.2)
    with campaign.rig:
        campaign.run(1000)
    assert campaign.settled_states > 1000
    assert campaign.worst_sigmas <= 3


def test_the_servos_pulses_and_the_combs_edges_are_told(homed: Rig) -> None:
    """What `lightprobe calibrate wheel` measures with, against the box's own numbers."""
    homed.set(servo_zero_us=812, servo_gain_us_deg=7.5)
    homed.home()
    for target in (0, 90, 180):
        homed.move(target)
        servo = homed.status()["WheelServo"]
        true_us = 812 + 7.5 * homed.get("wheel_deg")
        pulse_us = servo.number("pulse_hus") / 2
        assert pulse_us == pytest.approx(homed.get("pulse_us"), abs=0.1)
        assert pulse_us == pytest.approx(true_us, abs=7.5 * 0.3)
        edge_deg = homed.get("comb_first_deg") + 3 * (servo.number("edges") - 0.5)
        assert edge_deg == pytest.approx(homed.get("wheel_deg"), abs=1.5)
    homed.send("WheelAction", token=9, action="RELEASE")
    homed.run(30_000)
    assert homed.status()["WheelServo"].number("pulse_hus") == 0
