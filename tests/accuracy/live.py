"""How good estimates are while the camera turns: part of `make accuracy`.

A daemon before a simulated camera in simulated time (lightprobe.sim.live), so that no load changes
a figure. Each packet is judged by the light at its own capture time.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.evaluate.metrics import relighting
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

#: Panoramas of blender-data, and rooms with exact lamps.
SCENES = ("blender", "procedural:4")
#: As most tests have it: a quarter of full scale in 1/120 s.
MEDIAN_RADIANCE = 30.0
SIZE_PX, RATE_HZ = (1920, 960), 30.0
#: Until the exposures have settled; then it is judged for so long.
SETTLE_S, JUDGED_S = 2.0, 4.0
#: Wrong and healthy: off by more than the first, states less than the second, and no flag.
WRONG, STATED = 0.10, 0.03
#: The brightest lamp is listed when a light lies so near, with so much of its light.
NEAR_DEG, SHARE = 10.0, 0.1
#: A lamp that makes so much of all light must be listed.
A_SUN = 0.2

MOTIONS = {
    "0": Behaviour(act_s=0),
    **{f"{rate}": Behaviour(act_s=0, turn_deg_s=rate) for rate in (2, 10, 30, 100, 300)},
    "head": Behaviour(act_s=0, swing_deg=40, swing_hz=0.5),
}
EXPOSURES = {"reported": Faults(), "not reported": Faults(hide_exposure=True)}


@dataclass(frozen=True)
class Live:
    """Figures of one scene under one motion."""

    scene: str
    motion: str
    exposures: str
    packets: int
    packets_per_s: float
    error_median: float  # relighting, MAE
    error_p90: float
    wrong_and_healthy: float  # share of the packets
    healthy: float  # share without a flag
    births_per_s: float  # lights of the default subscription that were not in the packet before
    ambient_step: float  # largest from one packet to the next, of the mean irradiance
    sun_listed: float | None  # share of the packets; None: no lamp is as strong as a sun


def judge(scene: Scene, motion: str, exposures: str, size_px: tuple[int, int] = SIZE_PX) -> Live:
    """Run a daemon before `scene` and judge its packets."""
    cv2.setNumThreads(1)
    world = World([scene], MOTIONS[motion], MEDIAN_RADIANCE)
    camera = SimulatedCamera(world, lenses.load("equirect"), size_px, rate_hz=RATE_HZ)
    with LiveProbe(camera, faults=EXPOSURES[exposures]) as probe:
        raw = probe.client(Subscription(smoothing="RAW", max_lights=8, sh_order=4))
        usual = probe.client()
        probe.run(SETTLE_S)
        first = len(raw.estimates), len(usual.estimates)
        probe.run(JUDGED_S)
        judged, default = raw.estimates[first[0] :], usual.estimates[first[1] :]
        yaws = [world.at(probe.captured_s(estimate)).yaw_deg for estimate in judged]
    return figures(world, motion, exposures, judged, yaws, default)


def figures(
    world: World,
    motion: str,
    exposures: str,
    judged: Sequence[Estimate],
    yaws_deg: Sequence[float],
    default: Sequence[Estimate],
) -> Live:
    """Sum up; `yaws_deg`: of the scene at each judged packet's capture time."""
    truth = world.at(0).truth()
    normals = geometry.sphere_normals()
    true = truth.irradiance(normals)
    lamps = [(lamp.direction, float(luminance(lamp.irradiance))) for lamp in truth.lamps]
    brightest = max(lamps, key=lambda lamp: lamp[1], default=None)
    all_light = 4 * float(luminance(true).mean())  # over the sphere: ∫ radiance
    sun = brightest if brightest and brightest[1] > A_SUN * all_light else None
    errors, wrong, listed = [], 0, 0
    for estimate, yaw_deg in zip(judged, yaws_deg, strict=True):
        # The scene turns to the right: clockwise from above.
        turn = geometry.rotation_matrix(geometry.quaternion([0, 1, 0], -yaw_deg))
        error, _ = relighting(true, estimate.irradiance(normals @ turn.T))
        errors.append(error)
        stated = estimate.predicted_error
        confident = stated is not None and stated < STATED and not estimate.flags
        wrong += error > WRONG and confident
        listed += sun is not None and _lists(estimate, turn @ sun[0], sun[1])
    count = max(len(judged), 1)
    return Live(
        scene=world.scenes[0].name,
        motion=motion,
        exposures=exposures,
        packets=len(judged),
        packets_per_s=len(judged) / JUDGED_S,
        error_median=float(np.median(errors)) if errors else float("nan"),
        error_p90=float(np.quantile(errors, 0.9)) if errors else float("nan"),
        wrong_and_healthy=wrong / count,
        healthy=sum(estimate.flags == EstimateFlag(0) for estimate in judged) / count,
        births_per_s=births(default) / JUDGED_S,
        ambient_step=ambient_step(default),
        sun_listed=None if sun is None else listed / count,
    )


