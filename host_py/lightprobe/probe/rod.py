"""The light by the shadows of an upright rod on the printed board.

A lamp's shadow ends where the way from the lamp over the rod's end meets the board, so shadow and
height give its direction. Its penumbra gives its size. How dark it is, against the paper in the
light, gives its share of the light on the board; what all shadows keep is light from everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from lightprobe.calibrate.lens_board import Board
from lightprobe.errors import UsageError
from lightprobe.geometry import Array, equirect_directions, equirect_solid_angles
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards
from lightprobe.probe import paper
from lightprobe.probe.kinds import ProbeError, Upright

#: 1 sigma of where the rod stands and of its height, in millimetres; and of its lean.
PLACE_SIGMA_MM, HEIGHT_SIGMA_MM, LEAN_SIGMA_DEG = 0.5, 0.5, 0.5
#: How much irradiance by the light from everywhere differs from that of even light above and an
#: even table below, RMS over normals and relative to the mean (a choice: with it, all pictures of
#: tests/accuracy/rods.py are within 3 sigma).
AMBIENT_SIGMA = 0.3
#: Lamps that are looked for; what a fainter one would be, the model misses of the others.
_MOST_LAMPS, _LEAST_DEPTH = 4, 0.05
#: Cells of the board at most.
_MOST_CELLS = 60_000
#: A search for shadows: directions, and the least length in diameters of the rod.
_AZIMUTHS, _SHORTEST = 360, 1.5
#: Around the rod's picture and around the borders of squares so many pixels are left out.
_EDGE_PX = 2.0
#: Neighbouring cells have errors that are alike (interpolation, print, sharpening): so many of them
#: count as one.
_ALIKE = 4.0
#: The board is seen in a place when cells of it are so near, in squares: more than a border between
#: squares hides.
_NEAR = 0.35
#: Columns of the light without lamps: level, change to the right and down, hidden sky.
_EVEN = 4
#: Smallest and largest radius of a lamp, as seen from the board.
_LEAST_RADIUS, _MOST_RADIUS = np.radians(0.05), np.radians(10.0)
#: Radii from which the search for one begins.
_RADII = np.radians([0.3, 1.0, 3.0])
#: Between lit paper and the model at most, RMS: else something else lies on the board.
_MOST_RMS = 0.15


@dataclass(frozen=True)
class Rod:
    """A rod that stands on the board; lengths in squares of it."""

    height: float
    radius: float
    place: tuple[float, float]  # of its foot, right and down from the board's upper left corner
    square_mm: float


def stand(kind: Upright, board: Board, square_mm: float) -> Rod:
    """Where a rod is on a board whose squares have such sides; raises UsageError beside it."""
    if kind.diameter_mm > square_mm:
        raise UsageError(
            f"--probe rod: a rod of {kind.diameter_mm:g} mm is wider than the board's squares of "
            f"{square_mm:g} mm: take a thinner one, or correct --square-mm"
        )
    place = kind.place or (board.columns // 2, board.rows // 2)
    if not (0 <= place[0] <= board.columns and 0 <= place[1] <= board.rows):
        raise UsageError(
            f"--probe rod: it stands at {place[0]:g},{place[1]:g}, beside the board of "
            f"{board.columns}x{board.rows} squares"
        )
    return Rod(kind.height_mm / square_mm, kind.diameter_mm / 2 / square_mm, place, square_mm)


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp by its shadow; probe frame."""

    direction: Array  # (3,) unit
    direction_sigma_deg: float
    radius_rad: float  # as seen from the rod
    share: Array  # (3,) of the irradiance of the board
    irradiance: Array  # (3,) of a surface that faces it
    irradiance_sigma: float  # relative


