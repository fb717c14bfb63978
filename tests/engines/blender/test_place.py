"""Lamps with distances light the place of an object, or stand where they are."""

import math
import time

import bpy
import numpy as np
import pytest
from bl_ext.user_default.lightprobe import scene_lamps, session, sky, timeline
from bl_ext.user_default.lightprobe.link import Link, Wish
from lightprobe import recording
from lightprobe.wire import decode
from lightprobe_proto import lightprobe_pb2 as pb
from mathutils import Matrix, Vector
from probes import LONG_S, Probe, packet, ticked_until
from rendering import WHITE, camera, plane, render

#: Metres from the probe, +X right, +Y up, −Z forward; and the same in Blender's axes.
LAMP_M = np.array([0.9, 0.7, -0.3])
LAMP_IN_BLENDER_M = Vector((0.9, 0.3, 0.7))
IRRADIANCE = np.array([3.0, 2.0, 1.0])
AWAY_M = float(np.linalg.norm(LAMP_M))
RADIUS_DEG = 2.0


def light_of(distance_m, orientation=None):
    """A packet with one lamp."""
    made = packet(lamps=[(1, LAMP_M / AWAY_M, IRRADIANCE, RADIUS_DEG)])
    if distance_m is not None:
        made.lights[0].distance_m = distance_m
    if orientation is not None:
        made.orientation.extend(orientation)
    return made


def lit(scene, made, **settings):
    """Light the scene once, as a script does; give what the operator would report."""
    for name, value in {"map_size": "0", **settings}.items():
        setattr(scene.lightprobe, name, value)
    with Probe() as probe:
        scene.lightprobe.uri = probe.uri
        probe.send(made)
        found = session.light_once(scene, LONG_S)
    bpy.context.view_layer.update()
    return found


def cup(scene, location):
    """An empty that stands for an object."""
    made = bpy.data.objects.new("cup", None)
    made.location = location
    scene.collection.objects.link(made)
    return made


def the_lamp(scene):
    (lamp,) = scene_lamps.lamps(scene.lightprobe.root).values()
    return lamp


def towards(lamp):
    """Unit vector in the scene from where the sun shines."""
    return lamp.matrix_world.to_quaternion() @ Vector((0, 0, 1))


def stand_probe(scene):
    """Put the empty somewhere, turned; gives where the lamp is in the scene."""
    empty = scene_lamps.root(scene)
    empty.location = (1, -2, 0.5)
    empty.rotation_euler = (0, 0, math.radians(40))
    return Vector((1, -2, 0.5)) + Matrix.Rotation(math.radians(40), 3, "Z") @ LAMP_IN_BLENDER_M


def test_a_sun_shines_on_the_named_object_from_the_lamps_place(scene):
    lamp_m, place_m = stand_probe(scene), Vector((1.6, -1.2, 0.1))
    found = lit(scene, light_of(AWAY_M), lit_object=cup(scene, place_m))
    there = lamp_m - place_m
    lamp = the_lamp(scene)
    assert lamp.data.type == "SUN"
    assert math.degrees(towards(lamp).angle(there)) < 0.01
    nearer = AWAY_M / there.length
    assert np.allclose(np.array(lamp.data.color) * lamp.data.energy, IRRADIANCE * nearer**2)
    radius_deg = math.degrees(math.asin(math.sin(math.radians(RADIUS_DEG)) * nearer))
    assert math.degrees(lamp.data.angle) == pytest.approx(2 * radius_deg, rel=1e-4)
    assert not any(detail.startswith("Place:") for detail in found.details)


def test_the_place_is_found_while_the_probe_is_turned(scene):
    """The probe looks to its left: what was ahead of it (−Z) is now at −X."""
    half = math.radians(90) / 2
    place_m = Vector((0.4, 0.2, -0.1))
    made = light_of(AWAY_M, (0, math.sin(half), 0, math.cos(half)))
    lit(scene, made, lit_object=cup(scene, place_m))
    lamp_m = Matrix.Rotation(math.radians(90), 3, "Z") @ LAMP_IN_BLENDER_M
    assert math.degrees(towards(the_lamp(scene)).angle(lamp_m - place_m)) < 0.01


def test_the_light_follows_the_object_between_packets(scene):
    named = cup(scene, (0, 0, 0))
    scene.lightprobe.lit_object = named
    lit(scene, light_of(AWAY_M))
    assert math.degrees(towards(the_lamp(scene)).angle(LAMP_IN_BLENDER_M)) < 0.01
    with Probe() as probe:
        scene.lightprobe.uri = probe.uri
        running = session.connect(scene)
        probe.send(light_of(AWAY_M))
        ticked_until(running, lambda: running.fader.world_gain == 1, "no light")
        named.location = (1.5, 0, 0)
        bpy.context.view_layer.update()
        running.tick()
        bpy.context.view_layer.update()
        assert math.degrees(towards(the_lamp(scene)).angle(Vector((-0.6, 0.3, 0.7)))) < 0.01


