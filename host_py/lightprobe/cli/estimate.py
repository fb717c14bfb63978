"""`lightprobe estimate`: the daemon's own pipeline over files."""

from __future__ import annotations

import dataclasses
import io
import json
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from lightprobe.calibrate import ring
from lightprobe.cli import check, view, whole_file
from lightprobe.cli.cuts import Constellation, ConstellationCut, cut_of
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import Estimate, flag_names
from lightprobe.evaluate import offline
from lightprobe.imaging import constellation as constellations
from lightprobe.imaging import image
from lightprobe.imaging.film import Sheet
from lightprobe.installation import install_extras
from lightprobe.reflection_map import SIZES, ReflectionMap

#: What estimates with probes of a kind; with any other, estimate_probe.
_WITH = {"dodecahedron": "estimate_solid", "object": "estimate_object"}

CameraName = Annotated[
    str, typer.Option(metavar="equirect|FILE", help="Projection, or a camera file.")
]
Film = Annotated[
    str | None,
    typer.Option(
        metavar="T,R[,O[,N]]",
        help="Transmission, extinction ratio, offset in degrees and refractive index of the "
        "polarizer; default: what the camera file says, or 0.84,500,0,1.5.",
    ),
]


def command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE…", help="HDR, EXR, PFM, JPEG or PNG; several are one bracket."
        ),
    ],
    exposure_us: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,…",
            help="Exposure of each 8- or 16-bit file, in microseconds; default: its Exif.",
        ),
    ] = None,
    camera: CameraName = "equirect",
    order: Annotated[int, typer.Option(min=0, max=4, help="Highest SH order.")] = 2,
    lights: Annotated[int, typer.Option(min=0, max=8, help="Maximum number of lamps listed.")] = 8,
    area_lights: Annotated[
        bool, typer.Option("--area-lights", help="List windows, soft boxes and the like, too.")
    ] = False,
    key_light: Annotated[
        bool,
        typer.Option("--key-light", help="Add KEY, one light for what the listed ones leave."),
    ] = False,
    kind: Annotated[
        str, typer.Option(help="AMBIENT: SH without the listed lamps; TOTAL: with them.")
    ] = "AMBIENT",
    preset: Annotated[
        str, typer.Option(help="fast, balanced, accurate or reference.")
    ] = "accurate",
    panorama_width: Annotated[
        int | None, typer.Option(metavar="N", help="Width of the small panorama.")
    ] = None,
    detector: Annotated[
        str | None,
        typer.Option(help="adaptive, or research[:T]: the published recipe, to compare."),
    ] = None,
    ring_lux: Annotated[
        str | None,
        typer.Option(
            metavar="V0,…,V8",
            help="What the nine light sensors read then, in lux; nan: cannot be used.",
        ),
    ] = None,
    ring_sigma: Annotated[
        str,
        typer.Option(
            metavar="S|S0,…,S8",
            help="Relative 1 sigma of these readings, 0.001…10: one for all, or nine.",
        ),
    ] = "0.03",
    ring_rgb: Annotated[
        str | None,
        typer.Option(
            metavar="R0,G0,B0,…,B8",
            help="With --ring-lux: red, green and blue of each sensor, each colour in a unit of "
            "its own.",
        ),
    ] = None,
    ring_colour_sigma: Annotated[
        float, typer.Option(min=0.001, max=10, help="Relative 1 sigma of these.")
    ] = 0.03,
    cd_m2_per_unit: Annotated[
        float | None,
        typer.Option(metavar="X", help="Luminance of radiance 1; default: the camera file's."),
    ] = None,
    wheel_deg: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,C,…",
            help="Angle of the polarizer in front of the lens in each file, in degrees: tells "
            "reflections from lamps.",
        ),
    ] = None,
    film: Film = None,
    reflection_map: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=check.new_file(".hdr", ".exr", ".pfm", ".npy"),
            help="Write what shiny surfaces mirror: .hdr, .exr, .pfm: an environment map; .npy: "
            "the six faces of a cube.",
        ),
    ] = None,
    reflection_size: Annotated[
        int, typer.Option(metavar="16|32|64", help="Texels along an edge of the reflection map.")
    ] = 32,
    constellation: Constellation = None,
    cut: ConstellationCut = "variance",
    probe: Annotated[
        str | None,
        typer.Option(
            metavar="ball:MM|diffuse-ball:MM|rod:MM,MM|dodecahedron:MM|object:MESH",
            help="The pictures show a ball: ball:60mm (also ball:60mm,black or ,silver) mirrors, "
            "diffuse-ball:40mm is white and matt. Or a rod that stands upright on the board: "
            "rod:60mm,8mm@5,4, its height, its diameter and its place in squares from the upper "
            "left corner (default: the middle). Or a paper dodecahedron (lightprobe net), in one "
            "picture or several: dodecahedron:30mm, its edge. Or a matt object whose mesh is "
            "known: object:vase.glb@5,4,30,albedo=0.8, the place of the mesh's origin, its turn "
            "to the left in degrees, and what it reflects (default: found).",
        ),
    ] = None,
    intrinsics: Annotated[
        str | None,
        typer.Option(
            metavar="FX,FY,CX,CY[,K1,K2,P1,P2[,K3]]",
            help="With --probe: of the camera, in pixels of these pictures, and its distortion as "
            "OpenCV has it; default: the Exif's focal length.",
        ),
    ] = None,
    board: Annotated[
        str,
        typer.Option(
            metavar="COLUMNSxROWS|none",
            help="With --probe: squares of the printed board, which is the frame "
            "of the estimate; none: the camera is.",
        ),
    ] = "11x8",
    square_mm: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1, 1000, "mm"),
            help="With --probe: side of the board's squares as printed: a rod and an object need "
            "it, a ball's diameter is checked by it.",
        ),
    ] = None,
    ball_at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,RADIUS", help="With --probe: about where the ball is, in pixels."
        ),
    ] = None,
    save_camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.camera",
            callback=check.new_file(".camera"),
            help="With --probe ball: write the camera file for lightprobed, while nothing moves.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the estimate as JSON.")] = False,
) -> None:
    """Estimate the light in pictures with the daemon's own pipeline.

    Values are scene-linear: in the file's own units for HDR; for 8-bit pictures with exposures,
    radiance 1.0 is full scale at one second; without (also in their Exif), it is relative to
    full scale.
    --ring-lux recovers lamps that clip in every picture; with the scale of the camera
    (lightprobe calibrate scale) it does so best.
    Example: lightprobe estimate room-1.jpg room-2.jpg --exposure-us 8000,500 --json
    A ball on a printed board instead of a 360° camera (docs/users/probes.md): lightprobe estimate
    photo.jpg --probe ball:60mm
    Through a polarizer: lightprobe estimate a.jpg b.jpg c.jpg d.jpg --wheel-deg 0,45,90,135
    """
    if reflection_size not in SIZES:
        raise UsageError(f"estimate: --reflection-size {reflection_size}: expected 16, 32 or 64")
    if kind.upper() not in ("AMBIENT", "TOTAL"):
        raise UsageError(f"estimate: --kind {kind}: expected AMBIENT or TOTAL")
    settings = offline.Settings(
        camera=camera, preset=preset, panorama_width=panorama_width, detector=detector,
        sh_order=order, lights=lights, area_lights=area_lights, key_light=key_light,
        **ring_settings(ring_lux, ring_sigma, ring_rgb, ring_colour_sigma),
        cd_m2_per_unit=cd_m2_per_unit,
        wheel_deg=parse_angles(wheel_deg), film=parse_film(film),
        reflection_map=reflection_size if reflection_map else None,
    )  # fmt: skip
    if probe is None:
        once = offline.estimate_pictures(files, parse_exposures(exposure_us), settings)
    else:
        probe_kind = probe.strip().partition(":")[0]
        try:
            # They need scipy or trimesh, which panoramas do not.
            from lightprobe.cli import estimate_probe

            with_probe = import_module(f"lightprobe.cli.{_WITH.get(probe_kind, 'estimate_probe')}")
        except ModuleNotFoundError as error:
            extras = ["sim", "calibrate", *(["bake"] if probe_kind == "object" else [])]
            raise LightprobeError(
                f"estimate: --probe: needs {error.name}, which is not installed: "
                f"{install_extras(*extras)}"
            ) from None
        options = estimate_probe.Options(probe, intrinsics, board, square_mm, ball_at, save_camera)
        once = with_probe.estimate(files, parse_exposures(exposure_us), settings, options)
    result = once.estimate
    if reflection_map and once.reflection_map:
        write_reflection_map(once.reflection_map, reflection_map)
    notes = list(once.log)
    if constellation:
        result, more = constellations.constellation(result, constellation, cut_of(cut))
        notes += more
    if kind.upper() == "TOTAL":
        result = dataclasses.replace(result, sh=result.total())
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(result.to_json(), indent=2))
    else:
        show(result)


