"""An app in simulated time that sends the pose of the head on which the camera sits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lightprobe import geometry
from lightprobe.estimate import Pong, Refusal
from lightprobe.geometry import Array
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveClient
from lightprobe.wire import encode_ping, encode_pose

#: How the head is turned at a time of the simulated world: w, x, y, z, head to world; None: nothing
#: is sent.
Turned = Callable[[float], Array | None]
#: Where the head is at a time of the simulated world, in that world, metres.
Placed = Callable[[float], Array]


def true_turn(camera: SimulatedCamera) -> Turned:
    """Give the truth of a camera: w, x, y, z, from its frame to the scene's."""
    return camera.world.rotation


def true_place(camera: SimulatedCamera) -> Placed:
    """Give the truth of a camera: where it is in the scene."""
    return lambda t_s: np.array(camera.world.at(t_s).place_m)


@dataclass
class Habits:
    """How the app sends its poses."""

    rate_hz: float = 90.0
    transfer_ms: float = 4.0  # of a pose, and of a ping
    noise_deg: float = 0.1  # 1 sigma about each axis; it is stated
    noise_m: float = 0.005  # 1 sigma along each axis, where places are sent; it is stated
    memory_s: float = 0.0  # errors of poses are correlated: exp(-t / memory_s); 0: independent
    drop: float = 0.0  # share of poses that are not sent
    clock_ns: int = -123_456_789_000  # the app's clock less the probe's
    stamp_ns: int = 0  # what poses are stamped with besides: of another clock than pings
    pings: bool = True
    seed: int = 0


class Head:
    """Sends poses as time goes on; `LiveProbe.run` calls :meth:`work`."""

    def __init__(
        self,
        client: LiveClient,
        turned: Turned,
        start_ns: int,
        habits: Habits | None = None,
        placed: Placed | None = None,
    ) -> None:
        """`start_ns`: when the simulated world began, by the probe's clock.

        `placed`: the head says where it is, too.
        """
        self.client, self.turned, self.habits = client, turned, habits or Habits()
        self.placed = placed
        self._start_ns = start_ns
        self._poses = self._pings = self._heard = 0
        self._pong_ns: int | None = None
        self._rng = np.random.default_rng(self.habits.seed)
        self._error = self._rng.standard_normal(6)  # of the pose before, in sigmas

    @property
    def refusals(self) -> list[str]:
        """What the probe has said against it."""
        heard = [one.message for one in self.client.received]
        return [message.text for message in heard if isinstance(message, Refusal)]

    def due_ns(self) -> int:
        """When something is to be sent next, by the probe's clock."""
        return min(self._pose_ns(self._poses), self._ping_ns()) + self._transfer_ns()

    def work(self) -> None:
        """Send what is due: it arrives now, and left some time ago."""
        self._hear()
        if self._pose_ns(self._poses) <= self._ping_ns():
            self._pose()
        else:
            self._ping()

    def _transfer_ns(self) -> int:
        return round(1e6 * self.habits.transfer_ms)

    def _pose_ns(self, number: int) -> int:
        return self._start_ns + round(1e9 * number / self.habits.rate_hz)

    def _ping_ns(self) -> int:
        never = 1 << 62
        return self._start_ns + self._pings * 1_000_000_000 if self.habits.pings else never

    def _pose(self) -> None:
        habits, t_ns = self.habits, self._pose_ns(self._poses)
        self._poses += 1
        turned = self.turned((t_ns - self._start_ns) / 1e9)
        self._draw_error()
        noise_deg = habits.noise_deg * self._error[:3]
        if turned is None or self._rng.random() < habits.drop:
            return
        angle_deg = float(np.linalg.norm(noise_deg))
        if angle_deg:
            turned = geometry.turn_after(turned, geometry.quaternion(noise_deg, angle_deg))
        w, x, y, z = turned
        stamp_ns = t_ns + habits.clock_ns + habits.stamp_ns
        place: tuple[Array, float] | tuple[()] = ()
        if self.placed is not None:
            true_m = self.placed((t_ns - self._start_ns) / 1e9)
            place = (true_m + habits.noise_m * self._error[3:], max(habits.noise_m, 0.0005))
        sigma_deg = max(habits.noise_deg, 0.01)
        self.client.send(encode_pose([x, y, z, w], stamp_ns, sigma_deg, *place))

    def _draw_error(self) -> None:
        """Draw the next pose's error: Gaussian, correlated with the one before over memory_s."""
        memory_s = self.habits.memory_s
        kept = math.exp(-1 / (self.habits.rate_hz * memory_s)) if memory_s else 0.0
        fresh = self._rng.standard_normal(6)
        self._error = kept * self._error + math.sqrt(1 - kept**2) * fresh

    def _ping(self) -> None:
        t_ns = self._ping_ns() + self.habits.clock_ns
        self._pings += 1
        self.client.send(encode_ping(t_ns, self._pong_ns))
        self._pong_ns = None

    def _hear(self) -> None:
        """Note when answers to pings came, as they come after their transfer."""
        news = self.client.received[self._heard :]
        self._heard += len(news)
        for one in news:
            if isinstance(one.message, Pong):
                there_ns = self._start_ns + round(1e9 * one.t_s) + self._transfer_ns()
                self._pong_ns = there_ns + self.habits.clock_ns
