"""Serial, I2C and CAN of the flashed binary: one conversation; what each does with damage."""

import random
from collections.abc import Callable
from itertools import pairwise

import pytest
from hil_wire import passes
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from rig import Rig

CARRIERS = ("serial", "i2c", "can")
MakeRig = Callable[..., Rig]


def messages(rig: Rig, us: int, name: str = "") -> list[mcu.Message]:
    events = [item.event for item in rig.run(us)]
    return [e for e in events if isinstance(e, mcu.Message) and name in ("", e.name)]


def counters(rig: Rig) -> dict[str, int]:
    return rig.status()["CountersLink"].signals


# --- the same on all three ---------------------------------------------------------------------


@pytest.mark.parametrize("carrier", CARRIERS)
def test_the_strap_chooses_the_carrier_and_everything_works_over_it(
    make_rig: MakeRig, carrier: str
) -> None:
    rig = make_rig(carrier=carrier)
    rig.exact_adc()
    assert rig.status()["Capabilities"]["carrier"] == carrier.upper()
    rig.home()
    rig.move(135)
    assert rig.phase() == "SETTLED"
    assert rig.get("wheel_deg") == pytest.approx(135, abs=1.2)
    rig.param("lag_ms", 31)
    assert rig.ask("ParamAction", wait_us=1_000_000, action="SAVE")["result"] == "OK"
    rig.ask("Rates", ring_scans=8, wheel_ms=100, counters_ms=500)
    rings = [item.event for item in rig.run(1_000_000) if isinstance(item.event, mcu.Ring)]
    assert len(rings) >= 99
    assert rings[-1].levels == (816, 900, 980, 1060, 1144, 1224, 1308, 1388, 1472)
    assert rig.bad_frames == 0
    link = counters(rig)
    assert link["rx_bad"] == link["tx_dropped"] == link["rx_overrun"] == 0


@pytest.mark.parametrize("carrier", CARRIERS)
def test_unknown_ids_and_wrong_lengths_are_answered_and_change_nothing(
    make_rig: MakeRig, carrier: str
) -> None:
    rig = make_rig(carrier=carrier)
    rig.home()
    for message_id in (0x00, 0x0F, 0x3F):
        rig.send_raw(message_id, b"\1\2\3")
        (answer,) = messages(rig, 20_000, "Result")
        assert (answer["request"], answer["result"]) == (message_id, "UNKNOWN_ID")
    for length in range(9):
        if length != 7:
            rig.send_raw(0x02, bytes(length))  # WheelMove
            (answer,) = messages(rig, 20_000, "Result")
            assert (answer["request"], answer["result"]) == (2, "BAD_LENGTH")
    rig.run(100_000)
    assert rig.phase() == "SETTLED"
    assert counters(rig)["rx_unknown"] == 3
    assert counters(rig)["rx_bad"] == 8


@pytest.mark.parametrize("carrier", CARRIERS)
def test_clock_reading_is_stamped_at_reception(make_rig: MakeRig, carrier: str) -> None:
    """The MCU's clock against the simulator's: the same offset at every exchange."""
    rig = make_rig(carrier=carrier)
    offsets = []
    rng = random.Random(9)
    for count in range(10):
        rig.run(10_000 + rng.randrange(5_000))
        before_us = int(rig.command("time"))
        if carrier == "i2c":  # the transaction takes its own time
            rig.send("TimeRequest", count=count)
            before_us = int(rig.command("time"))
        else:
            rig.send("TimeRequest", count=count)
        (reply,) = messages(rig, 20_000, "TimeReply")
        assert reply["count"] == count
        assert reply["stamped"] == 1
        offsets.append(before_us - reply.number("t_rx_us"))
        assert reply["turnaround_us"] < (3_000 if carrier == "i2c" else 2_000)
    assert max(offsets) - min(offsets) <= 100


# --- serial ------------------------------------------------------------------------------------


