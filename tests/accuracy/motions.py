"""How cameras are turned before they are judged: steadily, as heads do, aside and back, tilted."""

from __future__ import annotations

import numpy as np
from lightprobe import geometry
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.world import Behaviour

#: A head that looks around: three axes whose periods share no beat.
_HEAD = Behaviour(
    act_s=0, swing_deg=40, swing_hz=0.5, nod_deg=15, nod_hz=0.31, roll_deg=8, roll_hz=0.23
)
#: A look aside takes so long, and so long it stays there, and back here.
_ASIDE_DEG, _ASIDE_S, _STAY_S = 90.0, 1.0, 2.0
#: What turns about a tilted axis; longer than anything is judged, since tracks go back at their
#: end.
_TILTED_AXIS, _TILTED_DEG_S, _TILTED_S = (0.36, 0.8, 0.48), 60.0, 600


def look_aside() -> Track:
    """A look by 90° to the side within a second, smooth; two seconds there, back, two here."""
    part = np.linspace(0, 1, 101)
    yaw_deg = _ASIDE_DEG * (1 - np.cos(np.pi * part)) / 2
    # A track goes back as it came, so half of each stay is at each of its ends.
    t_s = np.concatenate([[0], _STAY_S / 2 + _ASIDE_S * part, [_STAY_S + _ASIDE_S]])
    rotations = turned(np.concatenate([[0], yaw_deg, [_ASIDE_DEG]]))
    return Track(t_s, rotations, np.zeros((len(t_s), 3)), "look")


def about_a_tilted_axis() -> Track:
    """60° a second, always about the same axis."""
    t_s = np.arange(_TILTED_S + 1.0)
    rotations = [geometry.quaternion(_TILTED_AXIS, _TILTED_DEG_S * t) for t in t_s]
    return Track(t_s, np.array(rotations), np.zeros((len(t_s), 3)), "tilted")


MOTIONS = {
    "0": Behaviour(act_s=0),
    **{f"{rate}": Behaviour(act_s=0, turn_deg_s=rate) for rate in (2, 10, 30, 100, 300)},
    "swing": Behaviour(act_s=0, swing_deg=40, swing_hz=0.5),
    "head": _HEAD,
    "look": Behaviour(act_s=0, path=look_aside()),
    "tilted": Behaviour(act_s=0, path=about_a_tilted_axis()),
}
#: What tables say of them; of others: their rate.
WORDS = {
    "swing": "± 40° at 0.5 Hz",
    "head": "a head: ± 40° at 0.5 Hz, ± 15° up and down, ± 8° to the shoulders",
    "look": "a look aside by 90° within 1 s, and back",
    "tilted": "60 °/s about a tilted axis",
}


def words(motion: str) -> str:
    """What tables say of a motion."""
    return WORDS.get(motion, f"{motion} °/s")
