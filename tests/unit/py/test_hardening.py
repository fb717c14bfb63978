"""The program that ships ends at once where memory is misused: its ELF file says so."""

import re
import subprocess
from pathlib import Path

PROGRAM = Path(__file__).resolve().parents[3] / "build/release/bin/lightprobed"


def readelf(option: str, program: Path = PROGRAM) -> str:
    """Run readelf with one option."""
    return subprocess.run(
        ["readelf", "--wide", option, program], check=True, capture_output=True, text=True
    ).stdout


def missing(program: Path) -> set[str]:
    """Give what the program lacks."""
    dynamic, segments = readelf("--dynamic", program), readelf("--segments", program)
    symbols = readelf("--dyn-syms", program)
    stack = re.search(r"GNU_STACK.* (RWE?) ", segments)
    shown = {
        "PIE": bool(re.search(r"FLAGS_1.*\bPIE\b", dynamic)),
        "BIND_NOW": bool(re.search(r"\bBIND_NOW\b|FLAGS_1.*\bNOW\b", dynamic)),
        "RELRO": "GNU_RELRO" in segments,
        "stack without code": stack is not None and stack[1] == "RW",
        "stack protector": "__stack_chk_fail" in symbols,
        # Those of our own calls; libraries have theirs.
        "FORTIFY": len(set(re.findall(r"__(\w+)_chk@", symbols)) - {"stack"}) >= 5,
    }
    return {name for name, there in shown.items() if not there}


def test_what_ships_is_hardened():
    assert missing(PROGRAM) == set()


def test_the_test_sees_what_is_missing(tmp_path):
    source, plain = tmp_path / "plain.c", tmp_path / "plain"
    source.write_text('#include <stdio.h>\nint main(void) { return puts(""); }\n')
    flags = ["-no-pie", "-fno-stack-protector", "-Wl,-z,lazy,-z,norelro,-z,execstack"]
    subprocess.run(["gcc", *flags, "-o", plain, source], check=True)
    assert len(missing(plain)) == 6
