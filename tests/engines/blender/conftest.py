"""The real Blender (PyPI's bpy), with the extension installed from its zip into an empty home.

These tests run in a Python of their own (`make test-blender`), which has bpy but not lightprobe:
what the add-on imports comes from the wheels in the extension.
"""

import atexit
import importlib
import os
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
BUILD = ROOT / "build"
HOME = tempfile.TemporaryDirectory(prefix="lp-blender-")
# Before bpy is imported: nobody's own Blender settings are read or written.
os.environ["BLENDER_USER_RESOURCES"] = HOME.name

import bpy  # noqa: E402

sys.path.append(str(ROOT / "clients/blender/tools"))
from build_extension import here  # noqa: E402

addon_utils = importlib.import_module("addon_utils")  # found once bpy is there


def pytest_configure():
    """Install the extension as a user does: from a file."""
    file = BUILD / "blender" / f"lightprobe-blender-{here()}.zip"
    bpy.ops.extensions.package_install_files(
        filepath=str(file), repo="user_default", enable_on_install=True
    )
    assert addon_utils.check("bl_ext.user_default.lightprobe")[1], "the extension is not enabled"


@pytest.fixture
def scene():
    """A scene with nothing in it, white surfaces seen as linear numbers."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("bl_ext.user_default.lightprobe", default_set=True)
    yield bpy.context.scene
    bpy.ops.lightprobe.remove()


def pytest_sessionfinish(exitstatus):
    """End before bpy does: its C++ destructors call Python after Python's end, and crash.

    Seen with bpy 4.2.23: SpaceType::~SpaceType frees panels of add-ons by PyGILState_Ensure.
    """

    def end():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(exitstatus))

    atexit.register(end)


def pytest_unconfigure():
    """Remove the home."""
    HOME.cleanup()
