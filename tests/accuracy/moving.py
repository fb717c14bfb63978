"""Lamps and ambient light at a place, by one probe on a head that goes to and fro: end to end.

`python tests/accuracy/moving.py` prints tables of docs/users/places.md: rooms with pictures on
their walls and lamps at random places, some behind cupboards at times, a head that goes half a
metre and looks around, an app that sends its poses with errors that last. Truth is where the
simulated lamps hang, and the room seen from there. Simulated time: no load changes a figure.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import ambient
import numpy as np
import recording
from ambient import Ambient, Ambients, Lit
from judge import Packet
from lightprobe import geometry
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.room import Bulb, Cupboard, Room
from lightprobe.sim.world import Behaviour, World
from page import ROOT, put
from places import DISTANCES_M, offsets, shadow_deg
from recording import ORIENTATIONS, Run, record

PAGE = ROOT / "docs/users/places.md"
TELLERS = ("client", "place", "place-bad")
#: A lamp of the truth is the one that a packet lists so near.
_NEAR_DEG = 5.0
_KEYS_HZ = 60.0
#: Half the sides of a cupboard (m); and how far it is on the way to the lamp that it hides.
_CUPBOARD_M, _CUPBOARD_SHARE = (0.15, 0.3, 0.15), 0.6
#: Map of the room over which ambient light is summed.
_TRUTH_PX = (256, 128)
#: Places at each distance where light is compared.
_PLACES = 4
#: A small camera: what it renders is most of the time that this takes.
_SIZE_PX, _RATE_HZ = (960, 480), 15.0


def head_path(seed: int, reach_m: float = 0.25, seconds: float = 40.0) -> Track:
    """Give a head that goes `reach_m` to each side, and looks around."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 1 / _KEYS_HZ)

    def sway(amplitude: float, fastest_hz: float) -> Array:
        rates = rng.uniform(0.3, 1.0, 3) * fastest_hz
        waves = np.sin(2 * np.pi * (rates[:, None] * t_s + rng.uniform(size=(3, 1))))
        return np.asarray(amplitude * waves.mean(axis=0) * 1.4)

    places = np.stack([sway(reach_m, 0.3), sway(0.4 * reach_m, 0.3), sway(reach_m, 0.3)], axis=-1)
    return Track(t_s, turned(sway(50, 0.3), sway(15, 0.3), sway(6, 0.3)), places, f"head {seed}")


def room(seed: int, hides: bool = False) -> Room:
    """Give a room whose five lamps hang at random places, well apart; 0: the room as it is.

    Pictures hang on its walls. `hides`: cupboards hide two lamps for a while.
    """
    rng, found = np.random.default_rng(seed), Room()
    bulbs: list[Bulb] = []
    while seed and len(bulbs) < 5:
        place = rng.uniform([-2.2, -0.2, -3.0], [1.8, 1.2, 2.2])
        towards = geometry.normalize(place)
        apart = [geometry.angle_deg(towards, np.array(b.position_m)) for b in bulbs]
        if np.linalg.norm(place) < 1.2 or min(apart, default=90) < 25:
            continue
        colour = 40 * rng.uniform(0.6, 1.2) * rng.uniform(0.7, 1.0, 3)
        bulbs.append(Bulb(tuple(place.tolist()), rng.uniform(0.06, 0.12), tuple(colour.tolist())))
    if bulbs:
        found = replace(found, bulbs=tuple(bulbs), pictures=seed)
    cupboards = tuple(_before(bulb) for bulb in found.bulbs[:2]) if hides else ()
    return replace(found, cupboards=cupboards)


def _before(bulb: Bulb) -> Cupboard:
    """Give a cupboard whose side is in line with a lamp: it hides it from half of the places."""
    towards_m, half_m = np.array(bulb.position_m), np.array(_CUPBOARD_M)
    aside = geometry.normalize(np.cross(towards_m, [0.0, 1.0, 0.0]))
    middle_m = _CUPBOARD_SHARE * towards_m + aside * float(np.abs(aside) @ half_m)
    low, high = (tuple(corner.tolist()) for corner in (middle_m - half_m, middle_m + half_m))
    return Cupboard(low, high)


