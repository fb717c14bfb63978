"""A camera whose first picture is much too bright, as automatic exposure leaves it."""

from pathlib import Path

import numpy as np
from harness import Daemon
from lightprobe import geometry
from lightprobe.calibrate.camera_file import edited
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.world import Behaviour, World

MODULE = Path(__file__).parents[2] / "packaging" / "cameras" / "module_ahead.camera"
SIZE_PX = (640, 320)
LENS = {"cx_px": "320", "cy_px": "160", "fx_px": "94", "fy_px": "94"}
#: The first one is seven stops too bright: walls around a lamp clip with it.
EXPOSURES_US = (12800, *15 * (100,))
MEDIAN_RADIANCE = 19.53
OFF_DEG = 4.0  # the lamps are 5 to 9 pixels wide, and far apart


def test_a_lamp_is_not_hidden_by_the_area_that_clipped_around_it(tmp_path):
    """What had clipped was held as an area light, lamp and all, and the lamp was never listed."""
    size = dict(zip(("width_px", "height_px"), map(str, SIZE_PX), strict=True))
    file = tmp_path / "module.camera"
    file.write_text(edited(edited(MODULE.read_text(), "camera", size), "lens.0", LENS))
    world = World(scenes.load(["room"]), Behaviour(act_s=0), MEDIAN_RADIANCE)
    camera = SimulatedCamera(world, lenses.load(str(file)), SIZE_PX, chroma="422")
    frames = tmp_path / "frames"
    frames.mkdir()
    for number, exposure_us in enumerate(EXPOSURES_US):
        picture = camera.frame(number, Shot(exposure_us))
        (frames / f"{number:02d}.jpg").write_bytes(picture)
    in_view = [lamp.direction for lamp in world.scenes[0].lamps if lamp.direction[2] < -0.5]
    listed = ",".join(str(one) for one in EXPOSURES_US)
    with Daemon(
        f"--source=file:{frames}?rate=5&exposures_us={listed}", f"--camera={file}",
        "--orientation=none", "--preset=fast",
    ) as daemon, daemon.client(max_lights=8, smoothing="RAW") as client:  # fmt: skip
        estimates = [client.next("estimate")]
        while estimates[-1].capture_time_unix_ns - estimates[0].capture_time_unix_ns < 1e9:
            estimates.append(client.next("estimate"))
    found = np.array([light.direction for light in estimates[-1].lights]).reshape(-1, 3)
    for direction in in_view:
        assert geometry.angle_deg(found, direction).min(initial=180.0) < OFF_DEG
