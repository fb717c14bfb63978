"""The light on the faces: lamps, and light from everywhere.

A face with the normal n has the irradiance Σ L_k max(0, n·d_k) + a, per colour: L_k and a are not
negative (Lawson and Hanson 1974), the directions d_k are those that fit best. How the light from
everywhere differs from a is not solved for: it counts as noise that neighbouring faces share.
Several pictures are joined: their faces are all fitted at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, nnls

from lightprobe.geometry import Array, equirect_directions, equirect_solid_angles, sphere_normals
from lightprobe.probe.dodecahedron.faces import Reading
from lightprobe.probe.dodecahedron.pose import FOLD_SIGMA_DEG
from lightprobe.probe.dodecahedron.reflectance import Faces
from lightprobe.probe.kinds import ProbeError
from lightprobe.probe.paper import PAPER, PAPER_SIGMA

#: 1 sigma of how even light differs between faces, of the darkest face; and over all normals, of
#: its mean (choices, by what tests/accuracy/dodecahedra.py shows).
_UNEVEN, AMBIENT_SIGMA = 0.25, 0.3
#: Of a face's level: what its colours share (print, shading of the lens, response), what each has
#: for itself, and both of the brightest face.
_SHARED, _OWN, _FLOOR = 0.008, 0.004, 0.002
#: A colour of which there is less than this share of the brightest is not looked at closer.
_LEAST_COLOUR = 0.01
#: A lamp is listed when it makes the fit better by so much of χ²; at most so many are.
_BETTER, _MOST_LAMPS = 20.0, 3
#: 1 sigma of 1 / distance of a lamp, before anything is seen: in 1 / mm.
_NEARNESS_MM = 1 / 500
_NEAREST = 0.25  # in 1 / edges
#: A distance is told when 1 / distance is so many sigmas from 0.
_CLEARLY_NEAR = 4.0
_FEWEST_FACES = 3
#: 1 sigma of a direction when shadows end on a third of the faces or more: they may lie on others
#: as a whole. On fewer, by their share.
_SHADED_DEG, _SHADED = 90.0, 1 / 3
#: Another direction so far away that is nearly as good widens the sigma.
_ELSEWHERE_DEG = 15.0
#: A wider sigma is not that of the best fit alone.
_WIDE_DEG = 5.0
#: Beyond this, a direction is told to be nearly unknown.
UNKNOWN_DEG = 20.0
#: Half the angles between two lamps that are tried, whether they look like one.
_APART_DEG = np.arange(2.5, 50, 2.5)
#: A fit that is worse than this, RMS in sigmas, is told.
_POOR = 2.5
#: Normals so far from all faces that were seen may be lit by lamps that lit none; how much, of the
#: mean irradiance, is a choice: where no lamp is found, one that shines there is likely.
_UNSEEN_COSINE, _UNSEEN, _UNSEEN_WITHOUT_LAMP = 0.6, 0.5, 6.0
#: Radius of the disc that a lamp is drawn as: how large it is, faces do not tell.
_RADIUS = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp; frame of the estimate."""

    direction: Array  # (3,) unit, from the solid's centre
    direction_sigma_deg: float
    distance: float  # in edges; inf: far
    distance_sigma: float | None  # 1 sigma of it, relative; None: it may as well be far
    irradiance: Array  # (3,) of a surface that faces it in the place of the solid's centre
    irradiance_sigma: float  # relative


