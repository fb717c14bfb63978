"""The light by an object whose shape is known, and by its shadows on the paper on which it stands.

What the camera sees of matt surfaces is a sum over lights: albedo/π · Σ L_j Ω_j max(0, n·ω_j) V_j,
where V_j tells whether the object hides the light there. The lights are the 384 texels of a cube;
those below the horizon are the table. The sum is solved for lights that are nowhere negative, with
few steps between them (lightprobe.probe.cube).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lightprobe.calibrate.lens_board import Board
from lightprobe.geometry import Array, equirect_directions, sphere_normals
from lightprobe.probe import cube, paper, shadow_maps
from lightprobe.probe.kinds import ProbeError
from lightprobe.probe.object_samples import Samples

#: 1 sigma of an albedo that was stated, relative; by so many it may differ from the found one.
ALBEDO_SIGMA, _MOST_SIGMAS = 0.05, 3.0
#: Of the light: what a step between texels costs, and 1 sigma of a texel where nothing tells;
#: both for light whose mean on the board is 1.
_STEP_COST, _SPREAD = 3.0, 5.0
#: 1 sigma of the board's radiance from what is below the object, and of the table's, both beside
#: the board's mean and relative to that.
_BOARD_SIGMA, _TABLE_SIGMA = 0.1, 0.7
#: Noise of a sample: at first, and at least; relative to the board's level.
_BEGIN_SIGMA, _LEAST_SIGMA = 0.02, 0.004
#: Samples further off than this, in sigmas, count less (Huber).
_FAR = 4.0
#: Errors of neighbouring samples are alike (shadow maps, place of the object): so many count as
#: one. And 1 sigma of what texels of 11° and one throw of light leave of relighting, relative.
#: (Both are choices: with them tests/accuracy/objects.py has its errors within 3 sigma.)
_ALIKE, MODEL_SIGMA = 50.0, 0.04
#: 1 sigma of relighting for each share of the mesh that is missing (a choice).
_BACKS_SIGMA = 0.5
_ROUNDS, _BEGIN_ALBEDO = 6, 0.7
#: Between the picture and the model at most, RMS over the object, relative to its mean; and over
#: the paper.
_MOST_RMS, _MOST_PAPER_RMS = 0.12, 0.12
#: Parts of the object whose mean throws light, about; cells along a square of the board that does.
_PATCHES, _CELLS = 240, 4
#: An albedo above this is none.
_MOST_ALBEDO = 1.1


@dataclass(frozen=True, eq=False)
class Light:
    """Radiance of 384 texels, and how well it is known; probe frame."""

    radiance: Array  # (384, 3)
    covariance: Array  # (384, 384) of the mean of the channels, in the board's mean light, squared
    level: Array  # (3,) radiance of even light that would light the board as much
    albedo: Array  # (3,) of the object
    rms: float  # between picture and model, relative to the board's level
    backs: float = 0.0  # share of the mesh in view that are backs of triangles: holes
    notes: tuple[str, ...] = field(default=())

    def panorama(self, width: int) -> NDArray[np.float32]:
        """Radiance (width / 2, width, 3)."""
        directions = equirect_directions(width, width // 2)
        index = cube.nearest(directions.reshape(-1, 3))
        return np.asarray(self.radiance[index].reshape(width // 2, width, 3), np.float32)

    @property
    def relighting_sigma(self) -> float:
        """1 sigma of irradiance, mean over all normals, relative to its mean."""
        directions, sr = cube.texels()
        kernel = np.maximum(sphere_normals(3) @ directions.T, 0) * sr
        variance = np.einsum("ni,ij,nj->n", kernel, self.covariance, kernel)
        mean = float((kernel @ (self.radiance / self.level).mean(axis=1)).mean())
        model = MODEL_SIGMA + _BACKS_SIGMA * self.backs
        return float(np.hypot(np.sqrt(variance.mean()) / max(mean, 1e-9), model))

    def direction_sigma_deg(self, direction: Array) -> float:
        """1 sigma of a lamp's direction (3,): by the covariance around it, and the texels' gap."""
        directions, sr = cube.texels()
        near = directions @ direction > np.cos(np.radians(30))
        flux = (self.radiance / self.level).mean(axis=1)[near] * sr[near]
        total = float(flux.sum())
        gap = float(np.degrees(np.sqrt(4 * np.pi / len(directions) / 12)))
        if not total > 0:
            return 90.0
        off = (directions[near] - direction) * sr[near, None]
        spread = np.einsum("ia,ij,ja->", off, self.covariance[np.ix_(near, near)], off)
        return float(np.hypot(gap, np.degrees(np.sqrt(max(spread, 0.0)) / total)))


@dataclass(frozen=True, eq=False)
class Transport:
    """What light of 1 from each texel, and what is known, make of each sample of albedo 1."""

    direct: Array  # (N, 384) radiance by light that comes straight from the texels
    thrown: Array  # (N, 384) by way of the object, were its albedo 1
    known: Array  # (N, 3) by the board, as it is seen
    known_thrown: Array  # (N, 3) by the board and then the object, were its albedo 1

    def made(self, albedo: float) -> Array:
        """(N, 384) of an object of such an albedo."""
        return np.asarray(self.direct + albedo * self.thrown)

    def given(self, albedo: float) -> Array:
        """(N, 3) of an object of such an albedo."""
        return np.asarray(self.known + albedo * self.known_thrown)


def transport(found: Samples, board: Board, paper_light: Array) -> Transport:
    """How light reaches the samples.

    `paper_light`: (B, 3) radiance of the board's samples, were the paper's albedo 1. Where a ray
    down from the object meets the board, the board's radiance is known. What the object throws on
    itself and on the paper is taken from the mean of its parts that face there.
    """
    every = len(found.surface) // _PATCHES
    places = np.concatenate([found.places, found.surface[::every]])
    normals = np.concatenate([found.normals, found.facing[::every]])
    beside = np.concatenate([found.of_board, np.zeros(len(places) - len(found.places), bool)])
    fine, fine_sr = cube.texels(cube.SIDE * cube.PARTS)
    up, (coarse, coarse_sr) = fine[:, 1] > 0, cube.texels()
    below = coarse[:, 1] < 0
    directions = np.concatenate([fine[up], coarse[below]])
    sr = np.concatenate([fine_sr[up], coarse_sr[below]])
    seen = np.ones((len(places), len(directions)), np.float32)
    for lights, rows in ((slice(0, up.sum()), beside | True), (slice(up.sum(), None), ~beside)):
        seen[rows, lights] = shadow_maps.seen(
            found.surface, places[rows], normals[rows], directions[lights], beside[rows]
        ).T
    cosine = np.maximum(normals @ directions.T, 0) * (sr / np.pi)
    hidden = (cosine - cosine * seen)[: len(found.places)]
    cosine *= seen
    known = np.zeros((len(places), 3))
    ground = _ground(found, board, paper_light)
    for k in np.flatnonzero(directions[:, 1] < 0):
        radiance, meets = _paper_below(ground, places, directions[k])
        known += np.where(meets & ~beside, cosine[:, k], 0)[:, None] * radiance
        cosine[meets, k] = 0
    order = np.argsort(cube.nearest(directions), kind="stable")
    _, first = np.unique(cube.nearest(directions)[order], return_index=True)
    direct = np.add.reduceat(cosine[:, order], first, axis=1)
    faces = np.maximum(-directions @ found.facing[::every].T, 0)
    faces /= np.maximum(faces.sum(axis=1, keepdims=True), 1e-12)
    count = len(found.places)
    return Transport(
        direct[:count], hidden @ (faces @ direct[count:]), known[:count],
        hidden @ (faces @ known[count:]),
    )  # fmt: skip


def _ground(found: Samples, board: Board, paper_light: Array) -> Array:
    """Radiance (rows, columns, 3) of the board with its print, _CELLS to a square."""
    grey = board.draw(8 * _CELLS).reshape(board.rows * _CELLS, 8, board.columns * _CELLS, 8)
    white = grey.mean(axis=(1, 3))[..., None] / 255
    z, x = np.mgrid[: white.shape[0], : white.shape[1]]
    middles = (np.stack([x, z], axis=-1).reshape(-1, 2) + 0.5) / _CELLS
    _, nearest = cKDTree(found.places[found.of_board][:, [0, 2]]).query(middles)
    light = paper_light[nearest].reshape(*white.shape[:2], 3)
    return np.asarray((paper.TONER + (paper.PAPER - paper.TONER) * white) * light)


def _paper_below(
    ground: Array, places: Array, direction: Array
) -> tuple[Array, NDArray[np.bool_]]:  # fmt: skip
    """Radiance (N, 3) of the board where rays down from places (N, 3) meet it, and whether."""
    at = (places - places[:, 1:2] / direction[1] * direction)[:, [2, 0]] * _CELLS
    cell = np.floor(at).astype(int)
    meets = np.all((cell >= 0) & (cell < ground.shape[:2]), axis=1)
    row, column = np.clip(cell, 0, np.array(ground.shape[:2]) - 1).T
    return ground[row, column], meets


def solve(found: Samples, board: Board, albedo: float | None = None) -> Light:
    """Find the light that makes what is seen; raises ProbeError where none does.

    `albedo`: of the object, known within 5 %; None: found, one for each colour.
    """
    seen = found.radiance.copy()
    seen[found.of_board] /= paper.PAPER
    level = np.median(seen[found.of_board], axis=0)
    if not np.all(level > 0):
        raise ProbeError(
            "the white paper shows no red, no green or no blue: expose more, or use light of all "
            "colours"
        )
    ways = transport(found, board, seen[found.of_board] / level)
    fit = _Fit(ways, seen / level, found.of_board, _prior(found, board), albedo)
    fit.run()
    _check(fit)
    covariance = cube.covariance(fit.gram() / _ALIKE, fit.light, fit.prior)
    rms = float(np.sqrt(np.mean(fit.off() ** 2)))
    notes = (*found.notes, *_contradiction(fit.albedo, albedo))
    return Light(fit.light * level, covariance, level, fit.albedo, rms, found.backs, notes)


def _contradiction(found: Array, stated: float | None) -> list[str]:
    """A note where an object reflects another share of the light than was stated."""
    if stated is None:
        return []
    mean = float(found.mean())
    if abs(mean / stated - 1) < _MOST_SIGMAS * ALBEDO_SIGMA:
        return []
    return [f"the object seems to reflect {mean:.2f} of the light, not {stated:g} as stated"]


def _prior(found: Samples, board: Board) -> cube.Prior:
    """Below, the board as it is seen from the object's middle, were the object not there."""
    directions, _ = cube.texels()
    below = directions[:, 1] < 0
    grey = float(np.where(board.draw(8) > 127, paper.PAPER, paper.TONER).mean())
    middle = (found.surface.min(axis=0) + found.surface.max(axis=0)) / 2
    down = np.where(below, directions[:, 1], -1)
    at = (middle - middle[1] / down[:, None] * directions)[:, [0, 2]]
    on_board = below & np.all((at > 0) & (at < [board.columns, board.rows]), axis=1)
    expected = np.where(below, grey, 1.0)
    sigma = np.select([on_board, below], [_BOARD_SIGMA * grey, _TABLE_SIGMA * grey], _SPREAD)
    return cube.Prior(_STEP_COST, np.tile(expected[:, None], (1, 3)), 1 / sigma**2)


