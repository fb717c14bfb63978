"""What a user can get wrong before the daemon runs: each has its message and its exit status."""

import os
import re
import resource
import socket
from pathlib import Path

import pytest
from harness import BUILD, Daemon, jpeg, run

DOCUMENT = Path(__file__).parents[2] / "docs" / "users" / "cameras.md"
ROOT_ONLY = pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become another user")


def test_version_names_build_options():
    status, out, _ = run("--version")
    assert status == 0
    lines = out.decode().splitlines()
    assert re.fullmatch(r"lightprobed \d+\.\d+\.\d+", lines[0])
    assert "variant=asan" in lines
    assert [line for line in lines if line.startswith("WITH_")]
    assert all(re.fullmatch(r"WITH_\w+=[01]", line) for line in lines[2:])


def keys_of_back_ends() -> tuple[dict[str, dict[str, str]], str]:
    """Read --help-backends: per scheme its keys with their defaults (the last role's); the text."""
    status, out, _ = run("--help-backends")
    assert status == 0
    keys: dict[str, dict[str, str]] = {}
    scheme = ""
    for line in out.decode().splitlines():
        if found := re.match(r"  (\w+):", line):
            scheme = found[1]
            keys[scheme] = {}
        elif found := re.match(r"      (\w+)=(.*)   \(", line):
            keys[scheme][found[1]] = found[2]
    return keys, out.decode()


def test_help_names_options_and_back_ends():
    status, out, _ = run("--help")
    text = out.decode()
    assert status == 0
    for word in (
        "--source",
        "--once",
        "--detector",
        "file:PATH",
        "sim:PATH",
        "tcp:",
        "unix:",
    ):
        assert word in text
    assert max(len(line) for line in text.splitlines()) <= 100


def test_keys_of_uris_are_in_the_help_of_back_ends():
    keys, text = keys_of_back_ends()
    assert keys["pca9685"]["slew_deg_s"] == "90"
    assert keys["unix"]["mode"] == "660"
    assert max(len(line) for line in text.splitlines()) <= 100


@pytest.mark.parametrize(
    ("scheme", "heading"), [("v4l2", "Camera files"), ("libcamera", "libcamera"), ("osc", "osc:")]
)
def test_documented_keys_of_cameras_are_those_of_the_help(scheme, heading):
    """docs/users/cameras.md has a table of them, with their defaults."""
    part = re.split(r"^## ", DOCUMENT.read_text(), flags=re.MULTILINE)
    (section,) = [text for text in part if heading in text.splitlines()[0]]
    rows = re.findall(r"^\| `(\w+)` \| `?([^`|]*?)`? *\|", section, flags=re.MULTILINE)
    keys, _ = keys_of_back_ends()
    assert rows
    assert {name: keys[scheme][name] for name, _ in rows} == dict(rows)
    assert all(f"`{name}`" in section for name in keys[scheme])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "lightprobed: --source: no source is given — name a camera with --source=URI"),
        (
            ["--source=ftp:x"],
            "ftp:x: source: ftp: is not a known scheme; known are ",
        ),
        (["--source=room.jpg"], "room.jpg: parse: must begin with a scheme"),
        (["--source=file:"], "file:: parse: no path"),
        (
            ["--source=file:a?speed=3"],
            "file:a?speed=3: speed: unknown key; known: rate, loop",
        ),
        (
            ["--source=file:a?rate=x"],
            "file:a?rate=x: rate: 'x' is not a number 0..1000",
        ),
        (
            ["--sources=file:a"],
            "lightprobed: sources: unknown key; known: source, publish",
        ),
        (["--lights=9"], "lightprobed: lights: '9' is not a whole number 0..8"),
        (
            ["--detector=other"],
            "detector: 'other' is not adaptive|research[:RADIANCE]",
        ),
        (
            ["--source=file:a", "--publish=http:x"],
            "known are tcp:, unix:, ws:, wss:, mqtt:, mqtts:, stdout:",
        ),
        (
            ["--source=file:a", "--exposure-us=5"],
            "the exposure of this source cannot be set",
        ),
        (["--source=file:a", "--camera=/no/camera"], "/no/camera"),
        (["--config=/no/file"], "/no/file: read: No such file or directory"),
        (
            ["--source=file:a", "--publish=tcp:nonsense"],
            "tcp:nonsense: parse: must be tcp:HOST",
        ),
        (
            ["--source=file:a", "--publish=tcp:127.0.0.1:99999"],
            "with a port up to 65535",
        ),
        (
            ["--source=file:a", "--publish=unix:"],
            "unix:: parse: a socket path has 1 to 107",
        ),
        (
            ["--source=file:a", "--publish=unix:/tmp/" + 150 * "x"],
            "a socket path has 1 to 107",
        ),
    ],
)
@pytest.mark.parametrize("check", [[], ["--check-config"]])
def test_usage_errors(arguments, message, check):
    status, out, log = run(*arguments, *check)
    assert status == 2
    assert message in log
    assert out == b""
    assert log.startswith("error ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("source = file:a\nligths = 3\n", ":2: ligths: unknown key; known: source"),
        (
            "source = file:a\n\nlights = many\n",
            ":3: lights: 'many' is not a whole number",
        ),
        (
            "[daemon]\nsource = file:a\n",
            ":2: parse: unknown section [daemon]; known: (none)",
        ),
        ("source = file:a\nwhat is this\n", ":2: parse: neither NAME = VALUE"),
        (
            "source = file:a\ncamera = " + "x" * 300 + "\n",
            ":2: parse: a line has at most 198 bytes, this one 309",
        ),
    ],
)
def test_config_errors_name_file_and_line(tmp_path, text, message):
    config = tmp_path / "probe.conf"
    config.write_text(text)
    status, _, log = run(f"--config={config}", "--check-config")
    assert status == 2
    assert f"error {config}{message}" in log


