"""What an orientation sensor on the camera says: the truth, spoiled as faults ask for."""

from __future__ import annotations

import math

import numpy as np

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.faults import Faults

#: A sensor without noise states this, not 0.
_LEAST_SIGMA_DEG = 0.01
_LEAST_SIGMA_M = 0.0005
_UNKNOWN = (math.nan,) * 5
_NOWHERE = (math.nan,) * 4
#: What the chance is for, beside those of a frame's life in link.py.
_PURPOSE, _JUMPS, _PLACE = 2, 3, 4


def reading(
    camera: SimulatedCamera, frame: int, shot: Shot, faults: Faults
) -> tuple[float, float, float, float, float]:
    """Quaternion x, y, z, w, probe to scene, at the middle of the middle row's exposure; sigma.

    Sigma in degrees, about each axis. It tells of the noise alone: a sensor does not know that it
    jumps or is late. All NaN: nothing was measured.
    """
    rng = np.random.default_rng([camera.sensor.seed, frame, _PURPOSE])
    if faults.hide_orientation or rng.random() < faults.orientation_drop:
        return _UNKNOWN
    state = camera.state(frame, shot)
    true = camera.true_rotation(state)
    if faults.orientation_late_ms:
        before_s = state.t_s - 1e-3 * faults.orientation_late_ms
        true = camera.world.rotation(before_s + 0.5e-6 * shot.exposure_us)
    noise = _small_turn(faults.orientation_noise_deg * rng.standard_normal(3))
    jumps = _jumps(camera.sensor.seed, state.t_s, faults)
    w, x, y, z = geometry.turn_after(jumps, geometry.turn_after(true, noise))
    return x, y, z, w, max(faults.orientation_noise_deg, _LEAST_SIGMA_DEG)


def place(
    camera: SimulatedCamera, frame: int, shot: Shot, faults: Faults
) -> tuple[float, float, float, float]:
    """Where the camera is in the scene, in metres, at the same instant; 1 sigma along each axis.

    All NaN: it stays where it is, or nothing was measured.
    """
    if not camera.world.behaviour.is_going or math.isnan(reading(camera, frame, shot, faults)[0]):
        return _NOWHERE
    rng = np.random.default_rng([camera.sensor.seed, frame, _PLACE])
    noise_m = faults.place_noise_m * rng.standard_normal(3)
    x, y, z = (np.array(camera.state(frame, shot).place_m) + noise_m).tolist()
    return x, y, z, max(faults.place_noise_m, _LEAST_SIGMA_M)


def _jumps(seed: int, t_s: float, faults: Faults) -> Array:
    """By how much the sensor's idea of the world has turned: jumps about axes that are drawn."""
    total = geometry.quaternion([0, 1, 0], 0)
    if not (faults.orientation_jump_deg and faults.orientation_jump_s):
        return total
    for k in range(int(max(t_s, 0) // faults.orientation_jump_s)):
        axis = np.random.default_rng([seed, k, _JUMPS]).standard_normal(3)
        total = geometry.turn_after(geometry.quaternion(axis, faults.orientation_jump_deg), total)
    return total


def _small_turn(vector_deg: Array) -> Array:
    angle_deg = float(np.linalg.norm(vector_deg))
    axis = vector_deg if angle_deg else np.array([0.0, 1, 0])
    return geometry.quaternion(axis, angle_deg)
