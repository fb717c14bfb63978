"""What setting a parameter does to everything that it is not a parameter of."""

import itertools
from collections.abc import Callable

import pytest
from lightprobe.mcu import messages as mcu
from rig import Rig, param_number

MakeRig = Callable[..., Rig]
LSB = 4  # levels of one count
NAMES = list(mcu.param_names().values())
#: Parameters of the ring, and those that a carrier reads at a reset; all others are the wheel's.
OF_RING = ("mains_hz", "bandgap_mv", "supply_min_mv")
OF_CARRIER = ("can_kbit_s", "can_crystal_mhz", "i2c_address")
OF_WHEEL = [name for name in NAMES if name not in (*OF_RING, *OF_CARRIER)]


def other_value(rig: Rig, name: str) -> int:
    """A value that is allowed, and harmless to a box as it is."""
    if name == "mains_hz":
        return 60
    answer = rig.ask("ParamGet", param=param_number(name))
    value = answer.number("value")
    return value + (1 if value < answer.number("maximum") else -1)


def busy_box(make_rig: MakeRig, target: str, carrier: str) -> Rig:
    """A box with everything: a servo that tells its angle, homed and held; a ring that reports."""
    rig = make_rig(target=target, carrier=carrier)
    rig.exact_adc()
    rig.set(**{f"ldr{k}_mv": 1000 + 300 * k for k in range(9)})
    rig.fit_feedback()
    rig.param("hold_max_ds", 600)
    rig.home()
    rig.ask("Rates", ring_scans=8, wheel_ms=20, counters_ms=0)
    rig.run(100_000)
    assert rig.phase() == "SETTLED", rig.faults
    return rig


def change(rig: Rig, name: str, value: int) -> None:
    """Set a parameter: the ring goes on with the same light, no report is lost, no fault."""
    got: list[mcu.Ring] = []
    rig.on_seen = lambda item: got.append(item.event) if isinstance(item.event, mcu.Ring) else None
    rig.run(30_000)
    before = got[-1]
    rig.param(name, value)
    rig.run(200_000)
    rig.on_seen = None
    assert len(got) >= 18
    for ring in got:
        assert list(ring.levels) == pytest.approx(list(before.levels), abs=LSB)
        assert ring.supply_v == pytest.approx(before.supply_v, rel=0.02)
        assert not any(ring.dead)
    counters = [ring.counter for ring in got]
    assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(counters))
    assert not rig.faults, name


@pytest.mark.parametrize(
    ("target", "carrier"), [("avr", "serial"), ("avr", "can"), ("host", "serial")]
)
def test_parameters_of_ring_and_carrier_leave_the_wheel_alone(
    make_rig: MakeRig, target: str, carrier: str
) -> None:
    """Ten times each, with its former value in between, at any moment of a scan."""
    rig = busy_box(make_rig, target, carrier)
    for name in (*OF_RING, *OF_CARRIER):
        former, other = rig.param_value(name), other_value(rig, name)
        for k in range(10):
            rig.run(137 * k)
            change(rig, name, (other, former)[k % 2])
            assert rig.phase() == "SETTLED", name
            assert rig.wheel.servo_on
            assert rig.wheel.measured_deg == pytest.approx(rig.get("wheel_deg"), abs=1)


@pytest.mark.parametrize("name", OF_WHEEL)
def test_parameters_of_the_wheel_leave_the_ring_alone(make_rig: MakeRig, name: str) -> None:
    """The wheel is UNKNOWN then and let go, without a fault; it homes with the new value."""
    rig = busy_box(make_rig, "host", "serial")
    change(rig, name, other_value(rig, name))
    assert rig.phase() == "UNKNOWN"
    assert rig.get("powered") == 0
    rig.home()
    assert rig.phase() == "SETTLED", rig.faults
    rig.move(90)
    assert rig.phase() == "SETTLED", rig.faults
    assert rig.get("wheel_deg") == pytest.approx(90, abs=1.2)
