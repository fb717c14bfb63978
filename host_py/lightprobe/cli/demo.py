"""`lightprobe demo`: the whole path, live: world, camera, daemon, client, and a picture of it."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from lightprobe import daemon, installation
from lightprobe.cli import check, watch
from lightprobe.cli.demo_painter import Painter
from lightprobe.client import Client
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.sim import control, scenes
from lightprobe.wire import Subscription

PANORAMAS = ("sunset", "forest", "courtyard")
_ACT_S, _SWITCH_S = 8.0, 4.0
#: As somebody looks around: so far to each side, so often.
_SWING_DEG, _SWING_HZ = 40.0, 0.2
#: The wheel homes, goes there and stays: frames that are exposed while it turns are left out.
_WHEEL_DEG = 45.0
_FIRST_ESTIMATE_S = 60.0
#: A camera that the daemon cannot open by then is not waited for.
_SOURCE_S = 3.0
#: Homing takes some seconds; if it is not done by then, the show begins and says so.
_WHEEL_S = 30.0
#: The last picture's good moment comes by then, or there is none.
_LAST_S = 10.0
#: A picture is taken of a world that has been the same for so long.
_SETTLED_S = 1.5
#: Of a simulated room, whose light changes at once, it waits so long (the last one: so long) for a
#: packet that states a smaller error of the irradiance, of its mean.
_KNOWN_S, _LAST_KNOWN_S, _KNOWN_ERROR = 3.0, 5.0, 0.05


class DemoError(LightprobeError):
    """The demo cannot run on."""


@dataclass(frozen=True)
class Ports:
    """Where the page is served, and where the simulator publishes the truth."""

    page: int
    truth: int

    @classmethod
    def choose(cls) -> Ports:
        """Take the usual port of the page, or any that is free."""
        with ExitStack() as stack:
            return cls(*(_free_port(stack, usual) for usual in (7701, 0)))

    def publish(self) -> str:
        """Give the daemon's option."""
        truth = f"ws://127.0.0.1:{self.truth}"
        return f"--publish=ws:127.0.0.1:{self.page}?root={installation.viewer()}&connect={truth}"

    def url(self, has_truth: bool) -> str:
        """Give the address for a browser."""
        truth = f"?truth=ws://127.0.0.1:{self.truth}/" if has_truth else ""
        return f"http://127.0.0.1:{self.page}/{truth}"


def _free_port(stack: ExitStack, usual: int) -> int:
    for port in (usual, 0):
        server = stack.enter_context(socket.socket())
        with suppress(OSError):
            server.bind(("127.0.0.1", port))
            return int(server.getsockname()[1])
    raise DemoError("demo: no port is free on this machine")


