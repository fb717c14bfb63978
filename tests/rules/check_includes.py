"""Who may include whom in daemon/ (README.md of daemon): run by `make check`.

base <- include <- light <- vision <- app, and base, include <- drivers <- app. Besides:
generated protobuf only in app/codec.c, generated DBC packers only in drivers/*_mcu* and
firmware/messages.c, OpenCV only in vision/*.cpp, a driver never another role's driver
(link_* below the MCU drivers is the shared pair), concrete back ends only in app/backends.c.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MAY = {
    "base": {"base"},
    "include": {"include", "base"},
    "light": {"light", "include", "base"},
    "vision": {"vision", "light", "include", "base"},
    "drivers": {"drivers", "include", "base"},
    "app": {"app", "drivers", "vision", "light", "include", "base"},
}
INCLUDE = re.compile(r'^\s*#\s*include\s+(["<])([^">]+)[">]', re.M)
DECLARES_BACK_END = re.compile(r"\blp_(source|rotator|ring|publisher)_[a-z0-9_]+_ops\b")


def room_of(included: str, includer: Path) -> str | None:
    """Name the room a quoted include lives in; None when it is no file of the daemon."""
    for base in (includer.parent, ROOT / "daemon", ROOT / "daemon" / "include"):
        path = (base / included).resolve()
        if path.is_file() and (ROOT / "daemon") in path.parents:
            return path.relative_to(ROOT / "daemon").parts[0]
    return None


def role(name: str) -> str:
    """Role of a driver file: source_file.c -> source."""
    return name.split("_", 1)[0]


def faults_of(path: Path) -> list[str]:
    """List what one source file includes and must not."""
    room = path.relative_to(ROOT / "daemon").parts[0]
    here = path.relative_to(ROOT)
    text = path.read_text()
    faults = []
    for quote, name in INCLUDE.findall(text):
        if name.endswith(".pb.h") and here != Path("daemon/app/codec.c"):
            faults.append(
                f"{here}: includes {name}: generated protobuf belongs to app/codec.c alone"
            )
        if "dbc/" in name and not (room == "drivers" and "_mcu" in path.stem):
            faults.append(f"{here}: includes {name}: DBC packers belong to drivers/*_mcu* alone")
        if name.startswith("opencv2/") and not (room == "vision" and path.suffix == ".cpp"):
            faults.append(f"{here}: includes {name}: OpenCV belongs to vision/*.cpp alone")
        if quote != '"':
            continue
        target = room_of(name, path)
        if target and target not in MAY[room]:
            faults.append(f"{here}: includes {name}: {room} must not know {target}")
        if room == "drivers" and target == "drivers":
            other = Path(name).name
            if role(other) not in (role(path.name), "link"):
                faults.append(f"{here}: includes {name}: a driver of another role")
    if room == "app" and path.name != "backends.c" and DECLARES_BACK_END.search(text):
        faults.append(f"{here}: names a concrete back end; only app/backends.c may")
    return faults


def main() -> int:
    """Print every fault; the exit status says whether there was one."""
    sources = [p for p in sorted((ROOT / "daemon").rglob("*")) if p.suffix in (".c", ".h", ".cpp")]
    faults = [fault for path in sources for fault in faults_of(path)]
    print("\n".join(faults) if faults else f"include rules: {len(sources)} files, no fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
