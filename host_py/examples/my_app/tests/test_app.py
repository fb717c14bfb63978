"""The app sees the light of a room, and notices when it can see it no more."""

from lightprobe import EstimateFlag
from lightprobe.testing import Camera, Probe, Room
from shadow import App, shadow_of


def test_the_shadow_follows_the_lamp(probe: Probe, room: Room) -> None:
    lamp = room.lamp(azimuth_deg=40, elevation_deg=30, irradiance=100)
    probe.wait_lamp(40, 30)
    lamp.move(azimuth_deg=-60, elevation_deg=50)
    probe.wait_lamp(-60, 50)
    estimate = probe.wait_estimate(lambda one: len(one.lights) == 1, wanted="estimate of one lamp")
    shadow = shadow_of(estimate)
    assert shadow is not None
    assert abs(shadow.azimuth_deg - -60) < 2
    assert abs(shadow.elevation_deg - 50) < 2


def test_a_late_camera_casts_no_shadow(probe: Probe, room: Room, camera: Camera) -> None:
    room.lamp(azimuth_deg=40, elevation_deg=30)
    probe.wait_lamp(40, 30, within_s=10)
    camera.fault("camera-late")
    assert shadow_of(probe.wait_flag(EstimateFlag.STALE)) is None
    camera.heal()
    probe.wait_no_flag(EstimateFlag.STALE)
    assert shadow_of(probe.wait_estimate(lambda one: shadow_of(one) is not None)) is not None


def test_the_app_connects_by_itself(probe: Probe, room: Room) -> None:
    room.lamp(azimuth_deg=40, elevation_deg=30)
    with probe.going_on(), App(probe.uri) as app:
        assert app.light().flags & EstimateFlag.STALE == 0
