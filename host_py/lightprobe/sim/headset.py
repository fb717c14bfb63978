"""The poses that a headset tells while the simulated probe is mounted on it."""

from __future__ import annotations

import json
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.sim.world import World

#: What noise is drawn for, beside the frames of a camera with the same seed.
_PURPOSE = 77


@dataclass(frozen=True)
class Headset:
    """A head with a tracker: its rotation, and what is wrong with it."""

    mount_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)  # probe → head
    rate_hz: float = 72.0
    noise_deg: float = 0.05  # 1 sigma about each axis, of each pose
    late_ms: float = 0.0  # poses are stamped so much after their time
    ahead_s: float = 0.0  # the headset's clock shows so much more than the probe's
    jump_deg: float = 0.0  # its idea of the world turns by so much…
    jump_s: float = 0.0  # …each time so many seconds have passed; 0: never
    seed: int = 0

    def pose(self, world: World, number: int) -> tuple[float, Array]:
        """Pose `number`: the time that it claims, in seconds of the world, and x, y, z, w.

        The rotation turns the head's frame into the headset's idea of the world.
        """
        t_s = number / self.rate_hz
        rng = np.random.default_rng([self.seed, number, _PURPOSE])
        x, y, z, w = self.mount_xyzw
        to_scene = geometry.turn_after(world.rotation(t_s), geometry.inverse([w, x, y, z]))
        noise = geometry.quaternion(
            geometry.normalize(rng.standard_normal(3)), self._noise_angle_deg(rng)
        )
        pose = geometry.turn_after(to_scene, noise)
        pose = geometry.turn_after(self._idea_of_the_world(t_s), pose)
        w, x, y, z = pose / np.linalg.norm(pose)
        return t_s + 1e-3 * self.late_ms + self.ahead_s, np.array([x, y, z, w])

    def _noise_angle_deg(self, rng: np.random.Generator) -> float:
        return self.noise_deg * float(np.linalg.norm(rng.standard_normal(3)))

    def _idea_of_the_world(self, t_s: float) -> Array:
        jumps = int(t_s // self.jump_s) if self.jump_s else 0
        start = np.random.default_rng([self.seed, _PURPOSE])
        return geometry.turn_after(
            geometry.quaternion([0.0, 1, 0], jumps * self.jump_deg),
            geometry.quaternion([0.0, 1, 0], float(start.uniform(0, 360))),
        )


def line(time_ns: int, pose_xyzw: Array) -> str:
    """Give a pose as `lightprobe align` reads it."""
    rotation = [float(f"{value:.9g}") for value in pose_xyzw]
    return json.dumps({"time_ns": time_ns, "rotation_xyzw": rotation})


class HeadsetLog(threading.Thread):
    """Writes a headset's poses into a file as time goes on, as long as the block lasts."""

    _PERIOD_S = 0.02

    def __init__(self, path: Path, headset: Headset, world: World, start_ns: int) -> None:
        """`start_ns`: when the world began, CLOCK_MONOTONIC; poses tell Unix time."""
        super().__init__(name="headset", daemon=True)
        self._path, self._headset, self._world = path, headset, world
        self._unix_ns = start_ns + time.time_ns() - time.monotonic_ns()
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End, and close the file; who reads a pipe may have gone before."""
        self._ended.set()
        self.join(timeout=5)

    def run(self) -> None:
        """See :class:`HeadsetLog`."""
        number = 0
        try:
            with open(self._path, "w", encoding="utf-8") as file:  # of a pipe: waits for its reader
                while not self._ended.wait(self._PERIOD_S):
                    now_s = 1e-9 * (time.time_ns() - self._unix_ns)
                    while number / self._headset.rate_hz <= now_s:
                        t_s, pose = self._headset.pose(self._world, number)
                        file.write(line(self._unix_ns + round(1e9 * t_s), pose) + "\n")
                        number += 1
                    file.flush()
        except OSError as error:
            if not isinstance(error, BrokenPipeError):
                print(f"simulate: {self._path}: write: {error.strerror}", file=sys.stderr)