def test_check_config_says_what_is_in_force(tmp_path):
    config = tmp_path / "probe.conf"
    config.write_text("# my probe\nsource = sim:/run/sim.sock?drop=0.1\npublish = stdout:\n")
    status, out, log = run(f"--config={config}", "--check-config")
    assert (status, log) == (0, "")
    assert "source sim:/run/sim.sock?drop=0.1" in out.decode()


def test_the_shipped_example_is_good():
    example = BUILD.parent / "packaging" / "systemd" / "lightprobed.conf"
    status, _, log = run(f"--config={example}", "--check-config")
    assert (status, log) == (0, "")


def test_missing_file():
    status, _, log = run("--source=file:/no/such.jpg", "--publish=tcp:127.0.0.1:0")
    assert status == 1
    assert "error file: /no/such.jpg: open: No such file or directory — check the path" in log


@ROOT_ONLY
def test_unreadable_file():
    daemon = Daemon("--source=", "--once", user=65534)
    picture = daemon.folder / "a.jpg"  # others may look into this folder, not into pytest's
    picture.write_bytes(jpeg())
    picture.chmod(0o600)
    daemon.arguments[0] = f"--source=file:{picture}"
    assert daemon.start().wait() == 1
    assert "open: Permission denied — may this user read it?" in daemon.log()


@pytest.mark.parametrize("source", ["sim:/no/camera", "v4l2:", "libcamera:", "file:/no.jpg"])
@pytest.mark.parametrize("limit", range(6, 36, 3))
def test_too_few_file_descriptors_are_told(limit, source):
    """However few there are: one line that says so and what to do, and it is no usage error."""

    def set_limit():
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))

    status, _, log = run(f"--source={source}", variant="release", preexec_fn=set_limit)
    assert status == 1
    assert "more files can be opened, and 32 are needed — raise ulimit -n, or LimitNOFILE=" in log


def test_port_in_use(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        status, _, log = run(f"--source=file:{tmp_path}/a.jpg", f"--publish=tcp:127.0.0.1:{port}")
    assert status == 1
    assert f"error tcp:127.0.0.1:{port}: bind: Address already in use — does another" in log


def test_two_daemons_on_one_socket_path(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    with Daemon(f"--source=file:{tmp_path}/a.jpg") as first:
        status, _, log = run(f"--source=file:{tmp_path}/a.jpg", f"--publish=unix:{first.socket}")
        assert status == 1
        assert "bind: Address already in use — does another lightprobed run?" in log
        first.client().next("estimate")  # the first one serves as before
        first.process.kill()
        first.process.wait()
        assert first.socket.exists()  # nobody cleaned up: the next one takes the place
        with Daemon(f"--source=file:{tmp_path}/a.jpg", f"--publish=unix:{first.socket}") as second:
            assert "no daemon answers on this socket file; it is replaced" in second.log()
            second.socket = first.socket
            second.client().next("estimate")


def test_listens_on_loopback_and_a_unix_socket_only(tmp_path):
    """By default; the ports are seen through the daemon's own descriptors."""
    (tmp_path / "a.jpg").write_bytes(jpeg())
    with socket.socket() as probe:
        in_use = probe.connect_ex(("127.0.0.1", 7700)) == 0
    if in_use:
        pytest.skip("port 7700 is taken by something else on this machine")
    daemon = Daemon(f"--source=file:{tmp_path}/a.jpg")
    daemon.arguments.pop()  # the publisher that the harness adds
    with daemon:
        daemon.wait_log("unix:")
        descriptors = f"/proc/{daemon.process.pid}/fd"
        inodes = {
            match[1]
            for entry in os.listdir(descriptors)
            if (match := re.match(r"socket:\[(\d+)\]", os.readlink(f"{descriptors}/{entry}")))
        }
        listening = []
        for table in ("tcp", "tcp6", "udp", "udp6", "raw"):
            lines = Path(f"/proc/{daemon.process.pid}/net/{table}").read_text().splitlines()
            for line in lines[1:]:
                fields = line.split()
                if fields[9] in inodes:
                    listening.append(fields[1])
        assert listening == [f"0100007F:{7700:04X}"]
        assert (daemon.folder / "lightprobe.sock").is_socket()
