"""Ambient light at a place in furnished rooms by a renderer: one probe on a head, end to end.

`make furnished` (Mitsuba) writes a table of docs/users/places.md. Rooms: a box, an L, one with a
window, one with a desk under the probe; pictures on their walls, furniture. A head goes half a
metre to and fro and looks ahead; an app tells where it is, with errors that last; the daemon gets
the panorama of each place. Truth: renders from 0.5 and 1 m away. All are kept in build/furnished.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product

import ambient
import cv2
import furnished_rooms
import numpy as np
import recording
from ambient import Ambient, Ambients, Lit
from furnished_rooms import KINDS, TRUTH_M, Renders, node_shares, way_m
from judge import Packet
from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.scene import Layers, MapTruth, resize
from lightprobe.sim.world import Behaviour
from numpy.typing import ArrayLike, NDArray
from page import ROOT, put
from recording import ORIENTATIONS, SETTLE_S, SUBSCRIPTIONS, Recording, Run, record

PAGE = ROOT / "docs/users/places.md"
TELLERS = ("place", "place-bad")
SEEDS = (11, 12)
#: The head goes to the end of its way and back in this time, fastest in the middle: 0.15 m/s.
_ROUND_S = 40.0
#: It is judged in the middle of its way as it comes back: there places are as far as is said.
_JUDGED_AT_S, _JUDGED_S = 30.0, 0.6
_KEYS_HZ = 60.0
_SIZE_PX, _RATE_HZ = (480, 240), 15.0
WORDS = {"box": "a box", "L": "an L", "window": "with a window", "table": "above a desk"}
#: Whether large lamps and windows are listed, or stay in the SH.
_WISHES = {
    "raw": replace(SUBSCRIPTIONS["raw"], area_lights=True), "within": SUBSCRIPTIONS["raw"],
    "smoothed": replace(SUBSCRIPTIONS["raw"], area_lights=True, smoothing="SMOOTHED"),
}  # fmt: skip
#: A ray that passes a lamp's centre so near meets it; else the window, where there is one.
_LAMP_M = 0.3


def head_path() -> Track:
    """Give a head that goes to and fro on its way, and looks ahead."""
    t_s = np.arange(0, 2 * _ROUND_S, 1 / _KEYS_HZ)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * t_s / _ROUND_S)
    return Track(t_s, turned(np.zeros(len(t_s))), way_m(share), "to and fro")


@dataclass(frozen=True, eq=False)
class FurnishedRoom:
    """A rendered room from places of the head's way; between two of them, a mixture of both."""

    name: str
    nodes: NDArray[np.float16]  # (N, H, W, 3)
    brightness: float = 1.0
    place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lamps: tuple[Lamp, ...] = field(default=())  # none that could be switched

    def scaled(self, factor: float) -> FurnishedRoom:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return replace(self, brightness=factor * self.brightness)

    def contains(self, places_m: Array) -> NDArray[np.bool_]:
        """Tell which places (..., 3) are within a centimetre of the way."""
        return np.asarray(self._share(places_m)[1] < 0.01)

    def seen_from(self, place_m: tuple[float, float, float]) -> FurnishedRoom:
        """Give the same room from another place of the way; UsageError beside it."""
        if not self.contains(np.array(place_m)):
            raise UsageError(f"{self.name}: {place_m}: the probe would be beside its way")
        return replace(self, place_m=place_m)

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return Layers(resize(self._radiance(), width_px, height_px), ())

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map."""
        return MapTruth(self._radiance(), rotation)

    def _radiance(self) -> NDArray[np.float32]:
        share, _ = self._share(np.array(self.place_m))
        at = float(np.interp(share, node_shares(), np.arange(len(self.nodes))))
        first = min(int(at), len(self.nodes) - 2)
        a, b = (self.nodes[k].astype(np.float32) for k in (first, first + 1))
        return np.asarray(self.brightness * (a + (at - first) * (b - a)), np.float32)

    @staticmethod
    def _share(places_m: Array) -> tuple[Array, Array]:
        """Share of the way where it is nearest to places (..., 3), and how far that is (m)."""
        shares = np.linspace(0, 1, 1001)
        far_m = np.linalg.norm(places_m[..., None, :] - way_m(shares), axis=-1)
        return shares[far_m.argmin(axis=-1)], far_m.min(axis=-1)


@dataclass(frozen=True)
class Case:
    """A room, and an app."""

    kind: str
    seed: int
    teller: str


@dataclass(frozen=True)
class Furnished:
    """What came of a case."""

    case: Case
    packets: int  # judged, of each subscriber
    found: dict[str, list[Ambient]]  # by _WISHES, of each of them and each place
    listed: float  # lights in a packet of "raw", mean


def lights(kind: str, rendered: Renders, brightness: float) -> list[Lit]:
    """Give the light at each of the room's places, from its renders."""
    found = []
    for place_m, unlit, lit in zip(rendered.places_m, rendered.unlit, rendered.lit, strict=True):
        height, width, _ = lit.shape
        rays = geometry.equirect_directions(width, height)
        centres_m = rendered.emitters_m - place_m
        along = rays @ centres_m.T  # (H, W, E)
        beside = np.sqrt(np.maximum((centres_m**2).sum(axis=-1) - along**2, 0))
        beside[along < 0] = np.inf
        if kind == "window":
            beside[..., 0] = _LAMP_M
        whose = beside.argmin(axis=-1)
        solid_angle = geometry.equirect_solid_angles(width, height)[:, None]
        lamps, points, radii_m = [], [], []
        for k, centre_m in enumerate(centres_m):
            alone = np.where((whose == k)[..., None], lit - unlit, 0)
            lamps.append(brightness * ambient.irradiance(alone))
            points.append(brightness * ambient.as_point(alone))
            size = float((solid_angle * (alone.mean(axis=-1) > lit.mean())).sum())
            radius_deg = float(geometry.cap_radius_deg(size))
            radii_m.append(np.linalg.norm(centre_m) * np.tan(np.radians(min(radius_deg, 60.0))))
        found.append(
            Lit(place_m, brightness * ambient.irradiance(unlit), np.array(lamps),
                np.array(points),
                rendered.emitters_m, np.array(radii_m))
        )  # fmt: skip
    return found


