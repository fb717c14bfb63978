"""Generated files that are committed are up to date with their sources."""

import importlib.util
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GENERATE = "clients/csharp/Tools~/generate.py"


def test_the_csharp_messages_are_those_of_the_schema():
    spec = importlib.util.spec_from_file_location("generate", ROOT / GENERATE)
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    assert generate.generated() == generate.OUT.read_text(), f"run build/venv/bin/python {GENERATE}"


def test_the_csharp_ranges_are_those_of_the_table(tmp_path):
    command = [sys.executable, ROOT / "proto/ranges_code.py", "--csharp", tmp_path / "Ranges.cs"]
    subprocess.run(command, check=True)
    committed = ROOT / "clients/csharp/Runtime/Ranges.cs"
    assert (tmp_path / "Ranges.cs").read_text() == committed.read_text(), (
        f"run build/venv/bin/python proto/ranges_code.py --csharp {committed.relative_to(ROOT)}"
    )


def test_pythons_flags_are_those_of_the_schema(tmp_path):
    command = [sys.executable, ROOT / "proto/flags_code.py", "--python", tmp_path / "flags.py"]
    subprocess.run(command, check=True)
    committed = ROOT / "host_py/lightprobe/flags.py"
    assert (tmp_path / "flags.py").read_text() == committed.read_text(), (
        f"run build/venv/bin/python proto/flags_code.py --python {committed.relative_to(ROOT)}"
    )
