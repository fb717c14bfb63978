"""What a test can break, and repair."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager


class Breakable(ABC):
    """A camera or a box."""

    @abstractmethod
    def fault(self, name: str = "", /, **numbers: float) -> None:
        """Break something from now on."""

    @abstractmethod
    def heal(self) -> None:
        """Repair everything."""

    @contextmanager
    def faulty(self, name: str = "", /, **numbers: float) -> Iterator[None]:
        """Break something as :meth:`fault` does as long as the `with` block lasts."""
        self.fault(name, **numbers)
        try:
            yield
        finally:
            self.heal()
