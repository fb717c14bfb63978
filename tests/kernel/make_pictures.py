# SPDX-License-Identifier: Apache-2.0
"""Frames for the test camera: one simulated room at many exposures, and the truth about its lamps.

Writes WxH_EXPOSUREus_N.jpg (uvc_camera --pictures=folder:PATH) and truth.json; and into ahead/ and
back/ what two fisheye modules back to back see of the room. Exposures are powers of two of 100 us,
the step of the camera's control, so that a bracket of such exposures is exact.
"""

import json
import sys
from pathlib import Path

import numpy as np
from lightprobe.calibrate.camera_file import edited
from lightprobe.imaging import camera
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.world import Behaviour, World

SIZE_PX = (640, 320)
EXPOSURES_US = [100 * 2**k for k in range(10)]
FRAMES = 2  # of each exposure: their noise differs
# The scene's median reaches a quarter of full scale at 12.8 ms.
MEDIAN_RADIANCE = 0.25 / 12.8e-3
MODULES = Path(__file__).resolve().parents[2] / "packaging" / "cameras"


def main(folder: Path) -> None:
    """Fill the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    world = World(scenes.load(["room"]), Behaviour(act_s=0), MEDIAN_RADIANCE)
    write(folder, world, camera.equirect())
    for name in ("ahead", "back"):
        write(folder / name, world, camera.load(str(module(folder, name))))
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


def module(folder: Path, name: str) -> Path:
    """Write the camera file of a module whose pictures have this size."""
    width, height = SIZE_PX
    lens = {"cx_px": width / 2, "cy_px": height / 2, "fx_px": 94, "fy_px": 94}
    text = (MODULES / f"module_{name}.camera").read_text()
    text = edited(text, "camera", {"width_px": str(width), "height_px": str(height)})
    path = folder / f"{name}.camera"
    path.write_text(edited(text, "lens.0", {key: f"{value:g}" for key, value in lens.items()}))
    return path


def write(folder: Path, world: World, lens: camera.Camera) -> None:
    """Write what a camera sees at every exposure."""
    folder.mkdir(parents=True, exist_ok=True)
    simulated = SimulatedCamera(world, lens, SIZE_PX, chroma="422")
    for exposure_us in EXPOSURES_US:
        for number in range(FRAMES):
            picture = simulated.frame(number, Shot(exposure_us))
            name = f"{SIZE_PX[0]}x{SIZE_PX[1]}_{exposure_us}us_{number}.jpg"
            (folder / name).write_bytes(picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
