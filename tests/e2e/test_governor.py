"""The governor: a goal that is missed lowers the preset, and everyone is told."""

from harness import Daemon, camera, jpeg, panorama, streaming, wait_for

DEGRADED = 256


def test_a_missed_goal_lowers_the_preset_and_says_so():
    picture = jpeg(panorama(256))
    with (
        camera() as cam,
        Daemon(
            f"--source=sim:{cam.path}", "--preset=accurate", "--latency-goal-ms=0.001"
        ) as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        cam.accept()
        assert client.next("hello").preset == "accurate"
        with streaming(cam, picture, width=256, height=128):
            first = client.next("estimate")
            assert not first.flags & DEGRADED
            assert client.next("hello").preset == "balanced"
            assert client.until(lambda e: e.flags & DEGRADED).lights
            assert client.next("hello").preset == "fast"
            health = client.until(lambda h: h.preset == "fast", "health")
            fault = next(f for f in health.faults if f.id == "preset-lowered")
            assert "preset fast instead of accurate" in fault.text
            assert "later than 0.001 ms" in fault.text
            estimate = client.next("estimate")
            assert estimate.flags & DEGRADED
            assert len(estimate.lights) == len(first.lights)
        wait_for(lambda: "governor: fast: preset in force" in daemon.log(), "no log line")


def test_a_goal_that_is_kept_changes_nothing():
    picture = jpeg(panorama(256))
    with (
        camera() as cam,
        Daemon(
            f"--source=sim:{cam.path}", "--latency-goal-ms=60000", "--cpu-budget-percent=6400"
        ) as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        cam.accept()
        with streaming(cam, picture, width=256, height=128):
            health = client.until(lambda h: h.estimates > 150, "health")
        assert health.preset == "balanced"
        assert not health.faults
        assert "governor" not in daemon.log()
