"""Answers of one series of a lit scene, and all that they rest on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lightprobe.calibrate.exposure_response import ExposureResponse
from lightprobe.calibrate.exposure_series import ExposureSeries, Frame
from lightprobe.check_camera import balance, edges, exposure, in_step, noise, response, tearing
from lightprobe.check_camera.answers import Answer, cannot_tell
from lightprobe.check_camera.edges import EdgeProfile
from lightprobe.check_camera.response import Power, Regions
from lightprobe.check_camera.scene import MOST_FLICKER, SceneSeries, gather
from lightprobe.geometry import Array

#: Up by four, and down between; then ratios of 1.5 and 2.2 in turn (see `calibrate response`).
COMMANDS_US = (8.0, 32.0, 128.0, 512.0, 2048.0, 8192.0, 32768.0,
               12288.0, 3072.0, 768.0, 192.0, 48.0, 12.0)  # fmt: skip
RESPONSE_US = (8.0, 12.0, 26.4, 39.6, 87.12, 130.68, 287.5, 431.2, 948.7, 1423.1, 3130.8,
               4696.2, 10331.7, 15497.6, 32768.0)  # fmt: skip
SCENE_US = COMMANDS_US + RESPONSE_US
#: Questions that a lit scene at rest answers, in their order.
QUESTIONS = (
    exposure.OBEYS, tearing.QUESTION, exposure.EXACT, response.TONE, response.RESPONSE,
    edges.QUESTION, noise.QUESTION,
)  # fmt: skip
BALANCE = (balance.DRIFTS, balance.ADAPTS)
#: Share of a step by which local tone mapping alone makes edges overshoot.
_BENT = 0.12
_DARK_STEP = "switch lamps on, or choose a brighter room"
_FLICKER_STEP = "daylight, or lamps on direct current; many LED lamps flicker when dimmed"


@dataclass(frozen=True, eq=False)
class SceneFindings:
    """What a lit scene at rest showed."""

    answers: tuple[Answer, ...]
    scene: SceneSeries
    regions: Regions | None = None
    power: Power | None = None
    profile: EdgeProfile | None = None
    trouble: str = ""  # with the light: white balance cannot be told either
    next_step: str = ""


def commands_of(series: ExposureSeries) -> Sequence[Sequence[Frame]]:
    """Steps that follow :data:`COMMANDS_US`: up, and down again; the camera may lack some."""
    groups = series.steps()
    ends = [k for k in range(1, len(groups)) if _us(groups[k]) >= _us(groups[k - 1])]
    falls = next((k for k in range(1, len(groups)) if _us(groups[k]) < _us(groups[k - 1])), None)
    if falls is None:
        return groups
    return groups[: next((k for k in ends if k > falls), len(groups))]


def _us(group: Sequence[Frame]) -> float:
    return group[-1].commanded_us or 0.0


def judge(series: ExposureSeries, table: Array, of_file: bool) -> SceneFindings:
    """Answer all of :data:`QUESTIONS`; `table` (256, 3): response of the camera file, or sRGB."""
    scene = gather(series, table)
    if not scene.steps or scene.is_dark:
        answers = tuple(cannot_tell(QUESTIONS, "the room is dark", _DARK_STEP))
        return SceneFindings(answers, scene, trouble="the room is dark", next_step=_DARK_STEP)
    obedience = exposure.obedience(commands_of(series))
    profile = edges.profile(scene.lumas) if scene.lumas else None
    of_one_picture = [edges.judge(profile), noise.judge(scene.noise)]
    measured = (exposure.EXACT, response.TONE, response.RESPONSE)
    if isinstance(obedience, ExposureResponse) and obedience.ignores:
        why = "the camera does not obey exposure commands"
        unknown = cannot_tell((tearing.QUESTION, *measured), why)
        answers = (exposure.judge(obedience), *unknown, *of_one_picture)
        return SceneFindings(answers, scene, profile=profile)
    torn = tearing.judge(commands_of(series))
    same = in_step.find(scene, table, in_step.rate_hz(series))
    if scene.flickers > MOST_FLICKER or same is not None:
        trouble = f"the light flickers (by {100 * scene.flickers:.1f} % from picture to picture)"
        if same is not None:
            trouble = f"the light flickers in step with the pictures (by {100 * same.share:.0f} %)"
        obeys = exposure.judge(obedience, trouble, _FLICKER_STEP)
        unknown = cannot_tell(measured, trouble, _FLICKER_STEP)
        return SceneFindings(
            (obeys, torn, *unknown, *of_one_picture), scene, profile=profile, trouble=trouble,
            next_step=_FLICKER_STEP,
        )  # fmt: skip
    obeys = exposure.judge(obedience)
    regions = response.regions(scene)
    regional = response.judge_regions(regions)
    if regional.is_found and of_one_picture[0].is_found:
        overshoot = of_one_picture[0].numbers["overshoot"]
        if overshoot < _BENT:
            why = "local tone mapping makes edges overshoot, too"
            of_one_picture[0] = cannot_tell((edges.QUESTION,), why)[0]
    power = response.power(scene, table, with_fit=not regional.is_found)
    exact = exposure.judge_steps(power, scene.exposures_us.tolist(), regional)
    answers = (
        obeys,
        torn,
        exact,
        regional,
        response.judge_power(power, regional, of_file),
        *of_one_picture,
    )
    return SceneFindings(answers, scene, regions, power, profile)
