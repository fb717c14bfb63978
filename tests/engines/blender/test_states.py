"""What can go wrong, in words; and what the scene shows meanwhile."""

import socket
import threading
import time
from dataclasses import replace

import bpy
import numpy as np
import pytest
from bl_ext.user_default.lightprobe import scene_lamps, session, suns, words
from bl_ext.user_default.lightprobe.fade import FADE_S, MOST_STEP_S, Fader, ShownLamp
from lightprobe.errors import LightprobeError
from lightprobe.estimate import FLAG_WORDS, EstimateFlag, Fault, LightFlag
from lightprobe.wire import decode
from lightprobe_proto import lightprobe_pb2 as pb
from probes import LONG_S, Probe, packet, ticked_until

LAMP = (1, (0, 1, 0), (2, 2, 2), 1.0)


def estimate_of(**kwargs):
    return decode(pb.FromProbe(estimate=packet(**kwargs)).SerializeToString())


def connected(scene, uri):
    scene.lightprobe.uri = uri
    scene.lightprobe.map_size = "0"
    assert bpy.ops.lightprobe.connect() == {"FINISHED"}
    return session.current()


def energies(scene):
    return [lamp.data.energy for lamp in scene_lamps.lamps(scene.lightprobe.root).values()]


def test_a_wrong_address_is_an_error_that_says_what_is_expected(scene):
    scene.lightprobe.uri = "tcp://localhost"
    with pytest.raises(RuntimeError, match="tcp://localhost: address: expected tcp:HOST:PORT"):
        bpy.ops.lightprobe.connect()
    assert session.current() is None
    assert "expected tcp:HOST:PORT" in session.state().headline


def test_nobody_listens(scene, tmp_path):
    running = connected(scene, f"unix:{tmp_path}/nobody")
    ticked_until(running, lambda: "nobody listens" in running.report.headline, "no reason")
    assert running.report.state == "LOST"
    with pytest.raises(RuntimeError, match="nobody listens there"):
        bpy.ops.lightprobe.light_once(timeout_s=0.5)


def test_a_peer_that_says_nothing_blocks_neither_the_timer_nor_disconnect(scene):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        running = connected(scene, f"tcp:127.0.0.1:{silent.getsockname()[1]}")
        peer, _ = silent.accept()
        with peer:
            for _ in range(50):
                assert running.tick()
            assert running.report.state == "LOST"
            link = running.link
            bpy.ops.lightprobe.disconnect()
            assert link.wait_closed(LONG_S)
            peer.settimeout(LONG_S)
            while peer.recv(1024):  # the client's requests, then the end of the connection
                pass


def test_a_probe_without_light_is_waited_for(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        words_wanted = "connected, but no light has come yet"
        ticked_until(running, lambda: words_wanted in running.report.headline, "not connected")
        assert running.report.state == "WAITING"
        assert energies(scene) == []
        assert running.fader.world_gain == 0


def test_a_web_address_works_with_the_wheel_of_the_extension(scene):
    with Probe(scheme="ws") as probe:
        assert probe.uri.startswith("ws://")
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(2)], "no light")


def test_flags_are_shown_in_words(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP], flags=int(EstimateFlag.CLIPPED)))
        ticked_until(running, lambda: running.report.state == "FAULTY", "no flag")
        assert f"CLIPPED: {FLAG_WORDS['CLIPPED']}" in running.report.details
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: running.report.state == "FRESH", "flag stays")
        assert running.report.headline == "test probe: 1 lamp"


def test_faults_of_health_are_shown(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: running.report.state == "FRESH", "no light")
        sick = replace(running.link.seen, faults=(Fault("source.stall", "no frame for 3 s"),))
        said = words.report(sick)
        assert said.state == "FAULTY"
        assert "source.stall: no frame for 3 s" in said.details


def test_light_that_is_too_old_fades_out_and_comes_back(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP], ttl_ms=400))
        ticked_until(running, lambda: running.fader.world_gain > 0, "no light")
        ticked_until(running, lambda: running.report.state == "OLD", "stays fresh")
        assert "it is valid for 0.4 s" in running.report.details[0]
        ticked_until(running, lambda: energies(scene) == [], "lamp stays")
        assert running.fader.world_gain == 0
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(2)], "no light again")


def test_after_a_pause_of_blender_the_fade_goes_on_from_where_it_was(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP], ttl_ms=1000))
        ticked_until(running, lambda: running.fader.world_gain == 1, "no light")
        ticked_until(running, lambda: not running.link.seen.fresh, "stays fresh")
        gain = running.fader.world_gain
        time.sleep(1)  # no timer runs meanwhile
        running.tick()
        assert gain - MOST_STEP_S / FADE_S - 1e-6 <= running.fader.world_gain < gain


def test_after_the_last_light_the_world_is_a_grey_as_bright_in_the_mean(scene):
    def without():
        (socket,) = [
            one
            for one in scene.lightprobe.world.node_tree.nodes["lightprobe fade"].inputs
            if one.identifier == "A_Color"
        ]
        return np.array(socket.default_value[:3])

    scene.lightprobe.scale = 2
    with Probe() as probe:
        running = connected(scene, probe.uri)
        running.tick()
        np.testing.assert_allclose(without(), scene.lightprobe.default_colour)
        flat = np.zeros((9, 3))
        flat[0] = 3 / 0.2820948
        probe.send(packet(flat, lamps=[LAMP], ttl_ms=400))
        ticked_until(running, lambda: running.fader.world_gain > 0, "no light")
        ticked_until(running, lambda: energies(scene) == [], "lamp stays")
        np.testing.assert_allclose(without(), 3 + 2 / 4 / np.pi, rtol=1e-5)
        assert running.fader.world_gain == 0


