"""The mount's rotation from how head and probe turn, and what does not tell it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.align import hand_eye
from lightprobe.align.track import AlignError, Track, make
from scipy.spatial.transform import Rotation

MOUNT = Rotation.from_euler("yxz", [20, -35, 8], degrees=True)
#: Any fixed frames of the world.
APP_WORLD = Rotation.from_euler("yxz", [77, 0, 0], degrees=True)
ANCHOR = Rotation.from_euler("yxz", [-130, 20, 40], degrees=True)


def looking_around(t_s, yaw_deg=40.0, pitch_deg=20.0, roll_deg=3.0):
    """Head → world, as a head looks around: no motion repeats within a minute."""
    yaw = yaw_deg * np.sin(2 * np.pi * 0.31 * t_s) + 0.4 * yaw_deg * np.sin(2 * np.pi * 0.13 * t_s)
    pitch = pitch_deg * np.sin(2 * np.pi * 0.23 * t_s + 1)
    roll = roll_deg * np.sin(2 * np.pi * 0.41 * t_s + 2)
    return Rotation.from_euler("YXZ", np.stack([yaw, pitch, roll], axis=-1), degrees=True)


def tracks(
    *, motion=looking_around, mount=MOUNT, seconds=20.0, ahead_ns=0, late_s=0.0, noise_deg=0.1,
    probe_noise_deg=0.1, seed=1, head_hz=72.0, probe_hz=30.0,
):  # fmt: skip
    """Head and probe; the head's clock shows `ahead_ns` more, and its stamps are `late_s` late."""
    rng = np.random.default_rng(seed)
    head_s = np.arange(0, seconds, 1 / head_hz)
    probe_s = np.arange(0.3, seconds - 0.2, 1 / probe_hz)
    head = APP_WORLD * motion(head_s) * noise(rng, noise_deg, len(head_s))
    probe = ANCHOR * motion(probe_s) * mount * noise(rng, probe_noise_deg, len(probe_s))
    stamps = [ahead_ns + round(1e9 * (t + late_s)) for t in head_s]
    return (
        make("head", stamps, head.as_quat()),
        make("probe", [round(1e9 * t) for t in probe_s], probe.as_quat()),
    )


def noise(rng, sigma_deg, count):
    return Rotation.from_rotvec(sigma_deg * rng.standard_normal((count, 3)), degrees=True)


def error_deg(found: hand_eye.HandEye, mount=MOUNT) -> float:
    return float(np.degrees((found.rotation.inv() * mount).magnitude()))


def test_the_mount_and_the_offset_are_found():
    found = hand_eye.solve(*tracks(late_s=0.037))
    assert error_deg(found) < 0.1
    assert found.time_offset_s == pytest.approx(0.037, abs=0.002)
    assert found.agreeing == 1


@pytest.mark.parametrize("ahead_ns", [1_700_000_000_000_000_000, -3_000_000_000])
def test_another_clock_is_recognised(ahead_ns):
    found = hand_eye.solve(*tracks(ahead_ns=ahead_ns))
    assert error_deg(found) < 0.1
    assert found.time_offset_s == pytest.approx(1e-9 * ahead_ns, abs=0.002)


def test_one_clock_is_trusted_to_be_one_while_motion_repeats():
    """A swing comes again and again: times that are those of one clock are not to be shifted."""
    found = hand_eye.solve(*tracks(motion=swing_and_nod))
    assert error_deg(found) < 0.1


def swing_and_nod(t_s):
    angles = [40 * np.sin(np.pi * t_s), 15 * np.sin(2 * np.pi * 0.17 * t_s + 1)]
    return Rotation.from_euler("YX", np.stack(angles, axis=-1), degrees=True)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6), st.floats(-0.5, 0.5))
def test_any_mount_is_found(seed, late_s):
    mount = Rotation.random(random_state=seed)
    found = hand_eye.solve(*tracks(mount=mount, late_s=late_s, seed=seed))
    assert error_deg(found, mount) < 0.15


def test_the_sigma_holds():
    """Errors of 25 calibrations, in units of their own sigma about the worst axis."""
    errors = []
    for seed in range(25):
        found = hand_eye.solve(*tracks(seed=seed, noise_deg=0.3, seconds=12))
        errors.append(error_deg(found) / found.sigma_deg)
    # About three axes: chi with three degrees of freedom at most, as the worst axis counts.
    assert 0.3 < np.median(errors) < 1.9
    assert np.quantile(errors, 0.95) < 4.5


