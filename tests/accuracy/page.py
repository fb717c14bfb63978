"""Pages whose tables are measured: what docs/generated.py puts into them."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))
from generated import keep, put, written  # noqa: E402

ACCURACY = ROOT / "docs/users/accuracy.md"
__all__ = ["ACCURACY", "keep", "put", "written"]
