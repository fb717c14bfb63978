"""Who may import whom in host_py: a client must not need what tools need."""

import ast
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "host_py" / "lightprobe"

#: Rooms that each room's modules may import; the modules at the top are the room "".
MAY = {
    "": {""},
    "imaging": {"", "imaging"},
    "calibrate": {"", "imaging", "calibrate"},
    "check_camera": {"", "imaging", "calibrate", "check_camera"},
    "align": {"", "calibrate", "align"},
    "probe": {"", "imaging", "calibrate", "bake", "probe"},
    "bake": {"", "bake"},
    "mcu": {"", "mcu"},
    "hil": {"", "mcu", "hil"},
    "network": {"", "network"},
    "setup": {"", "network", "setup"},
    "study": {"", "study"},
    "panel": {"", "panel"},
    "sim": {"", "imaging", "calibrate", "sim"},
    "evaluate": {"", "imaging", "calibrate", "sim", "evaluate"},
    "testing": {"", "imaging", "calibrate", "sim", "testing"},
    "cli": {
        "",
        "imaging",
        "calibrate",
        "check_camera",
        "align",
        "bake",
        "probe",
        "mcu",
        "hil",
        "network",
        "setup",
        "study",
        "panel",
        "sim",
        "evaluate",
        "cli",
    },
}
#: Modules at the top that a client loads, and all that they may import from outside.
CLIENT = (
    "__init__", "async_client", "client", "clock_offset", "drained", "wire", "estimate", "flags",
    "fallback", "colour", "sh", "geometry", "convert", "errors",
)  # fmt: skip
CLIENT_MAY = {"numpy", "google", "lightprobe_proto"}
#: Figures and pictures that judge a real probe as well as a simulated one.
WITHOUT_SIMULATOR = ("evaluate/metrics.py", "evaluate/relight.py")


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0] if path.parent != PACKAGE else ""


def imported(path: Path) -> set[str]:
    """Full names of all that a module imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def rooms_of(path: Path) -> set[str]:
    """Rooms that a module imports from."""
    rooms = set()
    for name in imported(path):
        parts = name.split(".")
        if parts[0] == "lightprobe":
            rooms.add(parts[1] if (PACKAGE / parts[1]).is_dir() else "")
    return rooms


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_room_imports_only_what_it_may(path: Path) -> None:
    if path.name == "__main__.py":  # it is the command
        return
    assert rooms_of(path) <= MAY[room(path)]


def test_every_room_has_a_rule() -> None:
    assert {room(path) for path in modules()} == set(MAY)


@pytest.mark.parametrize("name", WITHOUT_SIMULATOR)
def test_a_judge_does_not_know_the_simulator(name: str) -> None:
    assert "sim" not in rooms_of(PACKAGE / name)


@pytest.mark.parametrize("name", CLIENT)
def test_a_client_needs_numpy_and_protobuf_alone(name: str) -> None:
    outside = {module.split(".")[0] for module in imported(PACKAGE / f"{name}.py")}
    assert outside - sys.stdlib_module_names - {"lightprobe"} <= CLIENT_MAY
