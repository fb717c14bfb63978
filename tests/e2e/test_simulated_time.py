"""Simulated time: the daemon's clock goes on when the test says so, and stands still otherwise."""

from dataclasses import replace

import pytest
from harness import run
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

ALL = Subscription(max_lights=8, sh_order=4, health_period_ms=1000)


def camera() -> SimulatedCamera:
    world = World(scenes.load(["room"]), Behaviour(act_s=0), 30.0)
    return SimulatedCamera(world, lenses.load("equirect"), (320, 160))


def story() -> tuple[list[Estimate], list[float], str]:
    """Nine seconds with a silent camera in them."""
    faults = Faults(stall_after=90, stall_s=3.0, jitter_ms=20)
    with LiveProbe(camera(), ["--ring=sim:?rate_hz=10"], faults=faults) as probe:
        client = probe.client(ALL)
        probe.run(9.0)
        health_s = [r.t_s for r in client.received if type(r.message).__name__ == "Health"]
        alike = [replace(e, boot_id=0) for e in client.estimates]
        return alike, health_s, probe.log


def test_two_runs_are_alike_to_the_last_bit() -> None:
    (first, health_s, log), (second, _, again) = story(), story()
    assert len(first) > 150
    assert [repr(e) for e in first] == [repr(e) for e in second]
    assert "no frame for 2 s" in log
    assert log.count("\n") == again.count("\n")
    assert health_s == pytest.approx([k + 0.1 for k in range(9)])  # with the daemon's tick


@pytest.mark.parametrize("faults", [Faults(), Faults(hide_exposure=1)])
def test_commands_take_effect_at_the_same_frames(faults: Faults) -> None:
    """A frame and the next exposure may be due at the same time: first the frame is taken."""

    def told() -> list[str]:
        with LiveProbe(camera(), faults=faults) as probe:
            client = probe.client(ALL)
            probe.run(2.0)
            return [repr(replace(one, boot_id=0)) for one in client.estimates]

    first = told()
    assert len(first) > 30
    assert first == told()


def test_a_silent_camera_makes_estimates_stale_after_their_time() -> None:
    estimates, _, _ = story()
    stale = [e for e in estimates if e.flags & 1]
    assert 1 <= len(stale) <= 3  # once a second from 1 s after the last frame


def test_a_camera_that_gives_only_corrupt_frames_is_stalled() -> None:
    with LiveProbe(camera(), faults=Faults(marked=1)) as probe:
        client = probe.client(ALL)
        probe.run(4.0)
        health = client.health
        assert health is not None
        assert health.source_state == "STALLED"
        assert "only corrupt frames for 2 s" in health.faults[0].text
        assert health.frames_rejected > 60
        assert not client.estimates


def test_without_a_test_that_listens_it_says_so_and_ends(tmp_path) -> None:
    status, _, log = run("--source=sim:/nowhere", f"--simulated-time={tmp_path}/none")
    assert status == 1
    assert "--simulated-time: No such file or directory — does a test listen there?" in log


def test_a_daemon_that_ends_is_told(tmp_path) -> None:
    with pytest.raises(LightprobeError, match="unknown key"):
        LiveProbe(camera(), ["--no-such-option=1"]).__enter__()


def test_a_daemon_whose_test_has_gone_ends() -> None:
    with LiveProbe(camera()) as probe:
        probe.run(0.5)
        probe.clock.close()
        process = probe._daemon.process
        assert process is not None
        assert process.wait(120) == 1
        assert "the test has gone" in probe.log
