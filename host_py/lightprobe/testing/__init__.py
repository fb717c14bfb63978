"""Tests of your own app and hardware with a simulated camera, wheel, ring and light.

In conftest.py:

    pytest_plugins = ["lightprobe.testing.plugin"]

Then tests take the fixtures `probe`, `room`, `camera` and `box`: docs/users/testing.md. It needs
the extra `testing`: pytest, and what the simulator needs.
"""

from lightprobe.testing.box import Box, RealBox, SimulatedBox
from lightprobe.testing.camera import Camera
from lightprobe.testing.failure import NotSeen
from lightprobe.testing.faults import FAULTS, NamedFault
from lightprobe.testing.options import CD_M2_PER_UNIT, Options
from lightprobe.testing.probe import Probe, running
from lightprobe.testing.room import Room, RoomLamp

__all__ = [
    "CD_M2_PER_UNIT", "FAULTS", "Box", "Camera", "NamedFault", "NotSeen", "Options", "Probe",
    "RealBox", "Room", "RoomLamp", "SimulatedBox", "running",
]  # fmt: skip
