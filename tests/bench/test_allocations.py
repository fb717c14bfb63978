"""After warm-up the daemon allocates nothing per frame, however many lights a picture holds."""

import cv2
import daemon_load
import frames
import numpy as np

KIND = frames.Kind("lights_960x480_420", 960, 480, "equirect", "420", 90)


def test_no_allocation_per_frame(tmp_path):
    """Dots on grey: more regions than the detector keeps, and lamps to refine."""
    files = []
    for dots in (3, 400):
        rng = np.random.default_rng(dots)
        picture = np.full((KIND.height_px, KIND.width_px, 3), 40, np.uint8)
        for x, y in rng.integers((20, 20), (KIND.width_px - 20, KIND.height_px - 20), (dots, 2)):
            level = int(rng.integers(150, 250))
            cv2.circle(picture, (int(x), int(y)), 4, (level,) * 3, -1)
        files.append(tmp_path / f"{dots}.jpg")
        cv2.imwrite(str(files[-1]), picture, [cv2.IMWRITE_JPEG_QUALITY, KIND.quality])
    load = daemon_load.Load(KIND, files, seconds=0)
    assert daemon_load.allocations_per_frame(load, tmp_path) == 0
