"""Who may include whom in daemon/ (README.md of daemon): run by `make check`.

base <- include <- light <- vision <- app, and base, include <- drivers <- app. Besides:
generated protobuf only in app/codec*.c, generated DBC packers only in drivers/link and
firmware/messages.c, OpenCV only in C++ of vision/, concrete back ends only in app/backends.c.
A driver may include what lies in its own folder, in a folder above it, or in drivers/link
(wheel and ring share that).
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
LINKS = ROOT / "daemon" / "drivers" / "link"
SUFFIXES = (".c", ".h", ".cpp", ".hpp")
INCLUDE = re.compile(r'^\s*#\s*include\s+(["<])([^">]+)[">]', re.M)
DECLARES_BACK_END = re.compile(r"\blp_(source|rotator|ring|publisher)_[a-z0-9_]+_ops\b")


def target_of(included: str, includer: Path) -> Path | None:
    """Find the file a quoted include means; None when it is no file of the daemon."""
    for base in (includer.parent, ROOT / "daemon", ROOT / "daemon" / "include"):
        path = (base / included).resolve()
        if path.is_file() and (ROOT / "daemon") in path.parents:
            return path
    return None


def may_share(includer: Path, included: Path) -> bool:
    """Whether a driver may include another driver's header: its folder, one above, the links."""
    return included.parent == LINKS or included.parent in includer.parents


def faults_of(path: Path) -> list[str]:
    """List what one source file includes and must not."""
    folders = path.relative_to(ROOT / "daemon").parts[:-1]
    room = folders[0]
    here = path.relative_to(ROOT)
    text = path.read_text()
    faults = []
    for quote, name in INCLUDE.findall(text):
        if name.endswith(".pb.h") and not here.match("daemon/app/codec*.c"):
            faults.append(
                f"{here}: includes {name}: generated protobuf belongs to app/codec*.c alone"
            )
        if "dbc/" in name and not (room == "drivers" and folders[1] == "link"):
            faults.append(f"{here}: includes {name}: DBC packers belong to the MCU's drivers alone")
        if name.startswith("opencv2/") and not (
            room == "vision" and path.suffix in (".cpp", ".hpp")
        ):
            faults.append(f"{here}: includes {name}: OpenCV belongs to C++ of vision alone")
        if quote != '"':
            continue
        target = target_of(name, path)
        if not target:
            continue
        other = target.relative_to(ROOT / "daemon").parts[0]
        if other not in MAY[room]:
            faults.append(f"{here}: includes {name}: {room} must not know {other}")
        if room == other == "drivers" and not may_share(path, target):
            faults.append(f"{here}: includes {name}: another driver's")
    if room == "app" and path.name != "backends.c" and DECLARES_BACK_END.search(text):
        faults.append(f"{here}: names a concrete back end; only app/backends.c may")
    return faults


def main() -> int:
    """Print every fault; the exit status says whether there was one."""
    sources = [p for p in sorted((ROOT / "daemon").rglob("*")) if p.suffix in SUFFIXES]
    faults = [fault for path in sources for fault in faults_of(path)]
    print("\n".join(faults) if faults else f"include rules: {len(sources)} files, no fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
