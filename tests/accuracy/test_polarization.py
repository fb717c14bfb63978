"""What a varnished floor mirrors is told from lamps, in 8-bit frames of the simulated camera."""

import polarization
import pytest
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene

pytestmark = pytest.mark.usefixtures("released_daemon")


@pytest.mark.parametrize(
    "seed",
    [
        0,  # near the nadir, of a lamp that clips
        10,  # a lamp of one pixel and its image, which clip alike
        16,  # where the film is edge-on
        18,  # an image that clips at all angles but one
        36,  # a lamp that clips at all of them
        214,  # few clipped pixels in a bright block
    ],
)
def test_a_sweep_tells_every_reflection(seed: int) -> None:
    scene = PolishedFloor(random_scene(seed))
    studio = polarization.Studio(scene, "8-bit")
    estimate = studio.estimate(*polarization.WAYS["0°, 45°, 90°, 135°"](studio))
    found = polarization.count(scene, estimate, estimate)
    assert (found.lost, found.false) == (0, 0), estimate.lights
    assert found.reflections >= 1
