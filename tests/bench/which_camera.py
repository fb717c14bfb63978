"""Figures of docs/users/which_camera.md: the daemon on a simulated THETA X, in real time.

`make which-camera` runs it (two minutes) and writes the table into the page. The error of the light
does not depend on the machine; times and processor load do.
"""

from __future__ import annotations

import re
import statistics
import sys
import tempfile
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
from lightprobe.sim import scenes
from lightprobe.sim.live import LiveClient
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.server import OscServer
from lightprobe.sim.world import Behaviour, World

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "users" / "which_camera.md"
SCENE, MEDIAN_RADIANCE = "room", 4.0
SETTLE_S, JUDGED_S = 6.0, 10.0
LONGEST_S = 60.0


@dataclass(frozen=True)
class Setting:
    """One line of the table."""

    words: str
    size: str = "1920x960"
    faults: str = ""
    begins_in_movie_mode: bool = False


SETTINGS = (
    Setting("Ethernet, camera in still mode before"),
    Setting("Ethernet, camera in movie mode before", begins_in_movie_mode=True),
    Setting(
        "Wi-Fi: 80 to 140 ms late, held back for 150 ms each second, options up to 3 frames later",
        faults="late_ms=80&jitter_ms=60&burst_ms=150&delay_jitter_frames=3",
    ),
    Setting("Ethernet, camera in still mode before", size="3840x1920"),
)


def measure(world: World, setting: Setting) -> str:
    """Run one setting; gives its row."""
    camera = OscCamera(world, faults=OscFaults().merged(setting.faults))
    width, height = (int(side) for side in setting.size.split("x"))
    camera.prepare((width, height), 30.0)
    if setting.begins_in_movie_mode:
        camera.options.set({"captureMode": "video"})
    truth = reference(world.scenes[0])
    with probing(camera, setting) as (client, begun_s):
        while not client.estimates and time.monotonic() - begun_s < LONGEST_S:
            read(client)
        first_s = time.monotonic() - begun_s
        run(client, SETTLE_S)
        before = len(client.estimates)
        run(client, JUDGED_S)
        judged = client.estimates[before:]
        health = client.health
        assert judged, "no estimates"
        assert health is not None, "no health"
        errors = [truth.score(estimate).relighting_mae for estimate in judged]
    return row(setting, first_s, errors, judged, health)


@contextmanager
def probing(camera: OscCamera, setting: Setting) -> Iterator[tuple[LiveClient, float]]:
    """A daemon on the camera, and a client; gives when the daemon was started."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lp-")))
        server = stack.enter_context(OscServer(camera, ("127.0.0.1", 0)))
        begun_s = time.monotonic()
        arguments = [
            f"--source=osc:127.0.0.1:{server.port}?size={setting.size}",
            f"--publish=unix:{folder / 'probe'}",
        ]
        stack.enter_context(Daemon(arguments, folder / "log"))
        client = connected(folder / "probe")
        stack.callback(client.close)
        yield client, begun_s


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


def row(
    setting: Setting, first_s: float, errors: list[float], judged: list[Estimate], health: Health
) -> str:
    """One line of the table."""
    rate_hz = len(judged) / JUDGED_S
    exposures = statistics.median(estimate.exposure_count or 0 for estimate in judged)
    cells = (
        setting.words, setting.size, f"{first_s:.1f} s", f"{exposures:.0f}",
        f"{100 * statistics.median(errors):.1f} % ({100 * max(errors):.1f} %)",
        f"{rate_hz:.0f}", f"{10 * health.cpu_percent / max(health.estimates_per_s, 0.1):.1f} ms",
        f"{health.latency_p50_us / 1000:.1f} ms",
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
        "| simulated THETA X | picture | first estimate after | exposures | error of the light "
        "(worst) | estimates a second | processor per estimate | frame here to packet |"
    )
    table = "\n".join([head, "| --- | --- | --- | --- | --- | --- | --- | --- |", *rows])
    text = PAGE.read_text()
    marked = re.compile(r"(<!-- generated: osc -->\n).*?(<!-- end: osc -->)", re.S)
    PAGE.write_text(marked.sub(lambda m: f"{m[1]}{table}\n{m[2]}", text))


if __name__ == "__main__":
    main()
