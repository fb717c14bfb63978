"""A file of options: `lightprobe simulate --scenario FILE`."""

from pathlib import Path
from typing import Any

import pytest
from lightprobe.cli import scenario
from lightprobe.cli.main import SIMULATE, Root
from lightprobe.errors import UsageError


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
    assert values("--scenario", file) | {"scenario_file": None} == values()


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
