"""`lightprobe estimate` through the daemon's own pipeline: what goes in, what comes out."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.evaluate import offline
from lightprobe.imaging import camera, image
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Bulb, Room
from lightprobe.sim.sensor import Sensor, encode_jpeg
from lightprobe.sim.world import Behaviour, World
from PIL import Image

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
ROOM = random_scene(2)  # three lamps
PACKAGED = sorted((Path(__file__).resolve().parents[2] / "packaging/cameras").glob("*.camera"))


@pytest.fixture(scope="module")
def radiance():
    return ROOM.render(1024, 512).compose(np.ones(3))


def run(*arguments):
    return subprocess.run(
        [LIGHTPROBE, "estimate", *map(str, arguments)], capture_output=True, text=True, timeout=60
    )


def run_json(*arguments):
    done = run(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def same_lamps(result, limit_deg=1.0):
    true = [lamp.direction for lamp in ROOM.lamps]
    pairs = geometry.match_directions(true, [light["direction"] for light in result["lights"]])
    return len(pairs) == 3 and max(angle for *_, angle in pairs) < limit_deg


def same_strengths(result, relative=0.12):
    """Luminance alone: JPEG's chroma is too coarse for the colour of lamps of two pixels."""
    for lamp in ROOM.lamps:
        light = max(result["lights"], key=lambda item: np.dot(item["direction"], lamp.direction))
        if abs(luminance(light["irradiance"]) / luminance(lamp.irradiance) - 1) > relative:
            return False
    return True


def test_json_has_the_one_shape(radiance, tmp_path):
    image.write_pfm(tmp_path / "x.pfm", radiance)
    result = run_json(tmp_path / "x.pfm", "--order", 3)
    assert set(result) >= {"sequence", "capture_time_unix_ns", "lights", "sh", "scale", "exposure",
                           "model", "flags"}  # fmt: skip
    assert set(result["lights"][0]) >= {
        "id", "direction", "irradiance", "angular_radius_deg", "solid_angle_sr",
        "direction_sigma_deg", "irradiance_sigma", "flags",
    }  # fmt: skip
    assert np.shape(result["sh"]["coefficients"]) == (16, 3)
    assert (result["sh"]["order"], result["sh"]["kind"]) == (3, "AMBIENT")
    assert result["scale"] == {
        "cd_m2_per_unit": None, "cd_m2_per_unit_sigma": None, "calibrated": False, "sigma": None,
    }  # fmt: skip
    assert result["exposure"]["exposure_us"] is None
    assert result["model"]["sh_order"] == 3
    assert result["model"]["lights"] == 3
    assert same_lamps(result)
    for light in result["lights"]:
        assert np.linalg.norm(light["direction"]) == pytest.approx(1, abs=1e-6)
        assert light["solid_angle_sr"] == pytest.approx(
            float(geometry.cap_solid_angle_sr(light["angular_radius_deg"])), rel=1e-6
        )


def test_a_lamps_shadow_is_as_dark_as_its_share_of_the_light_on_a_table(radiance, tmp_path):
    """Against the picture itself: what comes from the lamp, over all that comes from above.

    It does not depend on how many lamps are listed.
    """
    image.write_pfm(tmp_path / "x.pfm", radiance)
    result, one = (run_json(tmp_path / "x.pfm", "--lights", count) for count in (8, 1))
    up = np.maximum(geometry.equirect_directions(1024, 512)[..., 1], 0)
    weight = geometry.equirect_solid_angles(1024, 512)[:, None] * up
    upward = float((luminance(radiance) * weight).sum())
    for lamp in ROOM.lamps:
        light = max(result["lights"], key=lambda item: np.dot(item["direction"], lamp.direction))
        share = max(lamp.direction[1], 0) * luminance(lamp.irradiance) / upward
        assert light["shadow_strength"] == pytest.approx(share, abs=0.01)
    assert any(0.05 < light["shadow_strength"] < 0.95 for light in result["lights"])
    assert one["lights"][0]["shadow_strength"] == result["lights"][0]["shadow_strength"]


