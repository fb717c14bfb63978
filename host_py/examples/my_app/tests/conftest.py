"""The fixtures `probe`, `room`, `camera` and `box`, with small pictures: the tests run faster."""

import pytest
from lightprobe.testing import Options

pytest_plugins = ["lightprobe.testing.plugin"]


@pytest.fixture
def probe_options() -> Options:
    """Override what the fixtures are made of."""
    return Options(size_px=(320, 160), rate_hz=10.0)
