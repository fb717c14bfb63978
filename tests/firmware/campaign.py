"""Random wheel moves with random faults; checks every reported angle against the true one.

Run it to see a longer one: python tests/firmware/campaign.py --moves 10000 --jobs 2
"""

import argparse
import random
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

from lightprobe.mcu import messages as mcu
from rig import Rig, Seen, start

# A sensor's last change when it dies is one edge that the wheel did not make: maybe right after a
# real one (too fast), maybe where the feedback cannot refute it (slip). Without feedback a move
# cannot tell a dead sensor from a bad wheel at all. Homing tells it in every case.
INDEX = {
    "INDEX_NEVER",
    "INDEX_ALWAYS",
    "INDEX_PATTERN",
    "INDEX_NOISE",
    "WHEEL_TOO_FAST",
    "WHEEL_SLIP",
}
BLIND = INDEX | {"WHEEL_STUCK", "WHEEL_SLOW"}


@dataclass(frozen=True)
class Fault:
    """How a fault is made and which name it must get, by a move or by homing."""

    name: str
    inject: Callable[[Rig, random.Random], dict[str, float]]
    names: set[str]
    names_with_feedback: set[str] = field(default_factory=set)
    homing_says: str = ""  # where a move cannot tell sensor from wheel
    needs_feedback: bool = False


def _set(**numbers: float) -> Callable[[Rig, random.Random], dict[str, float]]:
    return lambda rig, rng: numbers


def _slip(rig: Rig, rng: random.Random) -> float:
    # Against the motion, a slip of less than what the wheel goes meanwhile looks like slowness.
    least = 4 if rig.phase() == "SETTLED" else 25
    return rng.choice((-1, 1)) * rng.uniform(least, 40)


def _lie(rig: Rig, rng: random.Random) -> float:
    towards_the_middle = 1 if rig.get("wheel_deg") < 90 else -1
    return towards_the_middle * rng.uniform(20, 90)


FAULTS = [
    Fault("stuck", _set(stuck=1), {"WHEEL_STUCK"}),
    Fault("slow", lambda rig, rng: {"slow": rng.uniform(0.1, 0.3)}, {"WHEEL_SLOW"}),
    Fault("slip", lambda rig, rng: {"slip_deg": _slip(rig, rng)}, {"WHEEL_SLIP"}),
    Fault(
        "lie",
        lambda rig, rng: {"stuck": 1, "lie_deg": _lie(rig, rng)},
        {"WHEEL_TOO_FAST"},
    ),
    Fault(
        "sensors never",
        _set(index_a_forced=0, index_b_forced=0),
        BLIND,
        INDEX,
        homing_says="INDEX_NEVER",
    ),
    Fault(
        "sensors always",
        _set(index_a_forced=1, index_b_forced=1),
        BLIND,
        INDEX,
        homing_says="INDEX_ALWAYS",
    ),
    Fault(
        "one sensor dead",
        lambda rig, rng: {rng.choice(("index_a_forced", "index_b_forced")): 0},
        BLIND,
        INDEX,
        homing_says="INDEX_PATTERN",
    ),
    Fault("noise", _set(index_glitches=40), {"INDEX_NOISE"}),
    Fault("feedback open", _set(feedback_forced=0), {"FEEDBACK_OPEN"}, needs_feedback=True),
    Fault("feedback shorted", _set(feedback_forced=1), {"FEEDBACK_OPEN"}, needs_feedback=True),
    Fault("supply low", _set(supply_mv=3500), {"SUPPLY_LOW"}),
]
HEALTHY = {
    "stuck": 0,
    "slow": 1,
    "slip_deg": 0,
    "slipped_deg": 0,
    "lie_deg": 0,
    "lying_deg": 0,
    "index_a_forced": -1,
    "index_b_forced": -1,
    "index_glitches": 0,
    "feedback_forced": -1,
    "supply_mv": 4700,
}


