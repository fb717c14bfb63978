"""Kinds of cameras that tables are measured with: `--cameras` of live.py and movers.py."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from lightprobe.imaging import camera as lenses
from lightprobe.imaging.camera import Camera

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Kind:
    """One camera, or several in one box."""

    words: str  # what tables say; empty: what they are about unless they say so
    files: Sequence[Path] = ()  # camera files, in order; none: an equirectangular camera

    @property
    def daemon_arguments(self) -> tuple[str, ...]:
        """What tells the daemon of the cameras."""
        return tuple(f"--camera={path}" for path in self.files)

    def seen(self, size_px: tuple[int, int]) -> Iterator[tuple[Camera, tuple[int, int]]]:
        """Lenses, and sizes of pictures: as the files state; `size_px`: of a panorama."""
        if not self.files:
            yield lenses.load("equirect"), size_px
        for path in self.files:
            camera = lenses.load(str(path))
            yield camera, (camera.width_px, camera.height_px)


#: By name.
KINDS = {
    "equirect": Kind(""),
    "dual-fisheye": Kind(
        "dual fisheye, 1280×720", (ROOT / "packaging/cameras/theta_s.camera",)
    ),
    "two-modules": Kind(
        "two fisheye modules, 1920×1080",
        tuple(ROOT / f"tests/accuracy/cameras/hd_module_{way}.camera" for way in ("ahead", "back")),
    ),
    # As many pixels to a degree as a panorama of 1920×960.
    "square-modules": Kind(
        "two fisheye modules, 1040×1040",
        tuple(ROOT / f"packaging/cameras/module_{way}.camera" for way in ("ahead", "back")),
    ),
}  # fmt: skip
