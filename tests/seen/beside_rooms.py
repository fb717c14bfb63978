"""The room of room.py around a probe that moves, and objects beside it: renders, and packets.

In each spot a head goes half a metre to and fro above a table, and looks ahead. Objects stand 0.3,
0.5 and 1 m to one side of the middle of its way. An app sends the head's poses with errors that
last. All of it is simulated, the daemon in simulated time.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import room
from composite import Surroundings
from probe import scaled, scaled_map
from room import Place

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/accuracy"))
import furnished_rooms  # noqa: E402
from furnished import FurnishedRoom, head_path  # noqa: E402
from judge import Packet  # noqa: E402
from lightprobe import geometry, sh  # noqa: E402
from lightprobe.estimate import Estimate  # noqa: E402
from lightprobe.geometry import Array  # noqa: E402
from lightprobe.imaging.environment import lamps_alone  # noqa: E402
from lightprobe.reflection_map import ReflectionMap  # noqa: E402
from lightprobe.sim.world import Behaviour  # noqa: E402
from lightprobe.wire import Subscription  # noqa: E402
from recording import SETTLE_S, Recording, Run, record  # noqa: E402

DISTANCES_M = (0.3, 0.5, 1.0)
TELLERS = ("place", "place-bad")
#: The middle of the head's way, above the foot of an object that would stand there.
_HEAD_M = np.array([0.0, 0.25, 0.0])
NODE_PX, _EXACT_PX, RATE_HZ = (480, 240), (960, 480), 15.0
#: The head is judged as it comes back through the middle of its way.
_JUDGED_AT_S, _JUDGED_S, _STILL_S = 30.0, 0.6, 4.0
_WIDTH_PX = 1024
WISH = Subscription(
    smoothing="RAW", max_lights=8, sh_order=4, reflection_map_size=64, reflection_map_rate_hz=30,
    reflection_map_kind="AMBIENT",
)  # fmt: skip


@dataclass(frozen=True)
class Spot:
    """Where the head goes: the room from the middle of its way, and the side of the objects."""

    name: str
    around: Place  # as of an object right below
    side: int  # of the objects: 1 right, -1 left

    def place(self, distance_m: float) -> Place:
        """Give the room as from an object at a distance."""
        x, z = self.around.middle
        along_m = self.side * distance_m
        left, right = self.around.table
        return Place(self.name, (x - along_m, z), (left - along_m, right - along_m))

    def object_m(self, distance_m: float, above_foot_m: float = room.RADIUS_M) -> Array:
        """Give an object's middle, from the middle of the head's way."""
        return np.array([self.side * distance_m, above_foot_m, 0]) - _HEAD_M


SPOTS = (
    Spot("near the globe", Place("", (0.5, 0.5), (-0.7, 1.3)), 1),
    Spot("in the middle of the room", Place("", (0.2, -0.1), (-0.7, 1.3)), 1),
    Spot("near the window", Place("", (-0.8, 0.3), (-1.3, 0.7)), -1),
)


@dataclass(frozen=True, eq=False)
class Seen:
    """What a probe says, in the room's units, and where it was from the middle of its way."""

    estimate: Estimate
    ambient: ReflectionMap
    place_m: Array

    def at(self, place_m: Array) -> Seen:
        """Give the light at a place (3,) from the middle of the way, as an app does."""
        offset_m = place_m - self.place_m
        around, estimate = self.ambient, self.estimate
        if estimate.room is not None:
            around = around.at(estimate.room, offset_m, estimate.frame)
        return Seen(estimate.at(offset_m), around, place_m)

    @property
    def turn(self) -> Array:
        """Matrix from the axes of the map to those of the packet."""
        if self.estimate.frame == "PROBE":
            return np.eye(3)
        assert self.ambient.orientation is not None
        x, y, z, w = self.ambient.orientation
        return geometry.rotation_matrix((w, x, y, z))

    def irradiance(self, normals: Array) -> dict[str, Array]:
        """Irradiance (N, 3) of lamps with the SH, and with the map."""
        lamps = self.estimate.irradiance(normals)
        lamps -= sh.irradiance(self.estimate.sh.coefficients, normals)
        by_map = lamps + self.ambient.irradiance(normals @ self.turn)
        return {"lamps and SH": self.estimate.irradiance(normals), "lamps and map": by_map}

    def surroundings(self) -> Surroundings:
        """Lamps as discs and the map between texels, in the axes of the packet."""
        towards = geometry.equirect_directions(_WIDTH_PX, _WIDTH_PX // 2) @ self.turn
        sharp = self.ambient.sample(towards)
        texel_px = _WIDTH_PX // (4 * self.ambient.size)
        wide = np.pad(sharp, ((0, 0), (texel_px, texel_px), (0, 0)), mode="wrap")
        smooth = cv2.blur(wide, (texel_px, texel_px), borderType=cv2.BORDER_REPLICATE)
        lamps = lamps_alone(self.estimate, _WIDTH_PX)
        return Surroundings(smooth[:, texel_px:-texel_px] + lamps)


def nodes(spot: Spot, samples: int) -> Array:
    """Panoramas (N, H, W, 3) along the way of the head."""
    return np.array([
        panorama(spot.around, _HEAD_M + at, NODE_PX, samples, number)
        for number, at in enumerate(furnished_rooms.way_m(furnished_rooms.node_shares()))
    ])  # fmt: skip


def exact(spot: Spot, distance_m: float, samples: int) -> Array:
    """The panorama (H, W, 3) at an object's place, without it; as high as room.PROBE_M."""
    return panorama(spot.place(distance_m), np.array(room.PROBE_M), _EXACT_PX, samples, 100)


def panorama(place: Place, at_m: Array, size_px: tuple[int, int], samples: int, seed: int) -> Array:
    """The empty room from `at_m`: (3,) from the foot of the object."""
    scene: dict[str, Any] = {"type": "scene", **room.room(place)}
    return np.asarray(furnished_rooms.panorama(
        furnished_rooms.mitsuba(), scene, at_m, size_px, samples, seed, hidden=False
    ))  # fmt: skip


def moving(spot: Spot, seen: Array, teller: str) -> Seen:
    """What a probe on a head says in the middle of its way, of its nodes()."""
    scene = FurnishedRoom(spot.name, np.float16(seen))
    path = Behaviour(act_s=0, path=head_path())
    judged_s = _JUDGED_AT_S + _JUDGED_S - SETTLE_S
    return _newest(_record(scene, path, teller, judged_s), _JUDGED_AT_S)


def still(panorama_there: Array) -> Seen:
    """What a probe says that stands where a panorama was rendered."""
    width, height = NODE_PX
    small = cv2.resize(panorama_there, (width, height), interpolation=cv2.INTER_AREA)
    everywhere = np.broadcast_to(np.float16(small), (furnished_rooms.NODES, *small.shape))
    scene = FurnishedRoom("still", everywhere)
    return _newest(_record(scene, Behaviour(act_s=0), "visual", _STILL_S), np.inf)


def _record(scene: FurnishedRoom, behaviour: Behaviour, teller: str, judged_s: float) -> Recording:
    return record(Run(
        scene, behaviour, orientation=teller, size_px=NODE_PX, rate_hz=RATE_HZ,
        judged_s=judged_s, daemon_arguments=("--reflection-map=64",), wishes={"raw": WISH},
    ))  # fmt: skip


def _newest(got: Recording, until_s: float) -> Seen:
    """Give the last packet with a map before a time, in the room's units."""
    pairs = [one for one in got.maps["raw"] if one[0].captured_s <= until_s]
    return seen_of(got, *pairs[-1])


def seen_of(got: Recording, packet: Packet, around: ReflectionMap) -> Seen:
    """Give a packet and its map in the room's units."""
    shown = got.world.scenes[0]
    assert isinstance(shown, FurnishedRoom)
    factor = 1 / shown.brightness
    here_m = np.array(got.world.at(packet.captured_s).place_m)
    return Seen(scaled(packet.estimate, factor), scaled_map(around, factor), here_m)
