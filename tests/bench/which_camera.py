"""Figures of docs/users/which_camera.md: the daemon on a simulated THETA X, in real time.

`make which-camera` runs it (three minutes) and writes the table into the page. The same scene comes
besides as frames of a USB camera: by the simulator's socket, with the exposures of UVC, since the
real driver wants a kernel with a camera (tests/kernel). The error of the light does not depend on
the machine; times and processor load do.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
from lightprobe import wire
from lightprobe.daemon import Daemon
from lightprobe.estimate import Estimate, Health
from lightprobe.evaluate.evaluation import reference
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.link import Exposure, Link
from lightprobe.sim.live import LiveClient
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.server import OscServer
from lightprobe.sim.world import Behaviour, World

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))
from generated import put  # noqa: E402

PAGE = ROOT / "docs" / "users" / "which_camera.md"
SCENE, MEDIAN_RADIANCE = "room", 4.0
RATE_HZ = 30.0
SETTLE_S, JUDGED_S = 6.0, 10.0
#: Then until frames come at nearly their rate, and all pictures have been drawn; at most so long.
NEARLY, LONGEST_S = 0.9, 60.0
#: The simulator repeats so many pictures of each exposure: drawn anew they would come too slowly,
#: and take the processor that the daemon is measured on.
KEPT = 4
#: Frames from a command to its effect, as many for both.
DELAY_FRAMES = 4


@dataclass(frozen=True)
class Setting:
    """One line of the table."""

    words: str
    size: str = "1920x960"
    faults: str = ""
    begins_in_movie_mode: bool = False
    usb: bool = False  # over UVC instead

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        width, height = (int(side) for side in self.size.split("x"))
        return width, height


SETTINGS = (
    Setting("THETA X, Ethernet, in still mode before"),
    Setting("THETA X, Ethernet, in movie mode before", begins_in_movie_mode=True),
    Setting(
        "THETA X, Wi-Fi: 80 to 140 ms late, held back for 150 ms each second, options up to 3 "
        "frames later",
        faults="late_ms=80&jitter_ms=60&burst_ms=150&delay_jitter_frames=3",
    ),
    Setting("a USB camera (UVC)", usb=True),
    Setting("THETA X, Ethernet, in still mode before", size="3840x1920"),
    Setting("a USB camera (UVC)", size="3840x1920", usb=True),
)


def measure(world: World, setting: Setting) -> str:
    """Run one setting; gives its row."""
    truth = reference(world.scenes[0])
    with probing(world, setting) as (client, begun_s):
        while not client.estimates and time.monotonic() - begun_s < LONGEST_S:
            read(client)
        first_s = time.monotonic() - begun_s
        settle(client)
        before = len(client.estimates)
        run(client, JUDGED_S)
        judged = client.estimates[before:]
        health = client.health
        assert judged, "no estimates"
        assert health is not None, "no health"
        errors = [truth.score(estimate).relighting_mae for estimate in judged]
    return row(setting, first_s, errors, judged, health)


@contextmanager
def probing(world: World, setting: Setting) -> Iterator[tuple[LiveClient, float]]:
    """A daemon on the camera, and a client; gives when the daemon was started."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lp-")))
        serve = on_usb if setting.usb else on_the_network
        uri = stack.enter_context(serve(world, setting, folder))
        begun_s = time.monotonic()
        arguments = [f"--source={uri}", f"--publish=unix:{folder / 'probe'}"]
        stack.enter_context(Daemon(arguments, folder / "log"))
        client = connected(folder / "probe")
        stack.callback(client.close)
        yield client, begun_s


@contextmanager
def on_the_network(world: World, setting: Setting, _: Path) -> Iterator[str]:
    """A simulated THETA X; gives the daemon's source."""
    faults = OscFaults().merged(setting.faults)
    camera = OscCamera(world, faults=faults, delay_frames=DELAY_FRAMES, kept=KEPT)
    camera.prepare(setting.size_px, RATE_HZ)
    if setting.begins_in_movie_mode:
        camera.options.set({"captureMode": "video"})
    with OscServer(camera, ("127.0.0.1", 0)) as server:
        yield f"osc:127.0.0.1:{server.port}?size={setting.size}"


@contextmanager
def on_usb(world: World, setting: Setting, folder: Path) -> Iterator[str]:
    """A simulated camera that takes exposures as UVC has them, and does not report them."""
    camera = SimulatedCamera(
        world, lenses.load("equirect"), setting.size_px, rate_hz=RATE_HZ, kept=KEPT
    )
    faults = Faults(hide_exposure=1, delay_frames=DELAY_FRAMES)
    link = Link(folder / "camera", camera, Exposure(camera), faults, say=lambda _: None)
    serving = threading.Thread(target=link.serve)
    serving.start()
    while not link.path.exists():
        time.sleep(0.002)
    try:
        yield f"sim:{folder / 'camera'}"
    finally:
        link.stop()
        serving.join()


def connected(path: Path) -> LiveClient:
    """Connect as soon as the daemon listens."""
    while True:
        try:
            return LiveClient(path, wire.Subscription(health_period_ms=1000))
        except (FileNotFoundError, ConnectionRefusedError):
            time.sleep(0.002)


def read(client: LiveClient) -> None:
    """Take what has come."""
    client.read(0.0)
    time.sleep(0.002)


def run(client: LiveClient, seconds: float) -> None:
    """Read for so long."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        read(client)


def settle(client: LiveClient) -> None:
    """Until the exposures have settled, and the simulator keeps up."""
    run(client, SETTLE_S)
    end_s = time.monotonic() + LONGEST_S
    while time.monotonic() < end_s:
        before = len(client.estimates)
        run(client, 2.0)
        if len(client.estimates) - before > NEARLY * 2.0 * RATE_HZ:
            return


def row(
    setting: Setting, first_s: float, errors: list[float], judged: list[Estimate], health: Health
) -> str:
    """One line of the table."""
    rate_hz = len(judged) / JUDGED_S
    exposures = statistics.median(estimate.exposure_count or 0 for estimate in judged)
    cells = (
        setting.words, setting.size, f"{first_s:.1f} s", f"{exposures:.0f}",
        f"{100 * statistics.median(errors):.1f} % ({100 * max(errors):.1f} %)",
        f"{rate_hz:.0f}", f"{health.cpu_percent:.0f} %",
        f"{health.latency_p50_us / 1000:.1f} ms ({health.latency_p99_us / 1000:.1f} ms)",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Measure everything and write the page."""
    cv2.setNumThreads(1)
    world = World(scenes.load([SCENE]), Behaviour(act_s=0), MEDIAN_RADIANCE)
    rows = []
    for setting in SETTINGS:
        rows.append(measure(world, setting))
        print(rows[-1], file=sys.stderr)
    head = (
        "| simulated camera | picture | first estimate after | exposures | error of the light "
        "(worst) | estimates a second | CPU, of one core | frame here to packet, median (99 %) |"
    )
    table = "\n".join([head, "| --- | --- | --- | --- | --- | --- | --- | --- |", *rows])
    put(PAGE, {"osc": table})


if __name__ == "__main__":
    main()
