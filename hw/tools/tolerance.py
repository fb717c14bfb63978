# SPDX-License-Identifier: Apache-2.0
"""From mechanical tolerance to error of the measurement (hw/README.md), and what the box hides.

Polarization: I = (S0 + S1 cos 2psi + S2 sin 2psi) / 2 per wheel angle, inverted by least squares
with the psi that a perfect box would have. psi is the direction in which a sheet with axis n and
transmission axis p lets light of direction d through: e ~ d x (n x p), in the pixel's frame
x = d x up, y up. The same model with the tolerance in it makes the intensities; what comes back
against what was put in is the error.

Ring: nine cosine sensors, E_k = max(0, n_k . v) + a, solved for lamp v and ambient a; a tolerance
moves n_k or scales E_k; the error is the angle between true and found v.

Random tolerances are 1 sigma (normal), and the errors printed for them RMS; fixed ones give the
worst case.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dimensions import dimensions

Array = npt.NDArray[np.float64]

WHEEL_DEG = np.array([0.0, 45.0, 90.0, 135.0])
DOLP = 0.5
SEED = 1
TRIALS = 2000
AOLP_STEP_DEG = 5.0


# --- polarization ------------------------------------------------------------------------------


def psi_rad(d: Array, normal: Array, axis: Array) -> Array:
    """Direction let through: angle in the pixel's frame (x = d x up, y up), shape (...)."""
    up = np.array([0.0, 1.0, 0.0])
    x = np.cross(d, up)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    y = np.cross(x, d)
    e = np.cross(d, np.cross(normal, axis))
    psi: Array = np.arctan2((e * y).sum(-1), (e * x).sum(-1))
    return psi


def direction(off_axis_deg: float, azimuth_deg: float) -> Array:
    """Unit vector so far from the wheel's axis (-Z), the azimuth counted from +X towards +Y."""
    t, a = math.radians(off_axis_deg), math.radians(azimuth_deg)
    return np.array([math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), -math.cos(t)])


def sheet(
    wheel_deg: Array, tilt_deg: float = 0.0, tilt_about_deg: float = 0.0
) -> tuple[Array, Array]:
    """Axis (3,) and transmission axes (N, 3) of a wheel tilted about an axis in its plane."""
    w = np.radians(wheel_deg)
    axes = np.stack([np.cos(w), np.sin(w), np.zeros_like(w)], -1)
    k = direction(90.0, tilt_about_deg)
    return rotate(np.array([0.0, 0.0, -1.0]), k, tilt_deg), rotate(axes, k, tilt_deg)


def rotate(v: Array, k: Array, angle_deg: float) -> Array:
    """Rodrigues: v (..., 3) turned about the unit vector k."""
    a = math.radians(angle_deg)
    dot = (v @ k)[..., None] * k
    return v * math.cos(a) + np.cross(k, v) * math.sin(a) + dot * (1 - math.cos(a))


def invert(intensities: Array, psi: Array) -> Array:
    """Stokes (..., 3) from intensities (..., N) at assumed psi (N,), least squares."""
    model = 0.5 * np.stack([np.ones_like(psi), np.cos(2 * psi), np.sin(2 * psi)], -1)
    return intensities @ np.linalg.pinv(model).T


def intensities(aolp_rad: Array, psi: Array, dolp: float) -> Array:
    """(A, N) from AoLP (A,) and true psi (N,) or (A, N), for S0 = 1."""
    return 0.5 * (1 + dolp * np.cos(2 * (aolp_rad[:, None] - psi)))


@dataclass
class PolarizationError:
    """Of AoLP in degrees, of DoLP absolute."""

    aolp_deg: float
    dolp: float


def compare(
    stokes: Array, aolp_rad: Array, dolp: float, summary: Callable[[Array], float]
) -> PolarizationError:
    """What came back, (..., A, 3), against what was put in."""
    found = np.hypot(stokes[..., 1], stokes[..., 2]) / stokes[..., 0]
    turned = 0.5 * np.arctan2(stokes[..., 2], stokes[..., 1]) - aolp_rad
    turned = (turned + np.pi / 2) % np.pi - np.pi / 2
    return PolarizationError(summary(np.degrees(turned)), summary(found - dolp))


