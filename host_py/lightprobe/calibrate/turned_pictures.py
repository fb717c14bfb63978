"""How a camera of known lens was turned between pictures of one place, by what they show.

Features (SIFT, Lowe 2004) of neighbours are paired, and the rotation that most pairs agree on is
taken (RANSAC): things near the camera and things that move are outvoted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array, cross
from lightprobe.imaging.camera import Camera

Codes = NDArray[np.uint8]
#: Directions (N, 3) of features, and their descriptors (N, 128).
Features = tuple[Array, NDArray[np.float32]]
#: Features are looked for in pictures of at most this width; that is exact enough for turns.
_WIDTH_PX = 1280
_MOST_FEATURES = 3000
_RATIO = 0.75  # Lowe's: the best match is so much nearer than the second
#: Pairs that agree on a rotation within so much; at least so many must.
_AGREE_DEG, LEAST_PAIRS = 0.7, 12
_TRIALS = 400
#: A picture is compared with so many before it, and only then with all others.
_COMPARED = 3


class TurnError(LightprobeError):
    """Pictures that do not tell how the camera was turned; says why, and what to do."""


def rotations(
    pictures: Sequence[Codes], camera: Camera, names: Sequence[str]
) -> tuple[list[int], list[Array]]:
    """Which pictures (H, W, 3) tell it, and from the probe frame of each of them to the first's.

    Gives their numbers, and a rotation (3, 3) for each.

    A picture that shows too little, as of a plain wall, is left out. Those after it are compared
    with all others: the camera may have come around to what it saw before. `names`: of the
    pictures, for messages. Raises :class:`TurnError` where more than half show too little.
    """
    seen = [_features(picture, camera) for picture in pictures]
    turned = {0: np.eye(3)}
    left = list(range(1, len(pictures)))
    failed: dict[int, tuple[int, int]] = {}
    count = 0
    while count != len(turned):
        count = len(turned)
        for number in left:
            turn, with_number, pairs = _turn_by(turned, seen, number)
            if turn is None:
                failed[number] = with_number, pairs
            else:
                turned[number] = turn
        left = [number for number in left if number not in turned]
    if 2 * len(left) > len(pictures):
        first = left[0]
        other, pairs = failed[first]
        raise TurnError(
            f"calibrate: {names[first]}: turn: only {pairs} things are seen in it and in "
            f"{names[other]}, at least {LEAST_PAIRS} are needed, and so it is with {len(left)} of "
            f"{len(pictures)} pictures: turn less from picture to picture (about 15 degrees), hold "
            "still, and show a room with detail"
        )
    numbers = sorted(turned)
    return numbers, [turned[number] for number in numbers]


def _turn_by(
    turned: Mapping[int, Array], seen: Sequence[Features], number: int
) -> tuple[Array | None, int, int]:
    """Rotation of a picture by others that show the same: one of its neighbours, else the best.

    Also the other's number, and how many things are seen in both; of none, the best is told.
    """
    nearest = sorted(turned, key=lambda other: abs(number - other))
    best: tuple[Array | None, int, int] = (None, nearest[0], 0)
    for place, other in enumerate(nearest):
        between, pairs = _between(seen[other], seen[number], seed=number)
        if between is not None and (best[0] is None or pairs > best[2]):
            best = turned[other] @ between, other, pairs
        elif best[0] is None and pairs > best[2]:
            best = None, other, pairs
        if best[0] is not None and place < _COMPARED:
            break
    return best


def _features(picture: Codes, camera: Camera) -> Features:
    """Directions (N, 3) of features, and their descriptors (N, 128)."""
    scale = min(1.0, _WIDTH_PX / picture.shape[1])
    size_px = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    grey = cv2.cvtColor(
        cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY
    )
    directions, illumination = camera.look(*size_px)
    inside = cv2.erode((illumination > 0).astype(np.uint8), np.ones((17, 17), np.uint8))
    finder = cv2.SIFT.create(nfeatures=_MOST_FEATURES, contrastThreshold=0.01)
    points, descriptors = finder.detectAndCompute(grey, inside)
    if descriptors is None:
        return np.zeros((0, 3)), np.zeros((0, 128), np.float32)
    places = np.array([point.pt for point in points], np.float32)
    seen = cv2.remap(
        np.nan_to_num(directions).astype(np.float32), places[:, :1], places[:, 1:],
        cv2.INTER_LINEAR,
    )[:, 0]  # fmt: skip
    length = np.linalg.norm(seen, axis=1, keepdims=True)
    return (seen / np.maximum(length, 1e-9)).astype(np.float64), descriptors.astype(np.float32)


def _between(before: Features, now: Features, seed: int) -> tuple[Array | None, int]:
    """Rotation (3, 3) that takes directions now to those before, and how many pairs agree."""
    if min(len(before[0]), len(now[0])) < 2:
        return None, 0
    matches = cv2.BFMatcher().knnMatch(now[1], before[1], k=2)
    pairs = [(m.queryIdx, m.trainIdx) for m, n in matches if m.distance < _RATIO * n.distance]
    if len(pairs) < LEAST_PAIRS:
        return None, len(pairs)
    after, first = now[0][[a for a, _ in pairs]], before[0][[b for _, b in pairs]]
    agree = _agreeing(after, first, np.random.default_rng(seed))
    turn = np.eye(3)
    for _ in range(2):
        if agree.sum() < LEAST_PAIRS:
            return None, int(agree.sum())
        turn = _turn(after[agree], first[agree])
        agree = _agree(turn, after, first)
    return turn, int(agree.sum())


def _agreeing(after: Array, first: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which pairs (N, 3), (N, 3) agree on the rotation that two of them tell: the most of any."""
    best = np.zeros(len(after), bool)
    for _ in range(_TRIALS):
        one, other = rng.choice(len(after), 2, replace=False)
        agree = _agree(_frame(first[one], first[other]) @ _frame(after[one], after[other]).T,
                       after, first)  # fmt: skip
        if agree.sum() > best.sum():
            best = agree
    return best


def _agree(turn: Array, after: Array, first: Array) -> NDArray[np.bool_]:
    cosine = np.einsum("ni,ni->n", after @ turn.T, first)
    return np.asarray(cosine > np.cos(np.radians(_AGREE_DEG)))


def _frame(one: Array, other: Array) -> Array:
    """An orthogonal frame (3, 3) by two directions."""
    across = cross(one, other)
    across /= max(float(np.linalg.norm(across)), 1e-9)
    return np.column_stack([one, across, cross(one, across)])


def _turn(after: Array, first: Array) -> Array:
    """The rotation that takes directions to others with the least squares (Kabsch 1976)."""
    left, _, right = np.linalg.svd(first.T @ after)
    sign = np.sign(np.linalg.det(left @ right))
    return np.asarray(left @ np.diag([1, 1, sign]) @ right)
