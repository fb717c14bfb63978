"""The C# package, compiled and run by mono: golden bytes, Unity's numbers, and a live daemon."""

import json
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from harness import Daemon
from lightprobe import Client, reflection_map, wire
from lightprobe.address import Address
from lightprobe.convert import ADAPTERS
from lightprobe.errors import ProbeError, ProbeTimeout
from lightprobe.estimate import LightFlag
from lightprobe.imaging import image
from lightprobe_proto import lightprobe_pb2 as pb
from range_cases import cases

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "clients/csharp"
GOLDEN = sorted(
    file for file in (ROOT / "proto/golden").glob("*.bin") if not file.name.startswith("from_")
)
COMPILER = ("mcs", "-langversion:7.2", "-codepage:utf8", "-warnaserror")


def compiled(out, *sources, options=()):
    files = [str(file) for source in sources for file in sorted(source.parent.glob(source.name))]
    subprocess.run([*COMPILER, *options, f"-out:{out}", *files], check=True, timeout=300)
    return out


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    out = tmp_path_factory.mktemp("csharp") / "checks.exe"
    return compiled(out, PACKAGE / "Runtime/*.cs", Path(__file__).with_name("Checks.cs"))


def ask(program, *words, given=""):
    done = subprocess.run(
        ["mono", program, *words], input=given, capture_output=True, text=True, timeout=300
    )
    assert not done.stderr, done.stderr
    return [
        json.loads(line, strict=False) if line[0] in '{["' else line
        for line in done.stdout.split("\n")[:-1]
    ]


def pascal(name):
    return "".join(part.capitalize() for part in name.split("_"))


def expected(message):
    """A message as Checks.cs prints it, from Python's protobuf."""
    told = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        is_message = field.type == FieldDescriptor.TYPE_MESSAGE
        if field.is_repeated:
            value = [expected(one) if is_message else one for one in value]
        elif field.has_presence and not message.HasField(field.name):
            value = None
        elif is_message:
            value = expected(value)
        elif field.type == FieldDescriptor.TYPE_BYTES:
            value = value.hex()
        told[pascal(field.name)] = value
    return told


def same(theirs, ours):
    if isinstance(ours, dict):
        assert theirs.keys() == ours.keys()
        for name in ours:
            same(theirs[name], ours[name])
    elif isinstance(ours, list):
        assert len(theirs) == len(ours)
        for one, other in zip(theirs, ours, strict=True):
            same(one, other)
    elif isinstance(ours, float):
        np.testing.assert_allclose(np.float32(theirs), np.float32(ours), rtol=2e-7)  # NaN is NaN
    else:
        assert theirs == ours


def test_golden_bytes_are_decoded_as_by_python(program):
    data = [file.read_bytes() for file in GOLDEN]
    found = ask(program, "decode", given="\n".join(one.hex() for one in data))
    assert len(found) == len(data) > 15
    for theirs, one in zip(found, data, strict=True):
        same(theirs, expected(parsed(one)))


def parsed(data):
    """The message behind its length."""
    start = next(i for i, byte in enumerate(data) if byte < 128) + 1
    return pb.FromProbe.FromString(data[start:])


def delimited(**message):
    return wire.delimit(pb.FromProbe(**message).SerializeToString())


def test_every_field_of_the_schema_is_read(program):
    """Also those that no golden message has: filled with numbers that differ."""
    count = iter(range(3, 10_000))

    def fill(message):
        for field in message.DESCRIPTOR.fields:
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                inner = getattr(message, field.name)
                fill(inner.add() if field.is_repeated else inner)
                continue
            value = {
                FieldDescriptor.CPPTYPE_STRING: str(next(count)),
                FieldDescriptor.CPPTYPE_BOOL: True,
                FieldDescriptor.CPPTYPE_ENUM: 1,
            }.get(field.cpp_type, next(count))
            if field.type == FieldDescriptor.TYPE_BYTES:
                value = value.encode()
            if field.is_repeated:
                getattr(message, field.name).extend([value, value])
            else:
                setattr(message, field.name, value)

    messages = []
    for field in pb.FromProbe.DESCRIPTOR.fields:
        messages.append(pb.FromProbe())
        fill(getattr(messages[-1], field.name))
        getattr(messages[-1], field.name).SetInParent()
    lines = (wire.delimit(one.SerializeToString()).hex() for one in messages)
    for theirs, message in zip(
        ask(program, "decode", given="\n".join(lines)), messages, strict=True
    ):
        same(theirs, expected(message))


