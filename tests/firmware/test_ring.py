"""The ring as the flashed binary samples it: values, latency, flicker, dead sensors, supply."""

import random
from itertools import pairwise

import pytest
from lightprobe.mcu import messages as mcu
from rig import Rig

LSB = 4  # one count of the 10-bit converter, in levels


def rings(rig: Rig, us: int) -> list[tuple[int, mcu.Ring]]:
    """Run and return the rings with the time when their last byte left."""
    seen = rig.run(us)
    return [(item.t_us, item.event) for item in seen if isinstance(item.event, mcu.Ring)]


def stream(rig: Rig, scans: int) -> None:
    rig.ask("Rates", ring_scans=scans, wheel_ms=0, counters_ms=0)


def levels_of(millivolts: list[float]) -> list[float]:
    return [mv / 5000 * 4092 for mv in millivolts]


def test_nine_values_within_one_count(rig: Rig) -> None:
    rng = random.Random(5)
    stream(rig, 8)
    for _ in range(10):
        millivolts = [rng.randrange(10, 4990) for _ in range(9)]
        rig.set(**{f"ldr{k}_mv": mv for k, mv in enumerate(millivolts)})
        *_, (_, ring) = rings(rig, 40_000)
        expected = levels_of(millivolts)
        assert max(abs(a - b) for a, b in zip(ring.levels, expected, strict=True)) <= LSB
        assert not any(ring.dead)


@pytest.mark.parametrize(("mains_hz", "period_us"), [(50, 10_000), (60, 8_330)])
def test_one_ring_per_flicker_period_and_more_than_100_a_second(
    rig: Rig, mains_hz: int, period_us: int
) -> None:
    rig.param("mains_hz", mains_hz)
    capabilities = rig.status()["Capabilities"]
    assert capabilities["window_scans"] * capabilities["scan_us"] == period_us
    stream(rig, int(capabilities["window_scans"]))
    got = rings(rig, 1_000_000)
    assert len(got) >= 100 - 1  # the second's last one may be on its way
    steps = [(b.t_us - a.t_us) for (_, a), (_, b) in pairwise(got)]
    assert all(abs(step - period_us) <= 150 for step in steps)
    assert sum(steps) / len(steps) == pytest.approx(period_us, rel=0.002)
    assert rig.decoder.rings_lost == 0


def test_400_rings_a_second_lose_nothing(rig: Rig) -> None:
    stream(rig, 2)
    rings(rig, 20_000)
    rig.command("load")
    got = rings(rig, 500_000)
    print(f"CPU load: {100 * float(rig.command('load').split()[0]):.0f} %")
    assert len(got) == pytest.approx(200, abs=2)
    assert rig.decoder.rings_lost == 0
    assert rig.status()["CountersWork"]["ring_dropped"] == 0


def test_more_than_the_line_takes_is_dropped_whole_and_counted(rig: Rig) -> None:
    stream(rig, 1)
    got = rings(rig, 500_000)
    dropped = rig.status()["CountersWork"]["ring_dropped"]
    assert len(got) + dropped == pytest.approx(400, abs=10)
    counters = [ring.counter for _, ring in got]
    assert rig.ask("TimeRequest", count=1)["stamped"] == 1  # requests are answered all the same
    assert sorted(counters[:50]) == counters[:50]


@pytest.mark.parametrize("mains_hz", [50, 60])
def test_a_step_of_the_voltages_is_out_within_15_ms(rig: Rig, mains_hz: int) -> None:
    """From the step to the last byte of the first ring with all nine new values within a count."""
    rig.param("mains_hz", mains_hz)
    stream(rig, 2)
    rng = random.Random(6)
    worst_us = 0
    for _ in range(25):
        millivolts = [rng.randrange(100, 4900) for _ in range(9)]
        rings(rig, 20_000 + rng.randrange(0, 5_000))
        rig.set(**{f"ldr{k}_mv": mv for k, mv in enumerate(millivolts)})
        step_us = int(rig.command("time"))
        expected = levels_of(millivolts)
        arrived = [
            t_us
            for t_us, ring in rings(rig, 25_000)
            if all(abs(a - b) <= LSB for a, b in zip(ring.levels, expected, strict=True))
        ]
        worst_us = max(worst_us, arrived[0] - step_us)
    print(f"worst step response at {mains_hz} Hz mains: {worst_us / 1000:.2f} ms")
    assert 8_000 < worst_us <= 15_000  # the average alone takes a period


