# SPDX-License-Identifier: Apache-2.0
"""A table with the printed marker on it, as a phone sees it, and what lightprobe.local makes of it.

    table.py picture FILE.y4m    a film of the table, for Chromium's simulated camera
    table.py pictures            for each pose on standard input: the picture, and the pose
    table.py ground              texels of the ground, factors, and radiance along rays

Poses: [eye x, y, z, target x, y, z]; the marker's edge is 0.4. JSON comes on standard input and
goes to standard output.
"""

import base64
import json
import sys
from typing import Any

import cv2
import numpy as np
from lightprobe import local
from lightprobe.align.marker import draw
from lightprobe.colour import linear_to_srgb, srgb_to_linear
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.geometry import Array, normalize
from lightprobe.reflection_map import ReflectionMap

EDGE_M = 0.4  # of the marker's black square
SIZE_PX = (640, 480)
FIELD_DEG = 65.0
PAPER_PX = 600  # the same edge
FINE = 3  # points along each edge of a pixel
POSE = [0.5, 0.9, 1.3, 0.1, 0.0, -0.1]


def camera(pose: list[float], fine: int = 1) -> local.ArCamera:
    """A pinhole, of pictures `fine` times as large."""
    eye, target = np.array(pose[:3]), np.array(pose[3:])
    forward = normalize(target - eye)
    right = normalize(np.cross(forward, [0, 1, 0]))
    width, height = (fine * n for n in SIZE_PX)
    focal = width / 2 / np.tan(np.radians(FIELD_DEG / 2))
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return local.ArCamera(matrix, np.stack([right, np.cross(forward, right), forward], axis=1), eye)


def seen(pose: list[float], *, with_marker: bool = True) -> Array:
    """The picture (H, W, 3), sRGB 0…255: a coloured table, a grey wall above the horizon."""
    phone = camera(pose, FINE)
    width, height = (FINE * n for n in SIZE_PX)
    y, x = np.mgrid[0:height, 0:width] + 0.5
    rays = (
        np.stack([x, y, np.ones_like(x)], axis=-1)
        @ np.linalg.inv(phone.matrix).T
        @ phone.rotation.T
    )
    down = rays[..., 1] < -1e-6
    along = np.where(down, -phone.place_m[1] / np.where(down, rays[..., 1], 1), 0)
    place = phone.place_m + along[..., None] * rays
    slope = np.stack(
        [0.3 + 0.1 * np.tanh(place[..., 0]), 0.25 + 0.1 * np.tanh(place[..., 2]), 0.2 + 0 * x],
        axis=-1,
    )
    light = np.where(down[..., None], slope, 0.4)
    paper = draw(7, 600) / 255.0
    module = 600 // 6
    column = (place[..., 0] / EDGE_M + 0.5) * 600 + (paper.shape[1] - 600) / 2
    row = (place[..., 2] / EDGE_M + 0.5) * 600 + (paper.shape[0] - 600) / 2
    on_paper = (
        down & (column >= 0) & (row >= 0) & (column < paper.shape[1]) & (row < paper.shape[0])
    )
    assert module * 6 == 600
    if with_marker:
        light[on_paper] = (
            0.02 + 0.7 * paper[row[on_paper].astype(int), column[on_paper].astype(int), None]
        )
    small = light.reshape(SIZE_PX[1], FINE, SIZE_PX[0], FINE, 3).mean(axis=(1, 3))
    return np.rint(255 * linear_to_srgb(small)).astype(np.uint8)


def rgba(picture: Array) -> str:
    """Bytes of a canvas, base64."""
    whole = np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
    return base64.b64encode(whole.tobytes()).decode()


def film(name: str) -> None:
    """Two frames of the same picture: YUV4MPEG2, 4:2:0."""
    planes = cv2.cvtColor(seen(POSE), cv2.COLOR_RGB2YUV_I420).tobytes()
    with open(name, "wb") as file:
        file.write(f"YUV4MPEG2 W{SIZE_PX[0]} H{SIZE_PX[1]} F15:1 Ip A1:1 C420jpeg\n".encode())
        file.write(2 * (b"FRAME\n" + planes))


def pose_of(pose: list[float]) -> dict[str, Any]:
    """Where three.js' camera is: place and axes."""
    phone = camera(pose)
    right, down, forward = phone.rotation.T
    return {
        "place": phone.place_m.tolist(),
        "right": right.tolist(),
        "up": (-down).tolist(),
        "back": (-forward).tolist(),
    }


def ground(asked: dict[str, Any]) -> dict[str, Any]:
    """Texels, factors and radiance by lightprobe.local."""
    picture = seen(POSE, with_marker=False)  # smooth: the number of points per texel does not show
    linear = srgb_to_linear(picture / 255)
    square = local.sample(linear, camera(POSE), [0, 0, 0], asked["side"], 64)
    faces = np.reshape(
        asked["map"]["faces"], (6, asked["map"]["size"], asked["map"]["size"], 3)
    ).astype(np.float32)
    around = ReflectionMap(1, 1, 0, 1, "AMBIENT", faces)
    coefficients = np.reshape(asked["coefficients"], (-1, 3))
    harmonics = SphericalHarmonics("AMBIENT", int(np.sqrt(len(coefficients))) - 1, coefficients)
    estimate = Estimate(0, 1, 0, 0, 0, EstimateFlag(0), (), harmonics, None, None, 1, None)
    mean = square.mean().mean()
    by_map = local.by_reflection_map(square, around, [0, asked["probe"], 0])
    radiance = local.radiance(by_map, around, asked["points"], asked["towards"])
    return {
        "texels": square.radiance.tolist(),
        "seen": square.seen.tolist(),
        "picture": rgba(picture),
        "pose": pose_of(POSE),
        "albedo": float(local.by_albedo(square, estimate).mean().mean() / mean),
        "byMap": float(by_map.mean().mean() / mean),
        "radiance": radiance.tolist(),
    }


def main() -> None:
    """Do what the first word says."""
    if sys.argv[1] == "picture":
        film(sys.argv[2])
    elif sys.argv[1] == "pictures":
        poses = json.load(sys.stdin)
        json.dump([pose_of(pose) | {"picture": rgba(seen(pose))} for pose in poses], sys.stdout)
    else:
        json.dump(ground(json.load(sys.stdin)), sys.stdout)


if __name__ == "__main__":
    main()