@dataclass(frozen=True, eq=False)
class Light:
    """Lamps, and light from everywhere."""

    lamps: tuple[Lamp, ...]
    ambient: Array  # (3,) irradiance by everything else, in the mean
    slope: Array  # (3, 3) by axis and colour: how it changes with the normal
    relighting_sigma: float  # of irradiance, over all normals, relative to its mean
    off_sigmas: float  # RMS of what does not fit
    chi2: float
    notes: tuple[str, ...] = field(default=())

    def panorama(self, width: int) -> NDArray[np.float32]:
        """Radiance (width / 2, width, 3): lamps are discs of 1° radius."""
        directions = equirect_directions(width, width // 2)
        sr = np.broadcast_to(
            equirect_solid_angles(width, width // 2)[:, None], directions.shape[:2]
        )
        # The irradiance of radiance x·d is 2π/3 times x·n.
        light = np.maximum(self.ambient / np.pi + directions @ self.slope * 1.5 / np.pi, 0)
        for lamp in self.lamps:
            inside = directions @ lamp.direction > np.cos(max(_RADIUS, 4 * np.pi / width))
            light[inside] += lamp.irradiance / sr[inside].sum()
        return np.asarray(light, np.float32)


def solve(
    readings: Sequence[Reading],
    edge_mm: float,
    roughness: float | None = None,
    rotation_sigma_deg: float = 0.0,
    shaded: float = 0.0,
) -> Light:
    """Find lamps and the light from everywhere that make faces look so.

    `readings`: of one picture or of several, in one frame. `edge_mm`: of the solid. `roughness`:
    0.05…1 of a coated solid; None: matt paper. `shaded`: share of the faces that were left out
    because they are lit unevenly: a shadow may be on others as a whole.
    Raises ProbeError for fewer than three faces.
    """
    if len(readings) < _FEWEST_FACES:
        raise ProbeError(
            f"{len(readings)} faces of the dodecahedron can be used, and three are needed: let "
            "more of them be seen, evenly lit, and not overexposed"
        )
    values = np.stack([one.radiance for one in readings]) * np.pi / PAPER
    if not values.max() > 0:
        raise ProbeError("the dodecahedron is black: expose more")
    fit = _Fit(tuple(readings), Faces.of(tuple(readings), roughness), values, edge_mm)
    state = fit.of([])
    while len(state.lamps) < _MOST_LAMPS:
        better = fit.refined([*state.lamps, fit.begun(state.lamps)])
        if not state.chi2 - better.chi2 > _BETTER:
            break
        state = better
    return fit.light(state, rotation_sigma_deg, shaded)


@dataclass(frozen=True, eq=False)
class _State:
    """Lamps, and how they fit."""

    lamps: tuple[Array, ...]  # (4,) each: direction, 1 / distance
    solved: Array  # (3 lamps + 3,) irradiance by lamp and colour, then the light from everywhere
    off: Array  # (3 N,) whitened residuals
    chi2: float  # with what is known of distances beforehand
    covariance: Array | None = None  # (3 lamps, 3 lamps): two turns and 1 / distance of each

    @property
    def poor(self) -> float:
        """RMS of what does not fit, in sigmas; at least 1."""
        free = max(self.off.size - 6 * len(self.lamps) - 3, 1)
        return max(1.0, float(np.sqrt(self.off @ self.off / free)))


@dataclass(eq=False)
class _Fit:
    """Least squares of light on faces."""

    readings: tuple[Reading, ...]
    faces: Faces
    values: Array  # (N, 3) irradiance
    edge_mm: float

    @cached_property
    def _near_sigma(self) -> float:
        return self.edge_mm * _NEARNESS_MM

    @cached_property
    def _ambient(self) -> Array:
        """(3 N, 3 N) covariance of how the light from everywhere differs, by face and colour."""
        cosine = np.clip(self.faces.normals @ self.faces.normals.T, -1, 1)
        # Irradiance has little of second order: a quarter of radiance's, of the first two thirds.
        alike = cosine + 0.15 * (1.5 * cosine**2 - 0.5)
        level = _UNEVEN * self.values.min(axis=0)
        colours = 0.8 * np.outer(level, level) + 0.2 * np.diag(level**2)
        return np.asarray(np.kron(alike, colours), np.float64)

    @cached_property
    def _root(self) -> Array:
        """(3 N, 3 N) lower triangle whose square is the covariance of all values."""
        brightest = self.values.max(axis=0)
        top = np.maximum(brightest, _LEAST_COLOUR * brightest.max())  # of a lamp of one colour
        total = self._ambient.copy()
        for i, reading in enumerate(self.readings):
            at = slice(3 * i, 3 * i + 3)
            level = self.values[i]
            folded = np.radians(FOLD_SIGMA_DEG) * np.maximum(top - level, 0.2 * top)
            for shared in (_SHARED * level, reading.sigma * level, folded, _FLOOR * top):
                total[at, at] += np.outer(shared, shared)
            total[at, at] += np.diag((_OWN * level) ** 2 + (_FLOOR * top) ** 2)
        return np.asarray(np.linalg.cholesky(total))

    @cached_property
    def _white(self) -> tuple[Array, Array, Array]:
        """Inverse of the root, the whitened values, and the columns of even light."""
        inverse = np.asarray(solve_triangular(self._root, np.eye(len(self._root)), lower=True))
        even = np.kron(self.faces.even[:, None], np.eye(3))
        return inverse, inverse @ self.values.ravel(), inverse @ even

    def of(self, lamps: Sequence[Array]) -> _State:
        """Irradiances are linear: solved for with these lamps."""
        inverse, wanted, even = self._white
        columns = [
            inverse @ np.kron(self.faces.lit(one[:3], one[3])[:, None], np.eye(3)) for one in lamps
        ]
        design = np.concatenate([*columns, even], axis=1)
        gram = design.T @ design
        gram += 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram))
        root = np.linalg.cholesky(gram)
        solved = nnls(root.T, solve_triangular(root, design.T @ wanted, lower=True))[0]
        off = wanted - design @ solved
        known = sum(float(one[3] / self._near_sigma) ** 2 for one in lamps)
        return _State(tuple(lamps), solved, off, float(off @ off) + known)

    def begun(self, lamps: Sequence[Array]) -> Array:
        """Of directions all around, the best for one lamp more."""
        tried = _all_around()
        return np.append(tried[self._chi2(lamps, tried, 0.0).argmin()], 0.0)

    def _chi2(self, lamps: Sequence[Array], directions: Array, nearness: float) -> Array:
        """χ² (D,) with these lamps, and one more in each of the directions (D, 3)."""
        inverse, wanted, even = self._white
        lit = np.stack([self.faces.lit(one, nearness) for one in directions])
        parts = inverse.reshape(len(inverse), -1, 3)
        tried = np.einsum("rnc,dn->drc", parts, lit, optimize=True)
        known = [np.einsum("rnc,n->rc", parts, self.faces.lit(x[:3], x[3])) for x in lamps]
        fixed = np.concatenate([*known, even], axis=1)
        design = np.concatenate([np.broadcast_to(fixed, (len(tried), *fixed.shape)), tried], axis=2)
        gram = design.transpose(0, 2, 1) @ design
        size = gram.shape[1]
        gram += 1e-10 * np.trace(gram, axis1=1, axis2=2)[:, None, None] / size * np.eye(size)
        wish = np.einsum("drk,r->dk", design, wanted)
        solved = np.linalg.solve(gram, wish[..., None])[..., 0]
        for i in np.flatnonzero(solved.min(axis=1) < 0):
            root = np.linalg.cholesky(gram[i])
            solved[i] = nnls(root.T, solve_triangular(root, wish[i], lower=True))[0]
        off = wanted - np.einsum("drk,dk->dr", design, solved)
        near = [*(float(one[3]) for one in lamps), nearness]
        return np.asarray((off**2).sum(axis=1) + sum((x / self._near_sigma) ** 2 for x in near))

    def refined(self, lamps: Sequence[Array]) -> _State:
        """The best lamps near these, how far away they are, and the covariance of both."""
        count = len(lamps)
        axes = [_across(one[:3]) for one in lamps]

        def placed(values: Array) -> list[Array]:
            moved = []
            for one, across, (x, y, near) in zip(lamps, axes, values.reshape(-1, 3), strict=True):
                direction = one[:3] + np.array([x, y]) @ across
                moved.append(np.append(direction / np.linalg.norm(direction), near))
            return moved

        def off(values: Array) -> Array:
            known = values.reshape(-1, 3)[:, 2] / self._near_sigma
            return np.concatenate([self.of(placed(values)).off, known])

        begin = np.concatenate([
            [0, 0, min(max(one[3], 0.2 * self._near_sigma), _NEAREST / 2)] for one in lamps
        ])  # fmt: skip
        low, high = np.tile([-2.0, -2.0, 0], count), np.tile([2.0, 2.0, _NEAREST], count)
        result = least_squares(
            off, begin, bounds=(low, high), x_scale=np.tile([0.1, 0.1, self._near_sigma], count),
            max_nfev=40,
        )  # fmt: skip
        information = result.jac.T @ result.jac
        information += np.diag(np.tile([0.1, 0.1, 0], count))  # a direction is on the sphere
        return replace(
            self.of(placed(result.x)), covariance=np.asarray(np.linalg.pinv(information))
        )

    def light(self, state: _State, rotation_sigma_deg: float, shaded: float) -> Light:
        """What was found, with what is not known of it."""
        count = len(state.lamps)
        poor, notes = state.poor, []
        state, turned = self.centred(state)
        if poor > _POOR:
            notes.append(
                f"the faces differ by {poor:.1f} sigma from what lamps and even light explain: is "
                "a shadow on them, is another thing near, or is the paper glossy?"
            )
        lamps = []
        for i, one in enumerate(state.lamps):
            sigma = float(np.linalg.norm([
                np.degrees(turned[i]), rotation_sigma_deg, _SHADED_DEG * min(shaded / _SHADED, 1)
            ]))  # fmt: skip
            sigma = min(sigma, 90.0)
            if sigma > UNKNOWN_DEG:
                notes.append(
                    f"the direction of a lamp is known to {sigma:.0f} degrees only: too few of the "
                    "faces that are seen are lit by it, or a shadow is on them: add pictures of "
                    "other sides"
                )
            irradiance = state.solved[3 * i : 3 * i + 3]
            strength = float(np.hypot(PAPER_SIGMA, np.radians(sigma)))
            sigma = min(float(np.hypot(sigma, self._apart_deg(state, i) / 2)), 90.0)
            lamps.append(Lamp(one[:3], sigma, *self._distance(state, i), irradiance, strength))
        if not lamps:
            notes.append(
                "no lamp stands out: the faces that are seen are lit evenly, or a lamp is behind "
                "the dodecahedron: add pictures of other sides"
            )
        ambient = state.solved[3 * count :]
        slope = self._slope(state)
        return Light(
            tuple(lamps), ambient, slope, self._relighting(lamps, ambient) * poor + shaded, poor,
            state.chi2, tuple(notes),
        )  # fmt: skip

    def centred(self, state: _State) -> tuple[_State, list[float]]:
        """With a direction that is hardly known, the mean of all that fit; 1 sigma of each, in rad.

        Near the best fit, the covariance tells. Where it is wide, and for other directions that
        fit nearly as well, the likelihood of directions all around does.
        """
        assert state.covariance is not None or not state.lamps  # refined() gives it
        directions = _all_around()
        lamps, sigmas = list(state.lamps), []
        for i, best in enumerate(state.lamps):
            at = slice(3 * i, 3 * i + 2)
            near = state.poor**2 * float(np.trace(np.asarray(state.covariance)[at, at]))
            away = np.arccos(np.clip(directions @ best[:3], -1, 1))
            is_wide = near > np.radians(_WIDE_DEG) ** 2
            used = away > (0 if is_wide else np.radians(_ELSEWHERE_DEG))
            others = [*lamps[:i], *lamps[i + 1 :]]
            worse = self._chi2(others, directions[used], float(best[3])) - state.chi2
            weight = np.exp(-np.maximum(worse, 0) / 2 / state.poor**2)
            if is_wide:
                mean = weight @ directions[used]
                mean = mean / np.linalg.norm(mean)
                away = np.arccos(np.clip(directions[used] @ mean, -1, 1))
                lamps[i] = np.append(mean, best[3])
                near = float(weight @ away**2 / weight.sum()) + np.radians(_WIDE_DEG) ** 2 / 4
            else:
                mass = 2 * np.pi * near / 2 / (4 * np.pi / len(directions))  # in cells
                mass = max(mass, 1e-4)
                away = away[used]
                near = float((mass * near + weight @ away**2) / (mass + weight.sum()))
            sigmas.append(float(np.sqrt(near)))
        return replace(self.of(lamps), covariance=state.covariance), sigmas

    def _apart_deg(self, state: _State, index: int) -> float:
        """How far from a lamp two may be that look like it: at 2 sigma, in degrees."""
        lamp = state.lamps[index]
        others = [*state.lamps[:index], *state.lamps[index + 1 :]]
        most = 0.0
        for turn in np.radians([0, 45, 90, 135]):
            across = np.array([np.cos(turn), np.sin(turn)]) @ _across(lamp[:3])
            for away_deg in _APART_DEG:
                if away_deg <= most:
                    continue
                away = np.radians(away_deg)
                pair = [
                    np.append(np.cos(away) * lamp[:3] + np.sin(side * away) * across, lamp[3])
                    for side in (-1, 1)
                ]
                known = float(lamp[3] / self._near_sigma) ** 2  # counts once
                if self.of([*others, *pair]).chi2 - known - state.chi2 > 4 * state.poor**2:
                    break
                most = float(away_deg)
        return most

    def _distance(self, state: _State, index: int) -> tuple[float, float | None]:
        """How far away a lamp is, in edges, and 1 sigma, relative; inf, None: perhaps far."""
        near = float(state.lamps[index][3])
        sigma = state.poor * float(np.sqrt(np.diag(np.asarray(state.covariance))[3 * index + 2]))
        return (1 / near, sigma / near) if near > _CLEARLY_NEAR * sigma else (np.inf, None)

    def _slope(self, state: _State) -> Array:
        """What the residuals tell of how the light from everywhere changes (3, 3)."""
        shared = solve_triangular(self._root.T, state.off, lower=False)
        level = _UNEVEN * self.values.min(axis=0)
        colours = 0.8 * np.outer(level, level) + 0.2 * np.diag(level**2)
        return np.asarray(self.faces.normals.T @ shared.reshape(-1, 3) @ colours)

    def _relighting(self, lamps: Sequence[Lamp], ambient: Array) -> float:
        """1 sigma of irradiance, RMS over all normals, relative to its mean."""
        normals = sphere_normals(2)
        total = np.full(len(normals), float(ambient.mean()))
        variance = (AMBIENT_SIGMA * total) ** 2
        for lamp in lamps:
            strength = float(lamp.irradiance.mean())
            cosine = normals @ lamp.direction
            total = total + strength * np.maximum(cosine, 0)
            turned = np.radians(lamp.direction_sigma_deg) / np.sqrt(2)
            variance = variance + (strength * turned) ** 2 * (1 - cosine**2)
        unseen = (normals @ self.faces.normals.T).max(axis=1) < _UNSEEN_COSINE
        hidden = _UNSEEN if lamps else _UNSEEN_WITHOUT_LAMP
        variance = variance + unseen * (hidden * total.mean()) ** 2
        return float(np.sqrt(variance.mean()) / max(float(total.mean()), 1e-12))


@cache
def _all_around() -> Array:
    """(642, 3) directions evenly over the sphere."""
    return sphere_normals(3)


def _across(direction: Array) -> Array:
    """(2, 3) unit vectors across a direction."""
    least = np.eye(3)[np.abs(direction).argmin()]
    first = np.cross(direction, least)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])
