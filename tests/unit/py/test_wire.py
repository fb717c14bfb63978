"""The wire module: nothing received is trusted, and pieces do not matter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import sh, wire
from lightprobe.estimate import Estimate, EstimateFlag, Health, Hello, LightFlag, Refusal
from lightprobe_proto import lightprobe_pb2 as pb


def message(**kind):
    return wire.delimit(pb.FromProbe(**kind).SerializeToString())


def estimate(**changes):
    light = pb.Light(id=3, direction=[0, 1, 0], irradiance=[3, 2, 1], angular_radius_deg=0.25,
                     irradiance_sigma_permille=20, colour_sigma_permille=187,
                     shadow_strength_permille=625, flags=1)  # fmt: skip
    sh = pb.SphericalHarmonics(kind=1, order=1, coefficients=range(12))
    fields = {"sequence": 7, "boot_id": 9, "capture_time_unix_ns": 10**18, "send_delay_us": 4000,
              "ttl_ms": 500, "flags": 4 | 64, "lights": [light], "sh": sh, "exposure_us": 8000,
              "exposure_count": 2, "predicted_error_permille": 15,
              "relighting_sigma_permille": 7}  # fmt: skip
    return pb.Estimate(**(fields | changes))


def test_every_value_arrives():
    (got,) = wire.Decoder().feed(message(estimate=estimate()))
    assert isinstance(got, Estimate)
    assert (got.sequence, got.boot_id, got.ttl_ms) == (7, 9, 500)
    assert got.send_time_unix_ns == 10**18 + 4_000_000
    assert got.flags == EstimateFlag.CLIPPED | EstimateFlag.MORE_LIGHTS
    assert got.sh.coefficients.tolist() == np.arange(12.0).reshape(4, 3).tolist()
    assert (got.predicted_error, got.exposure_us, got.exposure_count) == (0.015, 8000, 2)
    assert got.cd_m2_per_unit is None
    (light,) = got.lights
    assert light.irradiance_sigma == pytest.approx([0.06, 0.04, 0.02])
    assert light.colour_sigma == 0.187
    assert light.shadow_strength == 0.625
    assert (light.direction_sigma_deg, light.distance_m) == (None, None)
    assert (light.distance_sigma, light.nearest_m) == (None, None)
    shape = got.to_json()
    assert shape["flags"] == ["CLIPPED", "MORE_LIGHTS"]
    assert shape["lights"][0]["flags"] == ["CLIPPED"]
    assert shape["lights"][0]["direction_sigma_deg"] is None
    assert shape["lights"][0]["colour_sigma"] == 0.187
    assert shape["lights"][0]["shadow_strength"] == 0.625
    assert shape["scale"] == {
        "cd_m2_per_unit": None, "cd_m2_per_unit_sigma": None, "calibrated": False,
        "sigma": None,
    }  # fmt: skip
    assert shape["model"] == {
        "sh_order": 1,
        "lights": 1,
        "predicted_error": 0.015,
        "relighting_sigma": 0.007,
    }


def test_the_room_is_known_or_not():
    room = pb.Room(walls_m=[1, 2, 3, 4, 5, 6], walls_sigma_m=6 * [0.25], error_permille_per_m=12,
                   orientation=[0, 0.6, 0, 0.8])  # fmt: skip
    (got,) = wire.Decoder().feed(message(estimate=estimate(room=room)))
    assert got.room.size_m.tolist() == [3, 7, 11]
    assert got.room.orientation == pytest.approx([0, 0.6, 0, 0.8])
    assert got.to_json()["room"] == {
        "walls_m": [1, 2, 3, 4, 5, 6], "walls_sigma_m": 6 * [0.25], "error_per_m": 0.012,
        "orientation": pytest.approx([0, 0.6, 0, 0.8]),
    }  # fmt: skip
    (unknown,) = wire.Decoder().feed(message(estimate=estimate()))
    assert unknown.room is None
    assert unknown.to_json()["room"] is None


def test_key_is_light_of_its_own():
    key = pb.Light(direction=[0, 1, 0], irradiance=[1, 1, 1], angular_radius_deg=30)
    (plain,) = wire.Decoder().feed(message(estimate=estimate()))
    (got,) = wire.Decoder().feed(message(estimate=estimate(key=key)))
    up = [0, 1, 0]
    assert plain.key is None
    assert plain.to_json()["key"] is None
    assert got.irradiance(up) - plain.irradiance(up) == pytest.approx([1, 1, 1])
    assert sh.irradiance(got.total().coefficients, up) - sh.irradiance(
        plain.total().coefficients, up
    ) == pytest.approx([0.75] * 3)  # 1/4 + 1/2: what order 1 holds of a lamp
    total = pb.SphericalHarmonics(kind=2, order=1, coefficients=range(12))
    (inside,) = wire.Decoder().feed(message(estimate=estimate(key=key, sh=total)))
    assert inside.beside_sh == ()
    assert got.to_json()["key"]["irradiance"] == [1, 1, 1]


def test_area_lights_have_an_ellipse():
    area = pb.Light(id=3, direction=[0, 1, 0], irradiance=[3, 2, 1], angular_radius_deg=20,
                    flags=4, half_angle_deg=[30, 12], axis=[1, 0, 0])  # fmt: skip
    (got,) = wire.Decoder().feed(message(estimate=estimate(lights=[area])))
    (light,) = got.lights
    assert light.half_angle_deg == (30, 12)
    assert light.axis.tolist() == [1, 0, 0]
    assert light.to_json()["half_angle_deg"] == [30, 12]
    area.axis.pop()
    with pytest.raises(wire.WireError, match="axis"):
        wire.Decoder().feed(message(estimate=estimate(lights=[area])))


def test_other_kinds():
    hello, health, refusal = wire.Decoder().feed(
        message(hello=pb.Hello(protocol_major=1, software="lightprobed 9"))
        + message(health=pb.Health(source_state=3, faults=[pb.Fault(id="x", text="y")]))
        + message(error=pb.Error(code=-22, text="no"))
    )
    assert isinstance(hello, Hello)
    assert hello.software == "lightprobed 9"
    assert isinstance(health, Health)
    assert (health.source_state, health.faults[0].text) == ("STREAMING", "y")
    assert refusal == Refusal(-22, "no")


@pytest.mark.parametrize(("ours", "prefix"), [(EstimateFlag, "ESTIMATE"), (LightFlag, "LIGHT")])
def test_flags_are_those_of_the_schema(ours, prefix):
    schema = pb.Estimate.DESCRIPTOR.file.enum_types_by_name[ours.__name__].values_by_name
    known = {f"{prefix}_FLAG_{flag.name}": flag.value for flag in ours}
    known[f"{prefix}_FLAG_NONE"] = 0
    assert known == {name: value.number for name, value in schema.items()}


def test_newer_kinds_and_flags_are_no_error():
    unknown = wire.delimit(b"\xfa\x01\x03abc")  # field 31, of a later version
    assert wire.Decoder().feed(unknown + message(error=pb.Error())) == [Refusal(0, "")]
    (got,) = wire.Decoder().feed(message(estimate=estimate(flags=1 << 20)))
    assert got.to_json()["flags"] == ["BIT_20"]


@given(st.lists(st.integers(1, 40), max_size=60))
def test_pieces_do_not_matter(sizes):
    data = message(estimate=estimate()) + message(error=pb.Error(text="x" * 200))
    decoder, got = wire.Decoder(), []
    for size in [*sizes, len(data)]:
        got += decoder.feed(data[:size])
        data = data[size:]
    assert [type(m) for m in got] == [Estimate, Refusal]


@given(st.binary(max_size=300))
def test_garbage_is_a_wire_error_or_nothing(data):
    try:
        for _ in wire.Decoder().feed(data):
            pass
    except wire.WireError:
        pass


@given(st.binary(min_size=1, max_size=20), st.integers(0, 200))
def test_flipped_bytes_are_a_wire_error_or_numbers(noise, where):
    data = bytearray(message(estimate=estimate()))
    where %= len(data)
    data[where : where + len(noise)] = noise
    try:
        got = wire.Decoder().feed(bytes(data))
    except wire.WireError:
        return
    for one in got:
        if isinstance(one, Estimate):
            assert np.all(np.isfinite(one.sh.coefficients))


@pytest.mark.parametrize(
    ("changes", "message_text"),
    [
        ({"sh": pb.SphericalHarmonics(kind=1, order=1, coefficients=range(11))}, "coefficients"),
        ({"sh": pb.SphericalHarmonics(kind=1, coefficients=[1, 2, float("nan")])}, "finite"),
        (
            {"sh": pb.SphericalHarmonics(kind=0, coefficients=[1, 2, 3])},
            "kind: expected AMBIENT or TOTAL",
        ),
        ({"sh": pb.SphericalHarmonics(kind=1, basis=5, coefficients=[1, 2, 3])}, "basis"),
        ({"lights": [pb.Light(direction=[0, 2, 0], irradiance=[1, 1, 1])]}, "unit vector"),
        ({"lights": [pb.Light(direction=[0, 1], irradiance=[1, 1, 1])]}, "Light.direction"),
        ({"lights": [pb.Light(direction=[0, 1, 0], irradiance=[1, 1, float("inf")])]}, "finite"),
    ],
)
def test_numbers_without_sense(changes, message_text):
    with pytest.raises(wire.WireError, match=message_text):
        wire.Decoder().feed(message(estimate=estimate(**changes)))


@pytest.mark.parametrize("length", [wire.MAX_MESSAGE_BYTES + 1, 2**27, 2**40])
def test_oversized_messages_are_refused_before_they_come(length):
    prefix = bytearray()
    while length > 0x7F:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    with pytest.raises(wire.WireError, match="at most"):
        wire.Decoder().feed(bytes(prefix))


def test_subscription():
    wish = wire.Subscription(15, 3, 6, "TOTAL", 0.02, "RAW", 500)
    data = wire.encode_subscription(wish)
    assert data[0] == len(data) - 1
    sent = pb.FromClient.FromString(data[1:]).subscribe
    assert (sent.rate_hz, sent.sh_order, sent.max_lights, sent.kind) == (15, 3, 6, 2)
    assert (sent.tolerance_permille, sent.smoothing, sent.health_period_ms) == (20, 1, 500)
    assert not sent.key_light
    assert not sent.area_lights
    more = wire.encode_subscription(wire.Subscription(key_light=True, area_lights=True))
    sent = pb.FromClient.FromString(more[1:]).subscribe
    assert sent.key_light
    assert sent.area_lights
    assert not sent.leave_out_reflections
    without = wire.Subscription(leave_out_reflections=True)
    sent = pb.FromClient.FromString(wire.encode_subscription(without)[1:]).subscribe
    assert sent.leave_out_reflections
    assert pb.FromClient.FromString(
        wire.encode_subscription(wire.Subscription(sh_order=0, max_lights=0))[1:]
    ).subscribe.HasField("sh_order")


def test_how_a_lamp_is_polarized_comes_typed_and_unknown_is_none() -> None:
    plain = {"direction": [0, 1, 0], "irradiance": [1, 1, 1]}
    polarized = {"dolp_percent": 87, "aolp_deg": 3.5, "reflection_percent": 99, "flags": 2,
                 "dolp_sigma_permille": 12, "aolp_sigma_deg": 0.75}  # fmt: skip
    lights = [pb.Light(**plain), pb.Light(**plain, **polarized)]
    (got,) = wire.Decoder().feed(message(estimate=estimate(lights=lights)))
    assert isinstance(got, Estimate)
    unknown, known = got.lights
    assert (unknown.dolp, unknown.aolp_deg, unknown.reflection) == (None, None, None)
    assert (unknown.dolp_sigma, unknown.aolp_sigma_deg) == (None, None)
    assert (known.dolp, known.aolp_deg, known.reflection) == (0.87, 3.5, 0.99)
    assert (known.dolp_sigma, known.aolp_sigma_deg) == (0.012, 0.75)
    shown = known.to_json()
    assert shown["flags"] == ["REFLECTION"]
    assert (shown["dolp_sigma"], shown["aolp_sigma_deg"]) == (0.012, 0.75)


def test_wheel_and_ring_come_typed_and_unknown_is_none() -> None:
    message = pb.FromProbe()
    message.health.wheel.phase = pb.Wheel.SETTLED
    message.health.wheel.measured_deg = 45.5
    message.health.wheel.moves = 3
    message.health.ring.illuminance_lux[:] = [*range(8), float("nan")]
    health = wire.decode(message.SerializeToString())
    assert isinstance(health, Health)
    assert (health.wheel.phase, health.wheel.measured_deg, health.wheel.moves) == (
        "SETTLED", 45.5, 3,
    )  # fmt: skip
    assert health.wheel.sigma_deg is None
    assert health.wheel.clock_sigma_us is None
    assert health.ring.illuminance_lux == (0, 1, 2, 3, 4, 5, 6, 7, None)
    bare = wire.decode(pb.FromProbe(health=pb.Health()).SerializeToString())
    assert (bare.wheel, bare.ring) == (None, None)
