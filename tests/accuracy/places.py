"""How wrong the light beside a probe is: taken unchanged, and with the lamps' places known.

`python tests/accuracy/places.py` prints the tables of docs/users/places.md. Truth is the simulated
room seen from there; lamps are triangulated from two places with errors (`lightprobe field`). What
the daemon's own estimate errs by is left out: `tests/e2e/test_field.py` runs daemons.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from lightprobe import geometry, sh
from lightprobe.box_fit import BoxFit
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.field import Station, join, with_room
from lightprobe.geometry import Array
from lightprobe.sim.room import Room
from page import ROOT, put

PAGE = ROOT / "docs/users/places.md"
DISTANCES_M = (0.3, 0.5, 1.0)
#: Errors, 1 sigma, of both yaws, of how upright both are (degrees), of the second place (metres).
NOISES = ((0.3, 0.1, 0.005), (3.0, 0.5, 0.01), (10.0, 1.0, 0.02))
_DIRECTION_DEG = 0.05  # of a lamp, as a live probe states it
_NORMALS = geometry.sphere_normals(2)
_SIZE, _ORDER = (256, 128), 4


def ambient(room: Room) -> SphericalHarmonics:
    """Give the room's SH without the discs of its lamps."""
    whole = room.render(*_SIZE).compose(np.ones(len(room.bulbs))).astype(np.float64)
    total = sh.project(whole, _ORDER)
    for lamp in room.lamps:
        total -= sh.lamp(lamp.direction, _ORDER)[:, None] * lamp.irradiance
    return SphericalHarmonics("AMBIENT", _ORDER, total)


def lamps(room: Room) -> tuple[Light, ...]:
    """Give the lamps of a room as a probe lists them."""
    return tuple(
        Light(i + 1, lamp.direction, lamp.irradiance, lamp.radius_deg, _DIRECTION_DEG,
              0.01 * lamp.irradiance)
        for i, lamp in enumerate(room.lamps)
    )  # fmt: skip


def estimate(room: Room) -> Estimate:
    """Give the exact light of a room at the probe's place."""
    return Estimate(
        1, 1, 0, 0, 1000, EstimateFlag(0), lamps(room), ambient(room), None, None, 1, None,
        relighting_sigma=0.0,
    )  # fmt: skip


def _stands(station: Station, rng: np.random.Generator) -> tuple[Array, Array]:
    """Where a probe is (m), and its turn from the room: otherwise than said, by its sigmas."""
    true_m = station.place_m + station.place_sigma_m * rng.normal(size=3)
    turned_rad = station.turn_sigma_rad * rng.normal(size=3)
    turn = geometry.quaternion(turned_rad, np.degrees(np.linalg.norm(turned_rad)))
    return true_m, geometry.turn_after(geometry.inverse(station.turn_wxyz), turn)


def _listed(room: Room, own: Array, rng: np.random.Generator) -> tuple[Light, ...]:
    return tuple(
        replace(light, direction=_off(geometry.rotate(own, light.direction), rng))
        for light in lamps(room)
    )


def seen_by(station: Station, room: Room, rng: np.random.Generator) -> tuple[Light, ...]:
    """Give what a probe lists that stands, and is turned, otherwise than said, by its sigmas."""
    true_m, own = _stands(station, rng)
    return _listed(room.seen_from(tuple(true_m.tolist())), own, rng)


def sight_of(station: Station, room: Room, rng: np.random.Generator) -> Estimate:
    """Give all light that such a probe sees."""
    true_m, own = _stands(station, rng)
    there = room.seen_from(tuple(true_m.tolist()))
    exact = estimate(there)
    turned = replace(exact.sh, coefficients=sh.rotate(exact.sh.coefficients, own))
    return replace(exact, sh=turned, lights=_listed(there, own, rng))


def placed(
    room: Room, baseline_m: float, noise: tuple[float, float, float], rng: np.random.Generator
) -> Estimate:
    """Give the light at the origin, its lamps triangulated from there and from a second probe."""
    yaw_deg, level_deg, place_m = noise
    second_m = _within(room, baseline_m, rng)
    stations = [Station("a", np.zeros(3), 0.0, 0.0, yaw_deg, level_deg),
                Station("b", second_m, 0.0, place_m, yaw_deg, level_deg)]  # fmt: skip
    exact = estimate(room)
    base, other = (sight_of(station, room, rng) for station in stations)
    found = with_room(stations, join(stations, base, [other]), [other], BoxFit()).estimate
    names = ("distance_m", "distance_sigma", "nearest_m")
    return replace(exact, room=found.room, lights=tuple(
        replace(light, **{name: getattr(one, name) for name in names})
        for light, one in zip(exact.lights, found.lights, strict=True)
    ))  # fmt: skip


def _off(direction: Array, rng: np.random.Generator) -> Array:
    """Give a direction with the error that lamps state."""
    return geometry.normalize(direction + np.radians(_DIRECTION_DEG) * rng.normal(size=3))


def _within(room: Room, distance_m: float, rng: np.random.Generator) -> Array:
    """Give a place at a distance from the origin, well within the walls."""
    while True:
        place_m = distance_m * geometry.normalize(rng.normal(size=3))
        if room.contains(1.2 * place_m):
            return place_m


