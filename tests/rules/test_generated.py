"""Generated files that are committed are up to date with their sources."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GENERATE = "clients/csharp/Tools~/generate.py"


def test_the_csharp_messages_are_those_of_the_schema():
    spec = importlib.util.spec_from_file_location("generate", ROOT / GENERATE)
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    assert generate.generated() == generate.OUT.read_text(), f"run build/venv/bin/python {GENERATE}"
