"""`lightprobe estimate --ring-lux`: what is checked before the daemon runs."""

import pytest
from lightprobe.cli import estimate
from lightprobe.errors import UsageError

LUX = "1,2,3,nan,5,6,7,8,9"
RGB = ",".join(["100"] * 26 + ["nan"])


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5,6,7,8,x", "1,2,3,4,5,6,7,8,-9"])
def test_nine_numbers_are_needed(text):
    with pytest.raises(UsageError, match="nine numbers"):
        estimate.ring_settings(text, "0.03", None, 0.03)


@pytest.mark.parametrize("text", ["", "0", "0.1,0.2", "x"])
def test_sigma_is_one_number_or_nine(text):
    with pytest.raises(UsageError, match=r"--ring-sigma .*one number.*or nine"):
        estimate.ring_settings(LUX, text, None, 0.03)


@pytest.mark.parametrize("text", ["", "1,2,3", LUX, RGB.replace("nan", "-1")])
def test_colours_are_27_numbers(text):
    with pytest.raises(UsageError, match="27 numbers"):
        estimate.ring_settings(LUX, "0.03", text, 0.03)


def test_colours_need_the_readings():
    with pytest.raises(UsageError, match="--ring-rgb: needs --ring-lux"):
        estimate.ring_settings(None, "0.03", RGB, 0.03)


def test_a_sensor_may_be_missing():
    assert estimate.ring_settings(LUX, "0.03", None, 0.03) == {
        "ring_lux": LUX,
        "ring_sigma": "0.03",
    }
    assert estimate.ring_settings(LUX, "0.03", RGB, 0.1) == {
        "ring_lux": LUX,
        "ring_sigma": "0.03",
        "ring_rgb": RGB,
        "ring_colour_sigma": 0.1,
    }
    assert estimate.ring_settings(None, "0.03", None, 0.03) == {}