def relighting_error(stated: Estimate, true: Estimate) -> float:
    """Mean error of the irradiance over all normals, over its mean (luminance)."""
    a, b = (luminance(one.irradiance(_NORMALS)) for one in (stated, true))
    return float(np.abs(a - b).mean() / b.mean())


def shadow_deg(stated: Estimate, true: Estimate) -> float:
    """Root mean square of how far shadows of the lamps are turned."""
    ids = {light.id: light.direction for light in stated.lights}
    offs = [geometry.angle_deg(ids[light.id], light.direction) for light in true.lights]
    return float(np.sqrt(np.mean(np.square(offs))))


def offsets(room: Room, distance_m: float, number: int, rng: np.random.Generator) -> list[Array]:
    """Give places at a distance, within the walls and half a metre from every lamp."""
    found: list[Array] = []
    while len(found) < number:
        place_m = _within(room, distance_m, rng)
        if min(float(np.linalg.norm(bulb.position_m - place_m)) for bulb in room.bulbs) > 0.5:
            found.append(place_m)
    return found


def _row(name: str, values: list[list[float]], form: str) -> str:
    cells = (f"{np.median(one):{form}} ({np.max(one):{form}})" for one in values)
    return f"| {name} | " + " | ".join(cells) + " |"


def _placing(room: Room, trials: list[Estimate]) -> tuple[str, str, str, str]:
    """Lamps placed, how far off (median), and how many within 1 and within 3 sigma."""
    true_m = {i + 1: float(np.linalg.norm(b.position_m)) for i, b in enumerate(room.bulbs)}
    lights = [light for one in trials for light in one.lights]
    off_m, sigma_m = np.array([
        (abs(light.distance_m - true_m[light.id]), light.distance_sigma * light.distance_m)
        for light in lights if light.distance_m is not None and light.distance_sigma is not None
    ]).T  # fmt: skip
    shares = (f"{np.mean(off_m < k * sigma_m):.0%}" for k in (1, 3))
    return (f"{len(off_m)} of {len(lights)}", f"{100 * np.median(off_m):.1f} cm", *shares)  # type: ignore[return-value]


def table(places: int, trials: int) -> str:
    """Measure: Markdown, of the light and of the places themselves."""
    room, rng = Room(pictures=1), np.random.default_rng(1)
    here = estimate(room)
    there = [
        [(p, estimate(room.seen_from(tuple(p.tolist())))) for p in offsets(room, d, places, rng)]
        for d in DISTANCES_M
    ]
    of_lamps = [[replace(here, lights=true.lights) for _, true in one] for one in there]
    lines = [
        "| " + " | ".join(["light at a place", *(f"{d} m away" for d in DISTANCES_M)]) + " |",
        "|---|" + "---|" * len(DISTANCES_M),
        _row("unchanged: error", [[relighting_error(here, t) for _, t in one] for one in there],
             ".3f"),
        _row("ambient light alone unchanged: error",
             [[relighting_error(e, t) for e, (_, t) in zip(es, one, strict=True)]
              for es, one in zip(of_lamps, there, strict=True)], ".3f"),
        _row("unchanged: shadows turned by, degrees",
             [[shadow_deg(here, t) for _, t in one] for one in there], ".1f"),
    ]  # fmt: skip
    placings = [
        "",
        "| second probe 1 m away, errors | lamps placed | distance off by | within 1 sigma "
        "| within 3 | light: error within 3 sigma, where one is stated |",
        "|---|---|---|---|---|---|",
    ]
    for noise in NOISES:
        words = f"yaw {noise[0]:g}°, level {noise[1]:g}°, {1000 * noise[2]:.0f} mm"
        found = [placed(room, 1.0, noise, rng) for _ in range(trials)]
        moved = [[(one.at(p), true) for one in found for p, true in at] for at in there]
        ambients = [[(replace(e, lights=t.lights), t) for e, t in at] for at in moved]
        lines += [
            _row(f"two probes, {words}: error",
                 [[relighting_error(*m) for m in at] for at in moved], ".3f"),
            _row(f"two probes, {words}: ambient light alone: error",
                 [[relighting_error(*m) for m in at] for at in ambients], ".3f"),
            _row(f"two probes, {words}: shadows turned by, degrees",
                 [[shadow_deg(*m) for m in at] for at in moved], ".2f"),
        ]  # fmt: skip
        held = [
            relighting_error(stated, true) < 3 * stated.relighting_sigma
            for at in moved for stated, true in at if stated.relighting_sigma is not None
        ]  # fmt: skip
        cells = [words, *_placing(room, found), f"{np.mean(held):.0%}"]
        placings.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, *placings])


def main() -> None:
    """Print the tables, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", type=int, default=12, help="places at each distance (12)")
    parser.add_argument("--trials", type=int, default=40, help="second probes of each noise (40)")
    parser.add_argument("--page", action="store_true", help="write docs/users/places.md")
    options = parser.parse_args()
    measured = table(options.places, options.trials)
    print(measured)
    if options.page:
        put(PAGE, {"places": measured + "\n"})


if __name__ == "__main__":
    main()
