"""Bill of materials and power budget; tables of hw/README.md."""

import pytest
import readme
from bom import Part, Rail, budget, load, needed_n, total_eur
from dimensions import ROOT, dimensions


def test_the_bill_adds_up_and_leaves_reserve() -> None:
    parts, rails = load()
    low, high = total_eur(parts)
    assert 0 < low < high
    for rail in budget(parts, rails):
        assert rail.typical_ma <= rail.peak_ma
        assert rail.peak_ma <= 0.8 * rail.limit_ma, f"{rail.id}: less than a fifth left"
    assert len({part.id for part in parts}) == len(parts)


def test_tables_of_the_readme_are_up_to_date() -> None:
    text = (ROOT / "hw/README.md").read_text()
    assert readme.renewed(text, readme.tables()) == text, "make hw-docs"


def test_currents_climb_to_the_rail_that_feeds_a_rail_and_options_do_not_count() -> None:
    parts = [
        Part("a", "", 2, (1, 2), [], rail="low", typical_ma=10, peak_ma=20),
        Part("b", "", 1, (5, 5), [], rail="high", typical_ma=1, peak_ma=1),
        Part("c", "", 1, (9, 9), [], option="x", rail="low", typical_ma=100, peak_ma=100),
    ]
    low, high = budget(parts, [Rail("low", "", 100, "high"), Rail("high", "", 1000)])
    assert (low.typical_ma, low.peak_ma) == (20, 40)
    assert (high.typical_ma, high.peak_ma) == (21, 41)
    assert total_eur(parts) == (7, 9)


@pytest.mark.parametrize("wrong", ["price_eur: [9, 2]", "rail: nowhere", "typical_ma: 99999"])
def test_numbers_that_cannot_be_are_named(
    wrong: str, monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    key = wrong.split(":")[0]
    text = (
        "parts:\n- {id: thing, what: x, count: 1, price_eur: [1, 2], rail: host, typical_ma: 1, "
        "peak_ma: 2, instead: []}\n"
        "rails:\n  host: {what: x, limit_ma: 5}\n"
    )
    start = text.index(f"{key}: ")
    end = text.index("]" if key == "price_eur" else ",", start) + (key == "price_eur")
    (tmp_path / "bom.yml").write_text(text[:start] + wrong + text[end:])
    monkeypatch.setattr("bom.HW", tmp_path)
    with pytest.raises(ValueError, match=r"bom\.yml: thing"):
        load()


def test_the_servo_is_strong_enough_and_harmless_to_fingers() -> None:
    servo = next(part for part in load()[0] if part.id == "servo")
    radius_m = dimensions(servo_travel_deg=servo.travel_deg)["servo_gear_radius"] / 1000
    force_n = servo.torque_nm / radius_m
    assert 3 * needed_n() < force_n < 10
