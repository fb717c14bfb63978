"""Fisheye lenses are as good as an equirectangular camera, once their roll-off is calibrated."""

import fisheye
import pytest

pytestmark = pytest.mark.many_frames


@pytest.mark.nightly
def test_fisheye_lenses_are_as_good_and_roll_off_must_be_known(tmp_path):
    stills = fisheye.judged((3, str(fisheye.calibrated(tmp_path))))
    error = {one.camera: one.relighting_mae for one in stills if one.input == "3"}
    assert all(one.missed == one.false == 0 for one in stills)
    assert max(max(one.angles_deg) for one in stills if one.camera in ("dual", "modules")) < 0.1
    for camera in ("dual", "modules", "calibrated"):
        assert error[camera] < error["large"] + 0.01  # 0.004 more at most
    assert error["unknown"] > 5 * error["calibrated"]
