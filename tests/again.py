"""Which tests of the last run failed: at most MOST of them may run once more, alone.

Tests of programs in real time may fail where others leave them no processor, so what failed runs
once more. What needed that is named and counted; more than MOST of them are no accident, and then
the status is 1.

    python tests/again.py build/cache/pytest
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

MOST = 2


def main(cache: Path) -> int:
    """Print the tests; the status says whether a second run is allowed."""
    failed = sorted(json.loads((cache / "v/cache/lastfailed").read_text()))
    for test in failed:
        print(f"tests: failed: {test}")
    if len(failed) > MOST:
        print(f"tests: {len(failed)} failed, more than {MOST}: no second run")
        return 1
    print(f"tests: {len(failed)} failed, and run once more, alone", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
