"""The checks of the C# package, compiled once."""

from pathlib import Path

import pytest
from mono import PACKAGE, compiled


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    out = tmp_path_factory.mktemp("csharp") / "checks.exe"
    return compiled(out, PACKAGE / "Runtime/*.cs", Path(__file__).with_name("Checks.cs"))
