"""Who may include whom in daemon/ (README.md of daemon): run by `make check`.

base <- include <- light <- vision <- estimate <- app; base, include <- drivers <- app; and
base, include, light <- serve <- app, where serve besides reads estimate/estimates.h (what a frame
gives) and drivers/publisher/places.h. In light each folder may include those before it in LAYERS.
Besides: generated protobuf only in serve/codec, generated DBC packers only in drivers/link and
firmware/messages.c, OpenCV only in C++ of vision/, concrete back ends only in app/backends.c.
A driver may include what lies in its own folder, in a folder above it, or in drivers/link
(wheel and ring share that). No folder of light, vision, estimate, serve and app holds more than
MOST_FILES.
"""

import re
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MAY = {
    "base": {"base"},
    "include": {"include", "base"},
    "light": {"light", "include", "base"},
    "vision": {"vision", "light", "include", "base"},
    "estimate": {"estimate", "vision", "light", "include", "base"},
    "drivers": {"drivers", "include", "base"},
    "serve": {"serve", "light", "include", "base"},
    "app": {"app", "serve", "estimate", "drivers", "vision", "light", "include", "base"},
}
SERVED = ("estimate/estimates.h", "drivers/publisher/places.h")
LAYERS = ("linear", "math", "find", "turn", "place", "film", "send", "lamps", "clipped", "ring")
MOST_FILES = 12
#: Header of serve/codec that includes generated protobuf, for the files beside it.
PASSES_ON = "codec_fields.h"
SMALL_ROOMS = ("light", "vision", "estimate", "serve", "app")
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


def is_before(included: Path, folder: str) -> bool:
    """Whether a header of light lies in a folder, or in a layer below it."""
    return LAYERS.index(included.parent.name) <= LAYERS.index(folder)


def crowded(sources: list[Path]) -> list[str]:
    """List the folders that hold too many files to be understood at once."""
    counts = Counter(path.parent.relative_to(ROOT / "daemon") for path in sources)
    return [
        f"daemon/{folder}: {count} files, more than {MOST_FILES}: divide it"
        for folder, count in sorted(counts.items())
        if folder.parts[0] in SMALL_ROOMS and count > MOST_FILES
    ]


def faults_of(path: Path) -> list[str]:
    """List what one source file includes and must not."""
    folders = path.relative_to(ROOT / "daemon").parts[:-1]
    room = folders[0]
    here = path.relative_to(ROOT)
    text = path.read_text()
    faults = []
    for quote, name in INCLUDE.findall(text):
        generated = name.endswith((".pb.h", PASSES_ON))
        if generated and not here.match("daemon/serve/codec/*.c") and here.name != PASSES_ON:
            faults.append(
                f"{here}: includes {name}: generated protobuf belongs to serve/codec alone"
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
        place = str(target.relative_to(ROOT / "daemon"))
        if other not in MAY[room] and not (room == "serve" and place in SERVED):
            faults.append(f"{here}: includes {name}: {room} must not know {other}")
        if room == other == "light" and not is_before(target, folders[1]):
            faults.append(f"{here}: includes {name}: light/{folders[1]} must not know it")
        if room == other == "drivers" and not may_share(path, target):
            faults.append(f"{here}: includes {name}: another driver's")
    if room == "app" and path.name != "backends.c" and DECLARES_BACK_END.search(text):
        faults.append(f"{here}: names a concrete back end; only app/backends.c may")
    return faults


def main() -> int:
    """Print every fault; the exit status says whether there was one."""
    sources = [p for p in sorted((ROOT / "daemon").rglob("*")) if p.suffix in SUFFIXES]
    faults = [fault for path in sources for fault in faults_of(path)] + crowded(sources)
    print("\n".join(faults) if faults else f"include rules: {len(sources)} files, no fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