def test_spoilt_bytes_are_refused_with_a_sentence(program):
    rng = random.Random(5)
    lines = []
    for file in GOLDEN:
        data = file.read_bytes()
        lines += [
            data[:length].hex() for length in rng.sample(range(1, len(data)), min(8, len(data) - 1))
        ]
        for _ in range(60):
            spoilt = bytearray(data)
            for _ in range(rng.randint(1, 4)):
                spoilt[rng.randrange(len(spoilt))] = rng.randrange(256)
            lines.append(bytes(spoilt).hex())
    found = ask(program, "decode", given="\n".join(lines))  # nothing but WireException, or it ends
    assert len(found) == len(lines)
    refused = [one for one in found if isinstance(one, str) and one.startswith("refused: ")]
    assert len(refused) > len(lines) / 10
    assert any("Estimate." in one or "Light." in one for one in refused)


def test_a_subscription_is_written_as_python_reads_it(program):
    (line,) = ask(program, "subscribe")
    data = bytes.fromhex(line)
    wish = pb.FromClient.FromString(data[1:]).subscribe
    assert data[0] == len(data) - 1
    assert wish.HasField("sh_order")
    assert (wish.rate_hz, wish.sh_order, wish.max_lights, wish.number) == (30, 0, 8, 300)
    assert (wish.kind, wish.key_light) == (pb.SphericalHarmonics.TOTAL, True)
    assert (wish.reflection_map.size, wish.reflection_map.rate_hz) == (32, 2.5)


@pytest.mark.parametrize("cd_m2_per_unit", [None, 137.5])
@pytest.mark.parametrize("flags", [0, int(LightFlag.REFLECTION | LightFlag.CLIPPED)])
@pytest.mark.parametrize("towards", [(0, 1, 0), (0.6, 0, -0.8), (-0.48, 0.64, 0.6)])
def test_unitys_numbers_are_those_of_convert(program, towards, flags, cd_m2_per_unit):
    """URP takes light relative to the packet's unit, HDRP lux (irradiance) and cd/m² (SH).

    A mirror image casts no shadow.
    """
    rng = np.random.default_rng(7)
    message = pb.FromProbe()
    lamp = message.estimate.lights.add(id=1, angular_radius_deg=0.5, flags=flags)
    lamp.direction.extend(towards)
    lamp.irradiance.extend([3, 2, 0.5])
    if cd_m2_per_unit:
        message.estimate.cd_m2_per_unit = cd_m2_per_unit
        lamp.shadow_strength_permille = 625
    message.estimate.sh.order = 4
    coefficients = rng.normal(size=(25, 3)).astype(np.float32)
    message.estimate.sh.coefficients.extend(coefficients.ravel().tolist())
    lines = ask(program, "unity", given=wire.delimit(message.SerializeToString()).hex())
    for line, name in zip(lines, ("unity", "unity-hdrp"), strict=True):
        adapter = ADAPTERS[name]
        absolute = cd_m2_per_unit or 1 if name == "unity-hdrp" else 1
        intensity = 3 * adapter.light_scale * absolute
        colour = [1, *(1.055 * (x / 3) ** (1 / 2.4) - 0.055 for x in (2, 0.5))]
        forward = -adapter.direction(towards)
        np.testing.assert_allclose(line[:7], [*forward, *colour, intensity], rtol=1e-6, atol=1e-6)
        assert line[-2] == (0.625 if cd_m2_per_unit else -1)  # -1: not known
        assert line[-1] == (0 if flags else 1)
        coefficients_there = absolute * adapter.coefficients(coefficients)
        np.testing.assert_allclose(line[7:-2], coefficients_there, rtol=1e-5, atol=1e-6)
    if towards == (0, 1, 0):  # a lamp straight up shines down, along Unity's -y
        assert lines[0][:3] == [0, -1, 0]