def test_jumps_and_lost_tracking_are_outliers():
    """The world of the app, or the probe's anchor, jumps; one second of poses is missing."""
    head, probe = tracks(seconds=30)
    jump = Rotation.from_rotvec([0, 8, 3], degrees=True)
    after = head.time_s > 11
    rotations = head.rotation.as_quat()
    rotations[after] = (jump * head.rotation[after]).as_quat()
    keep = (head.time_s < 20) | (head.time_s > 21)
    spoilt = Track("head", head.start_ns, head.time_s[keep], Rotation.from_quat(rotations[keep]))
    found = hand_eye.solve(spoilt, probe)
    assert error_deg(found) < 0.15
    assert found.agreeing < 1


def test_one_axis_is_not_enough():
    with pytest.raises(AlignError, match=r"one axis only \(near turning left.*another axis too"):
        hand_eye.solve(*tracks(motion=lambda t: looking_around(t, 40, 0, 0)))
    with pytest.raises(AlignError, match=r"one axis only \(near nodding"):
        hand_eye.solve(*tracks(motion=lambda t: looking_around(t, 0, 25, 0)))


@pytest.mark.parametrize("noise_deg", [0.05, 0.3, 1.0])
def test_noise_is_no_second_axis(noise_deg):
    with pytest.raises(AlignError):
        hand_eye.solve(
            *tracks(motion=lambda t: looking_around(t, 40, 0, 0), noise_deg=noise_deg,
                    probe_noise_deg=noise_deg)
        )  # fmt: skip


def test_no_motion():
    with pytest.raises(AlignError, match="head: does not turn"):
        hand_eye.solve(*tracks(motion=lambda t: looking_around(t, 0, 0, 0)))
    head, _ = tracks()
    _, still = tracks(motion=lambda t: looking_around(t, 0, 0, 0))
    with pytest.raises(AlignError, match="probe: does not turn"):
        hand_eye.solve(head, still)


def test_poses_of_another_session():
    head, _ = tracks()
    _, probe = tracks(motion=lambda t: looking_around(1.37 * t + 8, 25, 31, 12))
    with pytest.raises(AlignError, match=r"contradict|never turn alike"):
        hand_eye.solve(head, probe)


def test_a_probe_that_moves_on_the_head():
    """The mount slips by 50° while it is calibrated."""
    head, probe = tracks()
    slip = Rotation.from_rotvec(
        np.outer(50 * np.sin(2 * np.pi * probe.time_s), [0.6, 0, 0.8]), degrees=True
    )
    loose = Track("probe", probe.start_ns, probe.time_s, probe.rotation * slip)
    with pytest.raises(AlignError, match=r"contradict|never turn alike"):
        hand_eye.solve(head, loose)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda q: Rotation.from_quat(q).inv().as_quat(), "inverse rotations"),
        (lambda q: np.roll(q, 1, axis=1), "order w, x, y, z"),
    ],
)
def test_what_apps_confuse_is_named(spoil, words):
    head, probe = tracks()
    stamps = [round(1e9 * t) for t in head.time_s]
    wrong = make("head", stamps, spoil(head.rotation.as_quat()))
    with pytest.raises(AlignError, match=words):
        hand_eye.solve(wrong, probe)


def test_motion_that_repeats_does_not_tell_unknown_clocks():
    with pytest.raises(AlignError, match="repeats itself"):
        hand_eye.solve(*tracks(
            motion=lambda t: Rotation.from_euler(
                "YX", np.stack([40 * np.sin(np.pi * t), 15 * np.cos(np.pi * t)], -1), degrees=True
            ),
            ahead_ns=10**18,
        ))  # fmt: skip


def test_too_little():
    head, probe = tracks(seconds=3)
    with pytest.raises(AlignError, match="look around longer"):
        hand_eye.solve(head, probe)
    slow, probe = tracks(head_hz=2)
    with pytest.raises(AlignError, match="without gaps"):
        hand_eye.solve(slow, probe)


def test_samples_are_checked():
    good = [0.0, 0, 0, 1]
    with pytest.raises(AlignError, match="pose 2 is not finite"):
        make("f", [0, 1, 2], [good, [np.nan, 0, 0, 1], good])
    with pytest.raises(AlignError, match="length 2"):
        make("f", [0, 1], [good, [0, 0, 0, 2.0]])
    with pytest.raises(AlignError, match="goes back by 3 s after pose 2"):
        make("f", [0, 5 * 10**9, 2 * 10**9], [good] * 3)
    with pytest.raises(AlignError, match="1 poses"):
        make("f", [0], [good])
    assert len(make("f", [0, 0, 7000], [good] * 3).time_s) == 2


def test_repeated_samples_whose_times_were_mapped_anew():
    """A probe repeats its last estimate; its time may differ by nanoseconds."""
    times_ns = [100, 90, 110, 10**9, 10**9 - 20, 2 * 10**9]
    assert make("f", times_ns, [[0, 0, 0, 1.0]] * 6).time_s == pytest.approx([0, 1, 2], abs=1e-6)
