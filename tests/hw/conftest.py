"""Tests of the box (hw/); hw/tools is on the path by pytest.ini."""

import pytest
from dimensions import dimensions
from meshes import SERVO_DEG


@pytest.fixture(scope="session")
def dim() -> dict[str, float]:
    """Dimensions in mm and degrees."""
    return dimensions(servo_travel_deg=SERVO_DEG)
