"""Shadows and mirrors beside a probe that moves: coarse bounds, and the check of it all.

The figures of docs/users/seen.md are by `make seen-beside`.
"""

import importlib.util

import numpy as np
import pytest

pytestmark = [pytest.mark.long, pytest.mark.many_frames]
needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="make test-renderer installs Mitsuba"
)


def test_shadows_beside_a_moving_probe_are_as_steep_as_the_lamp_there():
    import shadow_beside

    (found,) = shadow_beside.judge(shadow_beside.Case(1, 0, "place"))
    unchanged, at_place = (
        np.sqrt(np.mean(np.square(rows), axis=0))
        for rows in (found.unchanged_deg, found.at_place_deg)
    )
    assert (unchanged[1:] > 5).all()
    assert (at_place[1:] < 0.2 * unchanged[1:]).all()
    assert (at_place[1:] < at_place[0] + 0.3).all()


@needs_mitsuba
def test_a_ball_mirrors_what_is_before_it_and_beside_it():
    """Blue is above, red to the right, green behind, where the first view is from."""
    import mirror_ball
    from lightprobe import geometry

    towards = geometry.equirect_directions(256, 128)
    radiance = np.float32(np.maximum(towards[..., [0, 2, 1]], 0))
    from_behind, from_ahead = np.hsplit(mirror_ball.ball(radiance), 2)
    middle, aside = mirror_ball._BALL_PX // 2, round(mirror_ball._BALL_PX * 0.853)
    assert from_behind[middle, middle] == pytest.approx([0, 1, 0], abs=0.03)
    assert from_ahead[middle, middle] == pytest.approx([0, 0, 0], abs=0.03)
    assert from_behind[middle, aside] == pytest.approx([1, 0, 0], abs=0.05)  # 45° of the ball
    assert from_ahead[middle, -aside] == pytest.approx([1, 0, 0], abs=0.05)
    assert from_behind[-aside, middle] == pytest.approx([0, 0, 1], abs=0.05)
    both = mirror_ball.on_screen(radiance, 0.3)
    assert mirror_ball.flip(both, both) == 0
