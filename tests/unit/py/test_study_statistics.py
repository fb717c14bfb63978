"""The statistics of a study: published values, exact enumeration, and how often they are wrong."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.study import statistics

SEVERAL = st.lists(st.floats(-10, 10), min_size=2, max_size=8)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [  # R. G. Newcombe, Stat. Med. 17, 1998, table I, method 3
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)  # fmt: skip
def test_wilsons_interval_is_as_published(successes, trials, low, high):
    found = statistics.wilson(successes, trials)
    assert found.value == successes / trials
    assert (found.low, found.high) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilsons_interval_holds_the_share_and_stays_within_0_and_1(case):
    successes, trials = case
    found, other = statistics.wilson(*case), statistics.wilson(trials - successes, trials)
    assert 0 <= found.low <= found.value + 1e-12
    assert found.value - 1e-12 <= found.high <= 1
    assert found.low == pytest.approx(1 - other.high, abs=1e-12)


@given(SEVERAL)
def test_the_permutation_test_is_exact_enumeration(differences):
    x = np.array(differences)
    sums = [abs(np.dot(signs, x)) for signs in product((1, -1), repeat=len(x))]
    expected = np.mean(np.array(sums) >= abs(x.sum()) - 1e-9 * max(np.abs(x).sum(), 1e-300))
    assert statistics.permutation(differences) == pytest.approx(expected)


def test_the_random_permutation_test_agrees_with_the_exact_one(monkeypatch):
    x = np.random.default_rng(3).normal(0.5, 1, 14)
    exact = statistics.permutation(x)
    monkeypatch.setattr(statistics, "EXACT_UP_TO", 2)
    # Of 100 000 random signs: a standard deviation of 0.0007 at most.
    assert statistics.permutation(x) == pytest.approx(exact, abs=0.004)


def test_wilcoxons_test_is_as_published():
    """Darwin's maize, cross- and self-fertilized: p = 0.041 (W = 24, n = 15)."""
    eighths = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
    assert statistics.wilcoxon(eighths) == pytest.approx(0.0413, abs=2e-3)
    # R. A. Fisher, The Design of Experiments, 1935, section 21: 1726 of 32768 sums, two-sided.
    assert statistics.permutation(eighths) == pytest.approx(1726 / 32768)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_only_raises_p_and_keeps_the_order(p):
    adjusted = statistics.holm(p)
    assert all(one <= other <= 1 for one, other in zip(p, adjusted, strict=True))
    assert min(adjusted) == pytest.approx(min(min(p) * len(p), 1))
    ordered = [adjusted[k] for k in np.argsort(p, kind="stable")]
    assert ordered == sorted(ordered)


def test_holm_is_as_calculated_by_hand():
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(st.integers(2, 40), st.floats(-5, 5))
def test_equal_values_are_no_trouble(count, value):
    values = [value] * count
    assert statistics.mean(values).value == pytest.approx(value)
    assert statistics.permutation([0.0] * count) == 1
    assert statistics.wilcoxon([0.0] * count) == 1
    assert statistics.effect_size([0.0] * count) is None
    assert statistics.clustered_wilson([2] * count, 2).value == 1


def test_of_one_participant_nothing_is_said_of_others():
    assert statistics.mean([4]) == statistics.Interval(4, None, None)
    assert statistics.clustered_wilson([3], 4) == statistics.Interval(0.75, None, None)
    assert statistics.clustered_wilson([4], 4) == statistics.Interval(1, None, None)
    assert statistics.effect_size([4]) is None
    assert statistics.detectable(1) is None


@pytest.mark.parametrize("people", [8, 11])
def test_tests_cry_wolf_as_often_as_they_say(people):
    """Where nothing differs, p is at most 0.05 in one of twenty studies."""
    rng, studies = np.random.default_rng(people), 1000
    tests = (statistics.permutation, statistics.wilcoxon)
    p = np.array([[test(x) for test in tests] for x in rng.normal(0, 1, (studies, people))])
    # With four standard deviations of a share of 1000, 0.007 each.
    assert np.mean(p <= 0.05, axis=0) == pytest.approx(0.05, abs=4 * 0.007)


@given(st.lists(st.integers(-9, 9).filter(bool), min_size=3, max_size=9, unique_by=abs))
def test_without_ties_wilcoxons_test_is_scipys(differences):
    expected = statistics.stats.wilcoxon(differences, method="exact").pvalue
    assert statistics.wilcoxon(differences) == pytest.approx(expected)