def lit(scene: Room, place_m: Array) -> Lit:
    """Give the light at a place (3,) of a room; lamps as if no cupboard hid them from there."""
    there = scene.seen_from(tuple(place_m.tolist()))
    unseen = replace(there, shows_bulbs=False).render(*_TRUTH_PX)
    lamps = [
        np.maximum(ambient.NORMALS @ lamp.direction, 0)[:, None] * lamp.irradiance
        for lamp in there.lamps
    ]
    return Lit(
        place_m, ambient.irradiance(unseen.compose(np.ones(len(lamps)))), np.array(lamps),
        np.array(lamps),
        np.array([bulb.position_m for bulb in scene.bulbs]),
        np.array([bulb.radius_m for bulb in scene.bulbs]),
    )  # fmt: skip


@dataclass(frozen=True)
class Placed:
    """One lamp in one packet."""

    t_s: float
    true_m: float
    stated_m: float | None
    sigma_m: float | None
    nearest_m: float | None
    off_deg: float  # of its direction
    sigma_deg: float


@dataclass(frozen=True)
class Case:
    """A room, a head's path and an app."""

    room: int
    path: int
    teller: str
    reach_m: float = 0.25
    seconds: float = 10.0
    hides: bool = False  # cupboards hide lamps for a while

    @property
    def words(self) -> str:
        """For tables."""
        more = "; cupboards hide two lamps for a while" if self.hides else ""
        return ORIENTATIONS[self.teller].words + more


@dataclass(frozen=True)
class Moving:
    """What came of a case."""

    case: Case
    lamps: list[Placed]
    shadows_deg: list[list[float]]  # by DISTANCES_M, root mean square over lamps; newest packets
    smoothed_off_deg: list[float]  # of lamps' directions, in packets of those who ask for nothing
    ambient: list[Ambient]  # of the newest packets, at DISTANCES_M


def _off_deg(lamp_m: Array, light: Light, packet: Packet) -> float:
    return float(geometry.angle_deg(light.direction, packet.turn @ lamp_m))


def judge(case: Case) -> list[Moving]:
    """Run the daemon, and compare each lamp of its packets with where it hangs."""
    scene = room(case.room, case.hides)
    behaviour = Behaviour(act_s=0, path=head_path(case.path, case.reach_m))
    got = record(Run(
        scene, behaviour, judged_s=case.seconds, orientation=case.teller, size_px=_SIZE_PX,
        rate_hz=_RATE_HZ,
    ))  # fmt: skip
    found: list[Placed] = []
    shadows: list[list[float]] = [[] for _ in DISTANCES_M]
    found_light: list[Ambient] = []
    shown = got.world.scenes[0]
    assert isinstance(shown, Room)
    rng = np.random.default_rng(case.path)
    packets = got.packets["raw"]
    for number, packet in enumerate(packets):
        seen = _seen(packet, scene, got.world)
        found += [_placed(packet, light, lamp_m) for light, lamp_m in seen]
        if number >= len(packets) - 15 and number % 5 == 0:
            here_m = np.array(got.world.at(packet.captured_s).place_m)
            for k, distance_m in enumerate(DISTANCES_M):
                for place in offsets(scene, distance_m, _PLACES, rng):
                    shadows[k].append(_shadow_deg(packet, seen, place))
                    if scene.contains(here_m + place):
                        there = lit(shown, here_m + place)
                        found_light.append(ambient.judge(packet, here_m, there, distance_m))
    smoothed = [
        _off_deg(lamp_m, light, packet)
        for packet in got.packets["default"] for light, lamp_m in _seen(packet, scene, got.world)
    ]  # fmt: skip
    return [Moving(case, found, shadows, smoothed, found_light)]


