"""Does the camera change its exposure in the midst of a picture?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import Frame
from lightprobe.calibrate.flat_patches import block_means
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.check_camera.scene import GREEN

QUESTION = "torn pictures"
#: Codes by which a place differs between two exposures, at least, to tell them apart.
_APART_CODES = 20.0
#: Places of a row of blocks that tell, at least; rows on either side of a tear, at least.
_PLACES, _ROWS = 6, 2
#: Share of a row's places that have one of the two exposures: the row has it.
_MOST = 0.9
#: Share of the changes that must be torn, and how many must be seen.
_OFTEN, _LEAST_SEEN = 0.5, 3


def _codes(frame: Frame) -> NDArray[np.float32] | None:
    """Mean green codes of blocks; None: the frame is broken."""
    picture = frame.codes()
    return None if picture is None else block_means(picture[..., GREEN].astype(np.float32))


def torn_share(
    before: NDArray[np.float32], after: NDArray[np.float32], seen: NDArray[np.float32]
) -> float | None:
    """Share of the rows of `seen` that are as in `before`, above others that are as in `after`.

    0: it has one exposure, or comes from one to the other everywhere. None: it cannot be told, or
    nothing is as in `after` yet.
    """
    tells = np.abs(after - before) > _APART_CODES
    old = tells & (np.abs(seen - before) < np.abs(seen - after))
    count = tells.sum(axis=1)
    rows = np.flatnonzero(count >= _PLACES)
    share = old.sum(axis=1)[rows] / count[rows]
    new = share < 1 - _MOST
    if len(rows) < 2 * _ROWS or not new.any():
        return None
    first = int(np.argmax(new))
    if min(first, len(rows) - first) < _ROWS or not new[first:].all():
        return 0.0
    # The row in which the picture is torn belongs to neither.
    return float(rows[first]) / len(seen) if np.all(share[: first - 1] > _MOST) else 0.0


def _changes(groups: Sequence[Sequence[Frame]]) -> Iterator[float]:
    """What the frame shows with which each command takes effect."""
    for before, after in pairwise(groups):
        ends = _codes(before[-1]), _codes(after[-1])
        if ends[0] is None or ends[1] is None or ends[0].shape != ends[1].shape:
            continue
        for frame in after:
            seen = _codes(frame)
            share = None
            if seen is not None and seen.shape == ends[0].shape:
                share = torn_share(ends[0], ends[1], seen)
            if share is not None:
                yield share
                break


def judge(groups: Sequence[Sequence[Frame]]) -> Answer:
    """Look at the frames of each command, in their order."""
    shares = np.array(list(_changes(groups)))
    if len(shares) < _LEAST_SEEN:
        return Answer(
            QUESTION, Outcome.UNKNOWN, "because too few changes of the exposure were seen",
            "a room with more light, or more frames for each exposure",
        )  # fmt: skip
    torn = shares[shares > 0]
    numbers = {"changes_seen": float(len(shares)), "torn": float(len(torn))}
    if len(torn) < _OFTEN * len(shares):
        return Answer(QUESTION, Outcome.FINE, "each picture has one exposure", numbers=numbers)
    numbers["share_of_rows"] = float(np.median(torn))
    words = (
        "pictures of two exposures (where it changes, the first "
        f"{100 * numbers['share_of_rows']:.0f} % of the rows still have the one before)"
    )
    return Answer(
        QUESTION, Outcome.UNFIT, words,
        "another picture size or rate; or one exposure only: lightprobed --exposure-us",
        numbers,
    )  # fmt: skip