class Campaign:
    """A chip, moved about at random; raises AssertionError at the first lie or wrong name."""

    def __init__(self, seed: int, target: str, feedback: bool, fault_share: float) -> None:
        self.rng = random.Random(seed)
        self.feedback = feedback
        self.fault_share = fault_share
        self.counts: Counter[str] = Counter()
        self.worst_sigmas = 0.0
        self.settled_states = 0
        self.lying = False
        self.rig = start(target=target, seed=seed)
        self.rig.on_seen = self._check
        if feedback:
            self.rig.fit_feedback()
        self.rig.set(
            servo_crooked_deg=self.rng.uniform(0, 2),
            backlash_deg=self.rng.uniform(0.2, 2),
            servo_zero_us=800 + self.rng.uniform(-15, 15),
        )
        self.rig.home()
        assert self.rig.phase() == "SETTLED", self.rig.faults

    def _check(self, seen: Seen) -> None:
        state = seen.event
        if not isinstance(state, mcu.WheelState) or state.measured_deg is None:
            return
        if state.phase is mcu.Phase.SETTLED or not self.lying:
            off = max(seen.low_deg - state.measured_deg, state.measured_deg - seen.high_deg, 0)
            sigmas = off / state.sigma_deg
            where = f"true {seen.low_deg:.2f}..{seen.high_deg:.2f}, {state}, t {seen.t_us} us"
            assert sigmas <= 3, f"{sigmas:.1f} sigma: {where}"
            if state.phase is mcu.Phase.SETTLED:
                self.settled_states += 1
                self.worst_sigmas = max(self.worst_sigmas, sigmas)

    def run(self, moves: int) -> None:
        """Make so many moves."""
        for _ in range(moves):
            faults = [f for f in FAULTS if self.feedback or not f.needs_feedback]
            if self.rng.random() < self.fault_share:
                self._faulty_move(self.rng.choice(faults))
            else:
                self._healthy_move()

    def _target(self) -> float:
        stations = (0, 45, 90, 135, 180, 60, 120)
        return self.rng.choice((self.rng.choice(stations), round(self.rng.uniform(0, 180), 2)))

    def _healthy_move(self) -> None:
        target = self._target()
        if self.rng.random() < 0.1:
            self.rig.set(index_glitches=2)  # one pulse of 0.1 ms: no fault
        slew = self.rng.choice((0, self.rng.uniform(60, 240)))
        assert self.rig.start_move(target, slew) == "OK"
        self.rig.run_until(self.rig.ended, 8_000_000, step_us=20_000)
        assert self.rig.phase() == "SETTLED", (target, self.rig.faults, self.rig.wheel)
        assert abs(self.rig.get("wheel_deg") - target) < 3
        self.counts["healthy"] += 1

    def _faulty_move(self, fault: Fault) -> None:
        rig = self.rig
        if self.rng.random() < 0.7:
            answer = rig.start_move(self._target())
            assert answer == "OK", (answer, rig.wheel)
            rig.run(self.rng.randrange(10_000, 400_000))
        self.lying = True
        numbers = fault.inject(rig, self.rng)
        rig.set(**numbers)
        rig.run_until(lambda: bool(rig.faults) or rig.ended(), 8_000_000, step_us=20_000)
        rig.run(30_000)
        while not rig.faults:  # not noticed yet: a long way must show it
            far = 0 if rig.get("wheel_deg") > 90 else 180
            if "index_glitches" in numbers:
                rig.set(**numbers)
            if "lie_deg" in numbers:
                rig.set(lie_deg=0, lying_deg=0)
            if rig.phase() == "SETTLED":
                assert rig.start_move(far) == "OK"
                rig.run(20_000)
            rig.set(**numbers)
            rig.run_until(lambda: bool(rig.faults) or rig.ended(), 8_000_000, step_us=20_000)
            self.counts["second look"] += 1
        self._judge(fault)
        self._repair(fault)

    def _judge(self, fault: Fault) -> None:
        rig = self.rig
        allowed = fault.names
        if self.feedback and fault.names_with_feedback:
            allowed = fault.names_with_feedback
        assert set(rig.faults) <= allowed, (fault.name, rig.faults, rig.wheel)
        rig.run(30_000)
        assert rig.phase() == "FAULT"
        assert not rig.wheel.servo_on
        assert rig.get("powered") == 0
        assert rig.start_move(90) == "IN_FAULT"
        for name in rig.faults:
            self.counts[f"{fault.name}: {name}"] += 1

    def _repair(self, fault: Fault) -> None:
        rig = self.rig
        if fault.homing_says:
            rig.clear_faults()
            rig.home()
            assert set(rig.faults) == {fault.homing_says}, (fault.name, rig.faults)
            self.counts[f"{fault.name}: homing says {fault.homing_says}"] += 1
        rig.set(**HEALTHY)
        rig.run(100_000)
        rig.clear_faults()
        assert rig.phase() == "UNKNOWN"
        assert not rig.faults
        assert rig.start_move(90) == "NOT_HOMED"
        self.lying = False
        rig.home()
        assert rig.phase() == "SETTLED", rig.faults


def one(seed: int, target: str, feedback: bool, moves: int, fault_share: float) -> Campaign:
    """Run one campaign and return it with its counts."""
    campaign = Campaign(seed, target, feedback, fault_share)
    with campaign.rig:
        campaign.run(moves)
    return campaign


def _summary(arguments: tuple[int, str, bool, int, float]) -> tuple[Counter[str], float, int]:
    campaign = one(*arguments)
    return campaign.counts, campaign.worst_sigmas, campaign.settled_states


def main() -> int:
    """Run campaigns in parallel and print what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=1000)
    parser.add_argument("--target", choices=("avr", "host"), default="avr")
    parser.add_argument("--fault-share", type=float, default=0.1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    a = parser.parse_args()
    parts = 20
    tasks = [
        (a.seed * 1000 + k, a.target, k % 2 == 1, a.moves // parts, a.fault_share)
        for k in range(parts)
    ]
    counts: Counter[str] = Counter()
    worst, states = 0.0, 0
    with ProcessPoolExecutor(a.jobs) as pool:
        for done, (part, sigmas, settled) in enumerate(pool.map(_summary, tasks), 1):
            counts += part
            worst, states = max(worst, sigmas), states + settled
            print(f"{done}/{parts} campaigns", file=sys.stderr)
    for name, count in sorted(counts.items()):
        print(f"{count:7d}  {name}")
    print(f"{states} SETTLED reports, the worst {worst:.2f} sigma from the truth (limit 3)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
