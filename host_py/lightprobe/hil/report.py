"""What the checks of one box came to, for programs (JSON) and for people (an HTML page)."""

from __future__ import annotations

import datetime
import html
import json
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lightprobe import __version__
from lightprobe.hil import chart
from lightprobe.hil.bench import Bench
from lightprobe.hil.check import Check, Finding, Verdict

VERSION = 1  # of the JSON


@dataclass(frozen=True)
class Report:
    """Checks with their findings, and of which box."""

    checks: Sequence[Check]
    findings: dict[str, Finding]
    facts: dict[str, str]  # in words, in their order
    series: dict[str, Any]
    unrestored: Sequence[str] = ()

    @property
    def failed(self) -> list[Check]:
        """Checks that failed."""
        return [one for one in self.checks if self.findings[one.name].verdict is Verdict.FAIL]

    @property
    def words(self) -> str:
        """One line of what came out."""
        counts = {
            verdict: sum(one.verdict is verdict for one in self.findings.values())
            for verdict in Verdict
        }
        words = (
            f"{counts[Verdict.PASS]} passed, {counts[Verdict.FAIL]} failed, "
            f"{counts[Verdict.SKIPPED]} skipped"
        )
        if self.unrestored:
            words += f"; not put back: {', '.join(self.unrestored)} (a reset of the box does it)"
        return words


def facts_of(bench: Bench, serial_number: str, started: datetime.datetime) -> dict[str, str]:
    """Say which box this is, which programs, where and when."""
    hello = bench.box.greeting
    assert hello is not None
    parts = ("major", "minor", "patch")
    return {
        "port": bench.box.uri,
        "serial number": serial_number or "none",
        "firmware": ".".join(str(hello[f"firmware_{part}"]) for part in parts),
        "protocol": f"{hello['protocol_major']}.{hello['protocol_minor']}",
        "board": str(hello["board"]),
        "boot": f"{hello['boot_count']}, by {hello['reset_cause']}",
        "lightprobe": __version__,
        "host": f"{platform.node()}, {platform.system()} {platform.release()}, "
        f"Python {platform.python_version()}",
        "date": started.isoformat(timespec="seconds"),
    }


def as_json(report: Report) -> str:
    """Give the report for programs."""
    checks = [
        {
            "name": one.name,
            "verdict": report.findings[one.name].verdict.value,
            "asks": one.asks,
            "measured": report.findings[one.name].measured,
            "numbers": report.findings[one.name].numbers,
            "bound": one.bound,
            "source": {"file": one.source.file, "words": one.source.words},
            "next_step": report.findings[one.name].next_step,
        }
        for one in report.checks
    ]
    whole = {
        "lightprobe_hil": VERSION,
        "passed": not report.failed,
        "box": report.facts,
        "not_put_back": list(report.unrestored),
        "checks": checks,
        "series": report.series,
    }
    return json.dumps(whole, indent=1, allow_nan=False) + "\n"


_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 68rem;
  padding: 0 1rem; color: #1c2530; background: #fff; }
h1 { font-size: 1.5rem; margin: 0 0 .25rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; }
.sum { font-size: 1.1rem; margin: 0 0 1.5rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1.2rem; margin: 0; }
dt { color: #5b6875; } dd { margin: 0; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; }
th { text-align: left; color: #5b6875; font-weight: 600; }
th, td { padding: .4rem .7rem .4rem 0; border-bottom: 1px solid #e3e8ee; vertical-align: top; }
td:nth-child(2) { white-space: nowrap; font-weight: 600; }
td:first-child { white-space: nowrap; }
.pass { color: #14743a; } .fail { color: #b3261e; } .skipped { color: #6b7682; }
.step { color: #b3261e; } .step, .asks { display: block; } small { color: #5b6875; }
svg { width: 100%; height: auto; }
"""


def as_html(report: Report) -> str:
    """Give the report as one page that needs no other file."""
    text = html.escape
    title = f"lightprobe hil: {report.facts['port']}"
    facts = "".join(f"<dt>{text(k)}</dt><dd>{text(v)}</dd>" for k, v in report.facts.items())
    rows = "".join(_row(one, report.findings[one.name]) for one in report.checks)
    verdict = "fail" if report.failed else "pass"
    return (
        f'<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><title>{text(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style>'
        f'<h1>{text(title)}</h1><p class="sum {verdict}">{text(report.words)}</p>'
        f"<dl>{facts}</dl><h2>Checks</h2><table><thead><tr><th>check<th>verdict<th>measured"
        f"<th>bound</tr></thead><tbody>{rows}</tbody></table>{_plots(report.series)}</html>\n"
    )


def _row(check: Check, finding: Finding) -> str:
    text = html.escape
    step = f'<span class="step">→ {text(finding.next_step)}</span>' if finding.next_step else ""
    verdict = finding.verdict.value
    return (
        f'<tr><td>{text(check.name)}<td class="{verdict}">{verdict}'
        f'<td>{text(finding.measured)}{step}<small class="asks">{text(check.asks)}</small>'
        f"<td>{text(check.bound)}<br><small>{text(check.source.file)}</small></tr>"
    )


def _plots(series: dict[str, Any]) -> str:
    parts = []
    if times_ms := series.get("latency_ms"):
        parts.append("<h2>Latency: from a question to its answer</h2>")
        parts.append(chart.histogram(times_ms, "ms", "answers"))
    if rings := series.get("ring_levels"):
        lines = {
            f"sensor {k}": list(zip(series["ring_t_s"], (ring[k] for ring in rings), strict=True))
            for k in range(9)
        }
        parts.append("<h2>Ring: readings of the nine light sensors</h2>")
        parts.append(chart.lines(lines, "s", "level, of 4092"))
    if points := series.get("wheel"):
        start_s = points[0][0]
        lines = {
            "measured": [(t - start_s, measured) for t, measured, _ in points],
            "commanded": [(t - start_s, commanded) for t, _, commanded in points],
        }
        parts.append("<h2>Wheel: angle against the box's time</h2>")
        parts.append(chart.lines(lines, "s", "degrees"))
    return "".join(parts)