def write_reflection_map(found: ReflectionMap, file: Path) -> None:
    """Write the kind of file that its name says, whole or not at all."""
    if file.suffix.lower() == ".npy":
        buffer = io.BytesIO()
        np.save(buffer, found.radiance)
        data = buffer.getvalue()
    else:
        # Two pixels a texel: the faces' corners are finer than their centres.
        data = image.encode(file.suffix.lower(), found.environment_map(8 * found.size))
    whole_file.write("estimate", file, data)


def parse_exposures(text: str | None) -> list[float]:
    """Read `A,B,…` as microseconds; raises UsageError."""
    try:
        return [float(word) for word in text.split(",")] if text else []
    except ValueError:
        raise UsageError(
            f"estimate: --exposure-us {text}: expected numbers, like 8000,500"
        ) from None


def ring_settings(
    lux: str | None, sigma: str, rgb: str | None, colour_sigma: float
) -> dict[str, Any]:
    """Give the readings of the ring for :class:`offline.Settings`; raises UsageError."""
    if lux is None and rgb is not None:
        raise UsageError("estimate: --ring-rgb: needs --ring-lux, what the same sensors read")
    if lux is None:
        return {}
    missing = "separated by commas; nan for a sensor that cannot be used"
    check_numbers("ring-lux", lux, (ring.SENSORS,), 0, f"nine numbers in lux, {missing}")
    check_numbers("ring-sigma", sigma, (1, ring.SENSORS), 0.001, "one number 0.001…10, or nine")
    found: dict[str, Any] = {"ring_lux": lux, "ring_sigma": sigma}
    if rgb is not None:
        check_numbers("ring-rgb", rgb, (3 * ring.SENSORS,), 0, f"27 numbers, {missing}")
        found |= {"ring_rgb": rgb, "ring_colour_sigma": colour_sigma}
    return found


