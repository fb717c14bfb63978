"""`lightprobe estimate --probe dodecahedron:…`: a paper dodecahedron in one picture or several."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe import daemon
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_probe
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import UsageError
from lightprobe.estimate import EstimateFlag, Light
from lightprobe.evaluate import offline
from lightprobe.imaging import image, metadata
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards
from lightprobe.probe import diffuse, find, mirror
from lightprobe.probe.dodecahedron import faces, kind, light, pose, solid
from lightprobe.probe.dodecahedron.faces import Reading
from lightprobe.probe.kinds import ProbeError

#: Of the panorama: fine enough for a disc of 1°. A lamp of it is found so near.
_WIDTH, _SAME_LAMP_DEG = 960, 4.0
#: Roughnesses that are tried.
_ROUGHNESSES = (None, 0.2, 0.35, 0.5, 0.75, 1.0)
#: Stated edge, and the one by the board, may differ by this share, when a face lies on it.
_WRONG_EDGE, _LIES = 0.15, np.cos(np.radians(5))


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the pictures show."""

    readings: tuple[Reading, ...]
    rotation_sigma_deg: float
    notes: tuple[str, ...]
    shaded: float  # share of the faces that are lit unevenly
    edge_holds: bool  # the board does not contradict it


def estimate(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    options: Options,
) -> daemon.Once:
    """Estimate with a dodecahedron as the probe; several pictures are joined.

    Raises UsageError, ProbeError, and what estimating does. The frame of the estimate is the
    board's, or without one the camera's: then the camera stands still and the solid is turned.
    """
    probe = kind.parse(options.probe)
    if options.save_camera or options.at:
        raise UsageError("estimate: --save-camera and --ball-at: are for balls")
    exposures_us = exposures_us or metadata.exposures_us([metadata.read(file) for file in files])
    _check_exposures(files, exposures_us)
    pinhole = estimate_probe.pinhole_of(options.intrinsics, files[0], mirror.size_of(files))
    seen = _read(files, exposures_us, options, probe, pinhole)
    try:
        found = _solved(seen, probe)
    except ProbeError as error:
        raise ProbeError("; ".join([str(error), *seen.notes[:1]])) from None
    once = estimate_probe.listed(found.panorama(_WIDTH), settings)
    result = once.estimate
    result = dataclasses.replace(
        result,
        lights=tuple(
            _known(lamp, found, probe.edge_mm if seen.edge_holds else None)
            for lamp in result.lights
        ),
        flags=result.flags | EstimateFlag.PARTIAL_VIEW,
        relighting_sigma=float(np.hypot(result.relighting_sigma or 0.0, found.relighting_sigma)),
    )
    return dataclasses.replace(once, estimate=result, log=[*seen.notes, *found.notes, *once.log])


def _check_exposures(files: Sequence[Path], exposures_us: Sequence[float]) -> None:
    """Several pictures of 8 bits need one exposure each; raises UsageError."""
    if exposures_us and len(exposures_us) != len(files):
        raise UsageError(
            f"estimate: {len(files)} files and {len(exposures_us)} exposures: one for each file"
        )
    codes = [file for file in files if file.suffix.lower() not in image.HDR_SUFFIXES]
    if codes and len(codes) < len(files):
        raise UsageError(
            "estimate: --probe dodecahedron: pictures of 8 bits and of high range have other "
            "scales: give those of one kind"
        )
    if exposures_us and not codes:
        raise UsageError(
            "estimate: --exposure-us: pictures of high range hold radiance: leave it out, and "
            "bring them to one scale"
        )
    if len(files) > 1 and codes and not exposures_us:
        raise UsageError(
            "estimate: --probe dodecahedron: several pictures, and not all say in their Exif or "
            "XMP how they were exposed: give their exposures with --exposure-us A,B,…"
        )
    if any(not value > 0 or not np.isfinite(value) for value in exposures_us):
        raise UsageError("estimate: --exposure-us: exposures are above 0")


