"""`lightprobe.testing` as a library: what its fixtures do, against the real daemon."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from lightprobe import Client, Subscription
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.geometry import sphere_normals
from lightprobe.testing import NotSeen, Options, Probe, running

pytestmark = pytest.mark.many_frames

SMALL = Options(size_px=(320, 160), rate_hz=10.0)
CAMERA_ALONE = Options(size_px=(320, 160), rate_hz=10.0, box=False)


@pytest.fixture
def probe() -> Iterator[Probe]:
    with running(CAMERA_ALONE) as one:
        yield one


def test_a_lamp_is_as_bright_as_the_room_says(probe: Probe) -> None:
    probe.room.lamp(40, 30, irradiance=100, colour=(2, 1, 0.5))
    light = probe.wait_lamp(40, 30)
    probe.run(2)
    estimate = probe.wait_estimate()
    (light,) = estimate.lights
    true = probe.room.lamps[0].true().irradiance
    assert light.irradiance == pytest.approx(true, rel=0.1)
    normals = sphere_normals(1)
    error = estimate.irradiance(normals) - probe.room.truth().irradiance(normals)
    assert np.abs(luminance(error)).max() < 0.1 * 200


def test_lamps_move_dim_and_go(probe: Probe) -> None:
    lamp = probe.room.lamp(40, 30)
    probe.wait_lamp(40, 30)
    lamp.move(-100, 10)
    probe.wait_lamp(-100, 10)
    lamp.dim(50)
    probe.wait_estimate(lambda one: any(x.irradiance.mean() < 60 for x in one.lights))
    lamp.switch(False)
    probe.wait_estimate(lambda one: not one.lights)
    lamp.switch(True)
    probe.wait_lamp(-100, 10)
    lamp.remove()
    probe.wait_estimate(lambda one: not one.lights)


def test_a_dark_room_is_told(probe: Probe) -> None:
    probe.wait_no_flag(EstimateFlag.UNDEREXPOSED)
    probe.room.darken()
    probe.wait_flag(EstimateFlag.UNDEREXPOSED)
    probe.room.ambient(30)
    probe.wait_no_flag(EstimateFlag.UNDEREXPOSED)


def test_a_cap_on_the_lens_is_told_because_the_ring_sees_light() -> None:
    with running(SMALL) as probe:
        probe.wait_settled()
        probe.room.cover_lens()
        probe.wait_fault("lens-covered")
        assert probe.wait_estimate().flags & EstimateFlag.RING_ONLY
        probe.room.cover_lens(False)
        probe.wait_no_fault("lens-covered")


def test_a_camera_is_unplugged_and_comes_back(probe: Probe) -> None:
    probe.wait_estimate()
    probe.camera.unplug()
    probe.wait_fault("source-waiting")
    probe.camera.heal()
    probe.wait_no_fault()
    assert probe.camera.counters.connections == 2


def test_two_runs_are_alike_to_the_last_bit() -> None:
    def story() -> list[str]:
        with running(SMALL) as probe:
            probe.room.lamp(40, 30)
            probe.run(2)
            return [repr(r.message.lights) for r in probe.client.received if "Est" in repr(r)]

    assert story() == story()


@pytest.mark.parametrize("real_time", [False, True])
def test_an_app_with_its_own_client_gets_the_light(real_time: bool) -> None:
    with running(Options(size_px=(320, 160), rate_hz=10.0, real_time=real_time)) as probe:
        probe.room.lamp(40, 30)
        with probe.going_on(), Client(probe.uri, Subscription(max_lights=4)) as client:
            assert client.receive(60).sh.order == 2
        assert probe.wait_settled().sequence > 0


def test_the_ring_reads_the_light_of_the_room() -> None:
    with running(SMALL) as probe:
        probe.room.lamp(0, 90, irradiance=200)
        probe.wait_settled()
        probe.run(2)
        assert probe.health is not None
        assert probe.health.ring is not None
        lux = np.array(probe.health.ring.illuminance_lux, dtype=float)
        true = probe.room.lux(probe._live.link.state_now())
        assert lux == pytest.approx(true, rel=0.2)


def test_the_polarizer_turns_with_the_wheel() -> None:
    with running(SMALL) as probe:
        probe.wait_settled()
        assert probe.box is not None
        before = probe.box.wheel_deg()
        probe.run(5)
        assert abs(probe.box.wheel_deg() - before) > 10
        wheel = probe.wait_health(lambda one: one.wheel is not None and one.wheel.moves > 1).wheel
        assert wheel is not None
        assert wheel.frames_stamped > 0


def test_a_failure_names_stage_state_next_step_and_log(probe: Probe) -> None:
    probe.wait_estimate()
    probe.camera.fault("camera-stalled")
    probe.run(3)
    with pytest.raises(NotSeen) as failed:
        probe.wait_lamp(40, 30, within_s=2)
    text = str(failed.value)
    first = "probe: camera STALLED: no lamp within 5° of 40°, 30° in 2 s, at "
    assert text.startswith(first)
    assert "faults: source-stalled (" in text
    assert "next step: is a fault of the camera still on? camera.heal() takes all away" in text
    assert "frames arrive" in text.split("log of lightprobed:")[1]
    assert probe.t_s == pytest.approx(float(text[len(first) :].split()[0]), abs=0.01)


def test_unknown_faults_are_refused_with_the_right_name(probe: Probe) -> None:
    with pytest.raises(UsageError, match=r"no fault wheel-stick: did you mean wheel-stuck\?"):
        probe.fault("wheel-stick")
    with pytest.raises(UsageError, match="there is no box"):
        probe.fault("wheel-stuck")
    with pytest.raises(UsageError, match="unknown option lateness"):
        probe.camera.fault(lateness=3)
    with pytest.raises(UsageError, match="drop=2: expected a number, 0…1"):
        probe.camera.fault(drop=2)


def test_a_fault_ends_with_its_block(probe: Probe) -> None:
    probe.wait_estimate()
    with probe.camera.faulty("camera-late"):
        probe.wait_flag(EstimateFlag.STALE)
    probe.wait_no_flag(EstimateFlag.STALE)
    probe.wait_no_fault()


def test_options_that_the_daemon_refuses_are_told() -> None:
    wrong = Options(box=False, daemon=("--no-such-option=1",))
    with pytest.raises(Exception, match="unknown key"), running(wrong):
        pass
