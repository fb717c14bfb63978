"""A file of options: `lightprobe simulate --scenario FILE`."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from lightprobe.cli import scenario
from lightprobe.cli import simulate as commands
from lightprobe.cli.main import SIMULATE, Root
from lightprobe.colour import srgb_table
from lightprobe.errors import UsageError
from lightprobe.sim.faults import Faults
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing


def simulate() -> Any:
    """Give click's command."""
    return Root.entries["simulate"].load("simulate")


def values(*words: str | Path) -> dict[str, Any]:
    """Give the values that the command would get."""
    return simulate().make_context("simulate", [str(word) for word in words]).params


def test_a_file_says_what_options_say(tmp_path: Path) -> None:
    file = tmp_path / "evening.toml"
    file.write_text(
        'scenes = ["procedural:1", "room"]\nact_s = 3\nseed = 7\n'
        '[camera]\nsize = "960x480"\nrow-time-us = 15.5\n[lamps]\nflicker_depth = [0.3, 0.2]\n'
    )
    by_file = values("--scenario", file)
    by_options = values(
        "--scenes", "procedural:1", "--scenes", "room", "--act-s", "3", "--seed", "7", "--size",
        "960x480", "--row-time-us", "15.5", "--flicker-depth", "0.3,0.2",
    )  # fmt: skip
    assert by_file | {"scenario_file": None} == by_options
    assert by_file["scenario_file"] == file


def test_an_option_counts_before_the_file_wherever_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("rate = 10\nact_s = 3\n")
    for words in (["--rate", "60", "--scenario", file], ["--scenario", file, "--rate", "60"]):
        found = values(*words)
        assert (found["rate_hz"], found["act_s"]) == (60.0, 3.0)


def test_the_printed_file_says_what_no_file_says(tmp_path: Path) -> None:
    text = scenario.template(simulate(), "lightprobe simulate")
    file = tmp_path / "all.toml"
    file.write_text("\n".join(line.removeprefix("#") for line in text.splitlines()
                              if not line.startswith("# ") and '""' not in line))  # fmt: skip
    assert file.read_text().count("=") > 40
    found, plain = values("--scenario", file), values()
    kinds = {"processing": Processing, "lens_defects": LensDefects, "pixel_defects": PixelDefects}
    for key, kind in kinds.items():
        assert found[key].count("=") == len(fields(kind))
        assert kind().merged(found.pop(key)) == kind().merged(plain.pop(key)) == kind()
    assert found | {"scenario_file": None} == plain


def test_an_option_with_names_of_its_own_may_be_a_table(tmp_path: Path) -> None:
    file = tmp_path / "cheap.toml"
    file.write_text(
        "[world]\nseed = 7\n[processing]\nsharpen = 0.7\ntone-ev = 1\n"
        "[lens-defects]\nglare = 0.02\n[pixel_defects]\nstuck = 12\n[faults]\ndrop = 0.1\n"
    )
    found = values("--scenario", file)
    assert found["seed"] == 7
    assert Processing().merged(found["processing"]) == Processing(sharpen=0.7, tone_ev=1)
    assert LensDefects().merged(found["lens_defects"]) == LensDefects(glare=0.02)
    assert PixelDefects().merged(found["pixel_defects"]) == PixelDefects(stuck=12)
    assert Faults().merged(found["faults"]) == Faults(drop=0.1)
    by_option = values("--scenario", file, "--processing", "sharpen=0.2")
    assert by_option["processing"] == "sharpen=0.2"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--processing", "sharp=1"], "processing: unknown option sharp: known are exposure_tear"),
        (["--lens-defects", "glare=3"], "lens defects: glare=3: expected a number"),
        (["--processing", "tone_ev=1", "--format", "RGBF"], "processing: RGBF has no sensor"),
    ],
)
def test_what_no_camera_does_is_refused(tmp_path: Path, words: list[str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        simulate().main(
            ["--socket", str(tmp_path / "s"), "--size", "64x32", "--seconds", "0.1", *words],
            standalone_mode=False,
        )


def test_the_command_makes_the_pictures_that_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[dict[str, Any]] = []
    real = commands.SimulatedCamera

    def camera(*positional: Any, **named: Any) -> Any:
        made.append(named)
        return real(*positional, **named)

    monkeypatch.setattr(commands, "SimulatedCamera", camera)
    words = [
        "--processing",
        "sharpen=0.7",
        "--lens-defects",
        "glare=0.1",
        "--response",
        "srgb:1.04",
    ]
    simulate().main(
        ["--socket", str(tmp_path / "s"), "--size", "64x32", "--seconds", "0.05", *words],
        standalone_mode=False,
    )
    assert made[0]["processing"] == Processing(sharpen=0.7)
    assert made[0]["lens_defects"] == LensDefects(glare=0.1)
    assert made[0]["response"][128] == pytest.approx(srgb_table()[128] ** 1.04)


def test_the_page_names_each_of_them() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs/users/simulator.md").read_text()
    for kind in (Processing, LensDefects):
        assert [one.name for one in fields(kind) if f"`{one.name}`" not in page] == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("act_s = ", "Invalid value"),
        ("acts_s = 3", "acts_s: no such key: see --help-scenario"),
        ("[world]\nscenario = 'b.toml'", "scenario: no such key"),
        ("json = true", "json: no such key"),
    ],
)
def test_a_file_that_is_none_is_refused_by_its_name(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(UsageError, match=rf"simulate: --scenario .*bad\.toml: .*{says}"):
        values("--scenario", file)
    with pytest.raises(UsageError, match=r"none\.toml: No such file"):
        values("--scenario", tmp_path / "none.toml")


def test_a_value_that_cannot_be_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.toml"
    file.write_text("rate = -3\n")
    with pytest.raises(UsageError, match=r"simulate: .*bad\.toml: rate = -3: expected .*frames"):
        values("--scenario", file)


def test_help_shows_a_few_options_and_all_are_known() -> None:
    command = simulate()
    shown = {key for key, option in scenario.keys(command).items() if not option.hidden}
    assert shown == set(SIMULATE)
    assert len(scenario.keys(command)) > 2 * len(shown)