def test_hdr_formats_give_the_same_light_in_the_file_s_own_units(radiance, tmp_path):
    image.write_pfm(tmp_path / "x.pfm", radiance)
    cv2.imwrite(str(tmp_path / "x.hdr"), radiance[..., ::-1])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(radiance)}) as file:
        file.write(str(tmp_path / "x.exr"))
    seen = {kind: run_json(tmp_path / f"x.{kind}") for kind in ("pfm", "exr", "hdr")}
    assert seen["pfm"]["sh"] == seen["exr"]["sh"]
    total = ROOM.truth(np.ones(3)).total
    for result in seen.values():
        assert same_lamps(result)
        by_strength = sorted(ROOM.lamps, key=lambda lamp: -lamp.irradiance[1])
        assert result["lights"][0]["irradiance"] == pytest.approx(
            by_strength[0].irradiance, rel=0.03
        )
    whole = run_json(tmp_path / "x.exr", "--kind", "TOTAL")
    assert whole["sh"]["kind"] == "TOTAL"
    assert whole["sh"]["coefficients"][0] == pytest.approx(total[0], rel=0.01)


def test_a_bracket_is_one_estimate_in_radiance_at_one_second(tmp_path):
    radiance = ROOM.render(1920, 960).compose(np.ones(3))
    sensor = Sensor(1920, 960, seed=2)
    exposures_us = [200000 / radiance.max() * 16**k for k in (2, 1, 0)]
    files = [tmp_path / f"{name}.jpg" for name in ("long", "middle", "short")]
    for index, (path, exposure_us) in enumerate(zip(files, exposures_us, strict=True)):
        path.write_bytes(encode_jpeg(sensor.capture(radiance, exposure_us, index), 95))
    text = ",".join(f"{value:.6f}" for value in exposures_us)
    result = run_json(*files, "--exposure-us", text)
    assert result["exposure"]["count"] == 3
    assert "CLIPPED" not in result["flags"]
    assert same_lamps(result)
    assert same_strengths(result, relative=0.2)
    # The order in which a bracket is named does not matter.
    turned = run_json(*files[::-1], "--exposure-us", ",".join(text.split(",")[::-1]))
    assert turned["sh"]["coefficients"][0] == pytest.approx(
        result["sh"]["coefficients"][0], rel=0.01
    )


def bracket(tmp_path):
    """Two exposures, four stops apart, as JPEG; and their paths."""
    light = ROOM.render(512, 256).compose(np.ones(3))
    sensor, files = Sensor(512, 256, seed=1), []
    for index, exposure_us in enumerate((2e5 / light.max(), 3.2e6 / light.max())):
        files.append(tmp_path / f"{index}.jpg")
        files[-1].write_bytes(encode_jpeg(sensor.capture(light, exposure_us, index), 95))
    return files


def test_exposures_that_the_pictures_contradict_are_noted(tmp_path):
    short, long = bracket(tmp_path)
    assert run(short, long, "--exposure-us", "100,1600").stderr == ""
    done = run(short, long, "--exposure-us", "100,200")
    assert done.returncode == 0
    assert re.search(
        rf"note: {short} to {long}: the light grows 1[56].* times, the exposure 2 ti", done.stderr
    )


def test_one_exposure_for_pictures_that_differ_is_noted(tmp_path):
    """In whichever order they come; pictures of one exposure that agree are averaged."""
    short, long = bracket(tmp_path)
    for files in ((short, long), (long, short)):
        done = run(*files, "--exposure-us", "100,100")
        assert done.returncode == 0
        assert re.search(r"the light grows .* times, the exposure 1 times", done.stderr)
    assert run(short, short, "--exposure-us", "100,100").stderr == ""


def test_what_is_no_file_is_not_waited_for(tmp_path):
    pipe, folder = tmp_path / "pipe.jpg", tmp_path / "folder.jpg"
    os.mkfifo(pipe)
    folder.mkdir()
    for path in (pipe, folder):
        done = run(path)
        assert done.returncode == 1
        assert f"{path}: open: no such file" in done.stderr
        done = run(path, path, "--exposure-us", "1,2")
        assert f"{path}: open: no such file" in done.stderr


