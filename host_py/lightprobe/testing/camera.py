"""The simulated camera of a test."""

from __future__ import annotations

from urllib.parse import urlencode

from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.link import Counters, Link
from lightprobe.testing.breakable import Breakable
from lightprobe.testing.faults import CAMERA_FAULTS, healthy_camera, numbers_of
from lightprobe.testing.options import Options
from lightprobe.testing.room import Room


class Camera(Breakable):
    """A camera in the room; it films once the fixture `probe` runs."""

    def __init__(self, room: Room, options: Options) -> None:
        """`options`: size, rate, lens and film. Raises ImageError for a wrong camera file."""
        self.simulated = SimulatedCamera(
            room.world, lenses.load(options.lens), options.size_px, rate_hz=options.rate_hz,
            sheet=Sheet() if options.box and options.film else None, seed=options.seed,
        )  # fmt: skip
        self.faults = Faults()  # before it films
        self._link: Link | None = None
        self._is_unplugged = False

    def fault(self, name: str = "", /, **numbers: float) -> None:
        """Misbehave from the next frame on: `fault("camera-late")`, or `fault(late_ms=500)`.

        Names are those of :data:`lightprobe.testing.FAULTS`, numbers those of `lightprobe simulate
        --help-faults`. UsageError for an unknown name or an impossible number.
        """
        found = numbers_of(name, dict(numbers), CAMERA_FAULTS, "camera")
        if found:
            self._take(urlencode({key: f"{value:.12g}" for key, value in found.items()}))

    def heal(self) -> None:
        """Take all faults away, and plug it in."""
        self._take(healthy_camera())
        if self._is_unplugged:
            self.plug()

    def unplug(self) -> None:
        """Take the camera away, until :meth:`plug`. UsageError before the probe runs."""
        self._running().close()
        self._is_unplugged = True

    def plug(self) -> None:
        """Bring it back; the daemon finds it by itself."""
        self._running().listen()
        self._is_unplugged = False

    @property
    def counters(self) -> Counters:
        """Frames that it has sent, frames that were lost, commands, connections."""
        return self._running().counters

    def attach(self, link: Link) -> None:
        """Film through this link from now on; the fixture `probe` calls it."""
        self._link = link

    def _running(self) -> Link:
        if self._link is None:
            raise UsageError("camera: it does not film yet: let the test take the fixture `probe`")
        return self._link

    def _take(self, query: str) -> None:
        if self._link is None:
            self.faults = self.faults.merged(query)
        else:
            self._link.misbehave(query)
