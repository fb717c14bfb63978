# SPDX-License-Identifier: Apache-2.0
"""Our UVC camera from the test's side: start it, plug it, command its faults, find its nodes."""

import socket
import subprocess
from pathlib import Path

from gadget import load_bus
from machine import modprobe, wait_for

PROGRAM = Path(__file__).resolve().parents[3] / "build" / "kernel" / "bin" / "uvc_camera"
VIDEO = Path("/sys/class/video4linux")


def load_drivers(nodrop: int = 0) -> None:
    """Load uvcvideo and the bus. `nodrop` 1: frames with errors are delivered, with a flag."""
    load_bus()
    modprobe("raw_gadget")
    modprobe("uvcvideo")
    Path("/sys/module/uvcvideo/parameters/nodrop").write_text(str(nodrop))


def is_capture_node(entry: Path) -> bool:
    """Does this node deliver pictures? (A UVC camera has a second one for metadata.)"""
    try:
        return (entry / "index").read_text().strip() == "0"
    except OSError:
        return False  # gone between listing and reading


def device_of(node: Path) -> str:
    """Place of a node's device in sysfs; "" when it has gone."""
    try:
        return str((VIDEO / node.name / "device").resolve(strict=True))
    except OSError:
        return ""


def capture_nodes() -> list[Path]:
    """Nodes that deliver pictures."""
    return [
        Path("/dev") / entry.name
        for entry in sorted(VIDEO.glob("video*"))
        if is_capture_node(entry)
    ]


class Camera:
    """One camera process. Options are those of `uvc_camera --help`, with _ for -."""

    def __init__(self, port: int = 0, **options: object) -> None:
        self.controller = f"dummy_udc.{port}"
        self._bus_port = f"usb{self._bus_number(port)}"
        self._commands = Path(f"/run/uvc_camera.{port}")
        self._commands.unlink(missing_ok=True)  # a process that was ended leaves its socket
        arguments = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
        self._process = subprocess.Popen(
            [
                # Hardware does not wait for a processor.
                *("chrt", "--rr", "10"),
                PROGRAM,
                "--unplugged",
                f"--controller={self.controller}",
                f"--commands={self._commands}",
                *arguments,
            ]
        )
        self._socket = socket.socket(socket.AF_UNIX)
        wait_for("uvc_camera", lambda: self._socket.connect_ex(str(self._commands)) == 0)
        self._replies = self._socket.makefile("r")

    @staticmethod
    def _bus_number(port: int) -> str:
        (bus,) = Path("/sys/devices/platform").glob(f"dummy_hcd.{port}/usb*/busnum")
        return bus.read_text().strip()

    def command(self, line: str) -> str:
        """Send one command; returns what followed `ok`."""
        self._socket.sendall(f"{line}\n".encode())
        reply = self._replies.readline().strip()
        assert reply.startswith("ok"), f"uvc_camera: {line}: {reply or 'has ended'}"
        return reply.removeprefix("ok").strip()

    def plug(self) -> Path:
        """Connect, and return the node once it is there."""
        self.command(f"plug {self.controller}")
        return wait_for("video node", self.node)

    def unplug(self) -> None:
        """Disconnect, and wait until the node has gone."""
        self.command("unplug")
        wait_for("video node gone", lambda: self.node() is None)

    def node(self) -> Path | None:
        """Capture node of this camera; None while there is none."""
        for node in capture_nodes():
            if f"/{self._bus_port}/" in device_of(node) and node.exists():
                return node
        return None

    def state(self) -> dict[str, int]:
        """Counts and control values."""
        return {key: int(value) for key, value in
                (word.split("=") for word in self.command("state").split())}  # fmt: skip

    def close(self) -> None:
        """End the process; the camera goes with it."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(timeout=20)
        wait_for("video node gone", lambda: self.node() is None)
