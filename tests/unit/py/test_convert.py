"""Every adapter against its engine's own formula, as its public source or documentation states it.

The formulas are written down here independently of ours. SH: what the engine's shader computes at
a normal in its own axes. Lights: what a white surface that faces the lamp returns.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lightprobe import convert, geometry, sh
from lightprobe.colour import srgb_to_linear
from lightprobe.estimate import Light

finite = st.floats(-1, 1, allow_nan=False)
tables = hnp.arrays(np.float64, (9, 3), elements=finite)
vectors = hnp.arrays(np.float64, 3, elements=finite).filter(lambda v: np.linalg.norm(v) > 0.05)
NAMES = sorted(convert.ADAPTERS)
PI = np.pi


def majored(f):
    """Target that takes r0 g0 b0 r1 …"""
    return lambda flat, n: f(np.reshape(flat, (9, 3)), n)


def planar(f):
    """Target that takes R9 G9 B9."""
    return lambda flat, n: f(np.reshape(flat, (3, 9)).T, n)


def three(c, n):
    """mrdoob/three.js src/math/SphericalHarmonics3.js, getIrradianceAt: irradiance."""
    x, y, z = n
    return (
        0.886227 * c[0] + 2 * 0.511664 * (c[1] * y + c[2] * z + c[3] * x)
        + 2 * 0.429043 * (c[4] * x * y + c[5] * y * z + c[7] * x * z)
        + (0.743125 * z * z - 0.247708) * c[6] + 0.429043 * (x * x - y * y) * c[8]
    )  # fmt: skip


def monomials(c, n):
    """google/filament shaders/src, Irradiance_SphericalHarmonics: coefficients hold the rest."""
    x, y, z = n
    return (
        c[0] + c[1] * y + c[2] * z + c[3] * x + c[4] * y * x + c[5] * y * z
        + c[6] * (3 * z * z - 1) + c[7] * z * x + c[8] * (x * x - y * y)
    )  # fmt: skip


#: google/filament filament/src/details/IndirectLight.cpp, Builder::radiance: A of the comment.
FILAMENT = np.array([0.282095, -0.325735, 0.325735, -0.325735, 0.273137, -0.273137, 0.078848,
                     -0.273137, 0.136569])  # fmt: skip
#: google-ar/arcore-android-sdk, samples/hello_ar_java, HelloArActivity.sphericalHarmonicFactors.
HELLO_AR = FILAMENT


def filament_radiance(c, n):
    """What radiance() makes of its argument, then the shader: E/π."""
    return PI * monomials(c * FILAMENT[:, None], n)


def hello_ar(c, n):
    """hello_ar_java: updateSphericalHarmonicsCoefficients, then environmental_hdr.frag: E/π."""
    return PI * monomials(c * HELLO_AR[:, None], n)


def unity(c, n):
    """Unity-Technologies/Graphics: SphericalHarmonicsL2 is packed (SphericalHarmonicMath.cs,
    PackCoefficients: unity_SHA = sh[3], sh[1], sh[2], sh[0] − sh[6]; unity_SHB = sh[4], sh[5],
    3 sh[6], sh[7]; unity_SHC = sh[8]) and read by SphericalHarmonics.hlsl, SHEvalLinearL0L1 and
    SHEvalLinearL2: E/π."""
    x, y, z = n
    linear = c[3] * x + c[1] * y + c[2] * z + (c[0] - c[6])
    quadratic = c[4] * x * y + c[5] * y * z + 3 * c[6] * z * z + c[7] * z * x
    return PI * (linear + quadratic + c[8] * (x * x - y * y))


def unreal(c, n):
    """Engine/Source/Runtime/Engine/Public/SHMath.h as documented: SHBasisFunction with the sign of
    the associated Legendre functions, Dot with CalcDiffuseTransfer: irradiance."""
    x, y, z = n
    basis = np.array([
        0.282095, -0.488603 * y, 0.488603 * z, -0.488603 * x, 1.092548 * x * y, -1.092548 * y * z,
        0.315392 * (3 * z * z - 1), -1.092548 * x * z, 0.546274 * (x * x - y * y),
    ])  # fmt: skip
    return (basis * [PI, *3 * [2 * PI / 3], *5 * [PI / 4]]) @ c


def godot(c, n):
    """godotengine/godot servers/rendering/renderer_rd/shaders/forward_clustered/
    scene_forward_clustered.glsl: a lightmap capture is added to ambient_light, which is multiplied
    by the albedo: E/π."""
    x, y, z = n
    k = (0.886227, 1.023327, 0.858086, 0.247708, 0.429043)
    return PI * (
        k[0] * c[0] + k[1] * (c[1] * y + c[2] * z + c[3] * x)
        + k[2] * (c[4] * x * y + c[5] * y * z + c[7] * x * z) + k[3] * c[6] * (3 * z * z - 1)
        + k[4] * c[8] * (x * x - y * y)
    )  # fmt: skip


#: BabylonJS/Babylon.js packages/dev/core/src/Maths/sphericalPolynomial.ts, SH3ylmBasisConstants.
BABYLON = np.sqrt(np.array([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / (4 * PI)) * [
    1, -1, 1, -1, 1, -1, 1, -1, 1,
]  # fmt: skip


def babylon(c, n):
    """preScaleForRendering, then Shaders/ShadersInclude/harmonicsFunctions.fx: E/π, as
    convertIrradianceToLambertianRadiance of the same file leaves it."""
    return PI * monomials(c * BABYLON[:, None], n)


TARGETS = {
    "webxr": majored(three),
    "threejs": majored(three),
    "filament-radiance": majored(filament_radiance),
    "filament-irradiance": majored(lambda c, n: PI * monomials(c, n)),
    "unity": planar(unity),
    "unity-hdrp": planar(unity),
    "unreal": planar(unreal),
    "godot": majored(godot),
    "babylon": majored(babylon),
    "z-up": majored(three),
    "arcore": majored(hello_ar),
    "arcore-positive": majored(three),
    "arkit": planar(three),
}

#: What a white surface that faces the light returns, of linear colour × intensity.
#: 1/π in the shader: three.js r155+ BRDF_Lambert; Filament Fd_Lambert; HDRP and Unreal, in lux;
#: Babylon's diffuseBRDF_Burley / PI; Cycles' diffuse of a sun's strength.
#: None in the shader: URP and the built-in pipeline (Lighting.hlsl: LightingLambert); Godot, which
#: has 1/π in light_compute but multiplies the energy by π in light_storage.cpp.
DIVIDES_BY_PI = {name: name not in ("unity", "godot") for name in TARGETS}


def test_every_adapter_has_its_target():
    assert set(TARGETS) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_one_lamp_straight_up_lights_what_faces_up(name):
    adapter = convert.adapter(name)
    flat = adapter.coefficients(sh.lamp([0, 1, 0], 2)[:, None] * [3.0, 2.0, 1.0])
    up = adapter.direction([0, 1, 0])
    normals = adapter.direction(geometry.sphere_normals(2))
    lit = np.array([TARGETS[name](flat, n) for n in normals])
    assert geometry.angle_deg(normals[np.argmax(lit[:, 0])], up) < 1e-6
    assert TARGETS[name](flat, up) == pytest.approx(1.0625 * np.array([3, 2, 1]), rel=1e-5)


@pytest.mark.parametrize("name", NAMES)
@given(c=tables, v=vectors)
def test_target_s_shader_sees_our_irradiance(name, c, v):
    adapter, n = convert.adapter(name), geometry.normalize(v)
    theirs = TARGETS[name](adapter.coefficients(c), adapter.direction(n))
    assert theirs == pytest.approx(sh.irradiance(c, n), abs=1e-4)


@pytest.mark.parametrize("name", NAMES)
@given(c=tables, v=vectors)
def test_there_and_back(name, c, v):
    adapter = convert.adapter(name)
    assert adapter.from_coefficients(adapter.coefficients(c)) == pytest.approx(c, abs=1e-12)
    assert adapter.from_direction(adapter.direction(v)) == pytest.approx(v, abs=1e-12)
    assert adapter.from_light(adapter.light(v)) == pytest.approx(v, abs=1e-12)


def test_axes_as_documented():
    v = np.array([1.0, 2.0, 3.0])
    assert convert.adapter("unity").direction(v).tolist() == [1, 2, -3]
    assert convert.adapter("unreal").direction(v).tolist() == [-3, 1, 2]
    assert convert.adapter("z-up").direction(v).tolist() == [1, -3, 2]


def lit(name, light, normal):
    """What an engine makes of a directional light on a white surface: radiance."""
    adapter, lamp = convert.adapter(name), convert.adapter(name).directional_light(light)
    towards = lamp.direction if adapter.light_points == "towards" else -lamp.direction
    linear = lamp.colour if adapter.colour_encoding == "linear" else srgb_to_linear(lamp.colour)
    cosine = max(0.0, float(adapter.direction(normal) @ towards))
    return linear * lamp.intensity * cosine / (PI if DIVIDES_BY_PI[name] else 1)


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"arkit"}))
@given(v=vectors, n=vectors, e=hnp.arrays(np.float64, 3, elements=st.floats(0, 1e5)))
def test_a_lamp_lights_a_white_surface_as_it_does_here(name, v, n, e):
    direction, normal = geometry.normalize(v), geometry.normalize(n)
    here = e / PI * max(0.0, float(normal @ direction))
    assert lit(name, Light(1, direction, e, 0.5), normal) == pytest.approx(here, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"arkit"}))
def test_a_lamp_in_the_sh_and_as_a_light_are_alike(name):
    """A scale that is right for one alone makes everything π times too dark or too bright."""
    up, e = np.array([0.0, 1, 0]), np.array([3.0, 2, 1])
    adapter = convert.adapter(name)
    in_sh = TARGETS[name](adapter.coefficients(np.outer(sh.lamp(up, 2), e)), adapter.direction(up))
    as_light = PI * lit(name, Light(1, up, e, 0.5), up)
    assert in_sh == pytest.approx(1.0625 * as_light, rel=1e-4)


def test_which_way_lights_point_and_colours_are_encoded():
    lamp = Light(1, np.array([0.0, 1, 0]), np.array([4.0, 2, 0]), 0.5)
    assert convert.adapter("threejs").directional_light(lamp).direction.tolist() == [0, 1, 0]
    for name in ("filament-radiance", "unity", "unity-hdrp", "godot", "babylon"):
        assert convert.adapter(name).directional_light(lamp).direction.tolist() == [0, -1, 0]
    assert convert.adapter("unreal").directional_light(lamp).direction.tolist() == [0, 0, -1]
    linear, srgb = (convert.adapter(n).directional_light(lamp) for n in ("babylon", "unity-hdrp"))
    assert (linear.intensity, srgb.intensity) == (4.0, 4.0)
    assert linear.colour.tolist() == [1, 0.5, 0]
    assert srgb.colour == pytest.approx([1, 0.7354, 0], abs=1e-4)
    with pytest.raises(ValueError, match="arkit: does not say which way"):
        convert.adapter("arkit").directional_light(lamp)


def test_a_lamp_without_light_is_white():
    dark = convert.adapter("unity").directional_light(Light(1, np.eye(3)[1], np.zeros(3), 0.5))
    assert dark.intensity == 0
    assert dark.colour == pytest.approx([1, 1, 1])


def test_arcore_is_signed():
    """As hello_ar and every other public consumer found reads it."""
    c = np.outer(np.arange(1.0, 10), [1, 1, 1])
    signed, positive = (convert.adapter(n).coefficients(c) for n in ("arcore", "arcore-positive"))
    assert signed[::3].tolist() == [1, -2, 3, -4, 5, -6, 7, -8, 9]
    assert positive[::3].tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9]


def test_lower_orders_and_wrong_shapes():
    webxr = convert.adapter("webxr")
    assert webxr.coefficients(np.ones((4, 3))).tolist() == [1.0] * 12 + [0.0] * 15
    assert webxr.coefficients(np.ones((25, 3))).shape == (27,)
    for bad in (np.ones((5, 3)), np.ones((9, 4)), np.ones(27)):
        with pytest.raises(ValueError, match="shape"):
            webxr.coefficients(bad)
    with pytest.raises(ValueError, match="27"):
        webxr.from_coefficients(np.ones(9))
    with pytest.raises(KeyError, match="unity"):
        convert.adapter("unknown")
