# SPDX-License-Identifier: Apache-2.0
"""A series of exposures: the index up to a zero byte, then the bytes of every frame's file."""

import tempfile
from contextlib import suppress
from pathlib import Path

from lightprobe.calibrate import exposure_series
from lightprobe.errors import LightprobeError

# In memory where there is such a folder: a disk would make it five times slower.
_MEMORY = Path("/dev/shm")
_FOLDER = tempfile.TemporaryDirectory("lp-fuzz-series", dir=_MEMORY if _MEMORY.is_dir() else None)
#: More frames of one series are read like the first ones.
MOST_FRAMES = 4


def one_input(data: bytes) -> None:
    """Read the index and the frames; only LightprobeError may come out."""
    folder = Path(_FOLDER.name)
    index, _, frame = data.partition(b"\0")
    (folder / exposure_series.INDEX).write_bytes(index)
    (folder / "00000.raw").write_bytes(frame)
    with suppress(LightprobeError):
        series = exposure_series.load(folder)
        for shot in series.frames[:MOST_FRAMES]:
            codes = shot.codes()
            assert codes is None or (codes.ndim == 3 and codes.shape[2] == 3)
        assert sum(map(len, series.steps())) == len(series.frames)