def judge(case: Case) -> list[Furnished]:
    """Run the daemon, and compare its newest packets with the light at each place."""
    cv2.setNumThreads(1)
    rendered = furnished_rooms.renders(case.kind, case.seed)
    room = FurnishedRoom(f"{case.kind} {case.seed}", rendered.nodes)
    run = Run(
        room, Behaviour(act_s=0, path=head_path()), orientation=case.teller, size_px=_SIZE_PX,
        rate_hz=_RATE_HZ, judged_s=_JUDGED_AT_S + _JUDGED_S - SETTLE_S,
        wishes=_WISHES,
    )  # fmt: skip
    got = record(run)
    shown = got.world.scenes[0]
    assert isinstance(shown, FurnishedRoom)
    there = lights(case.kind, rendered, shown.brightness)
    distances_m = np.repeat(list(TRUTH_M), list(TRUTH_M.values()))
    exact = ambient.Exact.of(np.zeros(3), shown.brightness * rendered.unlit[0])
    newest = {
        name: [p for p in packets if abs(p.captured_s - _JUDGED_AT_S) < _JUDGED_S / 2]
        for name, packets in got.packets.items()
    }
    found = {
        name: [
            ambient.judge(packet, _place_m(got, packet), lit, float(d), exact)
            for packet in packets for lit, d in zip(there, distances_m, strict=True)
        ]
        for name, packets in newest.items()
    }  # fmt: skip
    listed = float(np.mean([len(one.estimate.lights) for one in newest["raw"]]))
    return [Furnished(case, len(newest["raw"]), found, listed)]


