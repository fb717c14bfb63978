"""Camera and box; `--lightprobe-port=/dev/ttyUSB0` takes a real one."""

from lightprobe.testing import Box, Probe


def test_the_box_is_healthy(probe: Probe) -> None:
    probe.wait_settled(within_s=10)
    health = probe.wait_health(lambda one: one.ring is not None and one.ring.samples > 100)
    assert health.wheel is not None
    assert not [fault for fault in health.faults if fault.id.isupper()]


def test_the_camera_is_on_time(probe: Probe) -> None:
    probe.run(6)
    assert not [one for one in probe.faults if one.id.startswith(("camera", "source"))]


def test_a_stuck_wheel_is_told(probe: Probe, box: Box) -> None:
    probe.wait_settled(within_s=10)
    box.fault("wheel-stuck")
    fault = probe.wait_fault("WHEEL_STUCK")
    assert "free it" in fault.text
    box.heal()
    probe.wait_no_fault("WHEEL_STUCK")
