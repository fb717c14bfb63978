"""The light without a probe is the same in every client: proto/golden/fallback.json."""

import json

import golden
import numpy as np
import pytest
from lightprobe import fallback_estimate
from lightprobe.colour import luminance
from lightprobe.fallback import mean_irradiance
from lightprobe.geometry import sphere_normals
from lightprobe.wire import decode

EXPECTED = json.loads((golden.GOLDEN / "fallback.json").read_text())


def last_of(name):
    """The estimate of a golden file; "": none came yet."""
    return decode(golden.decode(name).SerializeToString()) if name else None


@pytest.mark.parametrize("name", EXPECTED)
def test_the_fallback_after_a_golden_estimate(name):
    found = fallback_estimate(last_of(name))
    assert (found.sh.kind, found.sh.order, found.lights, found.key) == ("AMBIENT", 1, (), None)
    np.testing.assert_allclose(found.sh.coefficients.ravel(), EXPECTED[name], rtol=1e-5)


@pytest.mark.parametrize("name", [name for name in EXPECTED if any(EXPECTED[name])])
def test_it_is_as_bright_in_the_mean_as_the_last_light_and_comes_from_above(name):
    last = last_of(name)
    found = fallback_estimate(last)
    normals = sphere_normals(5)
    mean = luminance(found.irradiance(normals)).mean()
    wanted = luminance(last.irradiance(normals)).mean() if last else np.pi / 2
    assert mean == pytest.approx(wanted, rel=2e-3)
    assert mean_irradiance(found) == pytest.approx(mean, rel=2e-3)
    up, side, down = luminance(found.irradiance([(0, 1, 0), (1, 0, 0), (0, -1, 0)]))
    assert up > side > down > 0.5 * side
