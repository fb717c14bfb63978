# SPDX-License-Identifier: Apache-2.0
"""Levels of a reflection map by lightprobe.imaging.cube: what ggx.test.ts compares with.

Reads JSON on standard input: `size`, `faces` (all numbers in a row), `count`. Writes a list of
numbers per level.
"""

import json
import sys

import numpy as np
from lightprobe.imaging.cube import ggx_levels

if __name__ == "__main__":
    given = json.load(sys.stdin)
    faces = np.float32(given["faces"]).reshape(6, given["size"], given["size"], 3)
    levels = ggx_levels(faces, given["count"])
    json.dump([level.ravel().tolist() for level in levels], sys.stdout)