def checked(program, *messages):
    """What the client says of messages: "taken", or why not."""
    lines = [wire.delimit(one.SerializeToString()).hex() for one in messages]
    return ask(program, "check", given="\n".join(lines))


def test_messages_of_a_probe_are_taken(program):
    messages = [parsed(file.read_bytes()) for file in GOLDEN]
    assert checked(program, *messages) == len(messages) * ["taken"]


def test_each_number_is_taken_or_refused_by_name(program):
    """At and beyond the ends of every line of proto/ranges.toml: the cases of all clients."""
    all_cases = cases()
    lines = [wire.delimit(case.data).hex() for case in all_cases]
    for said, case in zip(ask(program, "check", given="\n".join(lines)), all_cases, strict=True):
        assert said == ("taken" if case.refusal is None else f"refused: {case.refusal}"), case.name


def test_lists_that_would_fill_the_memory_are_refused(program):
    """128 KiB of empty lamps would take 200 MB."""
    (line,) = checked(program, pb.FromProbe(estimate=pb.Estimate(lights=60_000 * [pb.Light()])))
    assert line == "refused: Estimate.lights: more than 256"


def test_of_two_answers_in_one_message_the_last_is_valid(program):
    data = pb.FromProbe(hello=pb.Hello(software="x")).SerializeToString()
    data += pb.FromProbe(pong=pb.Pong(ping_time_ns=3)).SerializeToString()
    (found,) = ask(program, "decode", given=wire.delimit(data).hex())
    same(found, expected(pb.FromProbe.FromString(data)))
    assert found["Hello"] is None


def test_a_reflection_map_in_unitys_axes(program):
    size = 16
    rng = np.random.default_rng(3)
    message = pb.FromProbe()
    message.reflection_map.size, message.reflection_map.scale = size, 0.25
    message.reflection_map.kind = pb.SphericalHarmonics.TOTAL
    message.reflection_map.texels = rng.integers(0, 2**32, 6 * size**2, dtype="<u4").tobytes()
    given = wire.delimit(message.SerializeToString())
    faces = np.array(ask(program, "reflection", given=given.hex()), np.float32)
    (theirs,) = (m for m in wire.Decoder().feed(given))
    # Cube maps have the same layout in every renderer, but Unity's z is the probe's turned round.
    towards = reflection_map.directions(size) * [1, 1, -1]
    np.testing.assert_allclose(
        faces.reshape(6, size, size, 3), theirs.sample(towards), rtol=1e-6, atol=0
    )


def room(folder):
    picture = np.full((64, 128, 3), 0.2, np.float32)
    picture[15:18, 94:98] = [400, 300, 200]  # 45° up, 90° to the right
    image.write_pfm(str(folder / "room.pfm"), picture)
    return folder / "room.pfm"


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def make_pair(folder, *arguments):
    command = [sys.executable, "-m", "lightprobe", "pair", "--dir", folder, "--json", *arguments]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.parametrize("scheme", ["tcp", "ws", "wss"])