def command(
    seconds: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1, unit="seconds"),
            help="Seconds to run after the first estimate.",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            metavar="URI",
            help="URI of a real camera, as for lightprobed, instead of the simulator.",
        ),
    ] = None,
    camera: Annotated[
        str, typer.Option(metavar="equirect|FILE", help="equirect, or a camera file.")
    ] = "equirect",
    scene: Annotated[
        list[str] | None,
        typer.Option(
            "--scenes",
            metavar="WHAT",
            help="As for simulate; default: a room, real CC0 panoramas, procedural lamps.",
        ),
    ] = None,
    every_s: Annotated[
        float,
        typer.Option(callback=check.number(1, unit="seconds"), help="Seconds between pictures."),
    ] = 8.0,
    output: Annotated[
        Path, typer.Option(callback=check.new_folder, help="Folder of the pictures.")
    ] = Path("build/demo"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Show the whole path: a simulated room, the daemon, a live view, and a picture of the result.

    The camera looks around, lamps switch, scenes change. The picture shows lamps true and
    estimated, and an object lit by each. Ends on Ctrl-C, or after --seconds, with a picture of the
    first scene. A real camera has no truth to compare with.
    """  # fmt: skip
    control.require_unix_sockets("demo")
    daemon.find()
    make_folder(output)
    ports = Ports.choose() if installation.viewer() else None
    chosen = scene or default_scenes() if source is None else []
    with Painter(output, chosen) as painter:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lightprobe-")))
            simulator = None
            if source is None:
                simulator = stack.enter_context(simulation(folder, chosen, ports))
                source = f"sim:{folder / 'camera'}"
            uri = f"unix:{folder / 'probe'}"
            arguments = [f"--source={source}", f"--publish={uri}", f"--camera={camera}"]
            if ports is not None:
                arguments.append(ports.publish())
                print(f"demo: open {ports.url(simulator is not None)}", file=sys.stderr)
            if simulator is not None:
                arguments.append("--reflection-map=32")  # nobody lives in that room
                box_uri = f"mcu:serial:{folder / 'mcu'}"
                arguments += [f"--rotator={box_uri}", f"--ring={box_uri}"]
                arguments.append(f"--polarizer=fixed:{_WHEEL_DEG:g}")
            running = stack.enter_context(daemon.Daemon(arguments, folder / "daemon.log"))
            wait_for_socket(folder / "probe", running)
            wish = Subscription(smoothing="RAW", max_lights=8, health_period_ms=500)
            client = stack.enter_context(Client(uri, wish))
            truth = TruthLog(folder / "truth") if simulator else None
            show = Show(client, running, painter, truth, simulator, seconds, every_s)
            with suppress(KeyboardInterrupt):
                watch.show(client, show.step) if not as_json else show.run_silently()
            summary = show.summary()
            with suppress(KeyboardInterrupt):
                if simulator is not None:  # it ends with the scene that it began with
                    control.send(folder / "control", "scene 1")
                show.take_picture(last=True)
        # Nothing else runs now. A second Ctrl-C ends this too.
        with suppress(KeyboardInterrupt):
            if not painter.collect():
                print("demo: drawing the last picture; Ctrl-C leaves it out", file=sys.stderr)
                painter.collect(wait=True)
    report(summary | {"pictures": painter.pictures}, as_json)
    if painter.problem:
        raise DemoError(painter.problem)


def default_scenes() -> list[str]:
    """Scenes of the demo: one with exact truth, real panoramas, procedural lamps."""
    folder = scenes.panorama_folder()
    return ["room", *(str(folder / f"{name}.exr") for name in PANORAMAS), "procedural:5"]


@contextmanager
def simulation(
    folder: Path, chosen: list[str], ports: Ports | None
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the simulator in a process of its own."""
    command_line: list[str | Path] = [
        sys.executable, "-m", "lightprobe", "simulate", "--socket", folder / "camera",
        "--truth", folder / "truth", "--act-s", str(_ACT_S), "--swing-deg", str(_SWING_DEG),
        "--swing-hz", str(_SWING_HZ), "--switch-s", str(_SWITCH_S), "--format", "MJPG",
        "--firmware", "host", "--pty", folder / "mcu", "--control", folder / "control",
    ]  # fmt: skip
    for name in chosen:
        command_line += ["--scenes", name]
    if ports is not None:
        command_line += ["--truth-publish", f"ws:127.0.0.1:{ports.truth}"]
    with open(folder / "simulate.log", "wb") as log:
        process = subprocess.Popen(
            command_line, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def wait_for_socket(path: Path, running: daemon.Daemon) -> None:
    """Wait until the daemon listens; raises DaemonError when it ends instead."""
    while not path.exists():
        running.check()
        time.sleep(0.02)


class TruthLog:
    """The simulator's account of its frames, read while it is written."""

    def __init__(self, path: Path) -> None:
        """`path` may not exist yet."""
        self._path = path
        self._offset = 0
        self._lines: deque[dict[str, Any]] = deque(maxlen=300)

    def at(self, estimate: Estimate) -> dict[str, Any] | None:
        """Frame of an estimate; None while it is not written, or when the world is on the move."""
        self._read()
        # Both clocks of this machine: the daemon tells Unix time, the simulator CLOCK_MONOTONIC.
        # Compared each time: one clock may be set, and this process may be held up in between.
        t_ns = estimate.capture_time_unix_ns - (time.time_ns() - time.monotonic_ns())
        near = [line for line in self._lines if abs(self._middle_ns(line) - t_ns) < 20e6]
        if not near:
            return None
        frame = min(near, key=lambda line: abs(self._middle_ns(line) - t_ns))
        state = (frame["act"], frame["powers"])
        before = [line for line in self._lines if 0 <= frame["t_s"] - line["t_s"] < _SETTLED_S]
        settled = all((line["act"], line["powers"]) == state for line in before)
        return frame if settled and len(before) > 5 else None

    def _middle_ns(self, line: dict[str, Any]) -> float:
        return float(line["t_start_ns"] + 500 * line["exposure_us"])

    def _read(self) -> None:
        with suppress(FileNotFoundError), open(self._path, encoding="utf-8") as file:
            file.seek(self._offset)
            for line in iter(file.readline, ""):
                if not line.endswith("\n"):
                    break
                self._offset += len(line.encode())
                self._lines.append(json.loads(line))


def make_folder(path: Path) -> None:
    """Make the folder of the pictures before there are any; raises UsageError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"demo: --output {path}: make folder: {error.strerror}: name another"
        ) from None


def is_whole(estimate: Estimate) -> bool:
    """Whether the bracket has caught up with the scene."""
    return EstimateFlag.BRACKET_INCOMPLETE not in estimate.flags


def is_known(estimate: Estimate) -> bool:
    """Whether the light is known so well that a picture of it shows the probe, not a change."""
    return is_whole(estimate) and _stated(estimate) < _KNOWN_ERROR


def _stated(estimate: Estimate) -> float:
    """1 sigma of the irradiance that the packet states, of its mean; 0: it states none."""
    from lightprobe.evaluate.metrics import stated_error

    return stated_error(estimate) or 0.0


#: What a picture is taken of: the estimate, and the truth log's line of its frame.
Moment = tuple[Estimate, dict[str, Any]]


@dataclass
class Choice:
    """The moment of a picture: the first whose light is known; after a while, the best there was.

    `patience_s`: so long after the first moment offered.
    """

    patience_s: float
    best: Moment | None = None
    begun_s: float = 0.0

    def offer(self, now_s: float, moment: Moment | None) -> Moment | None:
        """Give the chosen moment, or None: wait. `moment`: None while none can be had."""
        if moment is not None:
            if is_known(moment[0]):
                return moment
            if self.best is None:
                self.begun_s = now_s
            if self.best is None or _stated(moment[0]) <= _stated(self.best[0]):
                self.best = moment
        return self.best if now_s - self.begun_s >= self.patience_s else None


@dataclass
class Show:
    """What goes on while the view is shown."""

    client: Client
    running: daemon.Daemon
    painter: Painter
    truth: TruthLog | None
    simulator: subprocess.Popen[bytes] | None
    seconds: float | None
    every_s: float
    started_s: float = field(default_factory=time.monotonic)
    seen_s: float | None = None  # the first estimate came
    first_s: float | None = None  # the wheel stands: from now on it counts
    before: int = 0  # estimates until then
    picture_due_s: float = 0.0
    choice: Choice = field(default_factory=lambda: Choice(_KNOWN_S))

    def step(self) -> str | None:
        """One turn of the loop: a footnote, or None to end."""
        now = time.monotonic()
        self.running.check()
        if self.simulator is not None and self.simulator.poll() is not None:
            log = (self.running.log.parent / "simulate.log").read_text(errors="replace").strip()
            raise DemoError(f"demo: the simulator has ended: {log}")
        if self.first_s is None:
            self._wait_for_first(now)
            if self.seen_s is not None:
                return "starting: the polarizer wheel is homing"
            if self.simulator is None:
                return f"starting: {self._source_fault() or 'the daemon waits for the camera'}"
            return "starting: scenes are rendered, the daemon waits for the camera"
        if self.seconds is not None and now - self.first_s > self.seconds:
            return None
        if now >= self.picture_due_s and self.take_picture():
            self.picture_due_s = now + self.every_s
        self.painter.collect()
        newest = next(reversed(self.painter.pictures), None)
        return f"picture: {newest}" if newest else ""

    def _wait_for_first(self, now: float) -> None:
        if self.client.statistics.estimates:
            self.seen_s = now if self.seen_s is None else self.seen_s
            if self._wheel_ready() or now - self.seen_s > _WHEEL_S:
                self.first_s = now
                self.before = self.client.statistics.estimates
                self.picture_due_s = now + 2
        elif self.simulator is None and now - self.started_s > _SOURCE_S and self._source_fault():
            raise DemoError(f"demo: no picture from the source: {self._source_fault()}")
        elif now - self.started_s > _FIRST_ESTIMATE_S:
            why = self.client.last_error or "connected, but silent"
            words = self.running.log.read_text(errors="replace").strip().splitlines()[-5:]
            raise DemoError(
                "\n".join([f"demo: no estimate in {_FIRST_ESTIMATE_S:g} s: {why}", *words])
            )

    def _source_fault(self) -> str | None:
        """What the daemon says of a source that sends nothing; None while it says nothing."""
        faults = self.client.health.faults if self.client.health else ()
        return next((fault.text for fault in faults if fault.id.startswith("source")), None)

    def _wheel_ready(self) -> bool:
        """Whether there is no wheel to wait for, or it is where it is to be."""
        health = self.client.health
        wheel = health.wheel if health else None
        return self.simulator is None or (wheel is not None and wheel.phase == "SETTLED")

    def run_silently(self) -> None:
        """The same without a view."""
        while self.step() is not None:
            time.sleep(0.05)

    def take_picture(self, last: bool = False) -> bool:
        """Begin a picture if one can be had now; `last`: wait for one of the first scene."""
        if last:
            self.painter.collect(wait=True)
            self.choice = Choice(_LAST_KNOWN_S)
        deadline = time.monotonic() + _LAST_S
        while True:
            estimate = self.client.latest()
            if estimate is not None and not is_whole(estimate):
                estimate = None
            if self.painter.collect() and self._paint(estimate, last):
                self.choice = Choice(_KNOWN_S)
                return True
            is_over = time.monotonic() > deadline and self.choice.best is None
            if not last or is_over:
                return False
            time.sleep(0.02)

    def _paint(self, estimate: Estimate | None, last: bool) -> bool:
        """Begin a picture if its moment has come; of a real camera, that is any."""
        if self.truth is None:
            if estimate is not None:
                self.painter.start(estimate, None, self._footer(estimate))
            return estimate is not None
        frame = self.truth.at(estimate) if estimate is not None else None
        if frame is not None and last and frame["act"] != 0:
            frame = None
        offered = (estimate, frame) if estimate is not None and frame is not None else None
        chosen = self.choice.offer(time.monotonic(), offered)
        if chosen is not None:
            self.painter.start(*chosen, self._footer(chosen[0]))
        return chosen is not None

    def _footer(self, estimate: Estimate) -> str:
        count = estimate.exposure_count
        words = f"{count} exposure{'s' if count != 1 else ''} per estimate · {self.rate_hz():.0f}/s"
        if self.truth is not None and not is_known(estimate):
            words = f"{unknown(_stated(estimate))} · {words}"
        return words

    def rate_hz(self) -> float:
        """Estimates per second that reached the client since the first."""
        if self.first_s is None:
            return 0.0
        elapsed_s = time.monotonic() - self.first_s
        counted = self.client.statistics.estimates - self.before
        return counted / elapsed_s if elapsed_s > 0 else 0.0

    def summary(self) -> dict[str, Any]:
        """Figures of the whole run."""
        health = self.client.health
        wheel, ring = (health.wheel, health.ring) if health else (None, None)
        return {
            "estimates": self.client.statistics.estimates - self.before,
            "estimates_per_s": round(self.rate_hz(), 2),
            "latency_p50_us": health.latency_p50_us if health else None,
            "latency_p99_us": health.latency_p99_us if health else None,
            "frames_rejected": health.frames_rejected if health else None,
            "wheel": asdict(wheel) if wheel else None,
            "ring": asdict(ring) if ring else None,
            "faults": [fault.id for fault in health.faults] if health else [],
        }


def unknown(stated: float) -> str:
    """Words for a picture whose packet states this 1 sigma of the irradiance, of its mean."""
    return f"light not known well yet: the packet states ± {100 * stated:.0f} %"


def report(summary: dict[str, Any], as_json: bool) -> None:
    """Print the closing words."""
    if as_json:
        print(json.dumps(summary, indent=2))
        return
    print(f"demo: {summary['estimates']} estimates, {summary['estimates_per_s']:.1f}/s received")
    wheel, ring = summary["wheel"], summary["ring"]
    if wheel and wheel["measured_deg"] is not None:
        at = f"{wheel['measured_deg']:.1f}° ± {wheel['sigma_deg']:.1f}°"
        print(f"demo: wheel {wheel['phase'].lower()} at {at}")
    if ring:
        lux = " ".join("–" if v is None else f"{v:.0f}" for v in ring["illuminance_lux"])
        print(f"demo: ring {lux} lux")
    for path, figures in summary["pictures"].items():
        words = f"relighting error {100 * figures['relighting_mae']:.1f} %" if figures else ""
        if "lamps" in figures:
            words += f", {figures['found']:.0f} of {figures['lamps']:.0f} lamps"
        if figures.get("extra"):
            words += f", {figures['extra']:.0f} extra"
        if "direction_rmse_deg" in figures:
            words += f", {figures['direction_rmse_deg']:.2f}° off"
        if figures.get("stated_error", 0) >= _KNOWN_ERROR:
            words += f"; {unknown(figures['stated_error'])}"
        print(f"demo: picture: {path}  {words}")
    if not summary["estimates"]:
        raise DemoError("demo: no estimate came")
