"""How long the light of an object takes, for a mesh of 5000 vertices and 384 lights.

    build/venv/bin/python tests/bench/object_probe.py [--json]

Times are medians, of the processor, with one thread (OMP_NUM_THREADS=1) those of the clock, too;
they are printed, and nothing depends on them.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from contextlib import suppress

import numpy as np
from lightprobe.calibrate.lens_board import Board
from lightprobe.geometry import Array
from lightprobe.probe import object as objects
from lightprobe.probe import object_samples, paper, shadow_maps
from lightprobe.probe.kinds import ProbeError


def ring(major: int = 100, minor: int = 50) -> tuple[Array, Array, Array]:
    """Vertices (n, 3), normals and triangles of a ring that lies on the board; in squares."""
    u, v = np.meshgrid(np.arange(major), np.arange(minor), indexing="ij")
    a, b = 2 * np.pi * u.ravel() / major, 2 * np.pi * v.ravel() / minor
    out = np.stack([np.cos(a), 0 * a, np.sin(a)], axis=1)
    normals = np.cos(b)[:, None] * out + np.sin(b)[:, None] * np.array([0.0, 1, 0])
    vertices = np.array([5.0, 0.45, 4.0]) + out + 0.45 * normals
    at = np.arange(major * minor).reshape(major, minor)
    right, up = np.roll(at, -1, axis=0), np.roll(at, -1, axis=1)
    both = np.roll(right, -1, axis=1)
    quads = [np.stack([at, up, both], -1), np.stack([at, both, right], -1)]
    return vertices, normals, np.concatenate([q.reshape(-1, 3) for q in quads])


def samples() -> object_samples.Samples:
    """What a camera could see of the ring, and of the paper round it."""
    vertices, normals, triangles = ring()
    solid = object_samples.Solid(vertices, normals, triangles, 25.0)
    which, share = shadow_maps.strewn(vertices, triangles, shadow_maps.POINTS)
    surface, facing, _ = object_samples.placed(solid, which, share)
    seen = np.flatnonzero((normals[:, 1] > 0) | (normals[:, 2] > 0.3))
    seen = seen[np.linspace(0, len(seen) - 1, 1200).astype(int)]
    x, z = (part.ravel() for part in np.meshgrid(np.arange(0.1, 11, 0.33), np.arange(0.1, 8, 0.33)))
    around = np.hypot(x - 5, z - 4) > 1.5
    flat = np.stack([x, 0 * x, z], axis=1)[around]
    places = np.concatenate([vertices[seen], flat])
    up = np.tile([0.0, 1.0, 0.0], (len(flat), 1))
    of_board = np.arange(len(places)) >= len(seen)
    light = 0.3 + 0.7 * np.maximum(np.concatenate([normals[seen], up]) @ [0.48, 0.8, 0.36], 0)
    radiance = np.tile((paper.PAPER * light)[:, None], (1, 3))
    return object_samples.Samples(
        places, np.concatenate([normals[seen], up]), radiance, of_board, surface, facing
    )


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    found, board, times = samples(), Board(), []
    light = found.radiance[found.of_board] / paper.PAPER
    for _ in range(options.rounds):
        began_s = time.process_time()
        objects.transport(found, board, light)
        middle_s = time.process_time()
        with suppress(ProbeError):  # the light is made up: only the time matters
            objects.solve(found, board)
        times.append((middle_s - began_s, time.process_time() - middle_s))
    transport_s, whole_s = np.median(times, axis=0)
    told = {
        "vertices": 5000, "samples": len(found.places), "lights": 384,
        "transport_s": round(float(transport_s), 2), "whole_s": round(float(whole_s), 2),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }  # fmt: skip
    if options.json:
        print(json.dumps(told))
    else:
        print(
            f"5000 vertices, {told['samples']} samples, 384 lights: {told['whole_s']} s, of which "
            f"{told['transport_s']} s for how light reaches them; {told['peak_mb']} MB at most"
        )


if __name__ == "__main__":
    main()
