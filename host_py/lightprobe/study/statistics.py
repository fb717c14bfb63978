"""Intervals and tests of a study, each with its source. Confidence is 95 %, alpha is 0.05."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special, stats

from lightprobe.geometry import Array

ALPHA = 0.05
#: Up to as many participants all 2^n signs are tried; above, as many random ones.
EXACT_UP_TO = 16
_RANDOM = 100_000
_SEED = 20
#: Of the noncentral t of what is found: 2.8 for many participants, 5.7 for three.
_LARGEST_SHIFT = 12.0
#: Correlations of one person's answers that are tried, from independent to always the same.
_ALIKE = special.expit(np.linspace(-9, 11, 41))
#: Shares between which ends of an interval are looked for.
_MEANS: list[float] = [1e-6, 1e-4, *(k / 20 for k in range(1, 20)), 1 - 1e-4, 1 - 1e-6]


@dataclass(frozen=True)
class Interval:
    """A value with its confidence interval; the ends are None where nothing is known of them."""

    value: float
    low: float | None
    high: float | None


def mean(values: Sequence[float] | Array) -> Interval:
    """Mean with Student's t interval; of one value without interval."""
    x = np.asarray(values, float)
    middle = float(x.mean())
    if len(x) < 2:
        return Interval(middle, None, None)
    half = float(stats.t.ppf(1 - ALPHA / 2, len(x) - 1) * x.std(ddof=1) / math.sqrt(len(x)))
    return Interval(middle, middle - half, middle + half)


def wilson(successes: float, trials: float) -> Interval:
    """Share with Wilson's score interval (E. B. Wilson, J. Am. Stat. Assoc. 22, 1927).

    Both may be no whole numbers: those of an effective sample.
    """
    share = successes / trials
    return Interval(share, *_wilson(share, trials))


def _wilson(share: float, trials: float) -> tuple[float, float]:
    z = float(stats.norm.ppf(1 - ALPHA / 2))
    scale = 1 + z * z / trials
    centre = (share + z * z / (2 * trials)) / scale
    half = z * math.sqrt(share * (1 - share) / trials + (z / (2 * trials)) ** 2) / scale
    return max(centre - half, 0.0), min(centre + half, 1.0)


def clustered_wilson(successes: Sequence[int], trials: int) -> Interval:
    """Interval for a share of answers, `trials` of each participant; of one without interval.

    Wilson's, where answers of one person are alike and so count as fewer: the number of answers
    over the design effect, which is how many times the variance of the participants' shares exceeds
    that of as many independent answers (C. Franco et al., J. Surv. Stat. Methodol. 7, 2019), and at
    least 1. As its degrees of freedom are those of the participants, it shrinks by (z/t)² as E. L.
    Korn and B. I. Graubard do (Surv. Methodol. 24, 1998). Where all answers are equal, nothing
    tells how alike a person's answers are: each person counts as one answer.

    Few people, or answers that are almost all equal, tell little of the design effect. So the ends
    are at least as far apart as what a model that leaves it open allows: `_beta_binomial`.
    """
    counts = np.asarray(successes, float)
    people, total = len(counts), len(counts) * trials
    share = float(counts.sum() / total)
    if people < 2:
        return Interval(share, None, None)
    if 0 < share < 1:
        between = float((counts / trials).var(ddof=1)) / people
        effect = max(between / (share * (1 - share) / total), 1.0)
        z, t = stats.norm.ppf(1 - ALPHA / 2), stats.t.ppf(1 - ALPHA / 2, people - 1)
        effective = total / effect * float(z / t) ** 2
    else:
        effective = float(people)
    both = _wilson(share, effective), _beta_binomial(counts, trials)
    return Interval(share, min(low for low, _ in both), max(high for _, high in both))


