"""The yardsticks: a perfect estimate scores zero, and each fault shows where it belongs."""

import dataclasses

import numpy as np
import pytest
from lightprobe import geometry, sh
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.evaluate import evaluation, metrics
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import ProceduralScene

ROOM: ProceduralScene = random_scene(4)
REFERENCE = evaluation.reference(ROOM)


def perfect() -> Estimate:
    lights = tuple(
        Light(k + 1, lamp.direction, lamp.irradiance, lamp.radius_deg, 0.1, 0.01 * lamp.irradiance)
        for k, lamp in enumerate(ROOM.lamps)
    )
    ambient = SphericalHarmonics("AMBIENT", 2, ROOM.background)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), lights, ambient, 0.01, None, 1, None)


def test_perfect_estimate():
    score = REFERENCE.score(perfect())
    assert score.relighting_mae < 1e-3  # discs set softly, lamps do not
    assert score.sh_error < 0.01  # lamps are points in a packet, discs in the truth
    assert (score.missed, score.false) == (0, 0)
    assert max(match.angle_deg for match in score.matches) < 1e-6


def test_missed_false_and_turned_lamps():
    good = perfect()
    turned = geometry.rotate(geometry.quaternion([0.3, 1, 0.2], 3.0), good.lights[1].direction)
    strange = dataclasses.replace(good.lights[2], direction=-good.lights[2].direction)
    lights = (dataclasses.replace(good.lights[1], direction=turned), strange, *good.lights[3:])
    score = REFERENCE.score(dataclasses.replace(good, lights=lights))
    assert (score.missed, score.false) == (2, 1)
    assert max(match.angle_deg for match in score.matches) == pytest.approx(
        geometry.angle_deg(turned, good.lights[1].direction)
    )


def test_relighting_is_relative_to_the_truth_s_maximum():
    true = np.array([[1.0, 2, 4], [0, 0, 0]])
    mae, rmse = metrics.relighting(true, true + np.array([0.1, 0.2, 0.4]))
    assert mae == pytest.approx(0.1)
    assert rmse == pytest.approx(0.1)


def test_stated_and_true_error_of_relighting_are_comparable():
    true = np.array([[1.0, 1, 1], [3, 3, 3]])
    assert metrics.relighting_relative(true, 1.1 * true) == pytest.approx(0.1 * np.sqrt(5) / 2)
    stated = dataclasses.replace(perfect(), predicted_error=0.03, relighting_sigma=0.04)
    assert metrics.stated_error(stated) == pytest.approx(0.05)
    assert metrics.stated_error(dataclasses.replace(stated, relighting_sigma=None)) == 0.03


def test_sh_error_is_relative():
    true = np.arange(27.0).reshape(9, 3)
    assert metrics.sh_error(true, 1.1 * true) == pytest.approx(0.1)
    higher = np.vstack([true, np.ones((16, 3))])
    assert metrics.sh_error(higher, true) == 0


def test_summary_counts_coverage():
    good = perfect()
    nudged = geometry.rotate(geometry.quaternion([0, 1, 0], 0.15), good.lights[4].direction)
    lights = (*good.lights[:4], dataclasses.replace(good.lights[4], direction=nudged))
    scores = [REFERENCE.score(good), REFERENCE.score(dataclasses.replace(good, lights=lights))]
    summary = metrics.summarize(scores)
    assert summary.scenes == 2
    assert summary.direction_within_1_sigma == pytest.approx(0.9)
    assert summary.direction_within_2_sigma == 1
    assert summary.irradiance_within_1_sigma == 1
    assert summary.missed == summary.false == 0
    dimmed = dataclasses.replace(good, relighting_sigma=1e-4)
    unsure = dataclasses.replace(good, relighting_sigma=1.0)
    wrong = dataclasses.replace(dimmed, lights=lights[1:])
    half = metrics.summarize([REFERENCE.score(unsure), REFERENCE.score(wrong)])
    assert half.relighting_within_1_sigma == half.relighting_within_3_sigma == 0.5
    with pytest.raises(ValueError, match="no score"):
        metrics.summarize([])


def test_total_and_irradiance_agree_within_truncation():
    """The invariant that a client can check: AMBIENT + lamps light as TOTAL does."""
    estimate, normals = perfect(), geometry.sphere_normals()
    total = sh.irradiance(estimate.total().coefficients, normals)
    parts = estimate.irradiance(normals)
    assert np.abs(total - parts).mean() / parts.max() < 0.03


@pytest.mark.parametrize("count", [1, 3])
def test_exposures_start_at_the_median_and_are_four_stops_apart(count):
    radiance = ROOM.render(256, 128).compose(np.ones(5))
    exposures_us = evaluation.Input.parse(str(count)).exposures_us(radiance)
    assert len(exposures_us) == count
    assert np.all(np.isclose(np.divide(exposures_us[:-1], exposures_us[1:]), 16))
    weight = np.repeat(geometry.equirect_solid_angles(256, 128), 256)
    below = radiance.reshape(-1, 3) @ [0.2126, 0.7152, 0.0722] * exposures_us[0] * 1e-6 < 0.25
    assert weight[below].sum() == pytest.approx(2 * np.pi, rel=0.01)


def test_unclipped_exposure_does_not_clip():
    radiance = ROOM.render(256, 128).compose(np.ones(5))
    (exposure_us,) = evaluation.Input.parse("unclipped").exposures_us(radiance)
    assert radiance.max() * exposure_us * 1e-6 == pytest.approx(0.9, rel=1e-6)


@pytest.mark.parametrize("word", ["", "0", "9", "-1", "raw", "1.5"])
def test_inputs_that_are_none(word):
    with pytest.raises(UsageError, match="expected float"):
        evaluation.Input.parse(word)
