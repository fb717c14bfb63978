"""Draws the demo's pictures in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from lightprobe.cli.simulate import MEDIAN_RADIANCE
from lightprobe.estimate import Estimate
from lightprobe.sim import scenes

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


class Painter:
    """Draws pictures in a process of its own, at low priority, one at a time."""

    def __init__(self, output: Path, chosen: list[str]) -> None:
        """`chosen`: scenes as the simulator has them."""
        self.output = output
        self.pictures: dict[str, dict[str, float]] = {}  # path: error figures; the newest last
        self.problem: str | None = None  # of a picture that could not be drawn or written
        self._chosen = chosen
        self._busy = False

    def __enter__(self) -> Self:
        """Start its process."""
        resource_tracker.ensure_running()  # now: it would unblock Ctrl-C below
        with ExitStack() as stack:
            with _ctrl_c_held():
                spawn = multiprocessing.get_context("spawn")
                self._pipe, theirs = spawn.Pipe()
                self._process = spawn.Process(target=_draw_all, args=(theirs, self._chosen))
                self._process.start()
                stack.callback(self._process.kill)
                theirs.close()  # so that its death is seen as the end of the pipe
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Do not wait for a picture that nobody wants any more."""
        self._process.kill()

    def collect(self, wait: bool = False) -> bool:
        """Take over a picture that is done; True when none is under way.

        `wait`: until it is done, however long that takes.
        """
        if not self._busy:
            return True
        if not wait and not self._pipe.poll():
            return False
        self._busy = False
        try:
            done = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            self.problem = f"demo: the process that draws has ended: {self._process.exitcode}"
            return True
        if isinstance(done, OSError):
            self.problem = f"demo: {done.filename or self.output}: write: {done.strerror}"
        elif isinstance(done, Exception):
            raise done
        else:
            path, figures = done
            self.pictures.pop(path, None)
            self.pictures[path] = figures
        return True

    def start(self, estimate: Estimate, frame: dict[str, Any] | None, footer: str) -> None:
        """Begin a picture; `frame` is the truth log's line, None for a real camera."""
        with suppress(BrokenPipeError):  # collect() says why
            self._pipe.send((self.output, estimate, frame, footer))
        self._busy = True


# In the painter's process.

_world: dict[str, Any] = {}


def _draw_all(orders: Connection, chosen: list[str]) -> None:
    """Draw what is ordered until nobody orders any more: nice, and leaving Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(4)
    _world["names"] = chosen
    with suppress(EOFError, BrokenPipeError):
        while True:
            output, estimate, frame, footer = orders.recv()
            try:
                path, figures = _paint(output, estimate, frame, footer)
                shutil.copyfile(path, output / "latest.png")
                orders.send((path, figures))
            except Exception as error:  # the parent raises it
                orders.send(error)


def _paint(
    output: Path, estimate: Estimate, frame: dict[str, Any] | None, footer: str
) -> tuple[str, dict[str, float]]:
    """Draw one picture; gives its path and the error figures in it."""
    import cv2
    import numpy as np

    from lightprobe.evaluate import picture
    from lightprobe.sim import motion
    from lightprobe.sim.scene import has_exact_lamps
    from lightprobe.sim.world import World

    cv2.setNumThreads(1)
    if frame is None:
        path = output / "camera.png"
        return str(path), picture.draw(path, estimate, None, footer)
    if "world" not in _world:
        _world["world"] = World(scenes.load(_world["names"]), None, MEDIAN_RADIANCE)
    scene = _world["world"].scenes[frame["act"]]
    radiance = scene.render(1024, 512).compose(frame["powers"])
    # By whole pixels of the map: the truth beside it is turned by just as much.
    turn_px = round(frame["yaw_deg"] / 360 * 1024)
    off_deg = frame["yaw_deg"] - turn_px * 360 / 1024
    rotation = motion.turned(frame["yaw_deg"])
    lamps = scene.truth(frame["powers"], rotation).lamps if has_exact_lamps(scene) else None
    turned = np.roll(radiance, turn_px, axis=1)
    scenery = picture.Scenery(frame["scene"], turned, lamps, off_deg)
    path = output / f"{frame['scene']}.png"
    return str(path), picture.draw(path, estimate, scenery, footer)


@contextmanager
def _ctrl_c_held() -> Iterator[None]:
    """Hold Ctrl-C back as long as the block lasts; a process that starts in it never gets one.

    Blocked in this thread, it may still come by another one, such as numpy's.
    """
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