@dataclass(frozen=True, eq=False)
class Light:
    """Lamps, and light from everywhere above and from the board."""

    lamps: tuple[Lamp, ...]
    ambient: Array  # (3,) irradiance of the board by everything else
    board: Array  # (3,) mean radiance of the board
    left_out: float  # irradiance by lamps whose shadows leave the board, and so are in `ambient`
    notes: tuple[str, ...] = field(default=())

    def panorama(self, width: int) -> NDArray[np.float32]:
        """Radiance (width / 2, width, 3): lamps are discs of at least two pixels' radius."""
        directions = equirect_directions(width, width // 2)
        sr = np.broadcast_to(
            equirect_solid_angles(width, width // 2)[:, None], directions.shape[:2]
        )
        light = np.where(directions[..., 1:2] > 0, self.ambient / np.pi, self.board)
        for lamp in self.lamps:
            radius = max(lamp.radius_rad, 4 * np.pi / width)
            inside = directions @ lamp.direction > np.cos(radius)
            light[inside] += lamp.irradiance / sr[inside].sum()
        return np.asarray(light, np.float32)

    @property
    def relighting_sigma(self) -> float:
        """1 sigma of irradiance, mean over all normals, relative to its mean."""
        even = 2 * (self.ambient + np.pi * self.board).mean() / 4
        whole = even + sum(lamp.irradiance.mean() for lamp in self.lamps) / 4
        tipped = max(np.radians(lamp.direction_sigma_deg) for lamp in self.lamps)
        return float(np.hypot(AMBIENT_SIGMA * even / whole, tipped + self.left_out / 4 / whole))


@dataclass(frozen=True, eq=False)
class Sheet:
    """The board, seen straight from above, without its print: relative irradiance of its cells."""

    places: Array  # (N, 2) right and down from the foot of the rod, in squares
    irradiance: Array  # (N, 3) of the lit white paper's median
    level: Array  # (3,) that median, as irradiance
    weight: Array  # (N,) 1 / sigma
    blur: float  # 1 sigma of what a cell of the picture covers, in squares
    cell: float  # side of a cell, in squares
    longest: float  # of a shadow on the board, in squares
    grey: float  # what the board reflects of the light, in the mean


def sheet(
    radiance: Array, clipped: NDArray[np.bool_], pinhole: Pinhole, pose: boards.Pose,
    board: Board, rod: Rod,
) -> Sheet:  # fmt: skip
    """Take the print off the board's picture (H, W, 3); raises ProbeError where paper clips."""
    per_px = paper.squares_per_px(pinhole, pose, board)
    finest = float(np.sqrt(board.columns * board.rows / _MOST_CELLS))
    cell = max(per_px, finest, rod.radius / 5)
    across, down = (int(count / cell) for count in (board.columns, board.rows))
    x, z = np.meshgrid((np.arange(across) + 0.5) * cell, (np.arange(down) + 0.5) * cell)
    on_board = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    places_px = pinhole.places(pose.corner + on_board @ pose.rotation)
    at = (places_px - 0.5).astype(np.float32).reshape(down, across, 2)
    seen = paper.looked_up(radiance.astype(np.float32), at, 0.0)
    bad = paper.looked_up(clipped.astype(np.float32), at, 0.0) > 0
    seen_at_all = paper.looked_up(np.ones(clipped.shape, np.float32), at, 0.0) == 1
    white, black = paper.printed(board, cell, across, down, _EDGE_PX * per_px)
    used = seen_at_all & ~_behind_rod(pinhole, pose, rod, at, clipped.shape, per_px)
    if not np.any(white & used):
        raise ProbeError("no white paper of the board is seen around the rod: go nearer")
    if bad[white & used].mean() > 0.02:
        raise ProbeError(
            f"{100 * bad[white & used].mean():.0f} % of the white paper is overexposed: expose "
            "less, or add a shorter exposure"
        )
    used &= ~bad
    relative, weight = np.zeros_like(seen), np.zeros(seen.shape[:2])
    levels = []
    for part in (white & used, black & used):
        if part.sum() < 100:
            raise ProbeError("too little of the board is seen around the rod: go nearer")
        levels.append(np.median(seen[part], axis=0).astype(np.float64))
        relative[part] = seen[part] / np.maximum(levels[-1], 1e-30)
        weight[part] = 1 / max(float(_spread(relative[part])), 1e-3)
    if not np.all(levels[0] > 1.5 * levels[1]) or not np.all(levels[1] > 0):
        raise ProbeError("the board's white is hardly brighter than its black: expose it well")
    kept = weight > 0
    places = np.stack([x - rod.place[0], z - rod.place[1]], axis=-1)
    return Sheet(
        places[kept], relative[kept].astype(np.float64), levels[0] * np.pi / paper.PAPER,
        weight[kept], 0.5 * per_px, cell, float(np.hypot(board.columns, board.rows)),
        float(np.where(board.draw(8) > 127, paper.PAPER, paper.TONER).mean()),
    )  # fmt: skip


def _behind_rod(
    pinhole: Pinhole,
    pose: boards.Pose,
    rod: Rod,
    at_px: NDArray[np.float32],
    shape: tuple[int, int],
    per_px: float,
) -> NDArray[np.bool_]:
    """Which cells the rod hides from the camera, or nearly."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = rod.radius * np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1)
    foot = np.array([rod.place[0], 0, rod.place[1]])
    hull = np.concatenate([foot + ring, foot + ring + [0, rod.height, 0]])
    outline = cv2.convexHull(pinhole.places(pose.corner + hull @ pose.rotation).astype(np.float32))
    mask = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(outline - 0.5).astype(np.int32), 1)
    edge_px = 2 * _EDGE_PX + 3 * PLACE_SIGMA_MM / rod.square_mm / per_px
    side = 2 * int(edge_px) + 1
    hidden = cv2.dilate(mask, np.ones((side, side), np.uint8)).astype(np.float32)
    return np.asarray(paper.looked_up(hidden, at_px, 0.0) > 0)


def _spread(values: Array) -> float:
    """1 sigma of values (N, 3) by the median of their distance from the median."""
    bright = values.mean(axis=1)
    return float(1.4826 * np.median(np.abs(bright - np.median(bright))))


def coverage(places: Array, shadow: Array, rod: Rod, blur: float) -> Array:
    """Which share of a lamp the rod hides from places (N, 2).

    `shadow`: angle from +X towards +Z in which it falls, its length in squares, and the logarithm
    of the lamp's radius in rad. A lamp that is not tiny blurs the shadow as a disc of its radius:
    1 sigma is half of the radius.
    """
    angle, length, log_radius = shadow
    along = places @ [np.cos(angle), np.sin(angle)]
    off = places @ [-np.sin(angle), np.cos(angle)]
    way = np.hypot(length, rod.height)  # from the shadow's end to the rod's
    spread = np.exp(log_radius) / 2
    near = np.clip(along, 0, length)
    wide = np.hypot(blur, spread * near * way / length)
    # At the end the blur is longer: the board is met aslant.
    long = np.hypot(blur, spread * way * way / rod.height)
    round_end = np.sqrt(np.maximum(rod.radius**2 - off**2, 0))
    side = ndtr((off + rod.radius) / wide) - ndtr((off - rod.radius) / wide)
    return np.asarray(side * ndtr((length + round_end - along) / long) * (along > 0))


def _start(found: Sheet, left: Array, rod: Rod, foot: Array) -> tuple[float, float] | None:
    """Angle and length of the clearest shadow in what is `left` (N,) of the light; None: none."""
    places = found.places - foot
    distance, angle = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
    shortest = _SHORTEST * 2 * rod.radius
    lengths = np.arange(shortest, found.longest, rod.radius)
    best: tuple[float, float, float] | None = None
    for turn in np.linspace(-np.pi, np.pi, _AZIMUTHS, endpoint=False):
        away = (angle - turn + np.pi) % (2 * np.pi) - np.pi
        ahead = np.abs(away) < np.pi / 2
        along = distance[ahead] * np.cos(away[ahead])
        off = np.abs(distance[ahead] * np.sin(away[ahead]))
        bins = np.minimum((along / rod.radius).astype(int), len(lengths) + 8)
        weight = found.weight[ahead] ** 2
        size = len(lengths) + 9
        dark, of_dark = _sums(bins, off < 0.8 * rod.radius, left[ahead], weight, size)
        beside = (off > 1.5 * rod.radius) & (off < 4 * rod.radius)
        light, of_light = _sums(bins, beside, left[ahead], weight, size)
        known = (of_dark > 0) & (of_light > 0)
        drop = np.where(known, light / np.maximum(of_light, 1e-30)
                        - dark / np.maximum(of_dark, 1e-30), 0)  # fmt: skip
        weights = np.where(known, 1 / (1 / np.maximum(of_dark, 1e-30)
                                       + 1 / np.maximum(of_light, 1e-30)), 0)  # fmt: skip
        gain, total = np.cumsum(drop * weights), np.cumsum(weights)
        score = np.where(gain > 0, gain**2 / np.maximum(total, 1e-30), 0)
        first = int(np.ceil(shortest / rod.radius))
        at = first + int(np.argmax(score[first:]))
        if gain[at] / max(total[at], 1e-30) > _LEAST_DEPTH / 2 and (
            not best or score[at] > best[0]
        ):
            best = float(score[at]), float(turn), (at + 1) * rod.radius
    return best[1:] if best else None


def _sums(
    bins: Array, where: Array, values: Array, weight: Array, size: int
) -> tuple[Array, Array]:
    """Weighted sums of values, and of their weights, by bin."""
    of = bins[where]
    counted = (
        np.bincount(of, w, size)[:size] for w in (values[where] * weight[where], weight[where])
    )
    first, second = (np.asarray(one, np.float64) for one in counted)
    return first, second


def solve(found: Sheet, rod: Rod, pose: boards.Pose) -> Light:
    """Find the lamps by their shadows; raises ProbeError where there is none that is whole."""
    bright = found.irradiance.mean(axis=1)
    fit = _Fit(found, rod, bright)
    state = fit.of((), np.zeros(2))
    while len(state.shadows) < _MOST_LAMPS:
        start = _start(found, bright - state.model, rod, state.foot)
        if start is None:
            break
        better = fit.refined(fit.begun(state.shadows, state.foot, *start), state.foot)
        faint = better.depths.min() < max(_LEAST_DEPTH, 4 * better.depth_sigma.max())
        if faint or max(one[2] for one in better.shadows) > np.log(0.98 * _MOST_RADIUS):
            break  # what is left is no shadow, or one of light that comes from everywhere
        state = better
    if state.rms > _MOST_RMS:
        raise ProbeError(
            f"the board's light differs by {100 * state.rms:.0f} % from what the rod's shadows "
            "explain: does something else throw shadows on it, or lie on it?"
        )
    return _light(found, rod, state, pose.sigma_deg)


@dataclass(frozen=True, eq=False)
class _State:
    """Shadows, and how they fit."""

    shadows: tuple[Array, ...]
    foot: Array  # (2,) where the rod stands beside its stated place, in squares
    design: Array  # (N, _EVEN + lamps) columns: the light without lamps, shadows
    model: Array  # (N,) relative irradiance
    depths: Array  # (lamps,) share of the light that each shadow lacks
    depth_sigma: Array
    covariance: Array  # (3 lamps, 3 lamps) of the shadows
    rms: float


@dataclass(eq=False)
class _Fit:
    """Least squares of shadows on a sheet."""

    found: Sheet
    rod: Rod
    bright: Array

    def of(self, shadows: Iterable[Array], foot: Array) -> _State:
        """Level, slopes and depths are linear: solved for with these shadows."""
        design = np.concatenate([self._even, *(
            coverage(self.found.places - foot, one, self.rod, self.found.blur)[:, None]
            for one in shadows
        )], axis=1)  # fmt: skip
        weighted = design * self.found.weight[:, None]
        inverse = np.linalg.pinv(weighted.T @ weighted)
        solved = inverse @ (weighted.T @ (self.bright * self.found.weight))
        model = design @ solved
        off = (self.bright - model) * self.found.weight
        rms = float(np.sqrt((off @ off) / (self.found.weight @ self.found.weight)))
        level, size = max(float(solved[0]), 1e-9), 3 * (len(solved) - _EVEN)
        variance = np.diag(inverse)[_EVEN:] * float(off @ off) / len(off) * _ALIKE
        sigma = np.sqrt(np.maximum(variance, 0))
        return _State(
            tuple(shadows), foot, design, model, -solved[_EVEN:] / level, sigma / level,
            np.zeros((size, size)), rms,
        )  # fmt: skip

    @cached_property
    def _even(self) -> Array:
        """(N, _EVEN) columns of the light without lamps: level, change to the right and down, and
        how much of an even sky the rod hides."""
        distance = np.maximum(np.hypot(*self.found.places.T), self.rod.radius)
        height2 = self.rod.height**2
        hidden = np.arcsin(self.rod.radius / distance) / np.pi
        hidden *= height2 / (height2 + distance**2)
        even = np.ones(len(self.bright))
        return np.stack([even, *self.found.places.T, hidden], axis=1)

    def begun(
        self, shadows: Sequence[Array], foot: Array, angle: float, length: float
    ) -> list[Array]:
        """With one shadow more, of that angle: of all lengths and penumbras the best."""
        longer = np.geomspace(length / 2, self.found.longest, 12)
        tried = [
            [*shadows, np.array([angle, one, np.log(radius)])]
            for one in (length, *longer)
            for radius in _RADII
        ]
        return min(tried, key=lambda these: self.of(these, foot).rms)

    def refined(self, shadows: Sequence[Array], foot: Array) -> _State:
        """The best shadows near these, and where the rod stands: near its stated place."""
        count, size = len(shadows), 3 * len(shadows)
        low = np.tile([-np.inf, 2 * self.rod.radius, np.log(_LEAST_RADIUS)], count)
        high = np.tile([np.inf, 2 * self.found.longest, np.log(_MOST_RADIUS)], count)
        begin = np.clip(np.concatenate(shadows), low + 1e-9, high - 1e-9)
        foot_sigma = PLACE_SIGMA_MM / self.rod.square_mm

        def off(values: Array) -> Array:
            state = self.of(values[:size].reshape(count, 3), values[size:])
            light = (self.bright - state.model) * self.found.weight
            return np.concatenate([light, np.sqrt(_ALIKE) * values[size:] / foot_sigma])

        anywhere = np.full(2, np.inf)
        result = least_squares(
            off, np.concatenate([begin, foot]), loss="soft_l1", max_nfev=30,
            bounds=(np.append(low, -anywhere), np.append(high, anywhere)),
        )  # fmt: skip
        state = self.of(result.x[:size].reshape(count, 3), result.x[size:])
        light = result.jac[:-2]
        chi2 = float(np.mean(off(result.x)[:-2] ** 2))
        known = np.diag([*np.zeros(size), *np.full(2, 1 / foot_sigma**2)])
        covariance = np.linalg.pinv(light.T @ light / (chi2 * _ALIKE) + known)
        return replace(state, covariance=covariance[:size, :size])


def _light(found: Sheet, rod: Rod, state: _State, rotation_sigma_deg: float) -> Light:
    notes, lamps, left_out = [], [], 0.0
    root = found.weight[:, None]
    solved = np.linalg.lstsq(state.design * root, found.irradiance * root, rcond=None)[0]
    lit = np.maximum(solved[0], 1e-9)  # at the rod, relative
    shares = np.clip(-solved[_EVEN:] / lit, 0, 1)
    for i, (angle, length, log_radius) in enumerate(state.shadows):
        way = float(np.hypot(length, rod.height))
        irradiance = shares[i] * lit * found.level * way / rod.height
        if _leaves(found, rod, state.foot, (angle, length, log_radius)):
            notes.append(
                "a shadow leaves the board: its lamp is counted as light from everywhere; a "
                "shorter rod shows it"
            )
            left_out += float(irradiance.mean())
            continue
        towards = np.array([-length * np.cos(angle), rod.height, -length * np.sin(angle)]) / way
        of = state.covariance[3 * i : 3 * i + 2, 3 * i : 3 * i + 2]
        # An angle turns the direction by its horizontal part; a length tips it.
        turned = np.degrees(np.sqrt(max(of[0, 0], 0))) * length / way
        tipped = np.degrees(np.sqrt(max(of[1, 1], 0)) * rod.height / way**2)
        high = np.degrees(HEIGHT_SIGMA_MM / rod.square_mm * length / way**2)
        sigma = float(np.linalg.norm([turned, tipped, high, rotation_sigma_deg, LEAN_SIGMA_DEG]))
        strength = np.linalg.norm([
            paper.PAPER_SIGMA, state.depth_sigma[i] / state.depths[i],
            length / rod.height * np.radians(sigma),  # the board is met aslant
        ])  # fmt: skip
        lamps.append(Lamp(
            towards, sigma, float(np.exp(log_radius)), shares[i], irradiance, float(strength)
        ))  # fmt: skip
    if not lamps:
        raise ProbeError(
            "no whole shadow of the rod is found on the board: let a lamp or the sun shine on it, "
            "use a shorter rod, and check its height, its diameter and its place (@COLUMN,ROW)"
        )
    ambient = np.maximum(1 - sum(lamp.share for lamp in lamps), 0.0) * lit * found.level
    return Light(
        tuple(lamps), ambient, lit * found.level * found.grey / np.pi, left_out, tuple(notes)
    )


def _leaves(found: Sheet, rod: Rod, foot: Array, shadow: Sequence[float]) -> bool:
    """Tell whether a shadow's end, with its penumbra, is not whole on the board."""
    angle, length, log_radius = shadow
    spread = np.exp(log_radius) / 2 * (length**2 + rod.height**2) / rod.height
    whole = length + rod.radius + 2 * float(np.hypot(spread, found.blur)) + 2 * found.cell
    end = foot + whole * np.array([np.cos(angle), np.sin(angle)])
    return bool(np.hypot(*(found.places - end).T).min() > _NEAR)
