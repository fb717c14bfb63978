"""The package as its users get it: wheel and sdist in bare environments, old and new.

`make test-long` runs this; it takes minutes and needs a package index.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from built_package import run, wheel

pytestmark = pytest.mark.long
ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
#: The oldest versions that pyproject.toml names.
OLDEST = ("numpy==1.24.*", "protobuf==4.25.0")


@cache
def newest_python():
    """The newest Python 3 of this machine: on PATH, or one of pyenv's."""
    places = [Path(folder) for folder in os.environ["PATH"].split(os.pathsep)]
    places += Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob("versions/*/bin")
    found = {}
    for python in {path for place in places for path in place.glob("python3.*")}:
        if re.fullmatch(r"python3\.\d+", python.name):
            done = subprocess.run(
                [python, "-c", "import sys; print(*sys.version_info[:3])"], capture_output=True
            )
            if done.returncode == 0:
                found[tuple(map(int, done.stdout.split()))] = python
    return found[max(found)]


def environment(folder, python, *requirements):
    """Python of a new virtual environment."""
    run(python, "-m", "venv", folder)
    inside = folder / "bin" / "python"
    if requirements:
        run(inside, "-m", "pip", "install", "-q", *requirements)
    return inside


def packages(python):
    listed = json.loads(run(python, "-m", "pip", "list", "--format=json"))
    return {one["name"]: one["version"] for one in listed}


@pytest.mark.parametrize(
    ("which", "constraints"),
    [("this", OLDEST), ("this", ()), ("newest", ())],
    ids=["oldest numpy and protobuf", "newest numpy and protobuf", "newest Python"],
)
def test_a_client_needs_numpy_and_protobuf_alone(built, tmp_path, which, constraints):
    python = newest_python() if which == "newest" else sys.executable
    inside = environment(tmp_path / "bare", python, wheel(built), *constraints)
    there = packages(inside)
    print(run(inside, "--version").strip(), there)
    assert set(there) - {"pip", "setuptools"} == {"lightprobe", "numpy", "protobuf"}
    for wanted in constraints:
        name, version = wanted.split("==")
        assert there[name].startswith(version.removesuffix("*"))
    out = run(inside, "-W", "error", HERE / "use_client.py", ROOT / "proto" / "golden")
    assert "received 1 of subscription 1" in out
    assert "decoded" in out


def test_the_oldest_versions_are_those_that_the_package_names():
    named = (ROOT / "host_py" / "pyproject.toml").read_text()
    for oldest in OLDEST:
        name, version = oldest.split("==")
        assert f'"{name}>={".".join(version.split(".")[:2])}"' in named


def test_without_extras_the_command_says_what_to_install(built, tmp_path):
    inside = environment(tmp_path / "bare", sys.executable, wheel(built))
    done = subprocess.run([inside.with_name("lightprobe"), "watch"], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == (
        "lightprobe: the command needs typer, which is not installed: "
        f"in lightprobe's repository: {inside} -m pip install './host_py[cli]'\n"
    )
    run(inside, "-m", "pip", "install", "-q", f"{wheel(built)}[cli]")
    assert "cv2" not in run(inside.with_name("lightprobe"), "--help")
    done = subprocess.run(
        [inside.with_name("lightprobe"), "simulate"], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "needs cv2, which is not installed: " in done.stderr
    assert "pip install './host_py[sim]'" in done.stderr
    done = subprocess.run(
        [inside.with_name("lightprobe"), "doctor", "--wait", "0.1", "--json"],
        capture_output=True, text=True, env={"PATH": "/nowhere"},
    )  # fmt: skip
    found = {one["check"]: one for one in json.loads(done.stdout)["findings"]}
    assert found["daemon"]["verdict"] == "skip"
    assert found["extras"]["detail"] == "cli; not sim, mcu, calibrate"


def test_a_source_distribution_installs_without_protoc(built, tmp_path):
    """It carries the compiled schema; grpcio-tools is not there, and no index is asked."""
    (sdist,) = built.glob("*.tar.gz")
    inside = environment(tmp_path / "bare", sys.executable, "hatchling", "numpy", "protobuf")
    run(inside, "-m", "pip", "install", "-q", "--no-index", "--no-build-isolation", sdist,
        env={**os.environ, "PATH": "/usr/bin:/bin", "PIP_NO_INDEX": "1"})  # fmt: skip
    assert "decoded" in run(inside, HERE / "use_client.py", ROOT / "proto" / "golden")
    shutil.unpack_archive(sdist, tmp_path / "sdist")
    (licence,) = (tmp_path / "sdist").glob("*/LICENSE")
    assert not licence.is_symlink()
    assert licence.read_text() == (ROOT / "LICENSE").read_text()


def test_metadata_has_readme_licence_and_types(built, tmp_path):
    unpacked = tmp_path / "wheel"
    shutil.unpack_archive(wheel(built), unpacked, "zip")
    (info,) = unpacked.glob("*.dist-info")
    metadata = (info / "METADATA").read_text()
    assert "License-Expression: Apache-2.0" in metadata
    assert "# host_py: the Python package `lightprobe`" in metadata
    for extra in ("cli", "sim", "mcu", "calibrate"):
        assert f"Provides-Extra: {extra}" in metadata
    licence = (info / "licenses" / "LICENSE").read_text()
    assert licence == (ROOT / "LICENSE").read_text()
    assert (unpacked / "lightprobe" / "py.typed").is_file()
    assert not list(unpacked.rglob("*_pb2_grpc*"))


def test_mypy_finds_a_planted_mistake(built, tmp_path):
    inside = environment(tmp_path / "bare", sys.executable, wheel(built), "mypy")
    good = (HERE / "use_client.py").read_text()
    (tmp_path / "good.py").write_text(good)
    run(inside, "-m", "mypy", "--strict", "good.py", cwd=tmp_path)
    mistakes = [
        ('kind="TOTAL"', 'kind="TOTL"', "incompatible type \"Literal['TOTL']\""),
        (".irradiance", ".irradience", 'has no attribute "irradience"'),
        ("receive(", "recieve(", 'has no attribute "recieve"'),
    ]
    for number, (right, wrong, message) in enumerate(mistakes):
        assert right in good
        name = f"mistake_{number}.py"
        (tmp_path / name).write_text(good.replace(right, wrong, 1))
        done = subprocess.run(
            [inside, "-m", "mypy", "--strict", name],
            capture_output=True, text=True, cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 1
        assert message in done.stdout, done.stdout
