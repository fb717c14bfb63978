"""Build the Blender extension: the add-on and the Python packages that it needs, in one zip.

Blender brings Python 3.11 or newer, numpy and zstandard. It does not bring lightprobe, protobuf,
websockets, mcap and lz4 (of mcap): their wheels go into the extension. Three of them hold machine
code, so there is one extension for each platform.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
ADDON = ROOT / "clients/blender/addon"
CONSTRAINTS = ROOT / "host_py/constraints.txt"
#: Of Blender 4.2 to 5.0.
PYTHON = "3.11"
PACKAGES = ("protobuf", "websockets", "mcap", "lz4")
#: Blender's name of a platform, and pip's.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_11_0_arm64",),
    "macos-x64": ("macosx_11_0_x86_64", "macosx_10_9_x86_64"),
}


def here() -> str:
    """Blender's name of this machine's platform."""
    machine = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    return f"{system}-{machine}"


def pip(*arguments: str) -> None:
    """Run pip of this Python with the versions that the tests have seen."""
    environment = os.environ | {"PIP_CONSTRAINT": str(CONSTRAINTS)}
    command = [sys.executable, "-m", "pip", *arguments, "--quiet", "--disable-pip-version-check"]
    subprocess.run(command, check=True, env=environment)


def collect(blender_platform: str, folder: Path) -> list[Path]:
    """Put the wheels of a platform into a folder, which is emptied first."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.whl"):
        old.unlink()
    pip("wheel", "--no-deps", "--wheel-dir", str(folder), str(ROOT / "host_py"))
    tags = [f"--platform={tag}" for tag in PLATFORMS[blender_platform]]
    pip(
        "download", "--no-deps", "--only-binary=:all:", f"--python-version={PYTHON}", *tags,
        "--dest", str(folder), *PACKAGES,
    )  # fmt: skip
    return sorted(folder.glob("*.whl"))


def manifest(blender_platform: str, wheels: list[Path]) -> str:
    """Text of the manifest with platform and wheels; they precede its first table."""
    text = (ADDON / "blender_manifest.toml").read_text()
    lines = [f'platforms = ["{blender_platform}"]', "wheels = ["]
    lines += [*(f'  "./wheels/{wheel.name}",' for wheel in wheels), "]", "", ""]
    head, table, tail = text.partition("[permissions]")
    return head + "\n".join(lines) + table + tail


def pack(blender_platform: str, wheels: list[Path], file: Path) -> None:
    """Write the extension."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", manifest(blender_platform, wheels))
        archive.write(ROOT / "LICENSE", "LICENSE")
        for source in sorted(ADDON.glob("*.py")):
            archive.write(source, source.name)
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}")


def main() -> None:
    """Build the extension for one platform, and print its path."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--platform", choices=sorted(PLATFORMS), default=None)
    parser.add_argument("--out", type=Path, required=True, help="folder of the zip")
    arguments = parser.parse_args()
    wanted = arguments.platform or here()
    if wanted not in PLATFORMS:
        parser.error(f"no wheels are known for {wanted}: choose one of {', '.join(PLATFORMS)}")
    wheels = collect(wanted, arguments.out / "wheels" / wanted)
    file = arguments.out / f"lightprobe-blender-{wanted}.zip"
    pack(wanted, wheels, file)
    print(file)


if __name__ == "__main__":
    main()
