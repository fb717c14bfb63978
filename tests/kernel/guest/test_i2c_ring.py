# SPDX-License-Identifier: Apache-2.0
"""Nine colour sensors VEML6040 of one address behind two TCA9548A, on a kernel's bus."""

import pytest
from test_i2c import PARAMETERS, load_bus

CONF, RED, GREEN, BLUE = 0x00, 0x08, 0x09, 0x0A
LUX_PER_COUNT = 0.25168  # at 40 ms
RING_ONLY = 512
#: Counts of green at 40 ms: no two sensors are alike; sensor 2 looks at a lamp.
BRIGHT = (6000, 9000, 20000, 8500, 6500, 5000, 4500, 5500, 7000)


def show(green: tuple[int, ...]) -> None:
    """Set what all sensors see: a warm light."""
    for sensor, counts in enumerate(green):
        for register, share in ((RED, 1.2), (GREEN, 1.0), (BLUE, 0.5)):
            (PARAMETERS / "words").write_text(f"{sensor},{register},{round(share * counts)}")


def configurations() -> list[int]:
    """What the daemon has written to the sensors."""
    return [int(word) for word in (PARAMETERS / "words").read_text().split()]


def reads(health, lux: list[float]) -> bool:
    """Whether the ring's report is this."""
    told = health.ring.illuminance_lux
    return len(told) == 9 and list(told) == pytest.approx(lux, rel=1e-3)


@pytest.fixture(scope="module")
def bus():
    """Number of the bus; all sensors answer."""
    return load_bus()


@pytest.fixture
def daemon(bus, start):
    show(BRIGHT)
    yield start("sim:/nowhere", f"--ring=i2c:/dev/i2c-{bus}?cover=0.5")
    (PARAMETERS / "nack").write_text("-1")


def test_each_sensor_is_read_by_itself(daemon, record_property):
    lux = [counts * LUX_PER_COUNT / 0.5 for counts in BRIGHT]
    health = daemon.wait_health("nine readings", lambda h: reads(h, lux))
    assert configurations() == [0] * 9  # on, 40 ms
    assert not [f for f in health.faults if f.id.startswith("ring-")]
    rate = daemon.wait_health("a rate", lambda h: h.ring.samples_per_s).ring.samples_per_s
    record_property("figure", f"colour ring: {rate:.1f} samples a second of the guest")


def test_dim_light_takes_longer(daemon):
    dim = tuple(counts // 10 for counts in BRIGHT)
    daemon.wait_health("bright light", lambda h: h.ring.samples > 2)
    show(dim)
    daemon.wait_health("80 ms", lambda h: configurations() == [1 << 4] * 9)
    lux = [counts * LUX_PER_COUNT / 2 / 0.5 for counts in dim]
    daemon.wait_health("dim light", lambda h: reads(h, lux))


def test_the_ring_alone_gives_light(daemon):
    while True:
        estimate = daemon.next_message().estimate
        if estimate.flags & RING_ONLY and estimate.lights:
            break
    (light,) = estimate.lights
    assert light.direction[2] > 0.9, "sensor 2 looks backwards"
    assert light.HasField("colour_sigma_permille")


def test_a_bus_without_sensors_is_told_and_taken_up_again(daemon):
    daemon.wait_health("samples", lambda h: h.ring.samples > 2)
    (PARAMETERS / "nack").write_text(str(0x10))
    health = daemon.wait_health("silence", lambda h: any(f.id == "ring-silent" for f in h.faults))
    texts = {fault.id: fault.text for fault in health.faults}
    assert "ring-i2c-waiting" in texts
    assert "--ring=i2c" in texts["ring-silent"]
    assert not any("microcontroller" in text for text in texts.values())
    (PARAMETERS / "nack").write_text("-1")
    before = health.ring.samples
    daemon.wait_health(
        "samples again",
        lambda h: h.ring.samples > before and not any(f.id.startswith("ring-") for f in h.faults),
    )
