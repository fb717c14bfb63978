"""What a study found, as text: tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from lightprobe.study.analysis import ALL, RESEARCH_PEOPLE, Comparison, Findings
from lightprobe.study.statistics import ALPHA, EXACT_UP_TO, Interval, detectable
from lightprobe.study.trials import HIGHEST

#: On each table and plot of participants that were made up.
SIMULATED = "SIMULATED PARTICIPANTS: a test of the analysis, no study of people"


def lines(found: Findings) -> Iterator[str]:
    """Give it line by line."""
    made_up = "simulated participants" if found.simulated else "participants"
    yield f"# {plain(found.title)}"
    yield ""
    yield f"{found.people} {made_up}, {len(found.left_out)} left out. 95 % intervals."
    for one in found.left_out:
        who = f"{one.participant.file}, {one.participant.id}"
        yield f"left out: {plain(who)}: {one.reason}"
    for table in (_ratings(found), _compared_ratings(found), _choices(found), _consistency(found)):
        rows = list(table)
        if rows:
            yield ""
            if found.simulated:
                yield f"**{SIMULATED}**"
                yield ""
            yield from rows
    yield ""
    yield from _notes(found)


def plain(text: str) -> str:
    """Give a name without what a terminal or a table of Markdown would take as its own."""
    shown = "".join(letter if letter.isprintable() else "�" for letter in text)
    return shown.replace("|", "\\|")


def _ratings(found: Findings) -> Iterator[str]:
    if not found.ratings:
        return
    objects = list(dict.fromkeys(one.object for one in found.ratings))
    yield f"## Ratings, 0 to {HIGHEST}"
    yield ""
    heads = [*map(plain, objects), f"rated below {HIGHEST // 2}"]
    yield _row("method", *heads)
    yield _rule(len(heads) + 1)
    for method in dict.fromkeys(one.method for one in found.ratings):
        rows = {one.object: one for one in found.ratings if one.method == method}
        real = " (real)" if method == found.reference else ""
        cells = [interval(rows[thing].rating) for thing in objects]
        yield _row(plain(method) + real, *cells, percent(rows[ALL].virtual))


def _compared_ratings(found: Findings) -> Iterator[str]:
    rows = [one for one in found.comparisons if one.kind == "rating"]
    if not rows:
        return
    yield "## Ratings compared, by participant"
    yield ""
    yield _row("first", "second", "first − second", "d_z", "p", "p (Holm)", "p (Wilcoxon)",
               "would be found")  # fmt: skip
    yield _rule(8)
    for one in rows:
        yield _row(
            plain(one.first), plain(one.second), interval(one.value), _number(one.effect),
            *_tests(one), _number(one.detectable, "±"),
        )  # fmt: skip


def _choices(found: Findings) -> Iterator[str]:
    rows = [one for one in found.comparisons if one.kind == "choice"]
    if not rows:
        return
    objects = list(rows[0].objects)
    yield "## Choices: how often the first was chosen; 50 %: they cannot be told apart"
    yield ""
    yield _row("first", "second", ALL, *map(plain, objects), "p", "p (Holm)", "p (Wilcoxon)",
               "would be found")  # fmt: skip
    yield _rule(7 + len(objects))
    for one in rows:
        smallest = "–" if one.detectable is None else f"50 ± {100 * one.detectable:.0f} %"
        yield _row(
            plain(one.first), plain(one.second), percent(one.value),
            *(percent(one.objects[thing]) for thing in objects), *_tests(one), smallest,
        )  # fmt: skip


def _consistency(found: Findings) -> Iterator[str]:
    one = found.consistency
    rows = (
        ("a picture rated twice: difference", one.rating_change, interval),
        ("a pair shown twice: the same choice", one.same_choice, percent),
        ("two identical pictures: left or upper one", one.first_place, percent),
        ("all choices: left or upper one", one.first_place_all, percent),
    )
    if not any(value for _, value, _ in rows):
        return
    yield "## How consistent the answers are"
    yield ""
    yield _row("", "")
    yield _rule(2)
    for words, value, show in rows:
        if value is not None:
            yield _row(words, show(value))


def _notes(found: Findings) -> Iterator[str]:
    yield (
        "Means: Student's t over participants. Shares: Wilson, answers of one participant counted "
        "as alike as they are, and as alike as they may be where few people tell little of it. "
        f"p: paired permutation test, exact up to {EXACT_UP_TO} participants;"
        " Holm: over all comparisons of a table. *Would be found*: with these participants, in 80 %"
        f" of such studies, at p < {ALPHA}."
    )
    if found.people == 1:
        yield "One participant tells nothing of others: no intervals, and no tests."
    elif 2 / 2**found.people >= ALPHA:
        yield f"{found.people} participants: p is {2 / 2**found.people:g} at least: ask more."
    effect, research = found.detectable_effect, detectable(RESEARCH_PEOPLE)
    if effect is not None and research is not None:
        yield (
            f"{found.people} participants find a difference of {effect:.2f} standard deviations of "
            f"the differences between participants; {RESEARCH_PEOPLE}, as in the research behind "
            f"lightprobe, {research:.2f}."
        )


def interval(one: Interval) -> str:
    """Mean, and its interval in brackets."""
    if one.low is None or one.high is None:
        return f"{one.value:.2f}"
    return f"{one.value:.2f} ({one.low:.2f} … {one.high:.2f})"


def percent(one: Interval) -> str:
    """Share in percent, and its interval in brackets."""
    if one.low is None or one.high is None:
        return f"{100 * one.value:.0f} %"
    return f"{100 * one.value:.0f} % ({100 * one.low:.0f} … {100 * one.high:.0f})"


def _tests(one: Comparison) -> list[str]:
    return [_p(one.p), _p(one.p_holm), _p(one.p_wilcoxon)]


def _p(value: float | None) -> str:
    if value is None:
        return "–"
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _number(value: float | None, sign: str = "") -> str:
    return "–" if value is None else f"{sign}{value:.2f}"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _rule(count: int) -> str:
    return "|" + " --- |" * count