def damage(rng: random.Random, data: bytes, share: float) -> bytes:
    return bytes(b ^ rng.randrange(1, 256) if rng.random() < share else b for b in data)


def test_serial_at_one_percent_byte_errors(rig: Rig) -> None:
    """Over the real UART, both ways: nothing wrong is taken, streaming goes on.

    10 s here (3400 frames out, 1000 in); 10^6 frames natively in test_link.c.
    """
    rng = random.Random(10)
    rig.exact_adc()
    rig.ask("Rates", ring_scans=8, wheel_ms=50, counters_ms=0)
    decoder, events = mcu_link.SerialDecoder(), mcu.EventDecoder()
    sent, echoed, answered = {30}, set(), 0
    got = 0
    lag = mcu_link.database().get_message_by_name("ParamValue")
    number = {str(v): k for k, v in lag.get_signal_by_name("param").choices.items()}["lag_ms"]
    for _ in range(1000):
        value = rng.randrange(501)
        frame = mcu_link.serial_frame(*mcu.encode("ParamSet", param=number, value=value))
        sent.add(value)
        rig.send_bytes(damage(rng, frame, 0.01))
        rig.command("run 10000")
        for _, _, _, line in rig._lines("frames"):
            for message in decoder.feed(damage(rng, bytes.fromhex(line), 0.01)):
                event = events.decode(*message)
                if isinstance(event, mcu.Ring):
                    got += 1
                    assert event.levels == (816, 900, 980, 1060, 1144, 1224, 1308, 1388, 1472)
                elif isinstance(event, mcu.Message) and event.name == "ParamValue":
                    assert event["param"] == "lag_ms"
                    assert (event["minimum"], event["maximum"], event["count"]) == (0, 500, 27)
                    echoed.add(event["value"])
                    answered += 1
                elif isinstance(event, mcu.Message):
                    assert event.name == "Result", event  # of a frame cut in two: BAD_LENGTH
                elif isinstance(event, mcu.WheelState):
                    assert event.phase is mcu.Phase.UNKNOWN
    assert echoed <= sent, "a value that nobody sent was taken"
    assert answered > 0.7 * 1000
    assert got > 0.6 * 1000
    link = counters(rig)
    assert link["rx_bad"] > 50
    assert link["rx_overrun"] == 0


def test_serial_noise_truncated_and_oversized_frames(rig: Rig) -> None:
    rng = random.Random(11)
    good = mcu_link.serial_frame(*mcu.encode("TimeRequest", count=5))
    for _ in range(200):
        kind = rng.randrange(4)
        if kind == 0:
            rig.send_bytes(rng.randbytes(rng.randrange(1, 60)))
        elif kind == 1:
            rig.send_bytes(good[: rng.randrange(1, len(good) - 1)] + b"\0")
        elif kind == 2:
            rig.send_bytes(bytes([1]) * rng.randrange(14, 400) + b"\0")
        else:
            rig.send_bytes(bytes([rng.randrange(1, 256)]) * 30)
        assert messages(rig, 3_000, "TimeReply") == []
        rig.send_bytes(b"\0" + good)
        (reply,) = messages(rig, 12_000, "TimeReply")
        assert reply["count"] == 5
    assert counters(rig)["rx_bad"] > 150


def test_serial_flood_does_not_stop_ring_or_wheel(homed: Rig) -> None:
    """The line full of garbage for two seconds, 50 kB/s."""
    rng = random.Random(12)
    homed.ask("Rates", ring_scans=8, wheel_ms=20, counters_ms=0)
    homed.start_move(180)
    rings = 0
    for _ in range(20):
        homed.send_bytes(rng.randbytes(5_000))
        rings += sum(isinstance(item.event, mcu.Ring) for item in homed.run(100_000))
    assert rings > 190
    assert homed.phase() == "SETTLED", homed.faults
    assert homed.get("wheel_deg") == pytest.approx(180, abs=1.2)


