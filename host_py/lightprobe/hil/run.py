"""Which checks there are, and how they run: in order, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import can

from lightprobe.errors import UsageError
from lightprobe.hil import link_checks, ring_checks, traffic_checks, wheel_checks
from lightprobe.hil.bench import Bench
from lightprobe.hil.check import (
    CannotTellError,
    Check,
    FaultError,
    Finding,
    Group,
    RestartError,
    Source,
    Verdict,
    judged,
    skipped,
)
from lightprobe.mcu import faults
from lightprobe.mcu.link import NO_ACKNOWLEDGE, McuError

#: Causes of a start that tell of a defect; the others are what a port or a person does.
_BAD_CAUSES = ("BROWN_OUT", "WATCHDOG", "STACK")
_NO_ANSWER, _STOPPED = "no answer", "refused: IN_FAULT"
_HOME, _LINK_FAULT = "wheel-home", "I2C_BUS"

Progress = Callable[[Check, Finding | None], None]


def _faults(bench: Bench) -> Finding:
    found = [name for name in bench.box.latched() if name not in bench.owned]
    measured = ", ".join(found) or "none"
    return judged(not found, measured, "; ".join(f"{one}: {faults.words(one)}" for one in found))


def _starts(bench: Bench) -> Finding:
    box = bench.box
    assert box.greeting is not None
    cause, times = str(box.greeting["reset_cause"]), len(box.starts)
    latched = [name for name in box.latched() if name.startswith("RESET_")]
    measured = f"last start by {cause}"
    if times:
        often = "once" if times == 1 else f"{times} times"
        measured = f"started again {often} during this run, by {', '.join(box.starts)}"
    steps = {
        "BROWN_OUT": "the supply breaks down: a supply of its own for the servo, C5, the USB cable",
        "WATCHDOG": "the firmware stood still: report it, with this report",
        "STACK": "the firmware ran out of memory: report it, with this report",
    }
    step = steps.get(cause, "the line's DTR, a loose cable of the supply, or the reset button")
    return judged(not times and cause not in _BAD_CAUSES and not latched, measured, step)


FIRST = Check(
    "faults", "Has the firmware latched a fault that no other check judges?", "none",
    Source("firmware/README.md", "is latched until the host clears it"), _faults,
    needs=("versions",),
)  # fmt: skip
LAST = Check(
    "starts", "Has the box started again by itself?", "not once; not by brown-out or watchdog",
    Source("proto/mcu.md", "`Hello` that was not requested\nmeans that the MCU was reset"), _starts,
    faults=("RESET_BROWN_OUT", "RESET_WATCHDOG", "RESET_STACK"),
)  # fmt: skip
ALL: tuple[Check, ...] = (
    *link_checks.CHECKS, FIRST, *traffic_checks.CHECKS, *ring_checks.CHECKS, *ring_checks.COVERED,
    *link_checks.SETTING, *wheel_checks.CHECKS, LAST,
)  # fmt: skip


def choose(groups: Iterable[Group], only: Sequence[str] = ()) -> list[Check]:
    """Give the checks of these groups, or those named; UsageError for a name there is not.

    Those named may be of any group: who names a check that moves the wheel wants it to move.
    """
    known = {one.name: one for one in ALL}
    for name in only:
        if name not in known:
            raise UsageError(f"hil: --only {name}: unknown; known are {', '.join(known)}")
    groups = set(groups)
    return [one for one in ALL if (one.name in only if only else one.group in groups)]


def run(bench: Bench, checks: Sequence[Check], progress: Progress) -> dict[str, Finding]:
    """Run checks in their order, and put the box back as it was found, whatever happens."""
    owners = {fault: one.name for one in checks for fault in one.faults}
    bench.owned = frozenset(owners)
    run = _Run(bench, owners)
    try:
        for check in checks:
            progress(check, None)
            finding = run.finding(check)
            run.findings.setdefault(check.name, finding)
            progress(check, run.findings[check.name])
    finally:
        bench.restore(is_there=not run.silent)
    return {one.name: run.findings[one.name] for one in checks}


class _Run:
    """What has been found so far, and what it makes meaningless."""

    def __init__(self, bench: Bench, owners: dict[str, str]) -> None:
        """`owners`: which check judges a fault of the firmware."""
        self.bench, self.owners = bench, owners
        self.findings: dict[str, Finding] = {}
        self.silent = ""
        self.stopped = ""  # why the wheel does not turn any more

    def finding(self, check: Check) -> Finding:
        """Measure, unless that makes no sense any more."""
        found = self.findings
        missing = [n for n in check.needs if n in found and found[n].verdict is not Verdict.PASS]
        if self.silent:
            return skipped(self.silent)
        if self.stopped and _HOME in check.needs:
            return skipped(self.stopped)
        if missing:
            return skipped(f"needs {', '.join(missing)}")
        try:
            finding = check.measure(self.bench)
            if finding.verdict is Verdict.FAIL and not self.bench.box.answers():
                return self._silence(check, McuError(_NO_ANSWER))
            return finding
        except CannotTellError as why:
            return skipped(str(why))
        except RestartError as start:
            return self._started(start)
        except FaultError as fault:
            return self._fault(check, fault)
        except (McuError, OSError, can.CanError) as error:
            return self._error(check, error)

    def _error(self, check: Check, error: Exception) -> Finding:
        try:
            starting = isinstance(error, OSError) and error.errno in NO_ACKNOWLEDGE
            gone = not starting and not isinstance(error, McuError)
            if gone or not self.bench.box.answers():
                return self._silence(check, error)
            if _STOPPED in str(error):
                self.bench.box.raise_fault()
        except FaultError as fault:
            return self._fault(check, fault)
        except RestartError as start:
            return self._started(start)
        except (OSError, can.CanError) as end:
            return self._silence(check, end)
        step = "the firmware is not that of this release, or damaged: `lightprobe mcu flash`"
        return judged(False, str(error).removeprefix("mcu: "), step)

    def _fault(self, check: Check, fault: FaultError) -> Finding:
        self.bench.homed = False
        owner = self.owners.get(fault.name, check.name)
        self.stopped = f"the wheel was stopped by {fault.name}: see {owner}"
        if owner == check.name:
            return fault.finding()
        self._blame(owner, fault.finding())
        return skipped(self.stopped)

    def _started(self, start: RestartError) -> Finding:
        self.bench.homed = False
        with suppress(RestartError, OSError, can.CanError):
            self.bench.box.quiet()
        return skipped(f"the box started again ({start.cause}) while this ran: see starts")

    def _silence(self, check: Check, error: Exception) -> Finding:
        """Let the check of the line answer for a box that says nothing any more."""
        step = "plug, cable and supply; does the Nano's lamp shine?"
        silence = judged(False, f"the box fell silent during {check.name}: {error}", step)
        owner = self.owners.get(_LINK_FAULT, check.name)
        self.silent = f"the box has fallen silent: see {owner}"
        if owner == check.name:
            return silence
        self._blame(owner, silence)
        return skipped(self.silent)

    def _blame(self, owner: str, finding: Finding) -> None:
        if owner not in self.findings or self.findings[owner].verdict is not Verdict.FAIL:
            self.findings[owner] = finding