def _read(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    options: Options,
    probe: kind.Kind,
    pinhole: Pinhole,
) -> _Seen:
    """Faces of all pictures; those that show no solid, or no board, are left out with a note."""
    board = None if options.board == "none" else lens_board.parse(options.board)
    readings: list[Reading] = []
    notes: list[str] = []
    problems: list[str] = []
    sigmas: list[float] = []
    uneven, contradicts = 0, False
    for i, file in enumerate(files):
        name = f"{file}: " if len(files) > 1 else ""
        grey = np.asarray(find.as_codes(file).astype(np.float32) @ find.LUMA, np.uint8)
        try:
            where = pose.find(grey, pinhole)
            stands = boards.find(grey, pinhole, board) if board else None
            if board and stands is None:
                raise ProbeError(
                    "no board is found: let the picture show most of it, sharp and evenly lit, or "
                    "give --board none (then directions are in the frame of the camera)"
                )
        except ProbeError as error:
            problems.append(f"{file}: {error}")
            continue
        rotation = np.eye(3) if stands is None else stands.rotation
        radiance, clipped = diffuse.merged([file], exposures_us[i : i + 1])
        found = faces.read(radiance, clipped, pinhole, where, rotation)
        readings += found.faces
        uneven += found.uneven
        notes += [name + note for note in found.notes]
        sigmas.append(float(np.hypot(where.sigma_deg, stands.sigma_deg if stands else 0.0)))
        if stands is not None and options.square_mm is not None:
            wrong = _edge_notes(where, stands, options.square_mm, probe)
            notes += [name + note for note in wrong]
            contradicts = contradicts or bool(wrong)
    if not sigmas:
        raise ProbeError(problems[0])
    notes += [f"{problem}: it is left out" for problem in problems]
    shaded = uneven / max(uneven + len(readings), 1)
    return _Seen(tuple(readings), max(sigmas), tuple(notes), shaded, not contradicts)


def _edge_notes(
    where: pose.Pose, stands: boards.Pose, square_mm: float, probe: kind.Kind
) -> list[str]:
    """A note where a solid with that edge would not lie on the board."""
    up = stands.rotation[1]  # in the camera's frame
    if not np.min(solid.normals() @ where.rotation.T @ up) < -_LIES:
        return []  # held by hand, perhaps
    camera_mm = float(-(stands.corner @ up)) * square_mm  # above the board
    edge_mm = camera_mm / float(-(where.centre @ up) + solid.INRADIUS)
    if abs(edge_mm - probe.edge_mm) < _WRONG_EDGE * probe.edge_mm:
        return []
    return [
        f"by the board, a dodecahedron that lies on it has edges of {edge_mm:.0f} mm, not "
        f"{probe.edge_mm:g}: is the edge right, and --square-mm? Directions hardly depend on it; "
        "distances do, and are left out"
    ]


def _solved(seen: _Seen, probe: kind.Kind) -> light.Light:
    """The light; with the roughness that fits best, where that is asked for."""
    tried = _ROUGHNESSES if probe.fits_roughness else (probe.roughness,)
    found = [
        (
            light.solve(
                seen.readings, probe.edge_mm, one, seen.rotation_sigma_deg, shaded=seen.shaded
            ),
            one,
        )
        for one in tried
    ]
    best, roughness = min(found, key=lambda pair: pair[0].chi2)
    if not probe.fits_roughness:
        return best
    said = "matt paper" if roughness is None else f"roughness={roughness:g}"
    return dataclasses.replace(best, notes=(f"what fits best: {said}", *best.notes))


def _known(lamp: Light, found: light.Light, edge_mm: float | None) -> Light:
    """A lamp of the panorama, with what the faces tell of it; without an edge no distance."""
    if not found.lamps:
        return lamp
    known = max(found.lamps, key=lambda one: float(one.direction @ lamp.direction))
    listed = dataclasses.replace(
        lamp, direction_sigma_deg=known.direction_sigma_deg,
        irradiance_sigma=known.irradiance_sigma * lamp.irradiance,
    )  # fmt: skip
    if not known.direction @ lamp.direction > np.cos(np.radians(_SAME_LAMP_DEG)):
        return listed
    listed = dataclasses.replace(listed, direction=known.direction)
    if known.distance_sigma is None or edge_mm is None:
        return listed
    return dataclasses.replace(
        listed, distance_m=known.distance * edge_mm / 1000, distance_sigma=known.distance_sigma
    )