def test_two_requests_at_once_are_not_stamped(rig: Rig) -> None:
    frames = [mcu_link.serial_frame(*mcu.encode("TimeRequest", count=k)) for k in range(3)]
    rig.send_bytes(b"".join(frames))
    replies = messages(rig, 20_000, "TimeReply")
    assert [r["count"] for r in replies] == [0, 1, 2]
    for first, second in pairwise(replies):
        if first["stamped"] and second["stamped"]:
            assert second.number("t_rx_us") - first.number("t_rx_us") > 100


# --- I2C ---------------------------------------------------------------------------------------


@pytest.fixture
def i2c(make_rig: MakeRig) -> Rig:
    rig = make_rig(carrier="i2c")
    rig.ask("Rates", ring_scans=0, wheel_ms=0, counters_ms=0)
    return rig


def test_i2c_empty_mailbox_reads_as_length_zero(i2c: Rig) -> None:
    assert i2c.read_mail() == b"\0" + b"\xff" * 12


@pytest.mark.parametrize("bytes_read", [1, 5, 12])
def test_i2c_mail_stays_until_it_has_been_read_whole(i2c: Rig, bytes_read: int) -> None:
    i2c.send("TimeRequest", count=77)
    i2c.command("run 3000")
    head = i2c.read_mail(bytes_read)
    i2c.command("run 3000")
    whole = i2c.read_mail()
    assert whole[:bytes_read] == head
    message = mcu_link.unpack_envelope(whole[1 : 1 + whole[0]])
    assert mcu.decode(*message)["count"] == 77
    i2c.command("run 3000")
    assert i2c.read_mail()[0] == 0


def test_i2c_damaged_mails_are_dropped_and_counted(i2c: Rig) -> None:
    passes(i2c, "framing")


def test_i2c_more_than_a_mail_is_not_acknowledged(i2c: Rig) -> None:
    assert i2c.write_mail(bytes(30)) == 13
    i2c.run(10_000)
    assert i2c.ask("TimeRequest", count=2)["count"] == 2


def test_i2c_a_mail_before_the_last_was_taken_is_refused_not_lost(i2c: Rig) -> None:
    mail = mcu_link.i2c_mail(*mcu.encode("TimeRequest", count=1))
    assert i2c.write_mail(mail) == len(mail)
    assert i2c.write_mail(mail) < len(mail)  # at once: the program had no time yet
    replies = messages(i2c, 20_000, "TimeReply")
    assert len(replies) == 1


def test_i2c_bus_error_is_named_and_passes(i2c: Rig) -> None:
    i2c.command("twi error")
    i2c.run(20_000)
    assert set(i2c.faults) == {"I2C_BUS"}
    i2c.clear_faults()
    assert i2c.ask("TimeRequest", count=2)["count"] == 2
    assert not i2c.faults


def test_i2c_clock_is_stretched_less_than_100_us_under_full_load(i2c: Rig) -> None:
    i2c.home()
    i2c.ask("Rates", ring_scans=8, wheel_ms=20, counters_ms=100)
    i2c.start_move(180)
    i2c.stretch_us = 0
    i2c.run(1_500_000)
    assert i2c.phase() == "SETTLED"
    assert 0 < i2c.stretch_us < 100
    print(f"longest clock stretch: {i2c.stretch_us:.0f} us")


# --- CAN ---------------------------------------------------------------------------------------


@pytest.fixture
def can(make_rig: MakeRig) -> Rig:
    return make_rig(carrier="can")


def test_can_frames_that_are_not_for_it_pass_by(can: Rig) -> None:
    """Other identifiers and extended frames: filtered; remote frames: dropped and counted."""
    data = bytes([1])
    for identifier in (0x000, 0x4FF, 0x540, 0x546, 0x7FF):
        can.command(f"can send {identifier:x} {data.hex()}")
    can.command(f"can send {0x506:x} {data.hex()} ext")
    assert messages(can, 20_000) == []
    assert counters(can)["rx_bad"] == 0
    passes(can, "framing")


