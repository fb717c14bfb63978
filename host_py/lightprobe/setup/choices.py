"""What is there to be chosen: cameras, microcontrollers, camera files."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lightprobe import installation


@dataclass(frozen=True)
class Choice:
    """A value of a setting, and what it is."""

    value: str
    words: str


def sources(root: Path = Path("/")) -> list[Choice]:
    """Cameras that the kernel knows: those that give pictures, not their metadata."""
    found = []
    for device in sorted((root / "sys/class/video4linux").glob("video*")):
        with suppress(OSError):
            if (device / "index").read_text().strip() == "0":
                name = (device / "name").read_text().strip()
                found.append(Choice(f"v4l2:/dev/{device.name}", name))
    return found


def ports(root: Path = Path("/")) -> list[Choice]:
    """Serial lines by their lasting names, and the one that udev calls the microcontroller's."""
    found = []
    if (root / "dev/lightprobe-mcu").exists():
        found.append(Choice("serial:/dev/lightprobe-mcu", "the microcontroller"))
    for link in sorted((root / "dev/serial/by-id").glob("*")):
        found.append(Choice(f"serial:/dev/serial/by-id/{link.name}", link.name))
    return found


def camera_files(folder: Path) -> list[Choice]:
    """Camera files beside the configuration, and those that are shipped."""
    shipped = installation.share() / "cameras"
    own = [Choice(str(file), file.stem) for file in sorted(folder.glob("*.camera"))]
    return [
        *own,
        *(Choice(str(file), f"{file.stem} (shipped)") for file in sorted(shipped.glob("*.camera"))),
    ]