@dataclass(eq=False)
class _Fit:
    """Light and albedo in turn, and what single samples count."""

    ways: Transport
    seen: Array  # (N, 3) relative to the board's level; the object's with its albedo in it
    of_board: NDArray[np.bool_]
    prior: cube.Prior
    stated: float | None

    def __post_init__(self) -> None:
        """Let all count the same."""
        self.weight = np.full(len(self.seen), 1 / _BEGIN_SIGMA)
        self.albedo = np.full(3, _BEGIN_ALBEDO if self.stated is None else self.stated)
        self.light = self.prior.expected

    def gram(self) -> Array:
        """(L, L) of the equations, each divided by its sigma."""
        weighted = self._made() * self.weight[:, None]
        return np.asarray(weighted.T @ weighted)

    def run(self) -> None:
        """Find light, albedo and what samples count."""
        thing = self.weight.copy()
        self.weight[~self.of_board] = 0  # the paper's albedo is known
        self._find_light()
        self.weight = thing
        for _ in range(_ROUNDS):
            self._find_albedo()
            self._find_light()
            self._weigh()
        self._find_light()

    def values(self) -> Array:
        """(N, 3): what is seen, were the object's albedo 1."""
        return np.where(self.of_board[:, None], self.seen, self.seen / self.albedo)

    def off(self) -> Array:
        """(N, 3): what the picture differs by."""
        return np.asarray(self.values() - self._model())

    def _model(self) -> Array:
        return np.asarray(self._made() @ self.light + self.ways.given(self.albedo.mean()))

    def _made(self) -> Array:
        return self.ways.made(float(self.albedo.mean()))

    def _find_light(self) -> None:
        wanted = self.values() - self.ways.given(float(self.albedo.mean()))
        made = self._made()
        weighted = made * self.weight[:, None]
        right = weighted.T @ (self.weight[:, None] * wanted)
        self.light = cube.solve(weighted.T @ weighted, right, self.prior, self.light)

    def _find_albedo(self) -> None:
        """The object's, of each channel: least squares, towards what was stated."""
        thing = ~self.of_board
        model = self._model()[thing] * self.weight[thing, None]
        seen = self.seen[thing] * self.weight[thing, None]
        over, under = (model * seen).sum(axis=0), (model * model).sum(axis=0)
        if self.stated is not None:
            precision = 1 / (ALBEDO_SIGMA * self.stated) ** 2
            over, under = over / _ALIKE + precision * self.stated, under / _ALIKE + precision
        self.albedo = np.asarray(np.maximum(over / np.maximum(under, 1e-30), 1e-3))

    def _weigh(self) -> None:
        """By how much the samples are off, and less what is far off.

        Object and paper have one sigma: else the one that fits better would come to count alone.
        """
        off = np.sqrt(np.mean(self.off() ** 2, axis=1))
        paper_off, thing_off = (float(np.median(off[part]))
                                for part in (self.of_board, ~self.of_board))  # fmt: skip
        sigma = max(1.2 * float(np.hypot(paper_off, thing_off)) / np.sqrt(2), _LEAST_SIGMA)
        self.weight = 1 / (sigma * np.sqrt(np.maximum(off / (_FAR * sigma), 1)))


def _check(fit: _Fit) -> None:
    """Raise ProbeError where the picture is not that of such an object."""
    off, values = fit.off(), fit.values()
    for part, most, what in (
        (~fit.of_board, _MOST_RMS, "object"), (fit.of_board, _MOST_PAPER_RMS, "white paper")
    ):  # fmt: skip
        mean = float(values[part].mean())
        rms = float(np.sqrt(np.mean(off[part] ** 2))) / max(mean, 1e-9)
        if rms > most and what == "object":
            raise ProbeError(
                f"the object differs by {100 * rms:.0f} % from what light on such a shape "
                "explains: is it matt and of one colour, is the mesh its own, and does it stand "
                "where it is said to (@COLUMN,ROW,DEGREES)?"
            )
        if rms > most:
            raise ProbeError(
                f"the paper's light differs by {100 * rms:.0f} % from what the object's shadows "
                "explain: does something else throw shadows on the board, and does the object "
                "stand where it is said to (@COLUMN,ROW,DEGREES)?"
            )
    if fit.albedo.max() > _MOST_ALBEDO:
        raise ProbeError(
            f"the object would reflect {100 * fit.albedo.max():.0f} % of the light on it: does it "
            "shine, or is it another one than the mesh?"
        )
