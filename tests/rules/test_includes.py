"""What check_includes.py finds."""

from pathlib import Path

import check_includes
import pytest


@pytest.fixture
def daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a daemon's sources could be."""
    monkeypatch.setattr(check_includes, "ROOT", tmp_path)
    return tmp_path / "daemon"


def source(daemon: Path, name: str, *included: str) -> Path:
    """Write a file of the daemon."""
    path = daemon / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f'#include "{other}"\n' for other in included))
    return path


@pytest.mark.parametrize(
    ("includer", "included"),
    [
        ("light/math/a.c", "light/lamps/b.h"),
        ("light/lamps/a.c", "vision/b.h"),
        ("vision/map/a.cpp", "estimate/b.h"),
        ("estimate/a.c", "serve/b.h"),
        ("serve/a.c", "estimate/pipeline.h"),
        ("serve/a.c", "drivers/publisher/clients.h"),
        ("drivers/ring/a.c", "light/math/b.h"),
        ("drivers/ring/a.c", "drivers/wheel/b.h"),
    ],
)
def test_what_a_room_must_not_know_is_found(daemon: Path, includer: str, included: str) -> None:
    source(daemon, included)
    assert len(check_includes.faults_of(source(daemon, includer, included))) == 1


@pytest.mark.parametrize(
    ("includer", "included"),
    [
        ("light/lamps/a.c", "light/math/b.h"),
        ("estimate/a.c", "vision/map/b.h"),
        ("serve/a.c", "estimate/estimates.h"),
        ("serve/a.c", "drivers/publisher/places.h"),
        ("app/run/a.c", "serve/b.h"),
    ],
)
def test_what_it_may_know_is_no_fault(daemon: Path, includer: str, included: str) -> None:
    source(daemon, included)
    assert check_includes.faults_of(source(daemon, includer, included)) == []


def test_a_crowded_room_is_found(daemon: Path) -> None:
    files = [source(daemon, f"vision/map/{n}.c") for n in range(13)]
    drivers = [source(daemon, f"drivers/source/{n}.c") for n in range(13)]
    assert check_includes.crowded(files[1:] + drivers) == []
    (said,) = check_includes.crowded(files)
    assert said.startswith("daemon/vision/map: 13 files")
