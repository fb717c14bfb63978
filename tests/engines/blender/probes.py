"""Packets, and a probe of lightprobe.v1 that sends what a test says, over a real socket."""

import asyncio
import threading
import time

import numpy as np
from lightprobe import sh
from lightprobe.server import ProbeServer, stamp_now
from lightprobe_proto import lightprobe_pb2 as pb

LONG_S = 60


def packet(coefficients=None, lamps=(), kind="AMBIENT", ttl_ms=60_000, flags=0):
    """A pb.Estimate. `lamps`: (id, direction, irradiance, radius in degrees), probe frame."""
    made = pb.Estimate(ttl_ms=ttl_ms, flags=flags, sequence=1, boot_id=7)
    shape = np.zeros((9, 3)) if coefficients is None else np.asarray(coefficients)
    made.sh.order = sh.order_of(shape)
    made.sh.kind = pb.SphericalHarmonics.Kind.Value(kind)
    made.sh.basis = pb.SphericalHarmonics.REAL_POSITIVE
    made.sh.quantity = pb.SphericalHarmonics.RADIANCE
    made.sh.coefficients.extend(shape.ravel().tolist())
    for number, direction, irradiance, radius_deg in lamps:
        light = made.lights.add(id=number, angular_radius_deg=radius_deg)
        light.direction.extend(np.asarray(direction, float).tolist())
        light.irradiance.extend(np.asarray(irradiance, float).tolist())
    stamp_now(made)
    return made


class Probe:
    """A probe on a port of its own. Use with `with`; `send` publishes to whoever listens."""

    def __init__(self, port=0, scheme="tcp"):
        self._port, self._scheme = port, scheme
        self._loop = asyncio.new_event_loop()
        self._ready, self._end = threading.Event(), None
        self.uri = ""

    def __enter__(self):
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),))
        self._thread.start()
        assert self._ready.wait(LONG_S)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(LONG_S)
        assert not self._thread.is_alive()

    async def _run(self):
        self._end = asyncio.Event()
        self._server = ProbeServer("test probe", "tests")
        async with self._server.listening(f"{self._scheme}:127.0.0.1:{self._port}") as self.uri:
            self._ready.set()
            await self._end.wait()
            connections = asyncio.all_tasks() - {asyncio.current_task()}
            for task in connections:
                task.cancel()
            await asyncio.gather(*connections, return_exceptions=True)

    @property
    def port(self):
        return int(self.uri.rpartition(":")[2])

    def send(self, estimate):
        stamp_now(estimate)
        self._loop.call_soon_threadsafe(self._server.publish, estimate)


def ticked_until(session, condition, what):
    """Do as Blender's timer does until a condition holds."""
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        assert session.tick()
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError(f"after {LONG_S} s: {what}: {session.report}")