def _seen(packet: Packet, scene: Room, world: World) -> list[tuple[Light, Array]]:
    """Lights that are lamps of the room, and where these are from the probe, in the scene."""
    here = np.array(world.at(packet.captured_s).place_m)
    found = []
    for bulb in scene.bulbs:
        lamp_m = np.array(bulb.position_m) - here
        lights = packet.estimate.lights
        near = min(lights, key=lambda one: _off_deg(lamp_m, one, packet), default=None)
        if near is not None and _off_deg(lamp_m, near, packet) < _NEAR_DEG:
            found.append((near, lamp_m))
    return found


def _placed(packet: Packet, light: Light, lamp_m: Array) -> Placed:
    known = light.distance_m is not None and light.distance_sigma is not None
    return Placed(
        packet.captured_s, float(np.linalg.norm(lamp_m)), light.distance_m,
        light.distance_m * light.distance_sigma if known else None,  # type: ignore[operator]
        light.nearest_m, _off_deg(lamp_m, light, packet), light.direction_sigma_deg or 0,
    )  # fmt: skip


def _shadow_deg(packet: Packet, seen: Sequence[tuple[Light, Array]], place_m: Array) -> float:
    """Root mean square of how far shadows are turned at a place, of the lamps that are listed."""
    own = packet.turn @ place_m
    stated: Estimate = replace(packet.estimate, lights=tuple(one for one, _ in seen)).at(own)
    true = replace(stated, lights=tuple(
        replace(one, direction=geometry.normalize(packet.turn @ lamp_m - own))
        for one, lamp_m in seen
    ))  # fmt: skip
    return shadow_deg(stated, true)


