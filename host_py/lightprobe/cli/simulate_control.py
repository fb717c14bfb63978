"""What `lightprobe control` can ask and tell a running `lightprobe simulate` (proto/sim.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from lightprobe.errors import UsageError
from lightprobe.sim.box import Box, Illumination
from lightprobe.sim.control import Handler
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.link import Link
from lightprobe.sim.movers import Card
from lightprobe.sim.surroundings import flicker_share


@contextmanager
def illuminated(link: Link, box: Box, light: RingLight) -> Iterator[Illumination]:
    """Light on the box's ring as long as the block lasts."""
    state, behaviour = link.state_now(), link.camera.world.behaviour
    share = flicker_share(behaviour, light, state)
    box.set(flicker_hz=behaviour.flicker.hz, flicker_share=share)
    thread = Illumination(box, lambda: light.lux(link.state_now()), link.stop)
    thread.start()
    try:
        yield thread
    finally:
        thread.stop()


@dataclass
class Desk:
    """What can be asked and told while the simulator runs (proto/sim.md)."""

    link: Link
    box: Box | None
    light: RingLight | None
    lit: Illumination | None

    def handlers(self) -> dict[str, Handler]:
        """Commands by their first words."""
        return {"faults": self.faults, "status": self.status, "light": self.set_light,
                "get": self.get, "scene": self.keep_scene, "card": self.hold_card}  # fmt: skip

    def faults(self, query: str) -> str:
        """Misbehave from now on."""
        self.link.misbehave(query)
        return "ok"

    def get(self, name: str) -> str:
        """A number of the box."""
        return f"{self._box().get(name):.9g}"

    def set_light(self, words: str) -> str:
        """The same light on all sensors, in lux, as in a light box; or the scene's again."""
        self._box()
        assert self.lit is not None
        try:
            lux = None if words == "scene" else float(words)
        except ValueError:
            lux = -1.0
        if lux is not None and not 0 <= lux < 1e6:
            raise UsageError(f"simulate: light {words}: expected lux, or scene")
        self.lit.fixed_lux = lux
        return "ok"

    def keep_scene(self, words: str) -> str:
        """One scene from now on, by its place among --scenes; or one after the other again."""
        world = self.link.camera.world
        number = int(words) if words.isdecimal() else 0
        if words != "all" and not 1 <= number <= len(world.scenes):
            raise UsageError(f"simulate: scene {words}: expected 1…{len(world.scenes)}, or all")
        world.kept = None if words == "all" else number - 1
        return "ok"

    def hold_card(self, words: str) -> str:
        """Hold a round card before the lens from now on, or none: AZIMUTH,ELEVATION,RADIUS[,R,G,B].

        In degrees, as the scene stands; the colour is its albedo, black unless told.
        """
        try:
            told = [float(word) for word in words.split(",")] if words != "none" else []
        except ValueError:
            told = [math.nan]
        if not told and words == "none":
            self.link.camera.world.card = None
            return "ok"
        azimuth, elevation, radius, *rgb = [*told, math.nan, math.nan, math.nan][
            : max(len(told), 3)
        ]
        right = abs(azimuth) <= 360 and abs(elevation) <= 90 and 0 < radius <= 180
        if not right or len(rgb) not in (0, 3) or not all(0 <= one <= 1 for one in rgb):
            raise UsageError(
                f"simulate: card {words}: expected none, or AZIMUTH,ELEVATION,RADIUS in degrees, "
                "and R,G,B of 0…1 after them or not, as 30,20,3"
            )
        red, green, blue = rgb or (0.0, 0.0, 0.0)
        self.link.camera.world.card = Card(azimuth, elevation, radius, (red, green, blue))
        return "ok"

    def status(self, _: str) -> str:
        """Counters, faults of the camera, and what is true now, as JSON."""
        link, state = self.link, self.link.state_now()
        answer: dict[str, Any] = {"counters": asdict(link.counters), "faults": asdict(link.faults)}
        yaw_deg, nod_deg, roll_deg = state.angles_deg
        answer["world"] = {"t_s": state.t_s, "scene": state.scene.name, "yaw_deg": yaw_deg % 360,
                           "nod_deg": nod_deg, "roll_deg": roll_deg,
                           "powers": state.powers.tolist()}  # fmt: skip
        if self.box is not None and self.light is not None and self.lit is not None:
            fixed = self.lit.fixed_lux
            lux = self.light.lux(state).tolist() if fixed is None else [fixed] * 9
            answer["wheel_deg"] = self.box.get("wheel_deg")
            answer["ring_lux"] = lux
        return json.dumps(answer)

    def _box(self) -> Box:
        if self.box is None:
            raise UsageError("simulate: there is no box: start the simulator with --firmware host")
        return self.box