def worst(x: Array) -> float:
    """Largest magnitude."""
    return float(np.abs(x).max())


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt((x**2).mean()))


AOLP_RAD = np.radians(np.arange(0.0, 180.0, AOLP_STEP_DEG))
AHEAD = direction(0.0, 0.0)


def common_angle(error_deg: float, dolp: float = DOLP) -> PolarizationError:
    """Every wheel angle off by the same: film, comb or sensors turned."""
    true = psi_rad(AHEAD, *sheet(WHEEL_DEG + error_deg))
    return compare(
        invert(intensities(AOLP_RAD, true, dolp), psi_rad(AHEAD, *sheet(WHEEL_DEG))),
        AOLP_RAD,
        dolp,
        worst,
    )


def each_angle(sigma_deg: float, dolp: float = DOLP) -> PolarizationError:
    """Every wheel angle off by its own random error."""
    errors = np.random.default_rng(SEED).normal(0, sigma_deg, (TRIALS, 1, len(WHEEL_DEG)))
    nominal = psi_rad(AHEAD, *sheet(WHEEL_DEG))
    true = nominal + np.radians(errors)
    seen = 0.5 * (1 + dolp * np.cos(2 * (AOLP_RAD[None, :, None] - true)))
    return compare(invert(seen, nominal), AOLP_RAD, dolp, rms)


def each_gain(sigma: float, dolp: float = DOLP) -> PolarizationError:
    """Every picture brighter or darker by a random share: dirt on the film, a flickering lamp."""
    nominal = psi_rad(AHEAD, *sheet(WHEEL_DEG))
    gains = np.random.default_rng(SEED).normal(1, sigma, (TRIALS, 1, len(WHEEL_DEG)))
    return compare(
        invert(intensities(AOLP_RAD, nominal, dolp) * gains, nominal), AOLP_RAD, dolp, rms
    )


def tilt(tilt_deg: float, off_axis_deg: float, dolp: float = DOLP) -> PolarizationError:
    """Wheel tilted against the camera: worst over directions of tilt and pixel."""
    found = [
        compare(
            invert(
                intensities(AOLP_RAD, psi_rad(d, *sheet(WHEEL_DEG, tilt_deg, about)), dolp),
                psi_rad(d, *sheet(WHEEL_DEG)),
            ),
            AOLP_RAD,
            dolp,
            worst,
        )
        for about in range(0, 180, 15)
        for d in (direction(off_axis_deg, azimuth) for azimuth in range(0, 360, 15))
    ]
    return PolarizationError(max(e.aolp_deg for e in found), max(e.dolp for e in found))


def extinction(ratio: float, dolp: float = DOLP) -> PolarizationError:
    """A film that also lets 1/ratio of the other polarization through."""
    nominal = psi_rad(AHEAD, *sheet(WHEEL_DEG))
    seen = (
        intensities(AOLP_RAD, nominal, dolp)
        + intensities(AOLP_RAD, nominal + np.pi / 2, dolp) / ratio
    )
    return compare(invert(seen, nominal), AOLP_RAD, dolp, worst)


# --- ring --------------------------------------------------------------------------------------

RING = np.array(
    [[math.cos(k * math.pi / 4), 0.0, math.sin(k * math.pi / 4)] for k in range(8)]
    + [[0.0, 1.0, 0.0]]
)
AMBIENT = 0.2  # of the lamp's irradiance


def solve_ring(levels: Array) -> Array:
    """Lamp vector from nine irradiances: the k brightest are lit; the k of least residual wins."""
    order = np.argsort(-levels)
    best, least = np.zeros(3), math.inf
    for k in range(3, 9):
        lit = np.isin(np.arange(9), order[:k])
        model = np.concatenate([RING * lit[:, None], np.ones((9, 1))], 1)
        v, a = np.split(np.linalg.lstsq(model, levels, rcond=None)[0], [3])
        residual = float(((np.maximum(0, RING @ v) + a - levels) ** 2).sum())
        if residual < least:
            best, least = v, residual
    return best