def _lists(estimate: Estimate, direction: Array, irradiance: float) -> bool:
    near = np.cos(np.radians(NEAR_DEG))
    return any(
        light.direction @ direction > near and luminance(light.irradiance) > SHARE * irradiance
        for light in estimate.lights
    )


def births(estimates: Sequence[Estimate]) -> int:
    """Lights whose id the packet before did not list."""
    ids = [{light.id for light in estimate.lights} for estimate in estimates]
    return sum(len(after - before) for before, after in pairwise(ids))


def ambient_step(estimates: Sequence[Estimate]) -> float:
    """Largest change of the mean of AMBIENT between two packets, of the mean of TOTAL."""
    means = [
        (luminance(e.sh.coefficients[0]), luminance(e.total().coefficients[0])) for e in estimates
    ]
    return max((abs(b[0] - a[0]) / a[1] for a, b in pairwise(means)), default=0.0)


def all_figures(names: Sequence[str], motions: Sequence[str], processes: int) -> list[Live]:
    """Every scene under every motion, exposures reported and not; progress on stderr."""
    cases = list(product(scenes.load(list(names)), motions, EXPOSURES))
    found = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for done, live in enumerate(pool.imap_unordered(_judge, cases), 1):
            found.append(live)
            print(f"live: {done} of {len(cases)}: {live.scene} {live.motion} {live.exposures}",
                  file=sys.stderr, flush=True)  # fmt: skip
    return found


def _judge(case: tuple[Scene, str, str]) -> Live:
    return judge(*case)


def rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes: a row for each kind of exposures and motion; median (worst)."""
    table = []
    for exposures, motion in product(EXPOSURES, MOTIONS):
        some = [live for live in found if (live.exposures, live.motion) == (exposures, motion)]
        if not some:
            continue
        suns = [live.sun_listed for live in some if live.sun_listed is not None]
        table.append([
            exposures, f"{motion} °/s" if motion != "head" else "± 40° at 0.5 Hz",
            f"{min(live.packets_per_s for live in some):.0f}",
            f"{np.median([live.error_median for live in some]):.3f} "
            f"({max(live.error_median for live in some):.3f})",
            f"{max(live.error_p90 for live in some):.3f}",
            f"{100 * np.median([live.wrong_and_healthy for live in some]):.0f} % "
            f"({100 * max(live.wrong_and_healthy for live in some):.0f} %)",
            f"{np.median([live.births_per_s for live in some]):.1f} "
            f"({max(live.births_per_s for live in some):.1f})",
            f"{100 * max(live.ambient_step for live in some):.1f} %",
            f"{100 * min(suns):.0f} %" if suns else "–",
        ])  # fmt: skip
    return table


def draw(found: Sequence[Live], path: Path) -> None:
    """Error and share of wrong and healthy packets by turning rate, a line for each scene."""
    plt.switch_backend("Agg")
    rates = [motion for motion in MOTIONS if motion != "head"]
    fig, axes = plt.subplots(2, len(EXPOSURES), sharex=True, sharey="row", figsize=(10, 7))
    for column, exposures in enumerate(EXPOSURES):
        some = {(one.scene, one.motion): one for one in found if one.exposures == exposures}
        for scene in sorted({one.scene for one in found}):
            line = [some[scene, rate] for rate in rates]
            axes[0, column].plot(range(len(rates)), [one.error_median for one in line], "o-", ms=3)
            shares = [100 * one.wrong_and_healthy for one in line]
            axes[1, column].plot(range(len(rates)), shares, "o-", ms=3, label=scene)
        axes[0, column].set(title=f"exposures {exposures}", yscale="log")
        axes[1, column].set(xticks=range(len(rates)), xticklabels=rates)
        axes[1, column].set_xlabel("the camera turns, °/s")
    axes[0, 0].set_ylabel("relighting error, median of the packets")
    axes[1, 0].set_ylabel("wrong and healthy packets, %")
    axes[1, -1].legend(fontsize="x-small", ncols=2)
    fig.suptitle("While the camera turns (simulated)")
    fig.tight_layout()
    fig.savefig(path, dpi=110)


HEAD = [
    "exposures", "the camera turns", "packets per second, least",
    "relighting error, median (worst scene)", "of 90 % of the packets, worst scene",
    "wrong and healthy, median (worst)", "births per second, median (worst)",
    "AMBIENT's step, worst", "a sun is listed, worst",
]  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--motions", nargs="+", choices=list(MOTIONS), default=list(MOTIONS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, help="write all figures here")
    options = parser.parse_args()
    found = all_figures(options.scenes, options.motions, options.processes)
    if options.json:
        options.json.write_text(json.dumps([asdict(live) for live in found], indent=2) + "\n")
    for row in [HEAD, ["---"] * len(HEAD), *rows(found)]:
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
