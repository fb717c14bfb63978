"""Pages whose tables are measured: parts between `<!-- generated: NAME -->` and `<!-- end -->`."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ACCURACY = ROOT / "docs/users/accuracy.md"


def replace(text: str, name: str, part: str) -> str:
    """Put `part` where `name` is marked; SystemExit when it is not."""
    pattern = rf"(<!-- generated: {name} -->\n).*?(<!-- end -->)"
    if not re.search(pattern, text, re.DOTALL):
        raise SystemExit(f"accuracy: no mark for {name} in the page")
    return re.sub(pattern, lambda m: f"{m[1]}{part}\n{m[2]}", text, flags=re.DOTALL)


def put(page: Path, parts: dict[str, str]) -> None:
    """Replace the marked parts of a page."""
    text = page.read_text()
    for name, part in parts.items():
        text = replace(text, name, part)
    page.write_text(text)
