"""What belongs on the list of lights: errors of engines that draw a packet, by what is in it.

Each panorama is estimated from all of its light, so that only what the packet leaves out counts.
Prints the table of docs/users/accuracy.md, "What belongs on the list" (three minutes):

    build/venv/bin/python tests/accuracy/listing.py --scene blender apartment lobby
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from lightprobe import geometry
from lightprobe import sh as harmonics
from lightprobe.colour import luminance
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, Light, LightFlag, SphericalHarmonics
from lightprobe.evaluate import offline
from lightprobe.evaluate.relight import Lighting
from lightprobe.geometry import Array
from lightprobe.imaging import image
from lightprobe.imaging.image import HDR_SUFFIXES
from lightprobe.sim import scenes
from recording import MORE_PANORAMAS, markdown

#: Bytes on the wire: daemon/light/send/model.h; an ellipse is five more floats.
COEFFICIENT, LIGHT, ELLIPSE = 12, 47, 24
MOST_LIGHTS = 4
#: Where the floor under a unit sphere is looked at.
_STEPS = np.linspace(-3, 3, 25)
_FLOOR = np.array([(x, -1.0, z) for x in _STEPS for z in _STEPS if np.hypot(x, z) < 3])
_NORMALS = geometry.sphere_normals()
_UP = np.array([0.0, 1.0, 0.0])

#: In words: the lights that are sent, and whether KEY is.
CHOICES: dict[str, tuple[str, bool]] = {
    "no lights": ("none", False),
    "KEY alone": ("none", True),
    "lamps (default)": ("lamps", False),
    "lamps and area lights": ("all", False),
    "lamps and KEY": ("lamps", True),
}


@dataclass(frozen=True)
class Errors:
    """Of one packet; shares of the mean irradiance, and of the unshaded floor's."""

    scene: str
    order: int
    sent: str
    size_bytes: int
    diffuse: float  # RMS over 642 normals
    soft: float  # RMS over the floor, the engine lets all light be shaded
    hard_ambient: float  # the same, the engine shades only lights, not the ambient light
    deepest: float  # lowest radiance of AMBIENT, of the scene's mean radiance


def panoramas(parts: Sequence[str]) -> list[Path]:
    """Files whose names contain one of the parts; `blender`: all of blender-data."""
    own = sorted(scenes.panorama_folder().iterdir())
    more = sorted(MORE_PANORAMAS.iterdir()) if MORE_PANORAMAS.is_dir() else []
    found = [
        file
        for file in (*own, *more)
        if file.suffix.lower() in HDR_SUFFIXES
        and any(file in own if part == "blender" else part in file.stem for part in parts)
    ]
    if not found:
        raise LightprobeError(f"listing: no panorama is named like {', '.join(parts)}")
    return found


def errors_of(file: Path) -> list[Errors]:
    """All choices for one panorama."""
    radiance = np.maximum(image.read(file).radiance, 0)
    truth = Lighting.of_map(radiance)
    most = offline.Settings(preset="accurate", sh_order=4, lights=8, area_lights=True)
    whole, _ = offline.estimate_files([file], (), most)
    total = whole.total()
    found = []
    for order in (2, 4):
        for sent, (which, with_key) in CHOICES.items():
            lights = {
                "none": (),
                "lamps": [one for one in whole.lights if not one.flags & LightFlag.EXTENDED],
                "all": sorted(whole.lights, key=_strength, reverse=True),
            }[which][:MOST_LIGHTS]
            key = _key(file, len(lights)) if with_key else None
            packet = _packet(whole, total, order, tuple(lights), key)
            found.append(_judge(file.stem, sent, truth, packet))
    return found


def _strength(light: Light) -> float:
    return float(luminance(light.irradiance))


def _key(file: Path, lamps: int) -> Light | None:
    settings = offline.Settings(preset="accurate", sh_order=4, lights=lamps, key_light=True)
    return offline.estimate_files([file], (), settings)[0].key


