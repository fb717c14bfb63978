"""What belongs to this installation: viewer and firmware beside Python; the package's extras.

`make build` puts them into build/, beside build/venv; `make install` into PREFIX/lib/lightprobe,
beside its venv. A package that pip or pipx installed elsewhere has none.
"""

from __future__ import annotations

import sys
from pathlib import Path


def folder() -> Path:
    """Where they would be: two above the folder of this Python."""
    return Path(sys.executable).parents[2]


def viewer() -> Path | None:
    """Folder of the viewer, for `root=` of a publisher; None where it is not installed."""
    web = folder() / "web"
    return web if (web / "index.html").is_file() else None


def firmware() -> Path:
    """File of the microcontroller's firmware; it may be missing."""
    return folder() / "firmware" / "lightprobe-mcu.hex"


def share() -> Path:
    """Folder of drop-ins and camera files, if `make install` has installed this."""
    return folder().parents[1] / "share" / "lightprobe"


def install_extras(*names: str) -> str:
    """Say how extras of this package get into this Python. No package index has the package."""
    extras = ",".join(names)
    return f"in lightprobe's repository: {sys.executable} -m pip install './host_py[{extras}]'"
