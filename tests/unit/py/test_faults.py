"""What the simulator can be told to do wrong, and what it says of that."""

import dataclasses
from pathlib import Path

import pytest
from lightprobe.cli.main import app
from lightprobe.sim import faults
from lightprobe.sim.box import Box
from lightprobe.sim.osc.faults import OscFaults
from typer.testing import CliRunner


@pytest.mark.parametrize("kind", [faults.Faults, OscFaults])
def test_every_fault_says_what_it_does_and_takes_what_a_healthy_camera_has(
    kind: type[faults.PictureFaults],
) -> None:
    healthy = kind()
    for one in dataclasses.fields(kind):
        assert one.metadata["means"]
        value = getattr(healthy, one.name)
        assert healthy.merged(f"{one.name}={value}") == healthy


def test_all_are_listed() -> None:
    done = CliRunner().invoke(app, ["simulate", "--help-faults"])
    assert done.exit_code == 0
    said = done.stdout
    named = {line.split("=")[0].strip() for line in said.splitlines() if line.startswith("  ")}
    cameras = (faults.Faults, OscFaults)
    assert named == {one.name for kind in cameras for one in dataclasses.fields(kind)} | set(
        faults.BOX
    )
    assert "share of frames lost before the link" in said
    assert "the servo does not turn" in said


def test_the_box_knows_its_faults(tmp_path: Path) -> None:
    with Box("host", tmp_path / "mcu", lock_step=True) as box:
        assert set(faults.BOX) <= set(box.names)
        for name, (healthy, _) in faults.BOX.items():
            if name != "reset":  # an event, not a state
                assert box.get(name) == healthy, name
