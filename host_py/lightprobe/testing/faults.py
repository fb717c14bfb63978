"""Every fault of the simulator by a name, and what the probe then shows.

The names stand for numbers that `lightprobe simulate --help-faults` lists. All of those have a name
here (tests/e2e/test_testing_faults.py).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from difflib import get_close_matches
from urllib.parse import parse_qsl, urlencode

from lightprobe.errors import UsageError
from lightprobe.sim.faults import BOX, Faults


@dataclass(frozen=True)
class NamedFault:
    """A fault that can be asked for by name."""

    name: str
    query: str  # as `lightprobe simulate --faults` takes it
    means: str
    #: What the probe shows within ten seconds: `fault ID`, `flag NAME`, `count NAME` (a counter of
    #: the health message that rises) or `nothing`, where it copes.
    shows: str

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers of the simulator by their names."""
        return {key: float(text) for key, text in parse_qsl(self.query)}


_CAMERA = (
    ("camera-late", "late_ms=1500", "every frame arrives 1.5 s late", "flag STALE"),
    ("camera-jitter", "jitter_ms=300", "frames arrive up to 0.3 s late", "nothing"),
    ("camera-drops", "drop=0.5", "half of the frames are lost", "count frames_dropped"),
    (
        "camera-corrupt",
        "corrupt=0.5",
        "half of the frames have changed bytes",
        "count frames_rejected",
    ),
    ("camera-truncated", "truncate=1", "every frame is cut short", "count frames_rejected"),
    ("camera-garbage", "garbage=1", "every frame is random bytes", "count frames_rejected"),
    (
        "camera-marked",
        "marked=1",
        "the driver marks every frame as corrupt",
        "fault source-stalled",
    ),
    (
        "camera-wrong-size",
        "wrong_size=1",
        "every frame tells half its size",
        "count frames_rejected",
    ),
    ("camera-stalled", "stall_after=1", "no more frames come", "fault source-stalled"),
    (
        "camera-stalls",
        "stall_after=30&stall_s=3",
        "no frames for 3 s, again and again",
        "fault source-stalled",
    ),
    (
        "camera-reconnects",
        "disconnect_after=30",
        "it is unplugged and plugged in, again and again",
        "fault source-waiting",
    ),
    (
        "camera-cut",
        "cut_after=30",
        "it is unplugged in the middle of a frame, again and again",
        "fault source-waiting",
    ),
    ("camera-deaf", "ignore_exposure=1", "exposure commands have no effect", "nothing"),
    ("camera-slow-exposure", "delay_frames=9", "exposure commands take nine frames", "nothing"),
    (
        "camera-hidden-exposure",
        "hide_exposure=1",
        "frames do not report their exposure",
        "flag EXPOSURE_UNKNOWN",
    ),
    ("camera-automatic", "auto_exposure=1", "it exposes by itself", "nothing"),
    (
        "camera-breathing",
        "auto_exposure=1&breathe_stops=2&breathe_s=2",
        "its automatic exposure swings",
        "nothing",
    ),
    (
        "camera-orientation-hidden",
        "hide_orientation=1",
        "frames do not report their orientation",
        "nothing",
    ),
    (
        "camera-orientation-noise",
        "orientation_noise_deg=3",
        "the orientation has noise of 3 degrees",
        "nothing",
    ),
    (
        "camera-place-noise",
        "place_noise_m=0.1",
        "the place has noise of 0.1 m, of a probe that goes",
        "nothing",
    ),
    (
        "camera-orientation-late",
        "orientation_late_ms=500",
        "the orientation is half a second old",
        "nothing",
    ),
    (
        "camera-orientation-drops",
        "orientation_drop=0.9",
        "most frames have no orientation",
        "nothing",
    ),
    (
        "camera-orientation-jumps",
        "orientation_jump_s=1&orientation_jump_deg=30",
        "the orientation jumps every second",
        "nothing",
    ),
    ("camera-clock-stopped", "clock_stop_s=0.001", "time stamps stand still", "fault camera-clock"),
    (
        "camera-clock-ahead",
        "clock_ahead_ms=5000",
        "time stamps are 5 s ahead",
        "fault camera-clock",
    ),
    (
        "camera-clock-step",
        "clock_ahead_ms=-5000&clock_step_s=8",
        "time stamps jump back by 5 s, 8 s after the start",
        "fault camera-clock",
    ),
    (
        "camera-clock-drift",
        "clock_drift_ppm=50000",
        "its clock runs 5 % too fast",
        "fault camera-clock",
    ),
)