def _quantile(values: Array, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else math.nan


def summary(some: Sequence[Moving]) -> dict[str, float]:
    """Figures over the last third of each case: metres, degrees and shares."""
    late = [
        one for moving in some for one in moving.lamps
        if one.t_s > max(lamp.t_s for lamp in moving.lamps) - moving.case.seconds / 3
    ]  # fmt: skip
    known = [one for one in late if one.stated_m is not None and one.sigma_m is not None]
    off = np.array([abs((one.stated_m or 0) - one.true_m) for one in known])
    sigma = np.array([one.sigma_m for one in known], dtype=float)
    scaled = off * np.array([(3 / one.true_m) ** 2 for one in known])
    bounds = [one.true_m >= one.nearest_m for one in late if one.nearest_m is not None]
    turned_ = np.array([one.off_deg for one in late])
    smoothed = np.concatenate([one.smoothed_off_deg for one in some])
    figures = {
        "lamps": len(late),
        "placed": len(known) / max(len(late), 1),
        "off_m": _quantile(off, 0.5),
        "off_90_m": _quantile(off, 0.9),
        "off_at_3_m": _quantile(scaled, 0.5),
        "within_1": float(np.mean(off <= sigma)) if len(off) else math.nan,
        "within_3": float(np.mean(off <= 3 * sigma)) if len(off) else math.nan,
        "bounds_hold": float(np.mean(bounds)) if bounds else math.nan,
        "direction_deg": _quantile(turned_, 0.5),
        "direction_90_deg": _quantile(turned_, 0.9),
        "direction_within_3": float(np.mean(turned_ <= 3 * np.array([p.sigma_deg for p in late]))),
        "smoothed_deg": _quantile(smoothed, 0.5),
        "smoothed_90_deg": _quantile(smoothed, 0.9),
    }
    for k, distance_m in enumerate(DISTANCES_M):
        every = np.concatenate([one.shadows_deg[k] for one in some])
        figures[f"shadow_{distance_m:g}_m_deg"] = float(np.sqrt(np.mean(every**2)))
        at = Ambients.of([a for one in some for a in one.ambient if a.distance_m == distance_m])
        figures |= {
            f"ambient_{distance_m:g}_m_{name}": value for name, value in asdict(at).items()
        }  # fmt: skip
    return figures


def table(some: Sequence[Moving]) -> str:
    """Markdown: a row for each teller, and for rooms where lamps are hidden at times."""
    head = [
        "the app sends", "lamps placed", "distance off by, median (90 %)", "at 3 m, median",
        "within 1 sigma", "within 3", *(f"shadows {d:g} m away turned by" for d in DISTANCES_M),
        "directions off by, default packets, median (90 %)",
    ]  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for words in dict.fromkeys(one.case.words for one in some):
        f = summary([one for one in some if one.case.words == words])
        cells = [
            f"{f['placed']:.0%}", f"{100 * f['off_m']:.1f} ({100 * f['off_90_m']:.1f}) cm",
            f"{100 * f['off_at_3_m']:.1f} cm", f"{f['within_1']:.0%}", f"{f['within_3']:.1%}",
            *(f"{f[f'shadow_{d:g}_m_deg']:.2f}°" for d in DISTANCES_M),
            f"{f['smoothed_deg']:.2f} ({f['smoothed_90_deg']:.2f})°",
        ]  # fmt: skip
        known = ["–" if "nan" in cell else cell for cell in cells]
        lines.append("| " + " | ".join([words, *known]) + " |")
    return "\n".join(lines)


def ambient_table(some: Sequence[Moving]) -> str:
    """Markdown: two rows for each of table(): the SH as the probe has them, and moved."""
    head = [
        "the app sends", "packets with a box",
        *(f"ambient light {d:g} m away" for d in DISTANCES_M),
        *(f"light {d:g} m away within 1, 3 sigma" for d in DISTANCES_M),
    ]  # fmt: skip
    rows = []
    for words in dict.fromkeys(one.case.words for one in some):
        light = [a for one in some if one.case.words == words for a in one.ambient]
        at = [Ambients.of([a for a in light if a.distance_m == d]) for d in DISTANCES_M]
        unchanged = [f"{a.unchanged:.3f} ({a.unchanged_worst:.3f})" for a in at]
        moved = [f"{a.moved:.3f} ({a.moved_worst:.3f})" for a in at]
        shares = [f"{a.within_1:.0%}, {a.within_3:.1%}" if a.stated else "–" for a in at]
        rows += [
            [f"{words}; unchanged", "", *unchanged, *[""] * len(at)],
            [f"{words}; at the place", f"{at[0].has_room:.0%}", *moved, *shares],
        ]
    return recording.markdown(head, rows)


def main() -> None:
    """Print the tables, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, default=3, help="rooms and paths (3)")
    parser.add_argument("--tellers", type=recording.listed(tuple(ORIENTATIONS), "teller"),
                        default=TELLERS, help="what apps send, by comma")  # fmt: skip
    parser.add_argument("--reach", type=float, default=0.25, help="metres to each side (0.25)")
    parser.add_argument("--seconds", type=float, default=10.0, help="that are judged (10)")
    parser.add_argument("--plain", action="store_true", help="without cupboards before lamps")
    parser.add_argument("--json", action="store_true", help="figures of each case instead")
    parser.add_argument("--page", action="store_true", help="write docs/users/places.md")
    options = parser.parse_args()
    cases = [
        Case(k, k, teller, options.reach, options.seconds)
        for teller in options.tellers for k in range(options.rooms)
    ]  # fmt: skip
    if "place" in options.tellers and not options.plain:
        cases += [replace(one, hides=True) for one in cases if one.teller == "place"]
    some = recording.all_figures(
        "moving", judge, cases, lambda one: f"room {one.case.room}, {one.case.teller}", 2
    )
    some.sort(key=lambda one: cases.index(one.case))
    if options.json:
        print(json.dumps([asdict(one.case) | summary([one]) for one in some], indent=1))
        return
    measured = f"{table(some)}\n\n{ambient_table(some)}"
    print(measured)
    if options.page:
        put(PAGE, {"moving": measured + "\n"})


if __name__ == "__main__":
    main()
