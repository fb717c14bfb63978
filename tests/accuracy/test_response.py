"""A camera whose response is not what the daemon takes it for, in simulated time; with bounds."""

from __future__ import annotations

from dataclasses import replace

import live
import pytest
from defects import DEFECTS, Defects
from judge import Figures
from lightprobe.estimate import EstimateFlag
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Scene
from recording import Pair, record

pytestmark = pytest.mark.many_frames

SMALL_PX = (960, 480)
#: With a response as it should be, measured by these tests: still, and while a head turns.
RIGHT_ERROR = 0.005


def case(
    monkeypatch: pytest.MonkeyPatch,
    defects: Defects,
    motion: str = "0",
    judged_s: float = 2.0,
    scene: Scene | None = None,
    size_px: tuple[int, int] = SMALL_PX,
) -> live.Case:
    """A camera in a room."""
    monkeypatch.setitem(DEFECTS, "tested", defects)
    return live.case(
        scene or Room(), motion, "reported", size_px=size_px, defects="tested", judged_s=judged_s
    )


def figures(monkeypatch: pytest.MonkeyPatch, defects: Defects, motion: str = "0") -> Figures:
    """What a client gets that asks for nothing."""
    found = live.judged(case(monkeypatch, defects, motion))
    return next(one.figures for one in found if one.subscription == "default")


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("power", "motion"),
    [(1.04, "head"), (0.9, "0"), (1.15, "0")],
)
def test_light_to_another_power_is_learned(
    monkeypatch: pytest.MonkeyPatch, power: float, motion: str
) -> None:
    """Its error was .07 at 1.04, none within 3 sigma."""
    found = figures(monkeypatch, Defects("", response=f"srgb:{power}"), motion)
    assert found.error_median < RIGHT_ERROR + 0.01
    assert found.relighting.within_3 == 1
    assert found.flags.get("RESPONSE", 0) < 0.05  # while it is learned
    assert found.wrong_and_healthy == 0


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("processing", "motion"),
    [
        ("tone_ev=1", "0"),
        ("tone_ev=1", "head"),
        ("tone_ev=2", "0"),
        ("tone_ev=1&tone_aim=0.18", "0"),
        ("tone_ev=1&sharpen=0.7&sharpen_px=1.3", "head"),
        ("tone_ev=0.5", "0"),
        ("tone_ev=0.5", "head"),
        ("exposure_tear=0.33", "head"),
        ("exposure_tear=0.7", "0"),
    ],
)
def test_what_no_response_explains_is_named_and_in_the_sigma(
    monkeypatch: pytest.MonkeyPatch, processing: str, motion: str
) -> None:
    """Local tone mapping was wrong by up to .5, and stated as 2 to 5 %; torn pictures by 1 to 5."""
    found = figures(monkeypatch, Defects("", processing), motion)
    assert found.flags.get("RESPONSE", 0) > 0.99
    assert "FLICKER" not in found.flags
    assert found.relighting.within_3 is not None
    assert found.relighting.within_3 > 0.98
    assert found.wrong_and_healthy == 0


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    "processing",
    [
        "sharpen=0.7&sharpen_px=1.3",
        "denoise=6&denoise_px=2&denoise_time=0.7",
        "stitch_gain=0.03&stitch_deg=0.7",
    ],
)
def test_what_is_the_same_in_all_exposures_is_not_named(
    monkeypatch: pytest.MonkeyPatch, processing: str
) -> None:
    """The flag names what exposures contradict, and nothing else."""
    found = figures(monkeypatch, Defects("", processing), "head")
    assert "RESPONSE" not in found.flags


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("motion", "rate_hz", "film_deg"),
    [("0", 30.0, None), ("swing", 8.0, 45.0), ("swing", 8.0, None)],
)
def test_another_room_is_not_named(
    monkeypatch: pytest.MonkeyPatch, motion: str, rate_hz: float, film_deg: float | None
) -> None:
    """A camera as it should be had the flag for up to six seconds after each change of scene."""
    one = case(monkeypatch, Defects(""), motion, judged_s=11).run
    some = record(
        replace(
            one, then=(random_scene(1), random_scene(2)), rate_hz=rate_hz, film_deg=film_deg,
            behaviour=replace(one.behaviour, act_s=4.0), defects="none",
            daemon_arguments=() if film_deg is None else (f"--polarizer=fixed:{film_deg:g}",),
        )
    ).packets["default"]  # fmt: skip
    assert some
    assert not any(one.estimate.flags & EstimateFlag.RESPONSE for one in some)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("size_px", [(480, 240), (640, 320), SMALL_PX])
@pytest.mark.parametrize("quality", [60, 85])
@pytest.mark.parametrize("scene", [Room(), random_scene(2)], ids=str)
def test_what_rounding_does_to_dark_walls_is_not_named(
    monkeypatch: pytest.MonkeyPatch, size_px: tuple[int, int], quality: int, scene: Scene
) -> None:
    """A camera as it should be was said to alter its pictures where these have few pixels."""
    some = record(
        case(monkeypatch, Defects("", quality=quality), scene=scene, size_px=size_px).run
    ).packets["default"]
    assert some
    assert not any(one.estimate.flags & EstimateFlag.RESPONSE for one in some)


def test_tone_mapping_that_comes_and_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flag comes within three seconds, and goes within eight."""
    defects = Defects("", "tone_ev=1&from_s=4&to_s=9")
    some = record(case(monkeypatch, defects, judged_s=17).run).packets["default"]
    begin_s = some[0].captured_s

    def share(from_s: float, to_s: float) -> float:
        within = [one for one in some if from_s <= one.captured_s < to_s]
        return sum(bool(one.estimate.flags & EstimateFlag.RESPONSE) for one in within) / len(within)

    assert begin_s < 4
    assert share(begin_s, 4) == 0
    assert share(7, 9) == 1
    assert share(17, some[-1].captured_s) == 0


@pytest.mark.nightly
def test_each_of_two_cameras_has_a_response_of_its_own() -> None:
    """Both are brought to what sRGB says."""
    bent = Pair(gamma=1.06)
    run = live.case(Room(), "0", "reported", pair=bent, judged_s=2).run
    found = live.judged(live.Case("0", run))
    default = next(one.figures for one in found if one.subscription == "default")
    assert default.error_median < 0.02
    assert "RESPONSE" not in default.flags
