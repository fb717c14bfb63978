"""Recordings become keyframes; spoilt ones say what is wrong with them."""

import math

import bpy
import numpy as np
import pytest
from bl_ext.user_default.lightprobe import scene_lamps, timeline
from lightprobe import recording, sh
from lightprobe_proto import lightprobe_pb2 as pb
from mathutils import Vector
from probes import packet
from rendering import WHITE, camera, plane, render

FPS = 24


def record(path, packets):
    """Write packets (time in s, pb.Estimate) as `lightprobe record` does."""
    with recording.Recorder(path) as recorder:
        for time_s, estimate in packets:
            payload = pb.FromProbe(estimate=estimate).SerializeToString()
            recorder.write(payload, 10**18 + round(1e9 * time_s))
    return path


def a_lamp_that_turns(path, steps=31):
    """One second: a lamp goes from the right (+X) to the front (−Z), the sky gets brighter."""
    packets = []
    for step in range(steps):
        angle = math.radians(3 * step)
        lamp = (5, (math.cos(angle), 0, -math.sin(angle)), (2, 1, 1), 2.0)
        sky = np.zeros((9, 3))
        sky[0] = 0.5 + step / 30
        packets.append((step / 30, packet(sky, [lamp], ttl_ms=500)))
    return record(path, packets)


def keyframed(path, **options):
    return bpy.ops.lightprobe.keyframe_recording(filepath=str(path), **options)


def towards(scene, frame):
    """Direction towards the only lamp, and its strength, at a frame."""
    scene.frame_set(frame)
    (lamp,) = scene_lamps.lamps(scene.lightprobe.root).values()
    return lamp.matrix_world.to_quaternion() @ Vector((0, 0, 1)), lamp.data.energy


def test_a_lamp_moves_over_the_timeline(scene, tmp_path):
    path = a_lamp_that_turns(tmp_path / "turn.mcap")
    assert keyframed(path, start_frame=10) == {"FINISHED"}
    for frame in range(10, 10 + FPS + 1):
        step = math.floor((frame - 10) / FPS * 30 + 1e-6)  # the newest packet by then
        angle = math.radians(3 * step)
        direction, energy = towards(scene, frame)
        assert math.degrees(direction.angle(Vector((math.cos(angle), math.sin(angle), 0)))) < 0.1
        assert energy == pytest.approx(2)
    (lamp,) = scene_lamps.lamps(scene.lightprobe.root).values()
    assert tuple(lamp.data.color) == pytest.approx((1, 0.5, 0.5))
    assert math.degrees(lamp.data.angle) == pytest.approx(4)
    # Between two frames, as motion blur looks at it, the lamp is between its keyframes.
    scene.frame_set(20, subframe=0.5)
    between = lamp.matrix_world.to_quaternion() @ Vector((0, 0, 1))
    assert between.angle(towards(scene, 20)[0]) == pytest.approx(
        between.angle(towards(scene, 21)[0]), abs=1e-3
    )


def test_the_world_changes_over_the_timeline(scene, tmp_path):
    keyframed(a_lamp_that_turns(tmp_path / "turn.mcap"))
    plane()
    camera((0, 0, 1), width=1)
    for frame in (1, 13, 25):
        scene.frame_set(frame)
        step = math.floor((frame - 1) / FPS * 30 + 1e-6)
        wanted = sh.irradiance(np.array([[0.5 + step / 30]]), [0, 1, 0])[0] / np.pi * WHITE
        # The lamp is at the horizon: half of its disc is above it, which the plane sees a little.
        empty = scene.lightprobe.root
        for lamp in scene_lamps.lamps(empty).values():
            lamp.hide_render = True
        found = render(8, 256).mean()
        print(f"frame {frame}: {found:.4f}, expected {wanted:.4f}")
        assert found == pytest.approx(wanted, rel=0.01)


def test_lamps_come_and_go_without_popping(scene, tmp_path):
    """A lamp that is in the middle third, and a pause longer than the time to live."""
    lamp = (3, (0, 1, 0), (2, 2, 2), 1.0)
    packets = [
        (s / 10, packet(lamps=[lamp] if 10 <= s < 20 else [], ttl_ms=300)) for s in range(30)
    ]
    packets.append((6.0, packet(lamps=[lamp], ttl_ms=300)))
    keyframed(record(tmp_path / "come.mcap", packets))
    energy = [towards(scene, frame)[1] for frame in range(1, 6 * FPS + 2)]
    assert energy[: FPS - 1] == [0] * (FPS - 1)
    assert energy[int(1.5 * FPS)] == pytest.approx(2)
    assert energy[int(2.5 * FPS)] == 0
    assert np.abs(np.diff(energy)).max() <= 2 / (0.3 * FPS) + 1e-6
    world = scene.lightprobe.world.node_tree.nodes["lightprobe fade"].inputs["Factor"]
    scene.frame_set(5 * FPS)  # in the pause
    assert world.default_value == 0


def test_a_recording_that_is_cut_off_is_used_as_far_as_it_goes(scene, tmp_path):
    whole = a_lamp_that_turns(tmp_path / "turn.mcap", steps=600).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    assert keyframed(cut) == {"FINISHED"}
    packets, notes = timeline.read(cut)
    assert 1 <= len(packets) < 600
    assert "is cut off after" in notes[0]


def test_files_of_others_in_the_folder_stay(scene, tmp_path):
    folder = tmp_path / "turn_sky"
    folder.mkdir()
    (folder / "0001.exr").write_text("mine")
    (folder / "lightprobe_9999.exr").write_text("of a longer recording")
    keyframed(a_lamp_that_turns(tmp_path / "turn.mcap"))
    assert (folder / "0001.exr").read_text() == "mine"
    assert len(list(folder.glob("lightprobe_*.exr"))) == FPS + 1


def test_a_keyframed_scene_is_not_overwritten_by_a_live_probe(scene, tmp_path):
    keyframed(a_lamp_that_turns(tmp_path / "turn.mcap"))
    with pytest.raises(RuntimeError, match="press 'Remove lamps and world' first"):
        bpy.ops.lightprobe.connect()
    bpy.ops.lightprobe.remove()
    assert not bpy.data.images
    assert bpy.ops.lightprobe.connect() == {"FINISHED"}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no recording", "is no MCAP file: record one with `lightprobe record`"),
        (b"\x89MCAP0\r\n", "holds no message of a probe"),
        (None, "No such file"),
    ],
)
def test_what_is_no_recording_leaves_the_scene_alone(scene, tmp_path, content, words):
    path = tmp_path / "bad.mcap"
    if content is not None:
        path.write_bytes(content)
    former = scene.world
    with pytest.raises(RuntimeError, match=words):
        keyframed(path)
    assert scene.world == former
    assert not bpy.data.objects


def test_a_folder_that_cannot_be_written_is_named(scene, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RuntimeError, match="file/sky: write pictures of the sky"):
        keyframed(a_lamp_that_turns(tmp_path / "t.mcap"), sky_folder=str(tmp_path / "file/sky"))


def test_too_long_a_recording_is_refused(scene, tmp_path):
    path = record(tmp_path / "long.mcap", [(0, packet()), (10_000, packet())])
    with pytest.raises(RuntimeError, match="more than 20000: record a shorter one"):
        keyframed(path)