_BOX = (
    ("wheel-stuck", "stuck=1", "the servo does not turn", "fault WHEEL_STUCK"),
    ("wheel-slow", "slow=0.2", "the servo turns at a fifth of its speed", "fault WHEEL_SLOW"),
    ("wheel-slipped", "slip_deg=20", "the wheel has slipped by 20 degrees", "fault WHEEL_SLIP"),
    (
        "wheel-lies",
        "lie_deg=30",
        "the sensors of the comb see the wheel 30 degrees ahead",
        "fault WHEEL_TOO_FAST",
    ),
    (
        "index-a-never",
        "index_a_forced=0",
        "sensor A of the comb never sees a tooth",
        "fault WHEEL_SLIP",
    ),
    (
        "index-a-always",
        "index_a_forced=1",
        "sensor A of the comb always sees a tooth",
        "fault WHEEL_SLIP",
    ),
    (
        "index-b-never",
        "index_b_forced=0",
        "sensor B of the comb never sees a tooth",
        "fault WHEEL_SLIP",
    ),
    (
        "index-b-always",
        "index_b_forced=1",
        "sensor B of the comb always sees a tooth",
        "fault WHEEL_SLIP",
    ),
    (
        "index-noise",
        "index_glitches=500",
        "sensor A of the comb changes falsely 500 times",
        "fault INDEX_NOISE",
    ),
    (
        "feedback-open",
        "feedback_forced=0",
        "the feedback wire of the servo is open",
        "nothing",
    ),
    ("supply-low", "supply_mv=3600", "the supply has 3.6 V", "fault SUPPLY_LOW"),
    ("ldr-open", "ldr3_forced=0", "a light sensor of the ring is not connected", "fault LDR_OPEN"),
    (
        "ldr-shorted",
        "ldr3_forced=1",
        "a light sensor of the ring is shorted; told where it is darker than 1000 lx",
        "fault LDR_SHORTED",
    ),
    ("ldr-noise", "ldr3_noise=0.1", "a light sensor of the ring has a loose contact", "nothing"),
    (
        "select-stuck",
        "select_stuck=1",
        "a select line of the multiplexer is not connected: sensors read as their neighbours",
        "nothing",
    ),
    ("line-noise", "line_noise=0.02", "one byte in fifty on the serial line is changed", "nothing"),
    ("line-cut", "line_cut=1", "no byte passes the serial line", "fault mcu-silent"),
    ("line-unplugged", "line_unplugged=1", "the serial device is not there", "fault mcu-waiting"),
    ("reset", "reset=1", "the microcontroller starts again", "nothing"),
)

#: All of them by name, for `@pytest.mark.parametrize("name", FAULTS)`.
CAMERA_FAULTS = {row[0]: NamedFault(*row) for row in _CAMERA}
BOX_FAULTS = {row[0]: NamedFault(*row) for row in _BOX}
FAULTS = CAMERA_FAULTS | BOX_FAULTS


def numbers_of(
    name: str, numbers: dict[str, float], known: dict[str, NamedFault], what: str
) -> dict[str, float]:
    """Numbers of a fault by its name, or as they are given. UsageError for an unknown name."""
    if not name:
        return numbers
    if name not in known:
        near = get_close_matches(name, FAULTS, 1)
        hint = f": did you mean {near[0]}?" if near else ""
        raise UsageError(f"{what}: no fault {name}{hint} Known are {', '.join(sorted(known))}")
    return known[name].numbers | numbers


def healthy_camera() -> str:
    """Numbers of a camera without faults, as a query."""
    return urlencode(asdict(Faults()))


def healthy_box() -> dict[str, float]:
    """Numbers of a box without faults."""
    return {name: healthy for name, (healthy, _) in BOX.items() if name != "reset"}
