"""`lightprobe field`: two daemons in one simulated room, joined; truth is the room itself."""

import json
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from harness import LONG_S, Daemon, pfm
from lightprobe import geometry
from lightprobe.client import Client
from lightprobe.sim.room import Room
from lightprobe.wire import Subscription

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
ROOM = Room()
SECOND = (0.9, 0.1, -0.4)  # where the second probe stands
QUARTERS = 1  # and how it is turned: by so many quarters to the left
EXACT = ("--place-sigma", "0.002", "--level-sigma", "0.1")
STATED_DEG = 90 * QUARTERS - 4  # as somebody measured it


def picture(place_m, quarters=0):
    """Give a panorama of the room from a place, by a camera that is turned to the left."""
    here = ROOM.seen_from(place_m)
    radiance = here.render(512, 256).compose(np.ones(len(ROOM.bulbs)))
    return np.roll(radiance, 128 * quarters, axis=1)


@contextmanager
def probes(folder):
    """Start a probe at the origin and one beside it; gives their words for the command."""
    (folder / "a.pfm").write_bytes(pfm(picture((0, 0, 0))))
    (folder / "b.pfm").write_bytes(pfm(picture(SECOND, QUARTERS)))
    with (
        Daemon(f"--source=file:{folder}/a.pfm?rate=5") as first,
        Daemon(f"--source=file:{folder}/b.pfm?rate=5") as second,
    ):
        place = ",".join(map(str, SECOND))
        yield f"unix:{first.socket}@0,0,0", f"unix:{second.socket}@{place},{STATED_DEG}"


def field(*words):
    return subprocess.run(
        [LIGHTPROBE, "field", *map(str, words)], capture_output=True, text=True, timeout=LONG_S
    )


def test_lamps_are_where_they_hang(tmp_path):
    bulbs = np.array([bulb.position_m for bulb in ROOM.bulbs])
    with probes(tmp_path) as words:
        command = [LIGHTPROBE, "field", *words, "--json", *EXACT]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as joining:
            try:
                ends_s, places = time.monotonic() + LONG_S, []
                while len(places) < 3:
                    shape = json.loads(joining.stdout.readline())
                    places = [(one, one["place_m"]) for one in shape["lights"] if one["place_m"]]
                    assert time.monotonic() < ends_s, shape
            finally:
                joining.terminate()
    assert not shape["contradicts"]
    assert abs(shape["probes"][1]["yaw_deg"] - 90 * QUARTERS) < 1  # it was told 4 degrees less
    for light, place_m in places:
        off_m = np.linalg.norm(bulbs - place_m, axis=1).min()
        assert off_m < 0.1
        assert off_m < 3.5 * max(light["distance_sigma"] * light["distance_m"], 0.005)


def test_shadows_half_a_metre_away_fall_as_there(tmp_path):
    """Through the published packets, and the client's `at`; without, they are 10 degrees off."""
    offset_m = (0.3, -0.3, 0.25)
    with probes(tmp_path) as words:
        command = [LIGHTPROBE, "field", *words, "--publish", "tcp:127.0.0.1:0", *EXACT]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              text=True) as served:  # fmt: skip
            try:
                address = served.stderr.readline().split(" on ")[1].strip()
                with Client(address, Subscription(max_lights=4, sh_order=4)) as client:
                    ends_s = time.monotonic() + LONG_S
                    for estimate in client.estimates():
                        known = [light.distance_m for light in estimate.lights].count(None) <= 1
                        if len(estimate.lights) == 4 and known and estimate.room:
                            break
                        assert time.monotonic() < ends_s, (estimate.lights, estimate.room)
            finally:
                served.terminate()
    true = [lamp.direction for lamp in ROOM.seen_from(offset_m).lamps]
    there = estimate.at(offset_m)
    placed = [light.direction for light in there.lights if light.distance_m is not None]
    offs = [off for _, _, off in geometry.match_directions(true, placed)]
    assert len(offs) >= 3
    assert max(offs) < 2
    assert np.median(offs) < 0.5
    assert there.relighting_sigma is None or there.relighting_sigma > estimate.relighting_sigma


def test_without_the_second_probe_the_light_comes_and_says_who_is_silent(tmp_path):
    (tmp_path / "a.pfm").write_bytes(pfm(picture((0, 0, 0))))
    with Daemon(f"--source=file:{tmp_path}/a.pfm?rate=5") as first:
        done = field(f"unix:{first.socket}@0,0,0", f"unix:{tmp_path}/none@1,0,0", "--count", 3)
    assert done.returncode == 0, done.stderr
    assert f"no light from unix:{tmp_path}/none" in done.stdout


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["tcp:a:1@0,0,0"], "expected two or more"),
        (["tcp:a:1@0,0,0", "tcp:b:1"], "tcp:b:1: expected ADDRESS@X,Y,Z"),
        (["tcp:a:1@0,0,0", "tcp:b:1@1,2"], "expected ADDRESS@X,Y,Z"),
        (["tcp:a:1@0,0,0", "tcp:b:1@1,2,nan"], "expected ADDRESS@X,Y,Z"),
        (["tcp:a:1@0,0,0", "tcp:b:1@0,0,0.01"], "put them apart"),
        (["tcp:a:1@0,0,0", "nonsense@1,0,0"], "nonsense"),
        (["tcp:a:1@0,0,0", "tcp:b:1@1,0,0", "--publish", "tcp:0.0.0.0:1"], "this machine only"),
    ],
)
def test_what_cannot_be_is_refused(words, told):
    done = field(*words)
    assert done.returncode in (1, 2)
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_a_first_probe_that_is_not_there_is_an_error(tmp_path):
    done = field(f"unix:{tmp_path}/a@0,0,0", f"unix:{tmp_path}/b@1,0,0", "--seconds", 2)
    assert done.returncode == 1
    assert f"unix:{tmp_path}/a" in done.stderr