def _packet(
    whole: Estimate, total: SphericalHarmonics, order: int, lights: tuple[Light, ...],
    key: Light | None,
) -> Estimate:  # fmt: skip
    """Give the packet with these lights: AMBIENT is what they leave of TOTAL."""
    ambient = total.coefficients[: harmonics.count(order)].copy()
    for light in (*lights, *filter(None, [key])):
        ambient -= harmonics.lamp(light.direction, order)[:, None] * light.irradiance
    rest = SphericalHarmonics("AMBIENT", order, ambient)
    return replace(whole, lights=lights, key=key, sh=rest)


def _judge(scene: str, sent: str, truth: Lighting, packet: Estimate) -> Errors:
    lit = np.maximum(_NORMALS @ truth.directions.T, 0) @ luminance(truth.powers)
    shaded = _floor(truth)
    unshaded = float(np.maximum(truth.directions @ _UP, 0) @ luminance(truth.powers))
    alone = replace(packet, lights=(), key=None)
    lights = Lighting(np.empty((0, 3)), np.empty((0, 3))).plus(packet.beside_sh)
    ambient_up = float(luminance(harmonics.irradiance(packet.sh.coefficients, _UP)))
    ambient = Lighting.of_estimate(alone)
    dark = luminance(harmonics.radiance(packet.sh.coefficients, ambient.directions))
    ellipses = sum(light.axis is not None for light in packet.lights)

    def rms(error: Array, of: float) -> float:
        return float(np.sqrt((error**2).mean()) / of)

    return Errors(
        scene=scene,
        order=packet.sh.order,
        sent=sent,
        size_bytes=COEFFICIENT * harmonics.count(packet.sh.order)
        + LIGHT * len(packet.beside_sh) + ELLIPSE * ellipses,
        diffuse=rms(luminance(packet.irradiance(_NORMALS)) - lit, float(lit.mean())),
        soft=rms(_floor(Lighting.of_estimate(packet)) - shaded, unshaded),
        hard_ambient=rms(_floor(lights) + ambient_up - shaded, unshaded),
        deepest=float(dark.min() / (lit.mean() / np.pi)),
    )  # fmt: skip


def _floor(lighting: Lighting) -> Array:
    """Irradiance of the floor, luminance."""
    above = luminance(lighting.floor(_FLOOR))
    return np.asarray(above * np.pi / 0.45)  # its albedo: evaluate/relight.py


HEAD = [
    "order", "sent", "bytes, mean", "diffuse light, median (worst)",
    "shadows, all light is shaded", "shadows, only lights are shaded",
    "lowest radiance of AMBIENT, median",
]  # fmt: skip


def rows(found: Sequence[Errors]) -> list[list[str]]:
    """Table over scenes."""
    table = []
    for order in (2, 4):
        for sent in CHOICES:
            some = [one for one in found if (one.order, one.sent) == (order, sent)]
            shares = [
                [getattr(one, name) for one in some] for name in ("diffuse", "soft", "hard_ambient")
            ]
            table.append([
                str(order), sent, f"{np.mean([one.size_bytes for one in some]):.0f}",
                *(f"{100 * np.median(s):.1f} % ({100 * max(s):.0f} %)" for s in shares),
                f"{np.median([one.deepest for one in some]):.1f}",
            ])  # fmt: skip
    return table


def main() -> None:
    """Print the table, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", nargs="+", default=["blender"], metavar="PART",
        help="part of a panorama's file name, or blender: all of blender-data")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print all figures instead of a table")
    options = parser.parse_args()
    found: list[Errors] = []
    files = panoramas(options.scene)
    for number, file in enumerate(files, 1):
        found += errors_of(file)
        print(f"listing: {number} of {len(files)}: {file.stem}", file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps([asdict(one) for one in found], indent=2))
        return
    print(markdown(HEAD, rows(found)))


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"listing: {error}") from None
