"""What is true in a simulated world, as a probe: for viewers that show it beside an estimate."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
from lightprobe_proto import lightprobe_pb2 as pb

from lightprobe import geometry, sh
from lightprobe.errors import LightprobeError
from lightprobe.server import ProbeServer, stamp_now
from lightprobe.sim.moved import change
from lightprobe.sim.scene import lit_lamps
from lightprobe.sim.world import State

_ORDER = 4
_TTL_MS = 5000


class Exact:
    """Estimates that a perfect probe would give of a world's states.

    The sum over a panorama is taken once for each scene, place and state of its lamps, then turned.
    """

    def __init__(self) -> None:
        """Know nothing yet."""
        self._key: Hashable = None
        self._total = np.zeros((sh.count(_ORDER), 3))

    def estimate(self, state: State, gain: float) -> Any:
        """Give a pb.Estimate: all lamps, strongest first, and the rest as SH.

        `gain`: share of the light that reaches the camera (a polarizer takes some).
        """
        key = (state.act, state.place_m, state.powers.tobytes())
        if key != self._key:
            self._total = state.scene.truth(state.powers).total[: sh.count(_ORDER)]
            self._key = key
        to_probe = geometry.inverse(state.rotation)
        coefficients = sh.rotate(self._total, to_probe)
        lamps = lit_lamps(state.scene.lamps, state.powers, state.rotation)
        if state.movers:
            more = change(state.movers, state.scene, state.powers)
            coefficients += sh.rotate(more.total[: sh.count(_ORDER)], to_probe)
            lamps = more.dimmed(lamps, state.powers)
        message = pb.Estimate(ttl_ms=_TTL_MS, exposure_count=1)
        for lamp in sorted(lamps, key=lambda lamp: -float(np.sum(lamp.irradiance)))[:8]:
            coefficients -= sh.lamp(lamp.direction, _ORDER)[:, None] * lamp.irradiance
            message.lights.add(
                id=1 + len(message.lights),
                direction=lamp.direction.tolist(),
                irradiance=(gain * lamp.irradiance).tolist(),
                angular_radius_deg=lamp.radius_deg,
            )
        message.sh.kind = pb.SphericalHarmonics.AMBIENT
        message.sh.order = _ORDER
        message.sh.coefficients[:] = (gain * coefficients).ravel().tolist()
        return message


class TruthServer(threading.Thread):
    """Publishes the truth so many times a second, as long as the block lasts."""

    def __init__(
        self, uri: str, now: Callable[[], tuple[State, float]], rate_hz: float = 5.0
    ) -> None:
        """`uri`: of :meth:`ProbeServer.listening`; `now` gives state and gain, from any thread."""
        super().__init__(name="truth", daemon=True)
        self._uri, self._now, self._period_s = uri, now, 1 / rate_hz
        self._exact = Exact()
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self.error: LightprobeError | None = None

    def __enter__(self) -> TruthServer:
        """Start; raises :class:`LightprobeError` when it cannot listen."""
        self.start()
        self._ready.wait()
        if self.error is not None:
            raise self.error
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self.join()

    def run(self) -> None:
        """See :class:`TruthServer`."""
        try:
            self._loop.run_until_complete(self._serve())
        except LightprobeError as error:
            self.error = error
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        server = ProbeServer("truth", "lightprobe simulate")
        async with server.listening(self._uri):
            self._ready.set()
            while not self._ended.is_set():
                estimate = self._exact.estimate(*self._now())
                stamp_now(estimate)
                server.publish(estimate)
                try:
                    await asyncio.wait_for(self._ended.wait(), self._period_s)
                except TimeoutError:
                    continue
