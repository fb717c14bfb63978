"""The daemon for ARM64 against the one for this machine: same input, same light.

Integers (JPEG coefficients, cells, flags, counts, packets' integer fields) are the same to the
bit; floats differ by the rounding of fused multiply-adds. Run by `make test-arm64`.
"""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from harness import BUILD, split
from lightprobe.evaluate.evaluation import Input
from lightprobe.imaging import image
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.sensor import Sensor, encode_jpeg

EMULATOR = os.environ.get("EMULATOR", "").split()
ARM64, HERE = BUILD / "arm64", BUILD / "release"
TIMEOUT_S = 300
#: Of the largest number of its row: float32 has 6e-8, a cell is the sum of some hundred, and five
#: pictures correct it. Measured: 5.0e-6.
TOLERANCE = 1e-5
#: The same for a packet, by the number of pictures. Several come at times of the clock, and the
#: emulator takes longer between them: what was seen before counts less. Measured: 2e-6 and 4.4e-3.
PACKET_TOLERANCE = {1: 2e-5, 3: 1e-2}
#: Random, or of the clock.
UNLIKE = {"boot_id", "capture_time_unix_ns", "send_delay_us"}
#: How integers end that are rounded: they may differ by one.
ROUNDED = "_permille"


def output(variant: Path, name: str, *arguments: str) -> bytes:
    """Run a program of a variant; returns its standard output."""
    command = [*(EMULATOR if variant == ARM64 else []), variant / name, *arguments]
    done = subprocess.run(command, capture_output=True, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def farthest(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference, relative to the largest number."""
    return float(np.abs(one - other).max() / max(np.abs(one).max(), 1e-30))


def test_it_is_an_arm64_program_and_says_its_version():
    header = (ARM64 / "bin/lightprobed").read_bytes()[:20]
    assert header[:4] == b"\x7fELF"
    assert int.from_bytes(header[18:20], "little") == 183  # EM_AARCH64
    assert b"lightprobed" in output(ARM64, "bin/lightprobed", "--version")


def test_numbers_of_every_stage():
    """JPEG blocks, cells, merge, remap, lamps, SH: see numbers.c."""
    ours = output(HERE, "tests/numbers").decode().splitlines()
    theirs = output(ARM64, "tests/numbers").decode().splitlines()
    exact = [line for line in ours if " = " in line]
    assert len(exact) > 25
    assert exact == [line for line in theirs if " = " in line]
    worst = 0.0
    for one, other in zip(ours, theirs, strict=True):
        name, _, values = one.partition(" ~ ")
        assert other.startswith(name)
        if values:
            pair = (np.array(line.split(" ~ ")[1].split(), float) for line in (one, other))
            difference = farthest(*pair)
            assert difference <= TOLERANCE, name
            worst = max(worst, difference)
    print(f"floats of the stages differ by at most {worst:.1e}")


def compare(one, other, tolerance, path="estimate"):
    """Fail where two messages differ; returns the largest difference of their floats."""
    worst = 0.0
    assert {f.name for f, _ in one.ListFields()} == {f.name for f, _ in other.ListFields()}, path
    for descriptor, value in one.ListFields():
        theirs, here = getattr(other, descriptor.name), f"{path}.{descriptor.name}"
        if descriptor.name in UNLIKE:
            continue
        if descriptor.message_type:
            repeated = descriptor.is_repeated
            pairs = zip(value, theirs, strict=True) if repeated else [(value, theirs)]
            worst = max([worst, *(compare(a, b, tolerance, here) for a, b in pairs)])
        elif descriptor.type == FieldDescriptor.TYPE_FLOAT:
            difference = farthest(np.atleast_1d(value), np.atleast_1d(theirs))
            assert difference <= tolerance, f"{here}: {value} {theirs}"
            worst = max(worst, difference)
        elif descriptor.name.endswith(ROUNDED):
            assert abs(value - theirs) <= 1, here
        else:
            assert value == theirs, here
    return worst


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Pairs of the number of pictures and the option to read them with."""
    folder = tmp_path_factory.mktemp("pictures")
    sensor, sets = Sensor(1920, 960, seed=5), []
    for number, room in enumerate([random_scene(2), random_scene(9)]):
        scene = room.render(1920, 960).compose(np.ones(len(room.lamps)))
        image.write_pfm(folder / f"{number}.pfm", scene)
        sets.append((1, f"--source=file:{folder}/{number}.pfm"))
        for how in ("1", "3"):
            shots = folder / f"{number}-{how}"
            shots.mkdir()
            exposures_us = Input.parse(how).exposures_us(scene)
            for k, exposure_us in enumerate(exposures_us):
                codes = sensor.capture(scene, exposure_us, k)
                chroma = "422" if number else "420"
                (shots / f"{k}.jpg").write_bytes(encode_jpeg(codes, 85, chroma))
            listed = ",".join(f"{us:.9g}" for us in exposures_us)
            sets.append((len(exposures_us), f"--source=file:{shots}?exposures_us={listed}"))
    return sets


@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate"])
def test_packets_of_the_same_files(pictures, preset):
    worst = 0.0
    for count, source in pictures:
        options = [source, "--once", "--publish=stdout:", f"--preset={preset}"]
        estimates = []
        for variant in (HERE, ARM64):
            messages, rest = split(output(variant, "bin/lightprobed", *options))
            assert rest == b""
            estimates.append(messages[1].estimate)
        assert len(estimates[0].sh.coefficients) > 0
        worst = max(worst, compare(*estimates, PACKET_TOLERANCE[count]))
    print(f"floats of the packets differ by at most {worst:.1e}")


#: What must be NEON in the hot path: source, function, instruction on four or two lanes, how often
#: at least. Fused multiply-adds are the arithmetic; the others show how data moves.
KERNELS = [
    ("daemon/vision/picture/cells_blocks.cpp", "lp::cells_from_blocks", r"fmla\s+v\d+\.4s", 3),
    ("daemon/vision/picture/cells_raw_blocks.cpp", "", r"smlal2?\s+v\d+\.", 4),
    ("daemon/vision/picture/cells_jpeg.cpp", "jpeg_picture::read", r"(mul|mla)\s+v\d+\.4s", 2),
    ("daemon/vision/map/radiance_map.cpp", "lp_radiance_map_observe", r"fmla\s+v\d+\.4s", 4),
    ("daemon/vision/camera/remap.cpp", "lp_remap_apply", r"fmla\s+v\d+\.4s", 1),
    ("daemon/vision/map/sh_project.cpp", "lp_sh_project", r"fmla\s+v\d+\.4s", 4),
    ("daemon/vision/exposure.cpp", "lp_exposure_rescale", r"fmul\s+v\d+\.4s", 1),
]


@pytest.mark.parametrize(("path", "function", "instruction", "least"), KERNELS)
def test_hot_kernels_are_neon(path, function, instruction, least):
    """The object file itself: what the compiler made of the universal intrinsics."""
    assert (BUILD.parent / path).is_file()  # what is left of a source that is gone is not ours
    command = ["aarch64-linux-gnu-objdump", "-dC", "--no-show-raw-insn", ARM64 / f"{path}.o"]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    bodies = [
        body
        for name, body in re.findall(r"^[0-9a-f]+ <(.*?)>:\n((?:.+\n)*)", listing, re.MULTILINE)
        if function in name
    ]
    assert bodies, f"{path}: no {function}"
    found = sum(len(re.findall(instruction, body)) for body in bodies)
    assert found >= least, f"{function}: {found} of {instruction}"
