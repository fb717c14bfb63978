"""`lightprobe estimate --ring-lux`: what is checked before the daemon runs."""

import pytest
from lightprobe.cli import estimate
from lightprobe.errors import UsageError


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5,6,7,8,x", "1,2,3,4,5,6,7,8,-9"])
def test_nine_numbers_are_needed(text):
    with pytest.raises(UsageError, match="nine numbers"):
        estimate.parse_ring(text)


def test_a_sensor_may_be_missing():
    assert estimate.parse_ring("1,2,3,nan,5,6,7,8,9") == "1,2,3,nan,5,6,7,8,9"
    assert estimate.parse_ring(None) is None
