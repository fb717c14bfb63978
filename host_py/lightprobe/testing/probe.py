"""A daemon before the simulated camera, with a connected client."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Self, TypeVar

from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.estimate import (
    Estimate,
    EstimateFlag,
    Fault,
    Health,
    Hello,
    Light,
    LightFlag,
    flag_names,
)
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.testing.box import RealBox, SimulatedBox
from lightprobe.testing.camera import Camera
from lightprobe.testing.failure import not_seen
from lightprobe.testing.faults import CAMERA_FAULTS, FAULTS, numbers_of
from lightprobe.testing.options import CD_M2_PER_UNIT, Options
from lightprobe.testing.room import Room
from lightprobe.wire import Subscription

Found = TypeVar("Found")
#: Seconds that a wait takes at most, unless told otherwise.
WITHIN_S = 20.0
#: How often a condition is looked at, in seconds of the probe's time.
_LOOK_S = 0.05


class Probe:
    """Daemon, camera, box and client of a test. Time goes on only while the test waits.

    That is in :meth:`run`, in the methods `wait_…` and in a block `with probe.going_on():`.
    """

    def __init__(
        self, room: Room, camera: Camera, box: SimulatedBox | RealBox | None, options: Options
    ) -> None:
        """Take them together; the `with` block runs the daemon. NotInstalledError without one."""
        self.room, self.camera, self.box, self.options = room, camera, box, options
        self._lock = threading.RLock()
        self._live = LiveProbe(
            camera.simulated, _arguments(box, options), faults=camera.faults,
            box=box.live if box else None, real_time=options.real_time,
        )  # fmt: skip
        self._client: LiveClient | None = None

    def __enter__(self) -> Self:
        """Start the daemon and connect the client. DaemonError when it refuses its options."""
        self._live.__enter__()
        self.camera.attach(self._live.link)
        if self.box is not None and self.box.live is not None:
            self.box.live.shine(lambda: self.room.lux(self._live.link.state_now()))
        self._client = self._live.client(self.options.subscription)
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._live.__exit__()

    # ------------------------------------------------------------ what it shows

    @property
    def uri(self) -> str:
        """Address for the app under test: `Client(probe.uri)`."""
        return f"unix:{self._live.socket}"

    @property
    def t_s(self) -> float:
        """Seconds of the probe's time since its start."""
        return self._live.t_s

    @property
    def log(self) -> str:
        """All that the daemon has said."""
        return self._live.log

    @property
    def client(self) -> LiveClient:
        """The connected client; `client.received` has all messages with their times."""
        if self._client is None:
            raise UsageError("probe: it does not run: use it in a `with` block, or as a fixture")
        return self._client

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate; None before the first."""
        return self._newest(Estimate)

    @property
    def health(self) -> Health | None:
        """The newest health message; None before the first."""
        return self._newest(Health)

    @property
    def hello(self) -> Hello | None:
        """What the daemon says of itself."""
        return self._newest(Hello)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What it says is wrong now."""
        return self.health.faults if self.health else ()

    def connect(self, subscription: Subscription | None = None) -> LiveClient:
        """Connect one more client; it hears while time goes on."""
        with self._lock:
            return self._live.client(subscription)

    # ------------------------------------------------------------ faults

    def fault(self, name: str) -> None:
        """Break something of camera or box by its name in FAULTS. UsageError for an unknown one."""
        numbers_of(name, {}, FAULTS, "probe")
        if name in CAMERA_FAULTS:
            self.camera.fault(name)
        elif self.box is None:
            raise UsageError(f"probe: {name}: there is no box: set Options(box=True)")
        else:
            self.box.fault(name)

    def wait_shown(self, name: str, within_s: float = WITHIN_S) -> None:
        """Wait until the probe shows a fault as FAULTS says, after it was asked for by name.

        Where the table says `nothing`, wait for an estimate that comes all the same.
        """
        kind, _, what = FAULTS[name].shows.partition(" ")
        if kind == "fault":
            self.wait_fault(what, within_s=within_s)
        elif kind == "flag":
            self.wait_flag(EstimateFlag[what], within_s)
        elif kind == "count":
            before = getattr(self.health, what, 0)
            self.wait_health(lambda one: getattr(one, what) > before, within_s, f"rise of {what}")
        else:
            self.wait_estimate(within_s=within_s)

    def heal(self) -> None:
        """Take all faults of camera and box away."""
        self.camera.heal()
        if self.box is not None and not self.box.is_real:
            self.box.heal()

    # ------------------------------------------------------------ time

    def run(self, seconds: float) -> None:
        """Let time go on. ClockError when the daemon has ended."""
        with self._lock:
            self._live.run(seconds)

    @contextmanager
    def going_on(self, speed: float = 1.0) -> Iterator[None]:
        """Let time go on by itself while the block waits for an app.

        `speed`: simulated seconds in a second at most; in real time it does not count. An error of
        the daemon is raised at the end of the block.
        """
        ending, errors = threading.Event(), list[Exception]()

        def work() -> None:
            while not ending.is_set():
                due_s = time.monotonic() + _LOOK_S / speed
                try:
                    self.run(_LOOK_S)
                except Exception as error:
                    errors.append(error)
                    return
                ending.wait(max(due_s - time.monotonic(), 0.001))

        thread = threading.Thread(target=work, name="lightprobe time", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ending.set()
            thread.join()
        if errors:
            raise errors[0]

    # ------------------------------------------------------------ waiting

    def wait_for(
        self,
        found: Callable[[], Found | None],
        wanted: str,
        within_s: float = WITHIN_S,
        hint: str = "",
    ) -> Found:
        """Let time go on until `found` gives something true, and give it.

        NotSeen after `within_s` seconds of the probe's time; it names `wanted`, the stage, the
        state of the probe and the next step (`hint`, or one that fits the stage).
        """
        end_s = self.t_s + within_s
        while not (result := found()):
            if self.t_s >= end_s - 1e-9:
                raise not_seen(self, wanted, within_s, hint)
            self.run(min(_LOOK_S, end_s - self.t_s))
        return result

    def wait_estimate(
        self,
        condition: Callable[[Estimate], bool] = lambda estimate: True,
        within_s: float = WITHIN_S,
        wanted: str = "such estimate",
        hint: str = "",
    ) -> Estimate:
        """Wait for an estimate that comes from now on and fulfils a condition; give it."""
        seen = len(self.client.received)

        def found() -> Estimate | None:
            nonlocal seen
            new = self.client.received[seen:]
            seen += len(new)
            estimates = (one.message for one in new if isinstance(one.message, Estimate))
            return next((one for one in estimates if condition(one)), None)

        return self.wait_for(found, wanted, within_s, hint)

    def wait_lamp(
        self,
        azimuth_deg: float,
        elevation_deg: float,
        within_deg: float = 5.0,
        within_s: float = WITHIN_S,
    ) -> Light:
        """Wait for an estimate with a lamp in a direction that does not clip; give the nearest.

        A lamp that has just come clips at first: the camera needs shorter exposures to measure it.
        """
        there = geometry.direction_from_angles(azimuth_deg, elevation_deg)

        def away_deg(light: Light) -> float:
            return float(geometry.angle_deg(light.direction, there))

        def near(estimate: Estimate) -> list[Light]:
            whole = (one for one in estimate.lights if not one.flags & LightFlag.CLIPPED)
            return sorted((one for one in whole if away_deg(one) <= within_deg), key=away_deg)

        wanted = f"lamp within {within_deg:g}° of {azimuth_deg:g}°, {elevation_deg:g}°"
        hint = "a lamp that is listed and clips does not count: make it wider or dimmer"
        estimate = self.wait_estimate(lambda one: bool(near(one)), within_s, wanted, hint)
        return near(estimate)[0]

    def wait_flag(self, flag: EstimateFlag, within_s: float = WITHIN_S) -> Estimate:
        """Wait for a new estimate with a flag."""
        names = ", ".join(flag_names(flag))
        return self.wait_estimate(lambda one: bool(one.flags & flag), within_s, f"flag {names}")

    def wait_no_flag(self, flag: EstimateFlag, within_s: float = WITHIN_S) -> Estimate:
        """Wait for a new estimate without a flag."""
        wanted = f"estimate without {', '.join(flag_names(flag))}"
        return self.wait_estimate(lambda one: not one.flags & flag, within_s, wanted)

    def wait_fault(self, *ids: str, within_s: float = WITHIN_S) -> Fault:
        """Wait until the probe reports a fault with one of these ids (docs/users/faults.md)."""
        return self.wait_for(
            lambda: next((one for one in self.faults if one.id in ids), None),
            f"fault {' or '.join(ids)}", within_s,
        )  # fmt: skip

    def wait_no_fault(self, fault_id: str = "", within_s: float = 60.0) -> None:
        """Wait until the probe reports a fault no more; without an id: until it reports none."""

        def gone() -> bool:
            there = [one.id for one in self.faults]
            return self.health is not None and (fault_id not in there if fault_id else not there)

        self.wait_for(gone, f"end of {fault_id or 'all faults'}", within_s)

    def wait_health(
        self,
        condition: Callable[[Health], bool],
        within_s: float = WITHIN_S,
        wanted: str = "such health",
    ) -> Health:
        """Wait until the newest health message fulfils a condition; give it."""
        return self.wait_for(
            lambda: self.health if self.health and condition(self.health) else None,
            wanted, within_s,
        )  # fmt: skip

    def wait_settled(self, within_s: float = 60.0) -> Estimate:
        """Wait until the camera streams, the wheel has been homed and an estimate has come."""

        def settled(health: Health) -> bool:
            wheel = health.wheel
            homed = wheel is None or wheel.phase in ("MOVING", "SETTLED")
            return health.source_state == "STREAMING" and homed

        self.wait_health(settled, within_s, "camera that streams and wheel that was homed")
        return self.wait_estimate(within_s=within_s, wanted="estimate")

    def _newest(self, kind: type[Found]) -> Found | None:
        for one in reversed(self.client.received):
            if isinstance(one.message, kind):
                return one.message
        return None


@contextmanager
def running(options: Options | None = None, port: str | None = None) -> Iterator[Probe]:
    """Run a probe without fixtures, as they do; `port`: of a real box."""
    chosen = options or Options()
    room = Room(chosen.ambient, chosen.behaviour)
    camera = Camera(room, chosen)
    with ExitStack() as stack:
        box = make_box(chosen, port)
        if isinstance(box, SimulatedBox):
            stack.enter_context(box)
        yield stack.enter_context(Probe(room, camera, box, chosen))


def make_box(options: Options, port: str | None) -> SimulatedBox | RealBox | None:
    """Give the box that options ask for. BoxError when its firmware is not installed."""
    if not options.box:
        return None
    if port:
        return RealBox(port)
    return SimulatedBox(options.firmware, options.seed, real_time=options.real_time)


def _arguments(box: SimulatedBox | RealBox | None, options: Options) -> list[str]:
    """Options of lightprobed beside source and publisher."""
    arguments = [f"--cd-m2-per-unit={CD_M2_PER_UNIT:g}"]
    if options.lens != "equirect":
        arguments.append(f"--camera={options.lens}")
    if box is not None:
        arguments += [f"--rotator=mcu:serial:{box.port}", f"--ring=mcu:serial:{box.port}"]
        if options.film and not box.is_real:
            arguments.append("--polarizer=sweep")
    return [*arguments, *options.daemon]
