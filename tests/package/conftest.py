"""The package, built once for all tests of it."""

import fcntl
import sys
from pathlib import Path

import pytest
from built_package import run

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """A folder with wheel and sdist, built as for a release; by one process after the other."""
    folder = tmp_path_factory.mktemp("dist")
    with (ROOT / "build" / "cache" / "dist.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        run(sys.executable, "-m", "build", "--outdir", folder, ROOT / "host_py")
    return folder
