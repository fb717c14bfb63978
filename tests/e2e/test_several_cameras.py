"""Several cameras in one box, one map: two fisheye modules back to back, in simulated time."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import run
from lightprobe import geometry
from lightprobe.calibrate.camera_file import edited
from lightprobe.daemon import estimate_once
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.evaluate.metrics import relighting
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

pytestmark = pytest.mark.many_frames

CAMERAS = Path(__file__).parents[2] / "packaging" / "cameras"
AHEAD, BACK = CAMERAS / "module_ahead.camera", CAMERAS / "module_back.camera"
FILES = (f"--camera={AHEAD}", f"--camera={BACK}")
ALL = Subscription(smoothing="RAW", max_lights=8, sh_order=4, health_period_ms=1000)
LATER_S = 0.008
NORMALS = geometry.sphere_normals()


def probe(world: World, arguments: tuple[str, ...] = (), **later: Any) -> LiveProbe:
    """Two modules; `later`: what is different of the one that looks back."""
    ahead = SimulatedCamera(world, lenses.load(str(AHEAD)), (520, 520))
    back = SimulatedCamera(
        world,
        lenses.load(str(BACK)),
        (520, 520),
        **{"phase_s": LATER_S, "seed": 1} | later,
    )
    return LiveProbe(ahead, [*FILES, *arguments], others=[back])


def room(**behaviour: Any) -> World:
    return World(scenes.load(["room"]), Behaviour(act_s=0, **behaviour), 4.0)


@cache
def true_irradiance(scene: Scene) -> Array:
    """Of NORMALS, with all lamps on."""
    return scene.truth(np.ones(len(scene.lamps))).irradiance(NORMALS)


def error(world: World, estimate: Estimate) -> float:
    """Relighting error of a probe that has not been turned."""
    (scene,) = world.scenes
    return relighting(true_irradiance(scene), estimate.irradiance(NORMALS))[0]


def test_two_fisheyes_make_a_sphere() -> None:
    world = room()
    with probe(world) as running:
        client = running.client(ALL)
        running.run(3.0)
        last = client.estimates[-60:]
        assert all(e.flags == 0 for e in last)
        assert max(error(world, e) for e in last) < 0.02
        assert {len(e.lights) for e in last} == {4}
        # each frame of either is an observation at its own time
        steps = np.diff([e.capture_time_unix_ns for e in last]) / 1e6
        assert len(client.estimates) > 170
        assert np.unique(np.rint(steps)).size > 1


def test_one_is_unplugged_and_comes_back() -> None:
    world = room()
    with probe(world) as running:
        client = running.client(ALL)
        (link,) = running.other_links
        running.run(3.0)
        before = len(client.estimates)
        link.close()
        running.run(2.0)
        alone = client.estimates[before + 6 :]
        assert len(alone) > 50  # the other one goes on
        assert all(e.flags & EstimateFlag.PARTIAL_VIEW for e in alone)
        # what it has shown stays, less and less certain
        assert max(error(world, e) for e in alone) < 0.02
        sigmas = [e.relighting_sigma or 0.0 for e in alone]
        assert sigmas[-1] > sigmas[0] > 0.03
        health = client.health
        assert health is not None
        assert health.source_state == "STREAMING"
        (fault,) = health.faults
        assert fault.id == "source-waiting"
        assert str(link.path) in fault.text
        link.listen()
        running.run(5.0)
        assert client.estimates[-1].flags == 0
        assert error(world, client.estimates[-1]) < 0.02
        assert client.health is not None
        assert not client.health.faults
        assert client.health.source_reconnects == 1


@pytest.mark.nightly
def test_the_first_one_may_be_away_too() -> None:
    world = room()
    with probe(world) as running:
        client = running.client(ALL)
        running.run(3.0)
        running.link.close()
        before = len(client.estimates)
        running.run(2.0)
        alone = client.estimates[before + 6 :]
        assert len(alone) > 50
        assert all(e.flags & EstimateFlag.PARTIAL_VIEW for e in alone)
        assert max(error(world, e) for e in alone) < 0.02
        assert client.health is not None
        assert client.health.source_state == "STREAMING"


def test_cameras_of_different_rates() -> None:
    world = room()
    with probe(world, rate_hz=12.0) as running:
        client = running.client(ALL)
        running.run(4.0)
        last = client.estimates[-80:]
        assert all(e.flags == 0 for e in last)
        assert max(error(world, e) for e in last) < 0.02
        times_ns = [e.capture_time_unix_ns for e in client.estimates]
        seconds = (times_ns[-1] - times_ns[0]) / 1e9
        assert seconds > 3.7  # the first frame of either ends after one of its periods
        assert len(times_ns) == pytest.approx(seconds * (30 + 12), abs=3)


@pytest.mark.nightly
@pytest.mark.parametrize("rate_hz", [30.0, 15.0])
def test_while_they_turn(rate_hz: float) -> None:
    world = room(turn_deg_s=30.0)
    with probe(world, rate_hz=rate_hz) as running:
        client = running.client(ALL)
        running.run(4.0)
        (scene,) = world.scenes
        assert len(client.estimates) == pytest.approx(4 * (30 + rate_hz), abs=8)
        for e in client.estimates[-60:]:
            rotation = world.rotation(running.captured_s(e))
            truth = scene.truth(np.ones(len(scene.lamps)), rotation).irradiance(NORMALS[::4])
            assert relighting(truth, e.irradiance(NORMALS[::4]))[0] < 0.02


def of_rig(folder: Path, name: str, rig: str, number: int) -> str:
    """Option of a camera file of a rig."""
    path = folder / f"{name}.camera"
    values = {"id": rig, "camera": str(number), "sigma_deg": "0.2"}
    path.write_text(edited((CAMERAS / f"module_{name}.camera").read_text(), "rig", values))
    return f"--camera={path}"


def test_camera_files_of_different_rigs_are_refused(tmp_path: Path) -> None:
    sources = ("--source=sim:/a", "--source=sim:/b")
    ahead, back = (
        of_rig(tmp_path, "ahead", "1a2b", 1),
        of_rig(tmp_path, "back", "3c4d", 2),
    )
    cases = [
        ((ahead, back), "back.camera: rig: of rig 3c4d, but "),
        ((ahead, FILES[1]), "module_back.camera: rig: has no [rig], but "),
        ((FILES[0], back), "module_ahead.camera: rig: has no [rig], but "),
    ]
    for files, message in cases:
        status, _, log = run(*sources, *files)
        assert status == 2
        assert message in log, log
        assert "run lightprobe calibrate rig" in log
    again = of_rig(tmp_path, "back", "1a2b", 1)
    status, _, log = run(*sources, ahead, again)
    assert status == 2
    assert "back.camera: rig: camera 1 of rig 1a2b, as is " in log, log


def test_lamps_are_as_uncertain_as_the_rig(tmp_path: Path) -> None:
    files = of_rig(tmp_path, "ahead", "1a2b", 1), of_rig(tmp_path, "back", "1a2b", 2)
    camera, other = (
        SimulatedCamera(room(), lenses.load(str(lens)), (520, 520)) for lens in (AHEAD, BACK)
    )
    with LiveProbe(camera, files, others=[other]) as running:
        client = running.client(ALL)
        running.run(1.5)
        lights = client.estimates[-1].lights
        assert lights
        assert all((light.direction_sigma_deg or 0) >= 0.2 for light in lights)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("--source=sim:/a", "--source=sim:/b", f"--camera={AHEAD}"),
            "sim:/b: --camera: 2 sources, but 1 camera files — name one for each --source",
        ),
        (
            ("--source=sim:/a", f"--camera={AHEAD}", f"--camera={BACK}"),
            f"{BACK}: --camera: 2 camera files for 1 sources — name one for each --source",
        ),
        (
            ("--source=sim:/a", "--source=sim:/a", *FILES),
            "sim:/a: --source: is named twice — each --source is a camera of its own",
        ),
        (
            ("--source=sim:/a", "--source=sim:/b", "--polarizer=fixed:0", *FILES),
            "--rotator: a polarizer needs one camera",
        ),
        (
            tuple(f"--source=sim:/{k}" for k in range(5)),
            "source: 'sim:/4' is not a URI, at most four of them",
        ),
        (
            ("--source=sim:/a", "--source=sim:/b", "--series=x", *FILES),
            "--series: needs one --source",
        ),
    ],
)
def test_command_lines_that_make_no_sense(arguments: tuple[str, ...], message: str) -> None:
    status, _, log = run(*arguments)
    assert status == 2
    assert message in log, log


def test_once_takes_the_pictures_of_every_camera(tmp_path: Path) -> None:
    world = room()
    for name, lens in (("ahead", AHEAD), ("back", BACK)):
        camera = SimulatedCamera(world, lenses.load(str(lens)), (520, 520))
        shot = camera.automatic(0)[0]
        (tmp_path / f"{name}.jpg").write_bytes(camera.frame(0, shot))
    sources = [f"--source=file:{tmp_path / name}.jpg" for name in ("ahead", "back")]
    both, _ = estimate_once([*sources, *FILES])
    assert not both.flags & EstimateFlag.PARTIAL_VIEW
    one, _ = estimate_once([sources[0], FILES[0]])
    assert one.flags & EstimateFlag.PARTIAL_VIEW
