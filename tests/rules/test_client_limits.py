"""Numbers that every client has for itself are the same in all, and on the page that has them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = "docs/users/clients.md"
JS = "clients/js/src/client.ts"
CSHARP = "clients/csharp/Runtime/Probe.cs"
PYTHON = "host_py/lightprobe/async_client.py"

#: What a number is, its value, and where it stands: a file, what stands before it, and its unit.
NUMBERS = {
    "greeting, s": (5, [
        (PAGE, r"No `Hello` came within ", 1), (JS, r"HELLO_TIMEOUT_MS = ", 1e-3),
        (CSHARP, r"LeastPatienceMs = ", 1e-3), (PYTHON, r"HELLO_TIMEOUT_S = ", 1)]),
    "least silence, s": (5, [
        (PAGE, r"nothing came for ", 1), (JS, r"LEAST_PATIENCE_MS = ", 1e-3),
        (CSHARP, r"LeastPatienceMs = ", 1e-3), (PYTHON, r"LEAST_PATIENCE_S = ", 1)]),
    "first wait for the next try, s": (0.1, [
        (PAGE, r"connect again after ", 1), (JS, r"BACKOFF_FIRST_MS = ", 1e-3),
        (CSHARP, r"FirstBackoffMs = ", 1e-3), (PYTHON, r"BACKOFF_FIRST_S, BACKOFF_LAST_S = ", 1)]),
    "last wait for the next try, s": (5, [
        (PAGE, r"after each failure, up to ", 1), (JS, r"BACKOFF_LAST_MS = ", 1e-3),
        (CSHARP, r"LastBackoffMs = ", 1e-3), (PYTHON, r"BACKOFF_LAST_S = 0\.1, ", 1)]),
    "estimates that tell the clock": (32, [
        (PAGE, r"of the last ", 1), (JS, r"CLOCK_MESSAGES = ", 1), (CSHARP, r"ClockMessages = ", 1),
        ("host_py/lightprobe/clock_offset.py", r"_offsets_ns.*maxlen=", 1)]),
    "between turns, s": (0.05, [
        (PAGE, r"turns of their event loop or of a timer, ", 1e-3),
        ("clients/js/src/drained.ts", r"PERIOD_MS = ", 1e-3),
        ("clients/csharp/Runtime/Drained.cs", r"PeriodMs = ", 1e-3),
        ("host_py/lightprobe/drained.py", r"PERIOD_S = ", 1)]),
    "turns": (3, [
        ("clients/js/src/drained.ts", r"TURNS = ", 1),
        ("clients/csharp/Runtime/Drained.cs", r", Turns = ", 1),
        ("host_py/lightprobe/drained.py", r"TURNS = ", 1)]),
    "longest step of a fade, s": (0.1, [
        (PAGE, r"No step of a fade is longer than ", 1),
        ("clients/js/src/fading.ts", r"MOST_STEP_S = ", 1),
        ("clients/csharp/Unity/LightProbeReceiver.cs", r"MostStepS = ", 1),
        ("clients/blender/addon/fade.py", r"MOST_STEP_S = ", 1)]),
}  # fmt: skip


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_is_the_same_in_every_client_and_on_the_page(name):
    wanted, places = NUMBERS[name]
    found = {}
    for path, before, unit in places:
        match = re.search(before + r"(\d+(?:\.\d+)?)", (ROOT / path).read_text())
        assert match, f"{path}: nothing like {before}"
        found[path] = unit * float(match[1])
    assert found == {path: pytest.approx(wanted) for path, _, _ in places}