def test_can_bus_off_is_named_and_ends_without_a_reset(can: Rig) -> None:
    can.home()
    can.ask("Rates", ring_scans=8, wheel_ms=20, counters_ms=0)
    can.command("can busoff 1")
    assert can.run(500_000) == []
    can.command("can busoff 0")
    can.run(200_000)
    assert set(can.faults) == {"CAN_BUS_OFF"}
    assert can.phase() == "SETTLED"
    can.clear_faults()
    can.move(90)
    assert can.phase() == "SETTLED"
    assert not can.faults


def test_can_controller_that_is_absent_comes_back_by_itself(can: Rig) -> None:
    can.command("can absent 1")
    can.run(600_000)
    can.command("can absent 0")
    can.run(600_000)
    assert set(can.faults) == {"CAN_ABSENT"}
    can.clear_faults()
    can.home()
    assert can.phase() == "SETTLED"


def test_can_at_other_bit_rates_and_crystals(can: Rig) -> None:
    can.param("can_kbit_s", 250)
    assert can.ask("ParamAction", wait_us=1_000_000, action="SAVE")["result"] == "OK"
    can.reset()
    assert can.ask("Rates", ring_scans=0, wheel_ms=0, counters_ms=0)["result"] == "OK"


def frame_us(can: Rig) -> int:
    """How long a frame takes on the bus: the least distance within an answer of many."""
    can.send("StatusRequest", count=0)
    times = [item.t_us for item in can.run(30_000)]
    return min(b - a for a, b in pairwise(times))


def test_can_goes_on_at_the_bit_rate_that_it_began_with(can: Rig) -> None:
    """Until the next reset, also when the controller had to be set up again."""
    before_us = frame_us(can)
    can.param("can_kbit_s", 125)
    can.command("can absent 1")
    can.run(600_000)
    can.command("can absent 0")
    can.run(600_000)
    assert set(can.faults) == {"CAN_ABSENT"}
    assert frame_us(can) == pytest.approx(before_us, rel=0.2)


def time_requests(can: Rig, gaps_us: list[int]) -> list[tuple[int, int]]:
    """Put numbered requests on the bus, so far apart; return number and time of those that fit."""
    sent = []
    for count, gap_us in enumerate(gaps_us):
        if gap_us:
            can.command(f"run {gap_us}")
        _, payload = mcu.encode("TimeRequest", count=count)
        if can.command(f"can send {0x506:x} {payload.hex()}") == "ok":
            sent.append((count, int(can.command("time"))))
    return sent


def test_can_frames_are_taken_in_their_order_and_stamped_right_or_not_at_all(can: Rig) -> None:
    """Third frames come while the first of two is being read: into the buffer before the second's.

    A whole sweep of distances, for the moment in between is short.
    """
    offsets = []
    stamped = 0
    for gap_us in range(20, 700, 5):
        sent = time_requests(can, [3000, 2, gap_us, gap_us // 3])
        replies = messages(can, 20_000, "TimeReply")
        assert [r["count"] for r in replies] == [count for count, _ in sent], gap_us
        for (_, at_us), reply in zip(sent, replies, strict=True):
            if reply["stamped"]:
                stamped += 1
                offsets.append(at_us - reply.number("t_rx_us"))
    assert stamped > 100
    assert max(offsets) - min(offsets) <= 60


def test_can_two_frames_waiting_are_not_stamped(can: Rig) -> None:
    for count in (1, 2):
        _, payload = mcu.encode("TimeRequest", count=count)
        assert can.command(f"can send {0x506:x} {payload.hex()}") == "ok"
    replies = messages(can, 20_000, "TimeReply")
    assert [r["count"] for r in replies] == [1, 2]
    assert replies[0]["stamped"] == 0