def test_a_live_daemon_that_is_started_again(program, tmp_path, scheme):
    port, pair = free_port(), tmp_path / "pair"
    address = f"tcp:127.0.0.1:{port}" if scheme == "tcp" else f"ws://127.0.0.1:{port}/"
    publish = f"{scheme}:127.0.0.1:{port}"
    if scheme == "wss":
        address = make_pair(pair, "--host", "127.0.0.1", "--port", str(port))["url"]
        publish += f"?pair={pair}"
    arguments = (f"--source=file:{room(tmp_path)}?rate=30", f"--publish={publish}")
    client = subprocess.Popen(
        ["mono", program, "live", address, "120"], stdout=subprocess.PIPE, text=True
    )
    try:
        first = said(client, lambda one: one.get("error"))
        assert f"127.0.0.1:{port}" in first["error"].split(": connect: ")[0]
        assert "token" not in first["error"]
        assert first["error"].endswith("is lightprobed running, and is this its address?")
        boots = []
        for _ in range(2):
            with Daemon(*arguments):
                estimate = said(client, lambda one: one.get("BootId") not in (None, *boots))
                boots.append(estimate["BootId"])
                direction = estimate["Lights"][0]["Direction"]
                np.testing.assert_allclose(direction, [0.7071, 0.7071, 0], atol=0.05)
            said(client, lambda one: one.get("error") and one["stale"])
    finally:
        client.kill()
        client.wait()


@pytest.mark.parametrize("scheme", ["tcp", "ws"])
def test_a_pause_of_the_app_makes_nothing_old_and_is_no_silence(program, tmp_path, scheme):
    """The app is stopped for longer than the time to live, and than silence of a probe lasts."""
    port = free_port()
    address = f"tcp:127.0.0.1:{port}" if scheme == "tcp" else f"ws://127.0.0.1:{port}/"
    arguments = (f"--source=file:{room(tmp_path)}?rate=30", f"--publish={scheme}:127.0.0.1:{port}")
    with (
        Daemon(*arguments, "--ttl-ms=3000"),
        subprocess.Popen(
            ["mono", program, "pause", address], stdout=subprocess.PIPE, text=True
        ) as app,
    ):
        try:
            assert app.stdout.readline() == '"lit"\n'
            app.send_signal(signal.SIGSTOP)
            time.sleep(7)
            app.send_signal(signal.SIGCONT)
            assert json.loads(app.stdout.readline()) == {"dark": 0, "error": None}
        finally:
            app.kill()


def test_the_fallback_is_the_same_in_every_client(program):
    wanted = json.loads((ROOT / "proto/golden/fallback.json").read_text())
    lines = [(ROOT / "proto/golden" / name).read_bytes().hex() if name else "" for name in wanted]
    found = ask(program, "fallback", given="".join(f"{line}\n" for line in lines))
    assert len(found) == len(wanted) > 3
    for theirs, ours in zip(found, wanted.values(), strict=True):
        assert (theirs["Kind"], theirs["Order"]) == (pb.SphericalHarmonics.AMBIENT, 1)
        np.testing.assert_allclose(theirs["Coefficients"], ours, rtol=1e-5)


def test_light_at_a_place_is_the_same_in_every_client(program):
    vectors = json.loads((ROOT / "proto/golden/place.json").read_text())["lamps"]
    lines = []
    for vector in vectors:
        message, light = pb.FromProbe(), vector["light"]
        message.estimate.sh.kind = pb.SphericalHarmonics.AMBIENT
        lamp = message.estimate.lights.add(id=1)
        for name in ("direction", "irradiance", "half_angle_deg", "axis"):
            getattr(lamp, name).extend(light[name] or [])
        for name in ("angular_radius_deg", "direction_sigma_deg", "distance_m", "nearest_m"):
            if light[name] is not None:
                setattr(lamp, name, light[name])
        for name in ("distance_sigma", "irradiance_sigma"):
            if light[name] is not None:
                setattr(lamp, f"{name}_permille", round(1000 * light[name]))
        place = " ".join(str(x) for x in vector["position_m"])
        lines.append(f"{place} {wire.delimit(message.SerializeToString()).hex()}\n")
    found = ask(program, "place", given="".join(lines))
    assert len(found) == len(vectors) > 20
    for theirs, vector in zip(found, vectors, strict=True):
        there = vector["there"]
        for name, field in (("Direction", "direction"), ("Irradiance", "irradiance"),
                            ("HalfAngleDeg", "half_angle_deg"), ("Axis", "axis"),
                            ("AngularRadiusDeg", "angular_radius_deg"),
                            ("DirectionSigmaDeg", "direction_sigma_deg"),
                            ("DistanceM", "distance_m"), ("NearestM", "nearest_m")):  # fmt: skip
            if there[field] is None:
                assert not theirs[name]
            else:
                np.testing.assert_allclose(theirs[name], there[field], rtol=1e-5, atol=1e-6)
        for name, field in (("DistanceSigmaPermille", "distance_sigma"),
                            ("IrradianceSigmaPermille", "irradiance_sigma")):  # fmt: skip
            expected = there[field]
            assert theirs[name] == (
                None if expected is None else pytest.approx(1000 * expected, abs=0.51)
            )


