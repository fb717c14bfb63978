"""How long an app's update takes for one, two and three objects, beside the published times.

The page is in Chromium, with graphics in software (clients/js/test/updates.ts).
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

_JS = Path(__file__).resolve().parents[2] / "build/js"
#: Alhakamy and Tuceryan 2020: whole updates of their Unity app, ms.
_PUBLISHED = {"cube map": (173.4, 177.3, 183.2), "local sampling": (35.9, 37.8, 40.2)}


def measured() -> list[dict[str, Any]]:
    """Milliseconds (cubeMs, localMs) by the number of objects."""
    done = subprocess.run(
        ["node", "dist/test/updates.js"], cwd=_JS, check=True, capture_output=True, text=True
    )
    return list(json.loads(done.stdout))


def table(times: list[dict[str, Any]]) -> str:
    """Markdown: the published rows, and ours."""
    rows = {f"published: {name}": values for name, values in _PUBLISHED.items()} | {
        "here: lamps, SH and reflection map of 32": [one["cubeMs"] for one in times],
        "here: local sampling beside it": [one["localMs"] for one in times],
    }
    lines = ["| ms per update | one object | two | three |", "|---|---|---|---|"]
    for name, values in rows.items():
        lines.append(f"| {name} | {' | '.join(f'{value:.1f}' for value in values)} |")
    return "\n".join(lines)
