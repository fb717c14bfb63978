"""Simulated cameras × what `lightprobe check-camera` says of them; prints the table.

Each camera has one defect at one of three strengths, or two at once, or the room is dark or its
lamps flicker. A cell is wrong when a defect is not named, when another is, or when something is
said that cannot be told. Pictures come from the simulator without a daemon.

    build/venv/bin/python tests/accuracy/check_camera.py [NAME…]
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lightprobe.check_camera import balance, glare, judge, pixels, shade, tearing
from lightprobe.check_camera.answers import Answer, Verdict, cannot_tell
from lightprobe.geometry import Array
from lightprobe.imaging.camera import equirect
from lightprobe.sim import response, scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.movers import Card
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing
from lightprobe.sim.series import Photographer
from lightprobe.sim.world import Behaviour, World

SIZE_PX = (640, 320)
#: A red cloth before the lens, and a cap; and how large the card is that hides the lamp.
CLOTH, CAP, SHADE_DEG = Card(-40, 0, 50, (0.7, 0.08, 0.05)), Card(0, 0, 180), 6.0
MEDIAN_RADIANCE = 30.0


@dataclass(frozen=True)
class Case:
    """A simulated camera, and the questions whose answers must name a defect."""

    defects: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()  # of what must not be told
    processing: str = ""
    curve: str | None = None
    lens: str = ""
    pixels: str = ""
    quality: int = 85
    pixel_format: str = "MJPG"
    flicker_hz: float = 0.0
    flicker_depth: float = 0.3
    row_time_us: float = 0.0
    median_radiance: float = MEDIAN_RADIANCE
    ignores: bool = False
    delay_frames: int = 1
    frames: int = 6


TONE, RESPONSE, SHARP = ("tone mapping",), ("response",), ("sharpening",)
NOISE, PIXELS, DRIFT = ("noise reduction",), ("pixels",), ("white balance at rest",)
ADAPT, GLARE = ("white balance and colours",), ("glare",)
LINEAR = ("exposure steps", "tone mapping", "response")
COLOURS, TORN, VEIL = judge.BALANCE, (tearing.QUESTION,), (glare.QUESTION,)

CASES = {
    "no defect": Case(),
    "YUYV": Case(pixel_format="YUYV"),
    "JPEG quality 60": Case(quality=60),
    "commands come 3 frames late": Case(delay_frames=3, frames=9),
    "stitching 3 %, 0.7°": Case(processing="stitch_gain=0.03&stitch_deg=0.7"),
    **{f"tone mapping {ev} EV": Case(TONE, LINEAR[::2], f"tone_ev={ev}") for ev in (0.5, 1, 2)},
    **{
        f"tone mapping {ev} EV to middle grey": Case(
            TONE, LINEAR[::2], f"tone_ev={ev}&tone_aim=0.18"
        )
        for ev in (0.5, 1, 2)
    },
    **{f"response srgb:{p}": Case(RESPONSE, curve=f"srgb:{p}") for p in (1.02, 1.04, 1.1)},
    "response film": Case(RESPONSE, curve="film"),
    **{f"sharpening {a}": Case(SHARP, processing=f"sharpen={a}") for a in (0.3, 0.7, 1.5)},
    **{
        f"noise reduction in time {a}": Case(NOISE, processing=f"denoise_time={a}")
        for a in (0.4, 0.6, 0.8)
    },
    **{
        f"white balance drifts {a}": Case(DRIFT, ADAPT, f"white_drift={a}")
        for a in (0.02, 0.06, 0.12)
    },
    **{
        f"white balance adapts {a}": Case(ADAPT, processing=f"white_adapt={a}")
        for a in (0.3, 0.6, 1)
    },
    **{
        f"exposure tears at {share:g}": Case(TORN, VEIL, f"exposure_tear={share:g}")
        for share in (0.1, 0.33, 0.8)
    },
    "exposure tears at 0.33, commands come 3 frames late, sharpening 0.7": Case(
        TORN + SHARP, VEIL, "exposure_tear=0.33&sharpen=0.7", delay_frames=3, frames=9
    ),
    **{f"glare {share:g}": Case(GLARE, lens=f"glare={share:g}") for share in (0.01, 0.03, 0.1)},
    "glare 0.03 and stuck pixels": Case(GLARE + PIXELS, lens="glare=0.03", pixels="stuck=12"),
    "glare 0.03 and response srgb:1.04": Case(
        GLARE + RESPONSE, lens="glare=0.03", curve="srgb:1.04"
    ),
    **{f"{n} stuck pixels": Case(PIXELS, pixels=f"stuck={n}") for n in (1, 12)},
    # What shines in so many places hides how the veil lies.
    "200 stuck pixels": Case(PIXELS, ("glare",), pixels="stuck=200"),
    **{
        f"20 warm pixels of {e} e/s": Case(PIXELS, pixels=f"warm=20&warm_e_per_s={e}")
        for e in (20000, 100000, 300000)
    },
    "stuck and warm pixels of a Bayer sensor": Case(PIXELS, pixels="stuck=12&warm=20&bayer=1"),
    "a stuck row": Case(PIXELS, ("glare",), pixels="row=100"),
    "commands without effect": Case(("exposure",), LINEAR + TORN, ignores=True),
    "sharpening 0.7 and tone mapping 1 EV": Case(
        SHARP + TONE, LINEAR[::2], "sharpen=0.7&tone_ev=1"
    ),
    "sharpening 0.7 and white balance drifts 0.06": Case(
        SHARP + DRIFT, ADAPT, "sharpen=0.7&white_drift=0.06"
    ),
    "response srgb:1.04 and noise reduction": Case(
        RESPONSE + NOISE, processing="denoise_time=0.6", curve="srgb:1.04"
    ),
    "response srgb:1.04 and stuck pixels": Case(
        RESPONSE + PIXELS, curve="srgb:1.04", pixels="stuck=12"
    ),
    "a dark room": Case((), judge.QUESTIONS + COLOURS, median_radiance=0.0003),
    **{
        f"lamps flicker at {hz:g} Hz by {depth:g}, rows {row:g} µs apart": Case(
            (), LINEAR + COLOURS + (("exposure",) if (hz, depth) == (100, 0.3) else ()),
            flicker_hz=hz, flicker_depth=depth, row_time_us=row
        )
        for hz, depth, row in (
            (100, 0.05, 0), (100, 0.3, 0), (100, 0.3, 50), (120, 0.1, 0), (120, 0.3, 0),
            (120, 0.3, 50),
        )
    },
}  # fmt: skip


def verdict(case: Case, folder: Path) -> Verdict:
    """All answers on a simulated camera."""
    flicker = Flicker(case.flicker_hz, (case.flicker_depth,))
    behaviour = Behaviour(act_s=0, flicker=flicker)
    world = World(scenes.load(["room"]), behaviour, case.median_radiance)
    curve = None if case.curve is None else response.parse(case.curve)
    camera = SimulatedCamera(
        world, equirect(), SIZE_PX, quality=case.quality, pixel_format=case.pixel_format,
        response=curve, row_time_us=case.row_time_us, limits=ExposureLimits(8, 33000, 0),
        processing=Processing().merged(case.processing),
        pixels=PixelDefects().merged(case.pixels), lens_defects=LensDefects().merged(case.lens),
    )  # fmt: skip
    taker = Photographer(camera, folder, case.delay_frames, case.ignores)
    stated = equirect().response_table()
    found = judge.judge(taker.shoot(judge.SCENE_US, case.frames), stated, False)
    answers: list[Answer] = list(found.answers)
    if found.trouble:
        answers += cannot_tell(COLOURS, found.trouble, found.next_step)
    else:
        best_us = found.scene.best_us()
        rest = balance.colours(taker.shoot([best_us], 1200, every=30), stated)
        drift = balance.drift(rest)
        answers.append(balance.judge_drift(drift))
        world.card = CLOTH
        after = balance.colours(taker.shoot([best_us], 300, every=30), stated)
        size = drift.size if drift else 0.0
        answers.append(balance.judge_adaption(balance.adaption(rest, after), size))
    answers.append(veil(found, taker, world, stated))
    world.card = CAP
    covered = taker.shoot(pixels.SCHEDULE_US, max(case.frames, 6))
    answers.append(pixels.judge(pixels.find(covered)))
    return Verdict("simulated", tuple(answers))


def veil(found: judge.SceneFindings, taker: Photographer, world: World, stated: Array) -> Answer:
    """Hide the brightest lamp."""
    trouble = found.trouble or glare.hindrance(found.answers)
    if trouble:
        return cannot_tell((glare.QUESTION,), trouble)[0]
    world.card = None
    before = taker.shoot(shade.SHADE_US, taker.delay_frames + 4)
    lamp = max(world.scenes[0].lamps, key=lambda one: float(np.sum(one.irradiance)))
    x, y, z = lamp.direction
    azimuth, elevation = np.degrees([np.arctan2(x, -z), np.arcsin(y)])
    world.card = Card(float(azimuth), float(elevation), SHADE_DEG)
    after = taker.shoot(shade.SHADE_US, taker.delay_frames + 4)
    table = glare.table_of(found.answers, found.power, stated)
    return glare.judge(glare.look(equirect(*SIZE_PX), before, after, table))


def wrong(case: Case, found: Verdict) -> list[str]:
    """Say what is wrong with a verdict."""
    faults = [f"{one} is not named" for one in case.defects if one not in found.defects]
    faults += [f"{one} is named" for one in found.defects if one not in case.defects]
    for one in found.answers:
        told = one.outcome not in ("cannot tell", "skipped")
        if told and one.question in case.unknown:
            faults.append(f"{one.question} is told")
        bent = "tone mapping" in case.defects and one.question == "sharpening"
        hindered = one.question == glare.QUESTION and set(case.unknown) & {
            "tone mapping",
            "response",
        }
        if not told and one.question not in case.unknown and not bent and not hindered:
            faults.append(f"{one.question} is not told")
    return faults


def main(names: list[str]) -> int:
    """Print a row for each camera."""
    count = 0
    print("| the camera | verdict | wrong |")
    print("|---|---|---|")
    for name in names or CASES:
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as folder:
            found = verdict(CASES[name], Path(folder))
        faults = wrong(CASES[name], found)
        count += bool(faults)
        print(f"| {name} | {found.words} | {'; '.join(faults) or '–'} |", flush=True)
    print(f"\n{count} of {len(names or CASES)} wrong")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