def check_numbers(
    option: str, text: str, counts: tuple[int, ...], least: float, expected: str
) -> None:
    """Check that `text` is so many numbers; raises UsageError."""
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or any(value < least for value in values):
        raise UsageError(f"estimate: --{option} {text}: expected {expected}")


def parse_angles(text: str | None) -> tuple[float, ...]:
    """Read `A,B,…` as degrees; raises UsageError."""
    try:
        angles = tuple(float(word) for word in text.split(",")) if text else ()
    except ValueError:
        angles = (float("nan"),)
    if not all(0 <= angle <= 360 for angle in angles):
        raise UsageError(f"--wheel-deg {text}: expected degrees, 0…360, like 0,45,90,135")
    return angles


def parse_film(text: str | None) -> Sheet | None:
    """Read `T,R[,O[,N]]`: transmission, extinction ratio, offset, index; raises UsageError."""
    if text is None:
        return None
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3, 4) or not Sheet(*numbers).is_possible:
        raise UsageError(
            f"--film {text}: expected transmission (0.01…1), extinction ratio (1…1e9) and perhaps "
            "the offset in degrees (-180…180) and the refractive index (1…2), like 0.84,500 or "
            "0.84,500,2.5,1.4"
        )
    return Sheet(*numbers)


def show(estimate: Estimate) -> None:
    """Print an estimate for the eye."""
    console = view.console()
    if estimate.lights or estimate.key:
        console.print(view.lights_table(estimate))
    else:
        console.print("no lamps: all of the light is in the SH")
    console.print(f"\nSH of radiance, order {estimate.sh.order}, {estimate.sh.kind}, luminance:")
    console.print(view.sh_table(estimate))
    if estimate.predicted_error is not None:
        console.print(
            f"\nnot represented by this model: {100 * estimate.predicted_error:.1f} % of mean light"
        )
    if estimate.relighting_sigma is not None:
        console.print(f"irradiance is known to {100 * estimate.relighting_sigma:.1f} % (1 sigma)")
    if estimate.cd_m2_per_unit is not None:
        sigma = estimate.cd_m2_per_unit_sigma
        within = "" if sigma is None else f", within {100 * sigma:.1f} % (1 sigma)"
        console.print(f"radiance 1 is {estimate.cd_m2_per_unit:.4g} cd/m²{within}")
    for line in view.flag_lines(flag_names(estimate.flags)):
        console.print(f"[yellow]{line}[/yellow]")