@pytest.mark.parametrize("points", [False, True])
def test_cycles_renders_the_light_of_the_place(scene, points):
    """The white plane lies 0.7 m right of the probe, 0.4 m before it and 0.1 m below."""
    place_m = Vector((0.7, 0.4, -0.1))
    scene_lamps.root(scene).location = -place_m
    settings = {"point_lights": points, "lit_object": None if points else cup(scene, (0, 0, 0))}
    lit(scene, light_of(AWAY_M), **settings)
    plane(size=0.2)
    camera((0, 0, 1), width=0.02)
    there = LAMP_IN_BLENDER_M - place_m
    irradiance = IRRADIANCE * (AWAY_M / there.length) ** 2 * there.normalized().z
    off = np.abs(render(8, 256).mean(axis=(0, 1)) / (irradiance / np.pi * WHITE) - 1).max()
    print(f"{'point light' if points else 'sun'} beside the probe: {100 * off:.2f} % off")
    assert the_lamp(scene).data.type == ("POINT" if points else "SUN")
    assert off < 0.01


def test_a_point_light_stands_where_the_lamp_is(scene):
    lamp_m = stand_probe(scene)
    lit(scene, light_of(AWAY_M), point_lights=True)
    lamp = the_lamp(scene)
    assert (lamp.matrix_world.translation - lamp_m).length < 1e-5
    radius_m = AWAY_M * math.sin(math.radians(RADIUS_DEG))
    assert lamp.data.shadow_soft_size == pytest.approx(radius_m, rel=1e-4)
    lit(scene, light_of(None), point_lights=True)  # the distance is lost
    assert the_lamp(scene).data.type == "SUN"


def test_without_a_distance_the_report_says_so_and_light_is_as_at_the_probe(scene):
    found = lit(scene, light_of(None), lit_object=cup(scene, (1, 0, 0)))
    assert "Place: no lamp has a distance, so all light is as at the probe." in found.details
    assert math.degrees(towards(the_lamp(scene)).angle(LAMP_IN_BLENDER_M)) < 0.01


def in_a_room():
    """A packet without lamps in a room that is known."""
    coefficients = np.random.default_rng(2).normal(size=(25, 3)) / 4
    coefficients[0] = 4
    made = packet(coefficients)
    made.room.walls_m.extend([2, 2.5, 1.2, 1.5, 3, 1])
    made.room.walls_sigma_m.extend(6 * [0.1])
    made.room.orientation.extend([0, 0.6, 0, 0.8])
    return made


def test_the_world_is_that_of_the_objects_place(scene):
    made = in_a_room()
    here = decode(pb.FromProbe(estimate=made).SerializeToString())
    there = here.at((0.6, -0.2, -0.5))
    standing_m = np.array([0.6, 0.5, -0.2])  # the same in Blender's axes
    (frame,) = timeline.frames([timeline.TimedEstimate(0.0, here)], 1, 24, True, standing_m)
    assert frame.estimate.sh.coefficients == pytest.approx(there.sh.coefficients)
    with Probe() as probe:
        probe.send(made)
        link = Link(probe.uri, Wish(map_size=0), standing_m)
        end = time.monotonic() + LONG_S
        while link.seen.sky is None and time.monotonic() < end:
            time.sleep(0.01)
        link.close()
        assert link.wait_closed(LONG_S)
    wanted = sky.from_harmonics(there.sh).radiance
    assert np.abs(wanted - sky.from_harmonics(here.sh).radiance).max() > 0.1
    assert np.abs(link.seen.sky.radiance - wanted).max() < 1e-4
    found = lit(scene, made, lit_object=cup(scene, (1, 0, 0)))
    assert "Place: no lamp has a distance, so lamps are as at the probe." in found.details


def test_a_recording_is_keyframed_for_the_named_object(scene, tmp_path):
    """The empty is made anew at the origin, wherever it stood before."""
    stand_probe(scene)
    scene.lightprobe.lit_object = cup(scene, (1.5, 0, 0))
    bpy.context.view_layer.update()
    payload = pb.FromProbe(estimate=light_of(AWAY_M)).SerializeToString()
    with recording.Recorder(tmp_path / "room.mcap") as recorder:
        recorder.write(payload, 10**18)
    done = bpy.ops.lightprobe.keyframe_recording(filepath=str(tmp_path / "room.mcap"))
    assert done == {"FINISHED"}
    scene.frame_set(1)
    assert math.degrees(towards(the_lamp(scene)).angle(Vector((-0.6, 0.3, 0.7)))) < 0.01


def test_an_object_that_was_deleted_is_no_place(scene):
    named = cup(scene, (1, 0, 0))
    scene.lightprobe.lit_object = named
    scene.collection.objects.unlink(named)
    lit(scene, light_of(AWAY_M))
    assert math.degrees(towards(the_lamp(scene)).angle(LAMP_IN_BLENDER_M)) < 0.01
