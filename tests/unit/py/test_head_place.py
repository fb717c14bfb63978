"""Where a head is, as an app says it: what is sent, and what the simulated app errs by."""

import numpy as np
import pytest
from lightprobe.sim.head import Habits, Head
from lightprobe.wire import PoseError, encode_pose
from lightprobe_proto import lightprobe_pb2 as pb


def message(data: bytes) -> pb.FromClient:
    return pb.FromClient.FromString(data[1:])


def test_a_place_is_sent_with_its_sigma() -> None:
    pose = message(encode_pose([0, 0, 0, 1], 7, None, [1, 1.5, -2], 0.25)).pose
    assert list(pose.position) == [1, 1.5, -2]
    assert pose.position_sigma_m == 0.25
    without = message(encode_pose([0, 0, 0, 1], 7)).pose
    assert not without.position
    assert not without.HasField("position_sigma_m")


@pytest.mark.parametrize("place", [[0, 0], [0, 0, np.nan], [0, 0, np.inf], "here"])
def test_what_is_no_place_is_refused(place: object) -> None:
    with pytest.raises((PoseError, ValueError), match=r"position_m|could not convert"):
        encode_pose([0, 0, 0, 1], 7, None, place)  # type: ignore[arg-type]
    with pytest.raises(PoseError, match="position_sigma_m"):
        encode_pose([0, 0, 0, 1], 7, None, [0, 0, 0], 0.0)


class Sent:
    """Stands for the connection: keeps what is sent."""

    def __init__(self) -> None:
        self.received: list[object] = []
        self.poses: list[pb.Pose] = []

    def send(self, data: bytes) -> None:
        self.poses.append(message(data).pose)


def test_errors_last_as_long_as_said() -> None:
    """Their spread is that which is stated, and errors a memory apart are alike by 1 / e."""
    sent = Sent()
    habits = Habits(rate_hz=10, noise_m=0.01, memory_s=2, pings=False)
    head = Head(sent, lambda _: np.array([1.0, 0, 0, 0]), 0, habits, lambda _: np.ones(3))  # type: ignore[arg-type]
    for _ in range(20_000):
        head.work()
    off = np.array([pose.position for pose in sent.poses]) - 1
    assert off.std() == pytest.approx(0.01, rel=0.1)
    alike = np.mean(off[20:] * off[:-20]) / np.mean(off**2)
    assert alike == pytest.approx(np.exp(-1), abs=0.1)
    assert sent.poses[0].position_sigma_m == pytest.approx(0.01)
