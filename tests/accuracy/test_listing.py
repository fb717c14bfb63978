"""The comparison of what packets may hold compares what its columns say."""

import listing
import missing
import numpy as np
import pytest
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.evaluate.relight import Lighting

pytestmark = pytest.mark.many_frames
DIRECTION = np.array([0.6, 0.8, 0.0])
LAMP = Light(1, DIRECTION, np.array([3.0, 2.0, 1.0]), 2.0)
BLACK = SphericalHarmonics("AMBIENT", 2, np.zeros((9, 3)))


def packet(*lights: Light) -> Estimate:
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), lights, BLACK, None, None, 1, None)


def test_the_truth_itself_is_without_error():
    truth = Lighting(np.empty((0, 3)), np.empty((0, 3))).plus((LAMP,))
    found = listing._judge("a lamp", "lamps", truth, packet(LAMP))
    assert found.diffuse < 0.02  # points of a disc, and its centre
    assert found.soft < 1e-6
    assert found.hard_ambient < 1e-6
    assert found.size_bytes == 9 * 12 + 47
    dark = listing._judge("a lamp", "no lights", truth, packet())
    assert dark.diffuse > 1
    assert dark.soft > 0.5


def test_light_that_is_sent_is_the_same_whatever_is_listed():
    rng = np.random.default_rng(1)
    total = SphericalHarmonics("TOTAL", 4, rng.normal(size=(25, 3)))
    key = Light(0, np.array([0.0, 1.0, 0.0]), np.ones(3), 30.0)
    for lights, one in (((), None), ((LAMP,), None), ((LAMP,), key)):
        sent = listing._packet(packet(), total, 4, lights, one)
        np.testing.assert_allclose(sent.total().coefficients, total.coefficients, atol=1e-12)


def test_a_panorama_of_the_project():
    file = listing.panoramas(["studio"])[0]
    found = {(one.order, one.sent): one for one in listing.errors_of(file)}
    assert len(found) == 2 * len(listing.CHOICES)
    assert found[4, "lamps (default)"].diffuse < found[2, "no lights"].diffuse
    assert found[2, "lamps and KEY"].hard_ambient < found[2, "no lights"].hard_ambient
    assert len(listing.rows(list(found.values()))) == 2 * len(listing.CHOICES)


def test_a_name_that_fits_nothing():
    with pytest.raises(LightprobeError, match="no panorama is named like nowhere"):
        listing.panoramas(["nowhere"])


def test_a_strong_lamp_is_not_missing_while_a_place_is_free() -> None:
    """Of a list of four, as one lamp after the other of five goes off for four seconds."""
    (found,) = (one for name, one in missing.measured(14, 4.0, 960) if name == "default")
    assert found.packets > 300
    assert found.lacking <= 0.01 * found.packets
    assert found.longest_s <= 0.3
    assert found.births > 4  # lamps do go and come
