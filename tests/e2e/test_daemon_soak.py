"""The soak test in short; the hour is `make soak`."""

from soak import ALLOWED_KIB, soak


def test_memory_is_flat_over_three_thousand_frames():
    assert soak(3000) < ALLOWED_KIB