def test_a_restarted_probe_fades_over_to_new_objects(scene):
    with Probe() as first:
        port = first.port
        running = connected(scene, first.uri)
        first.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(2)], "no light")
        (old,) = scene_lamps.lamps(scene.lightprobe.root)
    ticked_until(running, lambda: running.report.state == "LOST", "still connected")
    with Probe(port) as second:
        second.send(packet(lamps=[(1, (1, 0, 0), (3, 3, 3), 1.0)]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(3)], "no light again")
        (new,) = scene_lamps.lamps(scene.lightprobe.root)
        assert old[0] != new[0]
        assert any("started again" in detail for detail in running.report.details)


def test_lamps_never_pop():
    fader, one, two = (
        Fader(),
        *suns.suns(estimate_of(lamps=[LAMP, (2, (1, 0, 0), (1, 1, 1), 1)]), True),
    )
    gains = []
    for step in range(40):
        fader.step(0.05, 7, [one] if step < 20 else [two])
        gains.append({lamp.key[1]: lamp.gain for lamp in fader.lamps})
    for number in (1, 2):
        course = [gain.get(number, 0) for gain in gains]
        assert np.abs(np.diff([0, *course])).max() < 0.05 / FADE_S + 1e-9
    assert gains[19] == {1: 1.0}
    assert gains[39] == {2: 1.0}
    assert gains[22][1] + gains[22][2] == pytest.approx(1)  # one comes as the other goes


def test_a_mirror_image_casts_no_shadow(scene):
    """It shines through the floor in which it is seen; a lamp does not."""
    estimate = estimate_of(lamps=[LAMP, (2, (0, -1, 0), (1, 1, 1), 1)])
    lamp, image = estimate.lights
    image = replace(image, flags=LightFlag.REFLECTION)
    shown = suns.suns(replace(estimate, lights=(lamp, image)), True)
    scene_lamps.show(scene, [ShownLamp((7, sun.id), sun, 1.0) for sun in shown], 1.0)
    lamps = scene_lamps.lamps(scene.lightprobe.root)
    for number, casts in ((1, True), (2, False)):
        data = lamps[7, number].data
        assert data.use_shadow == casts


def test_of_total_nothing_is_added():
    assert suns.suns(estimate_of(lamps=[LAMP], kind="TOTAL"), True) == []


def test_watts_need_a_calibrated_probe(scene):
    relative = estimate_of(lamps=[LAMP])
    with pytest.raises(LightprobeError, match="not calibrated"):
        suns.unit_scale(relative, "PHOTOMETRIC", 1)
    message = packet(lamps=[LAMP])
    message.cd_m2_per_unit = 1366
    calibrated = decode(pb.FromProbe(estimate=message).SerializeToString())
    assert suns.unit_scale(calibrated, "PHOTOMETRIC", 3) == pytest.approx(6)
    with Probe() as probe:
        scene.lightprobe.units = "PHOTOMETRIC"
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: "not calibrated" in running.report.headline, "no words")
        assert energies(scene) == []
        probe.send(message)
        ticked_until(running, lambda: energies(scene) == [pytest.approx(4)], "no light")


def test_a_probe_without_maps_says_so_in_map_mode(scene):
    with Probe() as probe:
        scene.lightprobe.uri, scene.lightprobe.mode = probe.uri, "MAP"
        bpy.ops.lightprobe.connect()
        running = session.current()
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: "--reflection-map=64" in running.report.headline, "no words")
        assert energies(scene) == []


def test_remove_puts_the_former_world_back(scene):
    scene.world = former = bpy.data.worlds.new("mine")
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(2)], "no light")
        assert scene.world != former
        bpy.ops.lightprobe.remove()
    assert scene.world == former
    assert not [thing for thing in bpy.data.objects if thing.type in ("LIGHT", "EMPTY")]
    assert [world.name for world in bpy.data.worlds] == ["mine"]
    assert not bpy.data.images


def test_a_deleted_empty_is_made_again(scene):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(lamps=[LAMP]))
        ticked_until(running, lambda: energies(scene) == [pytest.approx(2)], "no light")
        bpy.data.objects.remove(scene.lightprobe.root)
        running.tick()
        assert energies(scene) == [pytest.approx(2)]


def test_the_picture_is_saved_in_the_file(scene, tmp_path):
    with Probe() as probe:
        running = connected(scene, probe.uri)
        probe.send(packet(coefficients=np.full((1, 3), 70_000.0)))  # more than half floats hold
        ticked_until(running, lambda: scene.lightprobe.picture is not None, "no picture")
    file = str(tmp_path / "lit.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    assert session.current() is None
    image = bpy.context.scene.lightprobe.picture
    found = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(found)
    assert found.reshape(-1, 4)[:, 0] == pytest.approx(70_000 * 0.2820948, rel=1e-3)


def test_no_thread_touches_blender_and_all_end(scene):
    before = set(threading.enumerate())
    with Probe() as probe:
        for _ in range(3):
            running = connected(scene, probe.uri)
            running.tick()
        bpy.ops.lightprobe.disconnect()
    end = time.monotonic() + LONG_S
    while set(threading.enumerate()) - before:
        assert time.monotonic() < end, threading.enumerate()
        time.sleep(0.01)
