"""The extension as a file, and what it brings along."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import lightprobe
import pytest
from build_extension import here
from probes import LONG_S, Probe, packet
from rendering import quiet

ROOT = Path(__file__).parents[3]
FILE = ROOT / f"build/blender/lightprobe-blender-{here()}.zip"
HEAVY = ("cv2", "scipy", "matplotlib", "typer", "rich", "OpenEXR", "cryptography", "zeroconf")


def test_blender_finds_the_extension_valid():
    (tool,) = Path(bpy.utils.resource_path("LOCAL")).rglob("bl_pkg/cli/blender_ext.py")
    done = subprocess.run(
        [sys.executable, tool, "validate", FILE], capture_output=True, text=True, timeout=LONG_S
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_comes_from_the_wheels_of_the_extension(scene):
    assert "extensions/.local" in Path(lightprobe.__file__).as_posix()
    assert hasattr(scene, "lightprobe")


def test_no_heavy_package_is_needed(scene):
    found = [name for name in HEAVY if name in sys.modules]
    assert found == []


def test_it_can_be_switched_off_and_on_again(scene):
    name = "bl_ext.user_default.lightprobe"
    bpy.ops.preferences.addon_disable(module=name)
    assert not hasattr(scene, "lightprobe")
    bpy.ops.preferences.addon_enable(module=name)
    assert scene.lightprobe.uri == "tcp:127.0.0.1:7700"


def test_every_operator_and_setting_says_what_it_does(scene):
    for name in (
        "connect",
        "disconnect",
        "remove",
        "fit_scale",
        "light_once",
        "keyframe_recording",
    ):
        kind = getattr(bpy.ops.lightprobe, name).get_rna_type()
        assert len(kind.description) > 20, name
    shown = [p for p in scene.lightprobe.bl_rna.properties if p.type != "POINTER"]
    for one in shown:
        assert one.identifier in ("rna_type", "name") or one.description, one.identifier


def test_the_script_of_the_readme_lights_a_scene(scene, tmp_path):
    readme = (ROOT / "clients/blender/README.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert code.count("\n") <= 12
    with Probe() as probe:
        probe.send(packet(lamps=[(1, (0, 1, 0), (2, 2, 2), 1.0)]))
        code = code.replace("tcp:127.0.0.1:7700", probe.uri).replace("//lit", f"{tmp_path}/lit")
        scene.render.resolution_x = scene.render.resolution_y = 16
        scene.render.engine, scene.cycles.samples = "CYCLES", 4
        with quiet():
            exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "lit.png").is_file()
    assert [lamp.data.energy for lamp in bpy.data.objects if lamp.type == "LIGHT"] == [
        pytest.approx(bpy.context.scene.lightprobe.scale * 2)
    ]


def test_the_zip_holds_no_source_twice():
    names = zipfile.ZipFile(FILE).namelist()
    assert len(names) == len(set(names))
    assert {"__init__.py", "blender_manifest.toml", "LICENSE"} <= set(names)
