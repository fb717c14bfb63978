"""Head poses of the C# client: as Python reads them, and with a live daemon."""

import subprocess

import numpy as np
import pytest
from harness import Daemon
from lightprobe_proto import lightprobe_pb2 as pb
from mono import ask, free_port, room, said


def test_poses_and_pings_are_written_as_python_reads_them(program):
    def sent(*words):
        lines = ask(program, "pose", *map(str, words))
        return [pb.FromClient.FromString(bytes.fromhex(line)) for line in lines]

    bare, ping, answered = sent(0, 0.6, 0, 0.8, "-")
    assert bare.pose.time_ns == 1234567890123
    np.testing.assert_allclose(bare.pose.orientation, [0, 0.6, 0, 0.8])
    assert not bare.pose.HasField("sigma_deg")
    assert not bare.pose.position
    assert not bare.pose.HasField("position_sigma_m")
    placed, *_ = sent(0, 0, 0, 1, 0.5, 1, 1.5, -2, 0.0078125)
    assert placed.pose.sigma_deg == 0.5
    assert list(placed.pose.position) == [1, 1.5, -2]
    assert placed.pose.position_sigma_m == 0.0078125
    assert ping.ping.time_ns == 17
    assert not ping.ping.HasField("pong_time_ns")
    assert (answered.ping.time_ns, answered.ping.pong_time_ns) == (-17, 16)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((0, 0, 0, 2, "-"), "expected a unit quaternion"),
        (("NaN", 0, 0, 1, "-"), "expected a unit quaternion"),
        ((0, 0, 0, 1, 0, 1, 2, 3, 0.1), "sigmaDeg 0: expected degrees above 0"),
        ((0, 0, 0, 1, 0.1, 1, 2, 3, -1), "positionSigmaM -1: expected metres above 0"),
        ((0, 0, 0, 1, 0.1, 1, 2, 0.1), "expected x, y, z in metres"),
        ((0, 0, 0, 1, 0.1, 1, 2, "NaN", 0.1), "expected x, y, z in metres"),
    ],
)
def test_what_is_no_pose_is_refused(program, words, told):
    assert told in ask(program, "pose", *map(str, words))[0]


@pytest.mark.parametrize("scheme", ["tcp", "ws"])
def test_a_head_gets_the_light_in_its_world(program, tmp_path, scheme):
    """Turned left by 73.7°: a lamp on the right is nearly ahead."""
    port = free_port()
    address = f"tcp:127.0.0.1:{port}" if scheme == "tcp" else f"ws://127.0.0.1:{port}/"
    with Daemon(
        f"--source=file:{room(tmp_path)}?rate=30",
        f"--publish={scheme}:127.0.0.1:{port}",
        "--orientation=client",
    ):
        app = subprocess.Popen(
            ["mono", program, "poses", address, "60"], stdout=subprocess.PIPE, text=True
        )
        try:
            assert app.stdout.readline() == "false\n"  # not connected yet
            seen = said(app, lambda one: one["Frame"] == pb.Estimate.WORLD and one["Lights"])
        finally:
            app.kill()
            app.wait()
    np.testing.assert_allclose(seen["Orientation"], [0, 0.6, 0, 0.8], atol=0.02)
    np.testing.assert_allclose(seen["Position"], [1, 1.5, -2], atol=0.02)
    turned = [0.7071 * 0.28, 0.7071, -0.7071 * 0.96]
    np.testing.assert_allclose(seen["Lights"][0]["Direction"], turned, atol=0.05)