def test_ambient_light_at_a_place_is_the_same_in_every_client(program):
    vectors = json.loads((ROOT / "proto/golden/place.json").read_text())["rooms"]
    lines = []
    for vector in [*vectors, vectors[0]]:
        message, room = pb.FromProbe(), vector["room"]
        sh = pb.SphericalHarmonics(
            kind=1, order=vector["order"], coefficients=vector["coefficients"]
        )
        message.estimate.sh.CopyFrom(sh)
        if len(lines) < len(vectors):  # the last one has none: its SH stay
            message.estimate.room.walls_m.extend(room["walls_m"])
            message.estimate.room.orientation.extend(room["orientation"])
        place = " ".join(str(x) for x in vector["position_m"])
        lines.append(f"{place} {wire.delimit(message.SerializeToString()).hex()}\n")
    *found, still = ask(program, "ambient", given="".join(lines))
    assert len(found) == len(vectors) > 8
    for theirs, vector in zip(found, vectors, strict=True):
        np.testing.assert_allclose(theirs, vector["there"]["coefficients"], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(still, vectors[0]["coefficients"], rtol=1e-6)


def test_another_certificate_or_token_gets_nothing(program, tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    url = make_pair(pair, "--host", "127.0.0.1", "--port", str(port))["url"]
    other = make_pair(tmp_path / "other", "--host", "127.0.0.1", "--port", str(port))["url"]
    token, sha256 = url.split("#")[1].split("&")
    place, (other_token, other_sha256) = url.split("#")[0], other.split("#")[1].split("&")
    with Daemon(
        f"--source=file:{room(tmp_path)}?rate=30", f"--publish=wss:127.0.0.1:{port}?pair={pair}"
    ) as probe:
        for fragment, told in ((f"{token}&{other_sha256}", "the certificate is not the one"),
                               (f"{other_token}&{sha256}", "the token is missing or wrong"),
                               (sha256, "the token is missing or wrong")):  # fmt: skip
            lines = ask(program, "live", f"{place}#{fragment}", "4")
            assert all("BootId" not in line for line in lines)
            assert any(told in (line["error"] or "") for line in lines), lines
        assert token.removeprefix("token=") not in probe.log()


def said(client, condition, within_s=60):
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        one = json.loads(client.stdout.readline())
        if condition(one):
            return one
    raise AssertionError(f"not said within {within_s} s")


@pytest.mark.parametrize(
    ("sent", "told"),
    [(b"HTTP/1.1 400 Bad Request\r\nServer: " + 80 * b"x", "is this a lightprobe?"),
     (b"\xff\xff\xff\xff\xff", "a length of more than four bytes"),
     ((ROOT / "proto/golden/pong.bin").read_bytes(), "the first message is not a Hello"),
     (delimited(hello=pb.Hello(protocol_major=9, software="x 9")),
      "x 9 speaks protocol 9, this client 1")],
)  # fmt: skip
def test_what_is_no_probe_is_told(program, sent, told):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            for _ in range(3):
                connection, _ = server.accept()
                with connection:
                    connection.sendall(sent)
                    connection.recv(100)

        threading.Thread(target=serve, daemon=True).start()
        lines = ask(program, "live", f"tcp:127.0.0.1:{server.getsockname()[1]}", "5")
    assert any(told in (line["error"] or "") for line in lines)


@pytest.mark.parametrize(("delay_s", "is_old"), [(59.98, False), (60.02, True)])
def test_what_was_too_old_when_it_was_sent_is_old(program, delay_s, is_old):
    """As soon as it has come, although it has not been drained yet."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                one = pb.Estimate(sequence=1, capture_time_unix_ns=1, ttl_ms=60_000)
                one.send_delay_us = int(1e6 * delay_s)
                one.sh.kind = pb.SphericalHarmonics.TOTAL
                one.sh.coefficients.extend([1, 1, 1])
                time.sleep(0.5)  # the client waits for it
                connection.sendall(delimited(hello=pb.Hello(protocol_major=1)))
                connection.sendall(delimited(estimate=one))
                time.sleep(1)

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        assert ask(program, "old", address) == [{"came": True, "old": is_old}]


def connections_of(program, code):
    """How often a client comes that is refused with this code, in ten seconds; 3: or more."""
    came = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            while True:
                connection, _ = server.accept()
                came.append(1)
                with connection:
                    connection.sendall(delimited(error=pb.Error(code=code, text="it says why")))
                    connection.recv(100)

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        with subprocess.Popen(
            ["mono", program, "live", address, "600"], stdout=subprocess.PIPE, text=True
        ) as client:
            told = (line for line in client.stdout if "it says why" in line)  # one in 0.2 s
            for _ in range(50):
                assert next(told)
                if len(came) == 3:
                    break
            client.kill()
    return len(came)


def test_after_a_refused_token_it_does_not_come_again_soon(program):
    assert connections_of(program, -13) == 1
    assert connections_of(program, -87) == 3


@pytest.mark.parametrize(
    "address", ["tcp:", "tcp:host", "tcp:host:0", "tcp:h:70000", "udp:h:1", ""]
)
def test_an_address_that_is_none(program, address):
    (line,) = ask(program, "address", address)
    assert "expected tcp:HOST:PORT" in line


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]"])
@pytest.mark.parametrize("scheme", ["tcp:", "ws:", "ws://"])
def test_what_a_daemon_listens_on_is_no_address_of_it(program, scheme, host):
    (line,) = ask(program, "address", f"{scheme}{host}:7701")
    assert "stands for all addresses of the probe's machine" in line
    with pytest.raises(ProbeError, match="stands for all addresses of the probe's machine"):
        Address.parse(f"{scheme}{host}:7701")


def test_clients_take_the_address_that_the_daemon_prints(program, tmp_path):
    publish = f"--publish=ws:127.0.0.1:{free_port()}?clients=7"
    with Daemon(f"--source=file:{room(tmp_path)}?rate=30", publish) as probe:
        printed = re.search(r"(ws:\S+): listen: ", probe.log())[1]
        with Client(printed) as client:
            assert client.receive(60).lights
        lines = ask(program, "live", printed, "5")
        assert any(line.get("Lights") for line in lines), lines


def test_who_is_refused_is_told_how_to_be_allowed(program):
    """As a daemon refuses who calls it by a foreign name (403)."""
    body = b"this probe answers to its address or its own name only\n"
    answer = b"HTTP/1.1 403 Forbidden\r\ncontent-length: %d\r\n\r\n%s" % (len(body), body)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            while True:
                connection, _ = server.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        place = f"127.0.0.1:{server.getsockname()[1]}"
        wanted = f"{body.decode().strip()}: start lightprobed with ?origins=http://{place} at"
        lines = ask(program, "live", f"ws://{place}/", "5")
        assert any(wanted in (line["error"] or "") for line in lines), lines
        with Client(f"ws://{place}/") as client, pytest.raises(ProbeTimeout) as told:
            client.receive(5)
        assert wanted in str(told.value)


@pytest.mark.parametrize("scheme", ["http", "ws"])
def test_a_token_goes_over_tls_alone(program, scheme):
    (line,) = ask(program, "address", f"{scheme}://probe:7701/#token=secret")
    assert "would send the token in clear" in line
    assert "secret" not in line


def test_the_example_compiles(tmp_path):
    compiled(tmp_path / "watch.exe", PACKAGE / "Runtime/*.cs", PACKAGE / "Examples~/Watch.cs")


@pytest.fixture(scope="session")
def receiver(tmp_path_factory):
    """The component with stubs of Unity's types: they note what they are told, and do nothing."""
    return compiled(
        tmp_path_factory.mktemp("unity") / "receiver.exe",
        PACKAGE / "Runtime/*.cs", PACKAGE / "Unity/*.cs",
        *(Path(__file__).with_name(name) for name in ("UnityStubs.cs", "Receiver.cs")),
        options=("-nowarn:649,169,414",),
    )  # fmt: skip


def test_in_urp_the_component_sets_the_ambient_probe(receiver):
    told, _ = ask(receiver, "Universal")
    assert told == "0 3 True True"


def test_in_hdrp_it_says_once_that_lamps_alone_come(receiver):
    """HDRP's sky would overwrite the ambient probe: it is left alone."""
    told, warning = ask(receiver, "HighDefinition")
    assert told == "1 0 False False"
    assert "only lamps come from the probe" in warning


class Shown:
    """The component in URP, frame after frame."""

    def __init__(self, receiver, address):
        self._app = subprocess.Popen(
            ["mono", receiver, "Universal", address],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._app.kill()
        self._app.communicate()

    def frame(self, passed_s):
        """Mean radiance of the ambient light after a frame, and the component's status."""
        self._app.stdin.write(f"{passed_s}\n")
        self._app.stdin.flush()
        return json.loads(self._app.stdout.readline())

    def until(self, condition, passed_s=0.02):
        end = time.monotonic() + 60
        while time.monotonic() < end:
            radiance, status = self.frame(passed_s)
            if condition(radiance, status):
                return radiance
            time.sleep(0.01)
        raise AssertionError(f"{radiance}, {status}")


def test_silence_is_told_as_such(program):
    with socket.create_server(("127.0.0.1", 0)) as server:
        lines = ask(program, "live", f"tcp:127.0.0.1:{server.getsockname()[1]}", "8")
    assert any("silent for too long" in (line["error"] or "") for line in lines), lines


def test_the_component_shows_a_fallback_before_the_first_and_after_the_last_light(receiver):
    message = pb.Estimate(ttl_ms=5000, boot_id=7)
    message.sh.kind = pb.SphericalHarmonics.AMBIENT
    message.sh.coefficients.extend([20 / 0.2820948] * 3)  # radiance 20
    message.lights.add(id=1, direction=[0, 1, 0], irradiance=[40 * np.pi] * 3)
    go, over = threading.Event(), threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.sendall(delimited(hello=pb.Hello(protocol_major=1)))
                go.wait(60)
                message.capture_time_unix_ns = time.time_ns()
                connection.sendall(delimited(estimate=message))
                while not over.wait(0.5):
                    connection.sendall(delimited(health=pb.Health(source_state=2)))

        threading.Thread(target=serve, daemon=True).start()
        with Shown(receiver, f"tcp:127.0.0.1:{server.getsockname()[1]}") as shown:
            assert shown.frame(0.02)[0] == pytest.approx(0.5)  # from the first frame on
            shown.until(lambda _, status: status.startswith("connected, waiting for light"))
            go.set()
            assert shown.until(lambda radiance, _: radiance > 19.9, 0.1) < 20.1
            # Nothing comes any more: 20 of the ambient light and 10 of the lamp, without a jump.
            shown.until(lambda _, status: status.startswith("connected, waiting for light"), 0)
            before, after = shown.frame(0)[0], shown.frame(5.0)[0]
            assert before < after < before + 0.6 * (30 - before)  # a step of 5 s counts as 0.1 s
            assert shown.until(lambda radiance, _: radiance > 29.9, 0.1) < 30.1
            over.set()
