# SPDX-License-Identifier: Apache-2.0
"""Frames for the test camera: one simulated room at many exposures, and the truth about its lamps.

Writes WxH_EXPOSUREus_N.jpg (uvc_camera --pictures=folder:PATH) and truth.json. Exposures are powers
of two of 100 us, the step of the camera's control, so that a bracket of such exposures is exact.
"""

import json
import sys
from pathlib import Path

import numpy as np
from lightprobe.imaging import camera
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.world import Behaviour, World

SIZE_PX = (640, 320)
EXPOSURES_US = [100 * 2**k for k in range(10)]
FRAMES = 2  # of each exposure: their noise differs
# The scene's median reaches a quarter of full scale at 12.8 ms.
MEDIAN_RADIANCE = 0.25 / 12.8e-3


def main(folder: Path) -> None:
    """Fill the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    world = World(scenes.load(["room"]), Behaviour(act_s=0), MEDIAN_RADIANCE)
    simulated = SimulatedCamera(world, camera.equirect(), SIZE_PX, chroma="422")
    for exposure_us in EXPOSURES_US:
        for number in range(FRAMES):
            picture = simulated.frame(number, Shot(exposure_us))
            name = f"{SIZE_PX[0]}x{SIZE_PX[1]}_{exposure_us}us_{number}.jpg"
            (folder / name).write_bytes(picture)
    scene = world.scenes[0]
    truth = scene.truth(np.ones(len(scene.lamps)))
    lamps = [
        {
            "direction": lamp.direction.tolist(),
            "irradiance": np.asarray(lamp.irradiance).tolist(),
            "radius_deg": float(lamp.radius_deg),
        }
        for lamp in truth.lamps
    ]
    facts = {"median_radiance": MEDIAN_RADIANCE, "lamps": lamps}
    (folder / "truth.json").write_text(json.dumps(facts, indent=1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
