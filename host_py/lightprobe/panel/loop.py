"""Joins LED, button, commands and probe: waits for the first that wants something."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from lightprobe.panel.actions import ACTIONS, Runner
from lightprobe.panel.core import Core
from lightprobe.panel.patterns import State
from lightprobe.panel.probe import Probe
from lightprobe.panel.state import Judged

if TYPE_CHECKING:
    from lightprobe.panel.lines import Led, Push

_LOOK_S = 0.5
#: How often NetworkManager is asked whether the probe is an access point.
_ASK_S = 10.0
Tell = Callable[[Judged], None]


def run(led: Led | None, push: Push | None, probe: Probe, tell: Tell) -> None:
    """Run until something raises; `tell` gets each new state. Raises LightprobeError."""
    runner = Runner()
    now_s = time.monotonic()
    core = Core(now_s, push.pressed() if push else False)
    told: State | None = None
    look_s = ask_s = now_s
    try:
        while True:
            now_s = time.monotonic()
            if now_s >= look_s:
                core.see(probe.look(), now_s)
                look_s = now_s + _LOOK_S
            if now_s >= ask_s:  # others switch it, too
                runner.start(ACTIONS["access-point"], only_ask=True)
                ask_s = now_s + _ASK_S
            for done in runner.ended():
                core.ended(done, now_s)
                if done.problem:
                    print(done.problem, file=sys.stderr, flush=True)
            shown = core.shown(now_s)
            if shown.state is not told:
                told = shown.state
                tell(shown)
            lit, for_s = core.led(now_s)
            if led:
                led.set(lit)
            _wait(push, core, runner, min(for_s, look_s - now_s))
    finally:
        runner.close()


def _wait(push: Push | None, core: Core, runner: Runner, wait_s: float) -> None:
    """Wait for the button, and start what it asks for."""
    if push is None:
        time.sleep(max(wait_s, 0.0))
        return
    for pressed, at_s in push.edges(wait_s):
        action = core.edge(pressed, at_s)
        if action and runner.start(action):
            print(f"panel: button: {action.title}", file=sys.stderr, flush=True)
            core.started(action)
