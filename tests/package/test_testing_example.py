"""A user's test project, with the wheel alone: it finds a stuck wheel and a late camera."""

import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import pytest
from built_package import LONG_S, run, wheel

pytestmark = [pytest.mark.long, pytest.mark.many_frames]
ROOT = Path(__file__).resolve().parents[2]
MOST_S = 60


@pytest.fixture(scope="module")
def project(built, tmp_path_factory):
    """A copy of the example, and the Python of an environment with the wheel.

    What the wheel needs is that of this environment, so that nothing is fetched. The repository
    itself is not on the path.
    """
    folder = tmp_path_factory.mktemp("user")
    python = folder / "venv" / "bin" / "python"
    run(sys.executable, "-m", "venv", folder / "venv")
    run(python, "-m", "pip", "install", "-q", "--no-deps", "--no-index", wheel(built))
    inside = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    (Path(inside) / "shared.pth").write_text(sysconfig.get_path("purelib") + "\n")
    shutil.copytree(ROOT / "host_py" / "examples" / "my_app", folder / "my_app")
    return folder / "my_app", python


def outcome_of(project, *arguments):
    folder, python = project
    programs = {"LIGHTPROBE_FIRMWARE": str(ROOT / "build" / "firmware")}
    start_s = time.monotonic()
    done = subprocess.run(
        [python, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=LONG_S, env=os.environ | programs,
    )  # fmt: skip
    print(done.stdout, done.stderr)
    return done, time.monotonic() - start_s


def test_only_the_wheel_is_used(project):
    folder, python = project
    home = run(python, "-c", "import lightprobe.testing as t; print(t.__file__)", cwd=folder)
    assert home.startswith(str(python.parents[1]))


def test_it_passes_with_a_stuck_wheel_and_a_late_camera_in_a_minute(project):
    done, seconds = outcome_of(project)
    assert done.returncode == 0
    assert "6 passed" in done.stdout
    assert seconds < MOST_S


@pytest.mark.parametrize(
    ("fault", "noticed", "told"),
    [
        ("wheel-stuck", "test_the_box_is_healthy", "INDEX_ALWAYS"),
        ("camera-late", "test_the_camera_is_on_time", "camera-clock"),
    ],
)
def test_it_notices_what_is_broken_in_a_minute(project, fault, noticed, told):
    done, seconds = outcome_of(project, f"--lightprobe-fault={fault}", "-k", noticed)
    assert done.returncode == 1
    assert "1 failed" in done.stdout
    assert told in done.stdout
    assert seconds < MOST_S