def ring_error_deg(seat_sigma_deg: float, level_sigma: float, trials: int = 1000) -> float:
    """RMS direction error of one lamp, anywhere from 20 degrees above the horizon upwards."""
    rng = np.random.default_rng(SEED)
    errors = np.empty(trials)
    for i in range(trials):
        elevation, azimuth = (
            math.asin(rng.uniform(math.sin(math.radians(20)), 1)),
            rng.uniform(0, 2 * math.pi),
        )
        lamp = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.sin(elevation),
                math.cos(elevation) * math.sin(azimuth),
            ]
        )
        seats = RING + rng.normal(0, math.radians(seat_sigma_deg), RING.shape)
        seats /= np.linalg.norm(seats, axis=1, keepdims=True)
        levels = (np.maximum(0, seats @ lamp) + AMBIENT) * rng.normal(1, level_sigma, 9)
        v = solve_ring(levels)
        errors[i] = math.degrees(math.acos(np.clip(v @ lamp / np.linalg.norm(v), -1, 1)))
    return rms(errors)


# --- the table ---------------------------------------------------------------------------------


@dataclass
class Row:
    """One tolerance. Errors that do not exist are None."""

    what: str
    tolerance: str
    remedy: str
    wheel_deg: float | None = None
    polarization: PolarizationError | None = None
    direction_deg: float | None = None


def at_radius_deg(length_mm: float, radius_mm: float) -> float:
    """Angle that a length along the circumference makes."""
    return math.degrees(length_mm / radius_mm)


def wheel_rows(dim: dict[str, float]) -> list[Row]:
    """Tolerances of the wheel. Lengths in mm at the inner sensor, where they weigh most."""

    def common(what: str, tolerance: str, error_deg: float, remedy: str) -> Row:
        return Row(what, tolerance, remedy, error_deg, common_angle(error_deg))

    def each(what: str, tolerance: str, error_deg: float, remedy: str) -> Row:
        return Row(what, tolerance, remedy, error_deg, each_angle(error_deg))

    beam, gear = dim["beam_b"], dim["wheel_gear_radius"]
    play = 2 * math.tan(math.radians(dim["gear_pressure_deg"])) * dim["gear_backlash"]
    backlash = at_radius_deg(play, gear)
    return [
        common(
            "film put in by its marks",
            "1°",
            1.0,
            "light of known polarization (guide.md)",
        ),
        common(
            "both sensors set with the gauge drill", "0.1 mm", at_radius_deg(0.1, beam), "the same"
        ),
        each(
            "edges of the comb as printed",
            "0.1 mm",
            at_radius_deg(0.1, beam),
            f"`COMB_ERROR_CDEG` allows {0.3 / math.degrees(1) * beam:.2f} mm",
        ),
        each(
            "wheel off its centre (rollers, rim)",
            "0.1 mm",
            at_radius_deg(0.1, beam),
            "upper roller without play",
        ),
        each(
            "play of the gears", f"{play:.2f} mm", backlash, "every target is approached from below"
        ),
        each(
            "servo rests 5 µs off, not corrected",
            "5 µs",
            5 / 7.407,
            "the comb bounds it; the firmware says so in `sigma`",
        ),
        each(
            "all of the above as the firmware states it",
            "sigma 0.6°",
            0.6,
            "targets on multiples of 3°",
        ),
        each(
            "targets between the multiples of 3°", "sigma 1.2°", 1.2, "do not, or fit the feedback"
        ),
        Row("wheel tilted, seen straight ahead", "1°", "", None, tilt(1.0, 0.0)),
        Row(
            "wheel tilted, seen 45° off axis",
            "1°",
            "plate square on its pillars",
            None,
            tilt(1.0, 45.0),
        ),
        Row(
            "wheel tilted, seen 70° off axis",
            "1°",
            "weigh the outer field less",
            None,
            tilt(1.0, 70.0),
        ),
        Row("film with extinction ratio 1000 : 1", "", "", None, extinction(1000)),
        Row(
            "film with extinction ratio 50 : 1",
            "",
            "measure it once: a constant factor",
            None,
            extinction(50),
        ),
        Row(
            "film uneven, light changing during a sweep",
            "1 %",
            "repeat the first angle at the end",
            None,
            each_gain(0.01),
        ),
    ]