def ripple(rig: Rig, flicker_hz: float) -> int:
    """Peak to peak of the sensors, in levels, under a lamp that flickers by half."""
    rig.set(flicker_hz=flicker_hz, flicker_share=0.5)
    rings(rig, 20_000)
    levels = [ring.levels for _, ring in rings(rig, 200_000)]
    return max(max(column) - min(column) for column in zip(*levels, strict=True))


@pytest.mark.parametrize(("mains_hz", "other_hz"), [(50, 60), (60, 50)])
def test_lamps_on_the_mains_do_not_ripple(rig: Rig, mains_hz: int, other_hz: int) -> None:
    rig.param("mains_hz", mains_hz)
    stream(rig, 1)
    assert ripple(rig, 2 * mains_hz) <= 2 * LSB
    assert ripple(rig, 2 * other_hz) > 10 * LSB  # so the test can fail


@pytest.mark.parametrize("sensor", range(9))
def test_an_open_or_shorted_sensor_is_named(rig: Rig, sensor: int) -> None:
    stream(rig, 8)
    for mv, name in ((0, "LDR_OPEN"), (5000, "LDR_SHORTED")):
        rig.set(**{f"ldr{sensor}_mv": mv})
        got = rings(rig, 200_000)
        assert set(rig.faults) == {name}
        assert rig.faults[name].detail == 1 << sensor
        assert [k for k in range(9) if got[-1][1].dead[k]] == [sensor]
        state = rig.status()["FaultState"]
        which = "sensors_open" if name == "LDR_OPEN" else "sensors_shorted"
        assert state[which] == 1 << sensor
        rig.set(**{f"ldr{sensor}_mv": 1500})
        assert not any(rings(rig, 50_000)[-1][1].dead)  # the live mask follows at once
        rig.clear_faults()
        assert not rig.faults


def test_darkness_and_sunlight_are_no_faults(rig: Rig) -> None:
    stream(rig, 8)
    for mv in (0, 4, 4975):
        rig.set(**{f"ldr{k}_mv": mv for k in range(9)})
        rings(rig, 300_000)
        assert not rig.faults


def test_a_dead_sensor_does_not_stop_the_wheel(homed: Rig) -> None:
    homed.set(ldr3_mv=5000)
    homed.run(200_000)
    assert set(homed.faults) == {"LDR_SHORTED"}
    homed.move(90)
    assert homed.phase() == "SETTLED"


@pytest.mark.parametrize("supply_mv", [4500, 5000, 5250])
def test_supply_is_measured_and_the_levels_are_shares_of_it(rig: Rig, supply_mv: int) -> None:
    stream(rig, 8)
    rig.set(supply_mv=supply_mv)
    _, ring = rings(rig, 100_000)[-1]
    assert ring.supply_v == pytest.approx(supply_mv / 1000, rel=0.01)
    expected = levels_of([1000 + 100 * k for k in range(9)])
    assert max(abs(a - b) for a, b in zip(ring.levels, expected, strict=True)) <= LSB


def test_ring_goes_on_while_the_wheel_moves(homed: Rig) -> None:
    homed.ask("Rates", ring_scans=2, wheel_ms=20, counters_ms=100)
    lost = homed.decoder.rings_lost
    homed.move(180)
    assert homed.phase() == "SETTLED"
    assert homed.decoder.rings_lost == lost
    assert homed.status()["CountersWork"]["ring_dropped"] == 0
