"""AR pictures against renders of the real object: the order of methods, and the check of it all.

Few samples: the figures of docs/users/seen.md are by `make seen`. Needs Mitsuba: `make
test-renderer`.
"""

import importlib.util

import numpy as np
import pytest

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        importlib.util.find_spec("mitsuba") is None, reason="make test-renderer installs Mitsuba"
    ),
]  # fmt: skip


@pytest.fixture(scope="module")
def figures(tmp_path_factory):
    """Mean FLIP by material and method, at one place."""
    import room
    import seen

    quality = seen.Quality(truth=48, panorama=8, drawn=48)
    found, sheets = seen.measured(
        quality, [room.PLACES[0]], ["chalk", "chrome"], tmp_path_factory.mktemp("seen")
    )
    (sheet,) = sheets.values()
    assert np.isfinite(sheet).all()
    return {(one.material, one.method): one.flip for one in found}


def test_exact_light_gives_nearly_the_truth(figures):
    """What is left is noise, and near light: had a frame of reference been wrong, it would show."""
    import seen

    for material in ("chalk", "chrome"):
        assert figures[material, seen.EXACT] < 0.7 * figures[material, seen.PHONE]


def test_the_packet_is_closer_than_one_lamp_and_ambient(figures):
    import seen

    for material in ("chalk", "chrome"):
        assert figures[material, seen.MAP] < 0.8 * figures[material, seen.PHONE]
        assert figures[material, seen.MAP] < 1.25 * figures[material, seen.EXACT]


def test_area_lights_are_closer_than_lamps_and_harmonics_alone(figures):
    import seen

    assert figures["chrome", seen.AREAS] < 0.85 * figures["chrome", seen.PACKET]
    assert figures["chalk", seen.AREAS] < 1.05 * figures["chalk", seen.PACKET]


def test_chrome_wants_a_picture_of_the_room(figures):
    import seen

    assert figures["chrome", seen.MAP] < 0.85 * figures["chrome", seen.PACKET]


def test_shadows_are_as_steep_as_the_lamps():
    import shadow

    errors = [one.errors_deg[0] for one in shadow.measured()]
    assert max(errors) < 0.1
