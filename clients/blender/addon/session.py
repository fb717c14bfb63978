"""One live connection: what the timer does. Main thread only.

There is one session at a time. It belongs to the scene that was open at Connect.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import bpy
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate
from lightprobe.fallback import mean_irradiance

from . import place, scene_lamps, scene_world
from .fade import MOST_STEP_S, Fader
from .link import Link, Seen
from .suns import Sun, suns, unit_scale
from .words import Report, report

#: Between two steps; a fade has six of them.
TICK_S = 0.05


@dataclass(eq=False)
class Session:
    """A link and what of it is shown."""

    link: Link
    scene_uid: int
    fader: Fader = field(default_factory=Fader)
    report: Report = field(default_factory=lambda: Report("WAITING", "connecting"))
    _ticked_s: float | None = None
    _shown: Seen | None = None
    _scale: float = 1.0
    _last: Estimate | None = None  # that was shown
    #: Grey that the world fades to and from; None: no light came yet, the scene's own colour.
    _without: float | None = None

    def scene(self) -> bpy.types.Scene | None:
        """Give the scene of this session; None: it was deleted."""
        return next((s for s in bpy.data.scenes if s.session_uid == self.scene_uid), None)

    def tick(self) -> bool:
        """Go on to what is known now; False: the scene is gone. Never waits for the network."""
        scene = self.scene()
        if scene is None:
            return False
        now_s = time.monotonic()
        elapsed_s = 0.0 if self._ticked_s is None else min(MOST_STEP_S, now_s - self._ticked_s)
        self._ticked_s = now_s
        self.link.standing_m = place.position(scene, scene_lamps.root(scene))
        self.show(scene, self.link.seen, elapsed_s)
        return True

    def show(self, scene: bpy.types.Scene, seen: Seen, elapsed_s: float) -> None:
        """Draw what is known of the probe, `elapsed_s` after the last call."""
        settings = scene.lightprobe
        self.report = report(seen)
        estimate, fresh = seen.estimate, seen.fresh and seen.connected
        if estimate is not None and seen.sky is not None:
            try:
                self._scale = unit_scale(estimate, settings.units, settings.scale)
            except LightprobeError as error:
                self.report, fresh = Report("FAULTY", str(error), self.report.details), False
        else:
            fresh = False
        if estimate is not None and fresh:
            lamps = self._lamps(scene, estimate) if seen.mode == "LAMPS" else []
            self.fader.step(elapsed_s, estimate.boot_id, lamps)
            self._last = estimate
        else:
            self.fader.step(elapsed_s, None, ())
            if self._last is not None:  # as bright in the mean as its light, like every client
                self._without = max(0.0, mean_irradiance(self._last) / math.pi)
        scene_lamps.show(scene, self.fader.lamps, self._scale)
        if seen.sky is not None and fresh and (self._shown is None or self._shown.sky != seen.sky):
            scene_world.show_picture(scene, seen.sky)
            self._shown = seen
        orientation = self._shown.sky.orientation if self._shown and self._shown.sky else None
        gain = self.fader.world_gain
        scene_world.show(scene, gain, self._scale, orientation, self._without)

    def _lamps(self, scene: bpy.types.Scene, estimate: Estimate) -> list[Sun]:
        """Give the lamps for the named object, or at their places; the report says what lacks."""
        settings = scene.lightprobe
        details = (*self.report.details, *place.note(scene, estimate))
        self.report = replace(self.report, details=details)
        standing_m = place.position(scene, scene_lamps.root(scene))
        return suns(estimate, settings.steady, standing_m, settings.point_lights)


class _Current:
    """Holds the session that the timer drives."""

    session: Session | None = None
    last_words = "not connected"


def current() -> Session | None:
    """Give the session that runs now."""
    return _Current.session


def state() -> Report:
    """Give what the panel says, connected or not."""
    session = _Current.session
    return session.report if session else Report("ENDED", _Current.last_words)


def connect(scene: bpy.types.Scene) -> Session:
    """Start a session; one that runs is ended.

    Raises :class:`lightprobe.LightprobeError` for a wrong address or wish.
    """
    disconnect("not connected")
    link = _open(scene)
    _Current.session = Session(link, scene.session_uid)
    scene_lamps.root(scene)
    if not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, persistent=True)
    return _Current.session


def _open(scene: bpy.types.Scene) -> Link:
    if scene_world.is_keyframed(scene):
        raise LightprobeError(
            "connect: this scene shows a keyframed recording: press 'Remove lamps and world' first"
        )
    standing_m = place.position(scene, scene.lightprobe.root)
    return Link(scene.lightprobe.uri, scene.lightprobe.wish(), standing_m)


def disconnect(why: str = "not connected; the light stays as it was last") -> None:
    """End the session at once; what it has put into the scene stays."""
    if _Current.session is not None:
        _Current.session.link.close()
    _Current.session = None
    _Current.last_words = why


def _on_timer() -> float | None:
    """Called by Blender; None ends the timer."""
    session = _Current.session
    if session is None:
        return None
    before = session.report
    try:
        if not session.tick():
            disconnect("not connected: the scene was deleted")
    except Exception as error:
        disconnect(f"add-on: draw: {error}: please report it, with the text in the console")
        raise  # Blender prints it and ends the timer
    if _Current.session is None or session.report != before:
        redraw_panels()
    return TICK_S if _Current.session else None


def redraw_panels() -> None:
    """Have the 3D views draw their sidebars again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def light_once(scene: bpy.types.Scene, timeout_s: float) -> Report:
    """Light the scene with the probe's light of now, without a fade; for scripts. Blocks.

    Raises :class:`lightprobe.LightprobeError` with the reason when no light came in time.
    """
    disconnect("not connected")
    for layer in scene.view_layers:
        layer.update()  # a script may just have moved the named object
    link = _open(scene)
    try:
        return _wait_and_show(scene, link, time.monotonic() + timeout_s)
    finally:
        link.close()


def _wait_and_show(scene: bpy.types.Scene, link: Link, deadline_s: float) -> Report:
    session = Session(link, scene.session_uid)
    while True:
        seen = link.seen
        if seen.estimate is not None and seen.fresh:
            session.show(scene, seen, float("inf"))
            if session.fader.world_gain < 1:
                raise LightprobeError(session.report.headline)
            return session.report
        said = report(seen)
        if said.state == "ENDED" or time.monotonic() > deadline_s:
            raise LightprobeError(said.headline)
        time.sleep(0.02)
