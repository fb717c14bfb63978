"""Which test runs in which process: one after the other, whichever is free.

Tests of a file with fixtures of the file's own (`scope="module"`) stay together: such a fixture is
what many tests look at and takes seconds to make, and each process would make it again.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from xdist.scheduler import LoadScopeScheduling


@cache
def shares_fixtures(file: Path) -> bool:
    """Tell whether a file's tests share what takes long to make."""
    return 'scope="module"' in file.read_text()


class ByFixtures(LoadScopeScheduling):  # type: ignore[misc]
    """Give a free process the next test, or the next file whose tests share fixtures."""

    def _split_scope(self, nodeid: str) -> str:
        """Name what a test runs together with."""
        file = nodeid.split("::")[0]
        return file if shares_fixtures(self.config.rootpath / file) else nodeid