def _place_m(got: Recording, packet: Packet) -> Array:
    return np.array(got.world.at(packet.captured_s).place_m)


def summary(some: Sequence[Furnished], wish: str = "raw") -> dict[str, Ambients]:
    """Figures at each distance (m)."""
    found = [a for one in some for a in one.found[wish]]
    return {f"{d:g}": Ambients.of([a for a in found if a.distance_m == d]) for d in TRUTH_M}


def table(some: Sequence[Furnished]) -> str:
    """Markdown: a row for each kind of room and teller."""
    beside = [d for d in TRUTH_M if d]
    head = [
        "room", "the app sends", "packets with a box", "at the probe",
        *(f"{d:g} m away: {what}" for d in beside for what in ("unchanged", "at the place")),
        *(f"{d:g} m away: exact light, moved by the box" for d in beside),
        *(f"{d:g} m away, large lamps in the SH: unchanged → at the place" for d in beside),
        *(f"of these all light {d:g} m away within 1, 3 sigma" for d in beside),
    ]  # fmt: skip
    rows = []
    groups = dict.fromkeys((one.case.teller, one.case.kind) for one in some)
    for teller, kind in groups:
        group = [one for one in some if (one.case.teller, one.case.kind) == (teller, kind)]
        here, *at = summary(group).values()
        within = list(summary(group, "within").values())[1:]
        cells = [_error(here.unchanged, here.unchanged_worst)]
        for a in at:
            cells += [_error(a.unchanged, a.unchanged_worst), _error(a.moved, a.moved_worst)]
        cells += [_error(a.by_box, a.by_box_worst) if here.has_room else "–" for a in at]
        cells += [f"{a.unchanged:.4f} → {_error(a.moved, a.moved_worst)}" for a in within]
        cells += [f"{a.within_1:.0%}, {a.within_3:.1%}" if a.stated else "–" for a in within]
        boxes = f"{here.has_room:.0%} of {sum(one.packets for one in group)}"
        rows.append([WORDS[kind], ORIENTATIONS[teller].words, boxes, *cells])
    return recording.markdown(head, rows)


def _error(median: float, worst: float) -> str:
    return f"{median:.4f} ({worst:.4f})"


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", type=recording.listed(KINDS, "kind"), default=list(KINDS),
                        help=f"of rooms, by comma ({','.join(KINDS)})")  # fmt: skip
    parser.add_argument("--seeds", type=lambda text: [int(one) for one in text.split(",")],
                        default=list(SEEDS), help="of rooms, by comma (11,12)")  # fmt: skip
    parser.add_argument("--tellers", type=recording.listed(tuple(ORIENTATIONS), "teller"),
                        default=list(TELLERS), help="what apps send, by comma")  # fmt: skip
    parser.add_argument("--processes", type=int, default=2, help="runs at a time (2)")
    parser.add_argument("--json", action="store_true", help="figures of each case instead")
    parser.add_argument("--page", action="store_true", help="write docs/users/places.md")
    options = parser.parse_args()
    rooms = list(product(options.kinds, options.seeds))
    for kind, seed in rooms:
        furnished_rooms.renders(kind, seed)
    cases = [Case(*room, teller) for teller in options.tellers for room in rooms]
    some = recording.all_figures(
        "furnished", judge, cases, lambda one: " ".join(map(str, asdict(one.case).values())),
        options.processes,
    )  # fmt: skip
    some.sort(key=lambda one: cases.index(one.case))
    if options.json:
        print(json.dumps([
            asdict(one.case) | {"packets": one.packets, "lights": one.listed}
            | {wish: {d: asdict(at) for d, at in summary([one], wish).items()} for wish in _WISHES}
            for one in some
        ], indent=1))  # fmt: skip
        return
    measured = table(some)
    print(measured)
    if options.page:
        put(PAGE, {"furnished": measured + "\n"})


if __name__ == "__main__":
    main()
