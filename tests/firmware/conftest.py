"""Fixtures: a chip per test, ended with it."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # pytest's importlib mode does not

import rig as rigs


@pytest.fixture
def make_rig() -> Iterator[Callable[..., rigs.Rig]]:
    """Return a function that starts a chip which has said hello; all are ended after the test."""
    started = []

    def make(hello: bool = True, **options: object) -> rigs.Rig:
        rig = rigs.start(**options) if hello else rigs.Rig(**options)
        started.append(rig)
        return rig

    yield make
    for rig in started:
        rig.close()


@pytest.fixture
def rig(make_rig: Callable[..., rigs.Rig]) -> rigs.Rig:
    """Return a chip on the serial line."""
    return make_rig()


@pytest.fixture
def homed(rig: rigs.Rig) -> rigs.Rig:
    """Return a chip whose wheel is SETTLED at 0."""
    rig.home()
    assert rig.phase() == "SETTLED", rig.faults
    return rig