def _beta_binomial(counts: Array, trials: int) -> tuple[float, float]:
    """Profile likelihood interval of the mean of a beta-binomial distribution.

    Participants' own shares are of a beta distribution (J. G. Skellam, J. R. Stat. Soc. B 10,
    1948) of any width, from all alike to each always with the same answer: for each mean the
    likeliest width counts. The limit is that of a normal mean of as many people, whose likelihood
    interval of n log(1 + t²/(n − 1)) is Student's.
    """
    people = len(counts)
    t = float(stats.t.ppf(1 - ALPHA / 2, people - 1))
    fall = people * math.log1p(t * t / (people - 1)) / 2
    values, often = np.unique(counts, return_counts=True)

    def likelihood(mean: float) -> float:
        """Log, at the likeliest of _ALIKE."""
        strength = (1 - _ALIKE[:, None]) / _ALIKE[:, None]
        a, b = mean * strength, (1 - mean) * strength
        each = special.betaln(a + values, b + trials - values) - special.betaln(a, b)
        return float((each @ often).max())

    k = int(np.argmax([likelihood(one) for one in _MEANS]))
    around = _MEANS[max(k - 1, 0)], _MEANS[min(k + 1, len(_MEANS) - 1)]
    found = optimize.minimize_scalar(lambda one: -likelihood(one), bounds=around, method="bounded")
    best = float(found.x)
    limit = likelihood(best) - fall

    def end(means: list[float], beyond: float) -> float:
        """From `best` outwards, where likelihood falls below the limit."""
        inside = best
        for mean in means:
            if likelihood(mean) < limit:
                return float(optimize.brentq(lambda one: likelihood(one) - limit, inside, mean))
            inside = mean
        return beyond

    low = end([one for one in reversed(_MEANS) if one < best], 0.0)
    return low, end([one for one in _MEANS if one > best], 1.0)


def permutation(differences: Sequence[float] | Array) -> float:
    """p of the paired permutation test of the mean, two-sided: signs of differences are exchanged.

    Exact, by all 2^n signs, for up to EXACT_UP_TO participants; above by random ones, where the
    observed counts as one of them (B. Phipson, G. K. Smyth, Stat. Appl. Genet. Mol. Biol. 9, 2010).
    Differences that are all zero give 1.
    """
    x = np.asarray(differences, float)
    observed = abs(x.sum())
    least = observed - 1e-9 * max(np.abs(x).sum(), 1e-300)  # sums of the same numbers, rounded
    if len(x) <= EXACT_UP_TO:
        sums = np.zeros(1)
        for value in x:
            sums = np.concatenate([sums + value, sums - value])
        return float((np.abs(sums) >= least).mean())
    rng, count = np.random.default_rng(_SEED), 0
    for _ in range(10):
        signs = rng.integers(0, 2, (_RANDOM // 10, len(x)), dtype=np.int8) * 2 - 1
        count += int((np.abs(signs @ x) >= least).sum())
    return (count + 1) / (_RANDOM + 1)


def wilcoxon(differences: Sequence[float] | Array) -> float:
    """p of Wilcoxon's signed-rank test, two-sided: the permutation test of signed ranks.

    So it is exact with ties, too. Zeros have ranks and no sign (J. W. Pratt, J. Am. Stat. Assoc.
    54, 1959).
    """
    x = np.round(np.asarray(differences, float), 9)  # means of ratings that are equal, rounded
    return permutation(np.sign(x) * stats.rankdata(np.abs(x)))


def holm(p: Sequence[float]) -> list[float]:
    """Adjust p values of several tests (S. Holm, Scand. J. Stat. 6, 1979)."""
    adjusted, highest = [0.0] * len(p), 0.0
    for rank, k in enumerate(sorted(range(len(p)), key=lambda k: p[k])):
        highest = max(highest, min((len(p) - rank) * p[k], 1.0))
        adjusted[k] = highest
    return adjusted


def effect_size(differences: Sequence[float] | Array) -> float | None:
    """Cohen's d_z: the mean of differences over their standard deviation; None without one."""
    x = np.asarray(differences, float)
    spread = float(x.std(ddof=1)) if len(x) > 1 else 0.0
    return float(x.mean()) / spread if spread > 1e-12 else None


def detectable(people: int, power: float = 0.8) -> float | None:
    """Smallest d_z that a paired test of `people` finds with this power (noncentral t)."""
    if people < 3:
        return None
    freedom = people - 1
    limit = float(stats.t.ppf(1 - ALPHA / 2, freedom))

    def missing(shift: float) -> float:
        return float(stats.nct.sf(limit, freedom, shift)) - power

    # Beyond lie NaN; the other tail finds less than one in a thousand more.
    shift = float(optimize.brentq(missing, 0.0, _LARGEST_SHIFT))
    return shift / math.sqrt(people)
