"""What a mirror half a metre beside a head that goes shows: the map moved through the room."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.reflection_map import ReflectionMap, directions
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS
from lightprobe.sim.head import Habits, Head, true_place, true_turn
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.room import Room
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

SECONDS = 6.0
SIZE = 32
T_S = np.arange(0, 20, 1 / 60)
PLACES_M = 0.25 * np.stack(
    [np.sin(1.9 * T_S), 0.4 * np.sin(1.3 * T_S), np.sin(2.7 * T_S + 1)], axis=-1
)
LOOKS = turned(25 * np.sin(1.5 * T_S), 8 * np.sin(1.1 * T_S), 0.0)
#: Half a metre beside the probe, to all sides; axes of the room.
BESIDE_M = 0.5 * np.array([[1, 0, 0], [-0.8, 0.2, 0.56], [0, -0.3, -0.95], [0.1, 0.5, 0.86]])
PICTURE = (256, 128)


def seen(room: Room, place_m: Array, looks: Array) -> Array:
    """Radiance (…, 3) of the room without its lamps from a place along directions (…, 3)."""
    there = replace(room, shows_bulbs=False).seen_from(
        (float(place_m[0]), float(place_m[1]), float(place_m[2]))
    )
    picture = there.render(*PICTURE).compose(np.ones(len(room.bulbs)))
    column, row = geometry.equirect_pixel(looks, *PICTURE)
    rows = np.clip(np.rint(row).astype(int), 0, PICTURE[1] - 1)
    return np.asarray(picture[rows, np.rint(column).astype(int) % PICTURE[0]])


def off_beside(
    camera: SimulatedCamera, pairs: list[tuple[float, Estimate, ReflectionMap]]
) -> Iterator[tuple[float, float, float]]:
    """Mean difference over mean radiance: half a metre away, unchanged and moved; at the probe."""
    room = camera.world.scenes[0]
    assert isinstance(room, Room)
    for t_s, estimate, here in pairs:
        assert estimate.room is not None
        assert here.orientation is not None
        x, y, z, w = here.orientation
        looks = geometry.rotate((w, x, y, z), directions(SIZE))
        place_m = np.array(camera.world.at(t_s).place_m)
        true_here = seen(room, place_m, looks)
        at_probe = float(np.abs(here.radiance - true_here).mean() / true_here.mean())
        for beside_m in BESIDE_M:
            true = seen(room, place_m + beside_m, looks)
            inside = geometry.rotate(geometry.inverse((w, x, y, z)), beside_m)
            p_m = beside_m if estimate.frame == "WORLD" else inside
            there = here.at(estimate.room, p_m, estimate.frame)
            off = [float(np.abs(m.radiance - true).mean()) for m in (here, there)]
            yield off[0] / true.mean(), off[1] / true.mean(), at_probe


@pytest.mark.parametrize(("frame", "pictures"), [("WORLD", 3), ("PROBE", 0)])
def test_a_mirror_beside_the_head_shows_the_room_from_there(frame: str, pictures: int) -> None:
    world = World(
        [Room(pictures=pictures)], Behaviour(act_s=0, path=Track(T_S, LOOKS, PLACES_M)), 4.0
    )
    camera = SimulatedCamera(world, lenses.load("equirect"), (640, 320), rate_hz=12)
    wish = Subscription(
        smoothing="RAW", max_lights=8, sh_order=4, frame=frame,  # type: ignore[arg-type]
        reflection_map_size=SIZE, reflection_map_rate_hz=3, reflection_map_kind="AMBIENT",
    )  # fmt: skip
    with LiveProbe(camera, ("--orientation=client", f"--reflection-map={SIZE}")) as probe:
        client = probe.client(wish)
        probe.apps.append(
            Head(client, true_turn(camera), START_NS, Habits(memory_s=2), true_place(camera))
        )
        probe.run(SECONDS)
        of = {one.sequence: one for one in client.estimates}
        maps = [one.message for one in client.received if isinstance(one.message, ReflectionMap)]
        pairs = [
            (probe.captured_s(of[one.sequence]), of[one.sequence], one)
            for one in maps
            if one.sequence in of and of[one.sequence].room is not None
        ]
    pairs = [one for one in pairs if one[0] > SECONDS / 2]
    off = np.array(list(off_beside(camera, pairs)))
    unchanged, moved, at_probe = np.median(off, axis=0)
    print(f"{frame}: {unchanged:.3f} unchanged, {moved:.3f} moved, {at_probe:.3f} at the probe")
    assert len(off) > 10
    assert moved < 0.4 * unchanged