def direction_rows(dim: dict[str, float]) -> list[Row]:
    """Tolerances that turn directions."""
    off = math.degrees(math.atan(dim["ring_flat"] / 1000))
    near = math.degrees(math.atan(dim["ring_flat"] / 3000))
    return [
        Row(
            "camera turned or tilted in its cradle",
            "1°",
            "rotation in the camera file",
            direction_deg=1.0,
        ),
        Row("box not level, not square on its mount", "1°", "tripod's level", direction_deg=1.0),
        Row("ring alone: readings exact", "", "", direction_deg=ring_error_deg(0, 0)),
        Row(
            "ring alone: sensors tilted in their seats",
            "2°",
            "flush with the flat",
            direction_deg=ring_error_deg(2, 0),
        ),
        Row("ring alone: calibrated sensors", "3 %", "", direction_deg=ring_error_deg(0, 0.03)),
        Row("ring alone: both", "2°, 3 %", "", direction_deg=ring_error_deg(2, 0.03)),
        Row(
            "ring alone: sensors not calibrated",
            "25 %",
            "`lightprobe calibrate ring`",
            direction_deg=ring_error_deg(2, 0.25),
        ),
        Row(
            "sensor beside the camera, lamp at 1 m",
            f"{dim['ring_flat']:.0f} mm",
            "",
            direction_deg=off,
        ),
        Row(
            "sensor beside the camera, lamp at 3 m",
            f"{dim['ring_flat']:.0f} mm",
            "",
            direction_deg=near,
        ),
    ]


def number(value: float | None, digits: int) -> str:
    """Markdown cell."""
    return "" if value is None else f"{value + 0.0:.{digits}f}"


def wheel_table(dim: dict[str, float]) -> str:
    """Markdown."""
    lines = [
        "| tolerance | size | wheel, ° | AoLP, ° | DoLP | what helps |",
        "|---|---|---|---|---|---|",
    ]
    for row in wheel_rows(dim):
        assert row.polarization
        error = row.polarization
        lines.append(
            f"| {row.what} | {row.tolerance} | {number(row.wheel_deg, 2)} "
            f"| {number(error.aolp_deg, 2)} | {number(error.dolp, 4)} | {row.remedy} |"
        )
    return "\n".join(lines)


def direction_table(dim: dict[str, float]) -> str:
    """Markdown."""
    lines = ["| tolerance | size | direction, ° | what helps |", "|---|---|---|---|"]
    lines += [
        f"| {r.what} | {r.tolerance} | {number(r.direction_deg, 2)} | {r.remedy} |"
        for r in direction_rows(dim)
    ]
    return "\n".join(lines)


# --- what the box hides ------------------------------------------------------------------------


def view_table(dim: dict[str, float]) -> str:
    """Markdown: angles at which the box comes into view; y forward from the camera's middle."""
    pupil_y = dim["camera_diameter"] / 2 - dim["pupil_behind_apex"]
    lip_y = -dim["wheel_front_z"]
    through = math.degrees(math.atan(dim["lip_radius"] / (lip_y - pupil_y)))
    fork_y = -dim["comb_middle_z"] + dim["fork_length"] / 2
    ear_radius = dim["beam_b"] - dim["fork_beam"] + dim["fork_height"] - dim["fork_ear"]
    forks = math.degrees(math.atan2(ear_radius, fork_y - pupil_y))
    plate_radius = dim["roller_distance"] + dim["roller_radius"]
    rear = 180 - math.degrees(math.atan2(plate_radius, -dim["plate_back_z"] + pupil_y))
    drum = math.degrees(math.atan2(dim["lid_top_radius"], -dim["lid_top"]))
    drum = max(
        drum,
        math.degrees(math.atan2(dim["ring_radius"], -(dim["ring_z"] + dim["ring_height"] / 2))),
    )
    rows = [
        ("film's clear opening, from the front lens's axis", through),
        ("tips of the comb's sensors, from the same axis", forks),
        ("edge of the plate, from the rear lens's axis", rear),
        ("drum: half angle of the cone below that it hides", drum),
    ]
    lines = ["| what | ° |", "|---|---|"]
    lines += [f"| {what} | {angle:.1f} |" for what, angle in rows]
    return "\n".join(lines)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    dim = dimensions()
    print(f"Wheel angles {', '.join(f'{a:.0f}' for a in WHEEL_DEG)}; light of DoLP {DOLP}.\n")
    print(wheel_table(dim))
    print()
    print(direction_table(dim))
    print()
    print(view_table(dim))


if __name__ == "__main__":
    main()