@pytest.mark.parametrize("kind", ["corrupt", "cmyk"])
def test_what_the_daemon_cannot_use_is_named_as_the_user_named_it(tmp_path, kind):
    """What this package can read and the daemon cannot, alone and among others."""
    good, _ = bracket(tmp_path)
    bad = tmp_path / "bad picture.jpg"
    if kind == "cmyk":
        Image.open(good).convert("CMYK").save(bad)
    else:
        data = bytearray(good.read_bytes())
        data[len(data) // 2 : len(data) // 2 + 40] = bytes(40)
        bad.write_bytes(data)
    alone, among = run(bad), run(good, bad, "--exposure-us", "100,100")
    for done, name in ((alone, str(bad)), (among, f"one of {good}, {bad}")):
        assert done.returncode == 1
        assert done.stdout == ""
        # libjpeg, which reads the picture here too, writes its own line about what is corrupt.
        (line,) = [line for line in done.stderr.splitlines() if not line.startswith("Corrupt JPEG")]
        assert line.startswith(f"lightprobe: {name}: frame: JPEG")


def test_without_exposure_light_is_relative_and_says_so(radiance, tmp_path):
    codes = Sensor(1024, 512).capture(radiance, 900000 / radiance.max())
    (tmp_path / "x.jpg").write_bytes(encode_jpeg(codes, 95))
    result = run_json(tmp_path / "x.jpg")
    assert "EXPOSURE_UNKNOWN" in result["flags"]
    assert result["exposure"]["exposure_us"] is None


def test_clipped_lamps_are_flagged(radiance, tmp_path):
    codes = Sensor(1024, 512).capture(radiance, 2e7 / radiance.max())
    (tmp_path / "x.jpg").write_bytes(encode_jpeg(codes, 95))
    result = run_json(tmp_path / "x.jpg", "--exposure-us", 2e7 / radiance.max())
    assert "CLIPPED" in result["flags"]
    assert all("CLIPPED" in light["flags"] for light in result["lights"])


def test_options_reach_the_daemon(radiance, tmp_path):
    image.write_pfm(tmp_path / "x.pfm", radiance)
    path = tmp_path / "x.pfm"
    assert run_json(path, "--lights", 1)["model"]["lights"] == 1
    assert "MORE_LIGHTS" in run_json(path, "--lights", 1)["flags"]
    assert run_json(path, "--lights", 0)["lights"] == []
    assert np.shape(run_json(path, "--order", 0)["sh"]["coefficients"]) == (1, 3)
    for preset in ("fast", "balanced", "accurate", "reference"):
        assert same_lamps(run_json(path, "--preset", preset), limit_deg=2)
    assert run_json(path, "--detector", "research:1e9")["lights"] == []


@pytest.mark.parametrize("cut", ["variance", "median"])
def test_all_of_the_light_is_given_as_lights(radiance, tmp_path, cut):
    path = tmp_path / "room.pfm"
    image.write_pfm(path, radiance)
    packet = run_json(path, "--order", 4)
    result = run_json(path, "--order", 4, "--constellation", 16, "--cut", cut)
    assert len(result["lights"]) == 16
    lamp = max(packet["lights"], key=lambda light: luminance(light["irradiance"]))
    assert lamp in result["lights"]
    assert not np.any(result["sh"]["coefficients"])
    strongest = sum(luminance(light["irradiance"]) for light in result["lights"])
    assert strongest > sum(luminance(light["irradiance"]) for light in packet["lights"])


def test_a_constellation_that_makes_no_sense_is_refused(radiance, tmp_path):
    path = tmp_path / "room.pfm"
    image.write_pfm(path, radiance)
    assert run(path, "--constellation", 65).returncode == 2
    done = run(path, "--constellation", 8, "--cut", "thin")
    assert done.returncode == 2
    assert "--cut thin: expected variance or median" in done.stderr


def test_a_fisheye_camera_is_read_by_its_file(tmp_path):
    """A dual fisheye picture of the scene gives the same lamps as its panorama."""
    from lightprobe.imaging import camera as lenses
    from lightprobe.sim.camera import Shot, SimulatedCamera
    from lightprobe.sim.world import Behaviour, World

    text = "[camera]\nprojection = fisheye\nwidth_px = 1600\nheight_px = 800\n"
    for k, rotation in enumerate(("1, 0, 0, 0", "0, 0, 1, 0")):
        text += f"[lens.{k}]\ncx_px = {400 + 800 * k}\ncy_px = 400\nfx_px = 238\nfy_px = 238\n"
        text += f"max_theta_deg = 95\nrotation_wxyz = {rotation}\nrolloff = -0.05, 0, 0\n"
    path = tmp_path / "dual.camera"
    path.write_text(text)
    lens = lenses.load(str(path))
    world = World([ROOM], Behaviour(act_s=0))
    simulated = SimulatedCamera(world, lens, (1600, 800), quality=95)
    radiance = ROOM.render(1600, 800).compose(np.ones(3))
    exposure_us = 9e5 / float(radiance.max())
    (tmp_path / "x.jpg").write_bytes(simulated.frame(0, Shot(exposure_us)))
    result = run_json(tmp_path / "x.jpg", "--camera", path, "--exposure-us", exposure_us)
    assert same_lamps(result)
    assert same_strengths(result)


def test_negative_samples_are_noted_on_stderr(tmp_path):
    pixels = np.full((64, 128, 3), 0.5, np.float32)
    pixels[0, 0] = -0.001
    image.write_pfm(tmp_path / "x.pfm", pixels)
    done = run(tmp_path / "x.pfm")
    assert done.returncode == 0
    assert "note:" in done.stderr
    assert "3 negative samples" in done.stderr
    assert "no lamps" in done.stdout


def test_table_for_the_eye(radiance, tmp_path):
    image.write_pfm(tmp_path / "x.pfm", radiance)
    done = run(tmp_path / "x.pfm")
    assert done.returncode == 0
    assert "azimuth" in done.stdout
    assert "SH of radiance, order 2, AMBIENT" in done.stdout


@pytest.fixture
def bad(tmp_path):
    """Files that are no pictures."""
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "text.jpg").write_text("no picture at all")
    (tmp_path / "text.exr").write_text("no picture at all")
    (tmp_path / "text.pfm").write_text("PF\n10")
    image.write_pfm(tmp_path / "narrow.pfm", np.ones((64, 64, 3), np.float32))
    good = encode_jpeg(np.full((256, 512, 3), 99, np.uint8))
    (tmp_path / "good.jpg").write_bytes(good)
    (tmp_path / "cut.jpg").write_bytes(good[: len(good) // 8])
    (tmp_path / "bad.camera").write_text("[camera]\nprojection = cube\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["none.jpg"], 1, "none.jpg: open: no such file"),
        (["none.exr"], 1, "none.exr: open: no such file"),
        (["empty.jpg"], 1, ""),
        (["text.jpg"], 1, ""),
        (["cut.jpg"], 1, ""),
        (["text.exr"], 1, "text.exr: decode"),
        (["text.pfm"], 1, "text.pfm: header"),
        (["good.jpg", "good.jpg"], 2, "their exposures with --exposure-us"),
        (["good.jpg", "--exposure-us", "1,2"], 2, "one for each file"),
        (["good.jpg", "--exposure-us", "-3"], 2, "microseconds above 0"),
        (["good.jpg", "--exposure-us", "soon"], 2, "expected numbers"),
        (["narrow.pfm", "--exposure-us", "100"], 2, "HDR files contain radiance already"),
        (["good.jpg", "--preset", "magic"], 2, "magic"),
        (["good.jpg", "--detector", "magic"], 2, "magic"),
        (["good.jpg", "--camera", "none.camera"], 2, "none.camera"),
        (["good.jpg", "--camera", "bad.camera"], 2, "bad.camera"),
        (["good.jpg", "--kind", "BOTH"], 2, "AMBIENT or TOTAL"),
        (["good.jpg", "--order", "9"], 2, "--order"),
        ([], 2, "FILE"),
    ],
)
def test_bad_input_names_object_stage_and_next_step(bad, monkeypatch, arguments, code, message):
    monkeypatch.chdir(bad)
    done = run(*arguments)
    assert message in done.stderr
    assert len(done.stderr.strip()) > 20
    assert "Traceback" not in done.stderr
    assert "Sanitizer" not in done.stderr
    assert done.returncode == code
    assert done.stdout == ""


def test_no_daemon_says_where_it_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROBED", str(tmp_path / "nothing"))
    image.write_pfm(tmp_path / "x.pfm", np.ones((64, 128, 3), np.float32))
    done = run(tmp_path / "x.pfm")
    assert done.returncode == 1
    assert "no executable file there" in done.stderr


#: Of one colour each, and small: where chroma is subsampled, most of their pixels are rim.
SATURATED = Room(
    bulbs=(
        Bulb((-1.1, 0.85, -1.6), 0.10, (70, 6, 4)),
        Bulb((1.1, 0.9, 1.0), 0.08, (6, 60, 10)),
        Bulb((1.5, 0.1, -2.2), 0.16, (40, 22, 5)),
        Bulb((-1.9, -0.2, 1.4), 0.08, (14, 30, 70)),
    )
)


@pytest.mark.parametrize("width_px", [640, 1920])
@pytest.mark.parametrize("chroma", ["420", "422"])
def test_small_lamps_keep_their_colour(width_px, chroma, tmp_path):
    """Chroma that is repeated or smoothed errs by up to 30 % at 640 pixels, 68 % at 1920."""
    world = World([SATURATED], Behaviour(act_s=0), 0.25 / 12.8e-3)
    simulated = SimulatedCamera(
        world, camera.equirect(), (width_px, width_px // 2), quality=95, chroma=chroma
    )
    exposures_us = [12800.0, 1600.0, 100.0]
    for number, exposure_us in enumerate(exposures_us):
        (tmp_path / f"{number}.jpg").write_bytes(simulated.frame(number, Shot(exposure_us)))
    estimate = offline.estimate_folder(tmp_path, exposures_us)
    for lamp in world.scenes[0].lamps:
        light = max(estimate.lights, key=lambda item: np.dot(item.direction, lamp.direction))
        assert np.array(light.irradiance) == pytest.approx(lamp.irradiance, rel=0.08)


def behind_film(folder, scene, angles, size_px=(960, 480)):
    """Files of a scene behind a film at each angle."""
    layers, powers = scene.render(*size_px), np.ones(len(scene.lamps))
    film = Polarizer(Sheet(), camera.load("equirect"), size_px)
    files = []
    for index, angle in enumerate(angles):
        seen = film.through(layers.compose(powers), layers.compose_polarized(powers), (angle,))
        files.append(folder / f"{index}.pfm")
        image.write_pfm(files[-1], np.ascontiguousarray(seen))
    return files


def test_reflections_are_told_from_lamps_by_four_angles(tmp_path):
    scene = PolishedFloor(random_scene(8))  # four lamps; three of them are mirrored brightly
    files = behind_film(tmp_path, scene, (0, 45, 90, 135))
    result = run_json(*files, "--wheel-deg", "0,45,90,135")
    assert result["flags"] == []
    called = [light for light in result["lights"] if "REFLECTION" in light["flags"]]
    assert len(called) >= 3
    for light in result["lights"]:
        true = [geometry.angle_deg(light["direction"], lamp.direction) for lamp in scene.lamps]
        assert (min(true) > 2) == (light in called)
    for light in called:
        assert light["reflection"] > 0.9
        if light["dolp"] is not None:  # horizontal, as floors make it
            assert min(light["aolp_deg"], 180 - light["aolp_deg"]) < 3
    lamps = [light for light in result["lights"] if light not in called and light["dolp"]]
    assert all(light["dolp"] < 0.1 for light in lamps)
    bare = tmp_path / "bare.pfm"
    layers = scene.render(960, 480)
    image.write_pfm(bare, layers.compose(np.ones(len(scene.lamps))))
    false = [
        light
        for light in run_json(bare)["lights"]
        if min(geometry.angle_deg(light["direction"], lamp.direction) for lamp in scene.lamps) > 2
    ]
    assert len(false) >= 3  # what is told here is no easy scene


def test_two_angles_name_what_is_missing(tmp_path):
    scene = PolishedFloor(random_scene(8))
    for angles in ((0, 90), (45, 45, 45)):
        files = behind_film(tmp_path, scene, angles)
        text = ",".join(map(str, angles))
        result = run_json(*files, "--wheel-deg", text)
        assert result["flags"] == ["POLARIZATION_UNKNOWN"]
        for light in result["lights"]:
            assert light["dolp"] is None


def test_a_film_put_in_wrong_is_found(tmp_path):
    scene = PolishedFloor(random_scene(8))
    files = behind_film(tmp_path, scene, (90, 135, 0, 45))
    assert "FILM_TURNED" in run_json(*files, "--wheel-deg", "0,45,90,135")["flags"]


def test_angles_and_files_must_agree(tmp_path):
    done = run("a.jpg", "b.jpg", "--wheel-deg", "0,45,90")
    assert done.returncode == 2
    assert "2 files and 3 angles" in done.stderr


@pytest.mark.parametrize("path", PACKAGED, ids=lambda path: path.stem)
def test_the_daemon_reads_packaged_camera_files(path, tmp_path):
    """A grey picture through each: radiance is the same everywhere, and the same for all."""
    known = camera.load(str(path))
    size_px = (known.width_px, known.height_px) if known.lenses else (640, 320)
    cv2.imwrite(str(tmp_path / "grey.jpg"), np.full((size_px[1], size_px[0], 3), 128, np.uint8))
    estimate, _ = offline.estimate_files(
        [tmp_path / "grey.jpg"], [1000.0], offline.Settings(camera=str(path))
    )
    light = estimate.irradiance(geometry.sphere_normals())
    assert light == pytest.approx(np.pi * 1000 * 0.2158, rel=0.02)