@pytest.mark.parametrize("share", [0.5, 0.2])
@pytest.mark.parametrize("spread", [0.01, 0.15])
def test_intervals_of_a_share_cover_it_in_95_percent_of_500_studies(share, spread):
    """Also where participants differ: counted as independent, their answers would say too much."""
    rng, people, trials = np.random.default_rng(11), 33, 15
    strength = share * (1 - share) / spread**2 - 1
    covered = naive = 0
    for _ in range(500):
        own = rng.beta(share * strength, (1 - share) * strength, people)
        counts = rng.binomial(trials, own)
        found = statistics.clustered_wilson(counts.tolist(), trials)
        covered += found.low <= share <= found.high
        simple = statistics.wilson(counts.sum(), people * trials)
        naive += simple.low <= share <= simple.high
    assert 0.92 <= covered / 500 <= 0.99
    assert spread < 0.1 or naive / 500 < 0.91


def _shares_of_people(kind, share, people, rng):
    """Draw what each person answers "yes" to: all the same, all or nothing, or beta(0.9, 0.1)."""
    if kind == "independent":
        return np.full(people, share)
    if kind == "always alike":
        return (rng.random(people) < share).astype(float)
    return rng.beta(share, 1 - share, people)


@pytest.mark.parametrize("people", [6, 10])
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("kind", ["independent", "always alike", "beta"])
def test_intervals_cover_shares_of_few_people_and_near_1_also_where_a_persons_answers_are_alike(
    kind, share, people
):
    rng, trials, studies = np.random.default_rng(23), 20, 200
    covered = 0
    for _ in range(studies):
        own = _shares_of_people(kind, share, people, rng)
        found = statistics.clustered_wilson(rng.binomial(trials, own).tolist(), trials)
        covered += found.low <= share <= found.high
    assert covered / studies >= 0.92  # found: 0.95 to 1


def test_an_interval_knows_nothing_of_people_of_whom_none_came():
    """A limit that study.md states: of six, in 26 % of studies none is of a kind of one in five."""
    rng, trials, studies = np.random.default_rng(7), 20, 200
    covered = 0
    for _ in range(studies):
        own = np.where(rng.random(6) < 0.2, 0, 0.85)
        found = statistics.clustered_wilson(rng.binomial(trials, own).tolist(), trials)
        covered += found.low <= 0.68 <= found.high
    assert covered / studies == pytest.approx(0.75, abs=0.09)


@pytest.mark.parametrize("people", [2, 3, 6, 10, 33])
def test_people_who_all_answer_the_same_count_as_one_answer_each(people):
    found = statistics.clustered_wilson([20] * people, 20)
    assert (found.value, found.high) == (1, 1)
    assert found.low <= statistics.wilson(people, people).low
    none = statistics.clustered_wilson([0] * people, 20)
    assert (none.low, none.high) == (0, pytest.approx(1 - found.low, abs=1e-4))


def test_one_answer_that_differs_does_not_make_all_of_them_independent():
    """Of 10 people with 20 answers each; as independent ones, 97 to 100 %."""
    found = statistics.clustered_wilson([20] * 9 + [19], 20)
    assert found.low < 0.91
    assert statistics.wilson(199, 200).low > 0.97


def test_the_likelihood_interval_is_that_of_single_answers_where_each_person_gives_one():
    """A binomial's: with its ends the likelihood falls by n log(1 + t²/(n − 1)) / 2."""
    yes, people = 7, 10
    ends = statistics._beta_binomial(np.array([1.0] * yes + [0.0] * (people - yes)), 1)
    t = statistics.stats.t.ppf(0.975, people - 1)
    for end in ends:
        fall = yes * np.log(0.7 / end) + (people - yes) * np.log(0.3 / (1 - end))
        assert fall == pytest.approx(people * np.log(1 + t * t / (people - 1)) / 2, rel=1e-3)


@given(
    st.integers(1, 30).flatmap(
        lambda n: st.tuples(st.lists(st.integers(0, n), min_size=2, max_size=12), st.just(n))
    )
)
def test_the_interval_of_any_answers_holds_their_share_and_turns_round_with_them(case):
    counts, trials = case
    found = statistics.clustered_wilson(counts, trials)
    other = statistics.clustered_wilson([trials - one for one in counts], trials)
    assert 0 <= found.low <= found.value + 1e-9
    assert found.value - 1e-9 <= found.high <= 1
    assert found.low == pytest.approx(1 - other.high, abs=1e-3)


@pytest.mark.parametrize("people", [12, 33])
def test_what_can_be_found_is_found_in_80_percent_of_studies(people):
    effect = statistics.detectable(people)
    rng, count = np.random.default_rng(5), 2000
    x = rng.normal(effect, 1, (count, people))
    t = x.mean(axis=1) / x.std(axis=1, ddof=1) * np.sqrt(people)
    limit = statistics.stats.t.ppf(0.975, people - 1)
    assert np.mean(np.abs(t) > limit) == pytest.approx(0.8, abs=0.04)


def test_33_people_find_half_a_standard_deviation():
    """As G*Power 3.1 gives for paired t tests: n = 34 for d_z = 0.5 and a power of 0.8."""
    assert statistics.detectable(34) == pytest.approx(0.5, abs=0.01)
