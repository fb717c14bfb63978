"""A camera whose first pictures are much too bright, as automatic exposure leaves them."""

from pathlib import Path

import numpy as np
import pytest
from harness import Daemon
from lightprobe import geometry
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.world import Behaviour, World

MODULE = Path(__file__).parents[2] / "packaging" / "cameras" / "module_ahead.camera"
#: The first one is seven stops too bright: walls around a lamp clip with it.
EXPOSURES_US = (12800, *15 * (100,))


@pytest.mark.parametrize("preset", ["fast", "balanced"])
def test_a_lamp_is_not_hidden_by_the_area_that_clipped_around_it(tmp_path, preset):
    """What had clipped was held as an area light, lamp and all, and the lamp was never listed."""
    world = World(scenes.load(["room"]), Behaviour(act_s=0), 19.5)
    lens = lenses.load(str(MODULE))
    camera = SimulatedCamera(world, lens, (320, 320))
    for number, exposure_us in enumerate(EXPOSURES_US):
        path = tmp_path / f"{number:02d}.jpg"
        path.write_bytes(camera.frame(number, Shot(exposure_us)))
    in_view = [lamp.direction for lamp in world.scenes[0].lamps if lamp.direction[2] < -0.5]
    listed = ",".join(str(one) for one in EXPOSURES_US)

    def off_deg(estimate):
        found = np.array([one.direction for one in estimate.lights]).reshape(-1, 3)
        return max(geometry.angle_deg(found, one).min(initial=180.0) for one in in_view)

    with Daemon(
        f"--source=file:{tmp_path}?rate=15&exposures_us={listed}", f"--camera={MODULE}",
        "--orientation=none", f"--preset={preset}",
    ) as daemon, daemon.client(max_lights=8, smoothing="RAW") as client:  # fmt: skip
        client.until(lambda estimate: off_deg(estimate) < 4)
