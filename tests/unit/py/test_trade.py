"""Settings that suffice for what is drawn: lightprobe.trade, and the command."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import trade
from lightprobe.cli.main import app
from lightprobe.trade import AS_GOOD, DRAWS, SIGHTS, Need, advise, choices
from typer.testing import CliRunner

BUDGETS = st.one_of(st.none(), st.floats(1e-4, 1e3))
DRAWN = st.lists(st.sampled_from(list(DRAWS)), min_size=1, unique=True).map(tuple)
NEEDS = st.builds(
    Need, DRAWN, st.floats(0.1, 200), st.sampled_from(SIGHTS), st.floats(1, 60),
    st.floats(0.1, 1), BUDGETS,
    st.one_of(st.none(), st.floats(10, 1e7)), st.one_of(st.none(), st.floats(1e-4, 1)),
)  # fmt: skip


def said(*words):
    return CliRunner().invoke(app, ["trade", "--decode-ms", "5", *words])


@given(NEEDS)
def test_what_is_not_named_as_unmet_is_met(need):
    advice = advise(need)
    one = advice.choice
    for name, of, most in (
        ("cpu", one.cpu, need.cpu), ("bytes_per_s", one.bytes_per_s, need.bytes_per_s),
        ("error", one.median(), need.error),
    ):  # fmt: skip
        if most is not None:
            assert (of <= most) != (name in advice.unmet)
    assert one.rate_hz <= need.rate_hz
    assert set(one.errors) == set(need.draws)
    assert all(0 < median <= worst for median, worst in one.errors.values())
    one.subscription()  # a probe could serve it


@given(NEEDS)
def test_nothing_cheaper_at_this_rate_is_as_exact(need):
    """Whatever costs less of both is less exact in something that is drawn."""
    one = advise(need).choice
    for other in choices(need):
        same = (other.rate_hz, other.map_rate_hz) == (one.rate_hz, one.map_rate_hz)
        if same and other.cpu < one.cpu and other.bytes_per_s < one.bytes_per_s:
            assert any(other.errors[name][0] > one.errors[name][0] for name in need.draws)


def test_everything_that_is_drawn_is_nearly_as_exact_as_can_be():
    """A thing that no setting draws well does not spoil the others."""
    need = Need(("diffuse", "mirrors"), 10.0, "webcam")
    one = advise(need).choice
    for name in need.draws:
        best = max(min(other.errors[name][0] for other in choices(need)), 0.004)
        assert one.errors[name][0] <= AS_GOOD**2 * best


def test_an_error_that_may_be_larger_costs_less():
    need = Need(("diffuse", "mirrors"), 10.0, "any exposure")
    errors = [0.3, 0.1, 0.03]
    costs = [advise(replace(need, error=error)).choice for error in errors]
    assert costs[0].bytes_per_s < costs[1].bytes_per_s < costs[2].bytes_per_s
    assert costs[0].map_size == 0
    assert advise(need).choice.map_size == 64


def test_matt_things_need_no_map():
    assert all(one.map_size == 0 for one in choices(Need(("diffuse", "shadows"), 5.0)))


def test_rates_go_down_only_where_a_budget_asks_for_it():
    need = Need(("diffuse",), 20.0)
    assert advise(need).choice.rate_hz == 30
    assert advise(replace(need, cpu=0.03)).choice.rate_hz < 30
    assert "cpu" in advise(replace(need, cpu=1e-6)).unmet


def test_the_table_is_whole():
    found = trade.table()
    assert found["scenes"] >= 10
    assert tuple(row["sight"] for row in found["sights"]) == SIGHTS
    for rows in (found["sights"], found["measuring"], found["models"], found["maps"]):
        for row in rows:
            assert set(row["errors"]) == set(DRAWS)
            assert all(0 <= median <= worst < 2 for median, worst in row["errors"].values())
            assert row.get("bytes", 1) > 0
            assert row.get("decodes", 1) > 0
    by_order = {
        row["sh_order"]: row["errors"]["diffuse"][0]
        for row in found["models"] if row["max_lights"] == 8 and not row["area_lights"]
    }  # fmt: skip
    assert by_order[0] > by_order[1] > by_order[2] >= by_order[4]


def test_the_command_answers():
    result = said("--draws", "matt,chrome", "--cpu", "10%", "--bytes", "100k", "--json")
    assert result.exit_code == 0, result.output
    choice = json.loads(result.output)["choice"]
    assert choice["cpu"] <= 0.1
    assert choice["bytes_per_s"] <= 100e3
    assert set(choice["errors"]) == {"diffuse", "mirrors"}
    words = said("--draws", "shadows").output
    assert "lightprobed --preset=" in words
    assert "Subscription(rate_hz=30" in words
    assert "simulated" in words


def test_what_cannot_be_had_is_said():
    result = said("--bytes", "50")
    assert result.exit_code == 1
    assert "not met: no settings send fewer bytes; this is the nearest" in result.output
    result = said("--error", "0.0001%")
    assert result.exit_code == 1
    assert "not met: no settings within the budgets are as exact" in result.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("--sight", "eye"),
            "trade: --sight eye: expected any-exposure, webcam, webcam-and-ring",
        ),
        (
            ("--draws", "hair"),
            "trade: --draws hair: expected diffuse, shadows, glossy, mirrors",
        ),
        (
            ("--cpu", "-3%"),
            "trade: --cpu -3%: expected a number above 0, as 10%, 20k or 0.1",
        ),
        (("--bytes", "0"), "trade: --bytes 0: expected"),
        (("--error", "nan"), "trade: --error nan: expected"),
    ],
)
def test_what_makes_no_sense_is_refused(words, message):
    result = said(*words)
    assert result.exit_code != 0
    assert message in str(result.exception) + result.output


def test_a_decode_is_measured_here():
    from lightprobe.cli.trade import measured_decode_ms

    assert 0.5 < measured_decode_ms() < 1000
