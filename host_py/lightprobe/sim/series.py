"""A series of exposures of a simulated camera, as `lightprobed --series` would write it.

For tests of what looks at such series: without a daemon, and as fast as this machine draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lightprobe.calibrate.exposure_series import ExposureSeries, Frame
from lightprobe.sim.camera import Shot, SimulatedCamera

_SUFFIX = {"MJPG": "jpg", "YUYV": "yuyv", "NV12": "nv12", "GREY": "grey"}


@dataclass
class Photographer:
    """Takes series of one camera, one after the other, as time goes on."""

    camera: SimulatedCamera
    folder: Path
    delay_frames: int = 1  # frames read after a command and before the first that obeys
    ignores: bool = False  # exposure commands
    reports: bool = False  # exposures
    first_us: float = 8000.0  # until the first command
    number: int = 0  # of the next frame
    processing: tuple[str, ...] | None = None
    _shot_us: float = 0.0

    def shoot(self, exposures_us: Sequence[float], frames: int, every: int = 1) -> ExposureSeries:
        """Command each exposure and take so many frames; keep each `every`-th of them."""
        limits, period_ns = self.camera.limits, round(1e9 / self.camera.rate_hz)
        folder = self.folder / f"{self.number:06d}"
        folder.mkdir(parents=True)
        taken: list[Frame] = []
        now_us = self._shot_us or self.first_us
        for step, wanted_us in enumerate(exposures_us):
            command_ns = self.number * period_ns - period_ns // 2
            for k in range(frames):
                obeys = k >= self.delay_frames and not self.ignores
                us = limits.nearest(wanted_us) if obeys else now_us
                if k % every == 0:
                    taken.append(self._take(folder, step, command_ns, wanted_us, us))
                self.number += 1
            now_us = limits.nearest(wanted_us) if not self.ignores else now_us
        self._shot_us = now_us
        return ExposureSeries(
            source="simulated", settable=True, reports_exposure=self.reports,
            min_us=limits.least_us, max_us=limits.most_us, step_us=limits.step_us,
            processing=self.processing, frames=tuple(taken),
        )  # fmt: skip

    def _take(self, folder: Path, step: int, command_ns: int, wanted_us: float, us: float) -> Frame:
        camera, period_ns = self.camera, round(1e9 / self.camera.rate_hz)
        path = folder / f"{self.number:06d}.{_SUFFIX[camera.pixel_format]}"
        path.write_bytes(camera.frame(self.number, Shot(us)))
        return Frame(
            path=path, format=camera.pixel_format, width_px=camera.size_px[0],
            height_px=camera.size_px[1], stride_bytes=0, sequence=self.number,
            t_read_ns=self.number * period_ns, corrupt=False, step=step,
            t_command_ns=command_ns, commanded_us=wanted_us,
            stated_us=us if self.reports else None,
        )  # fmt: skip
