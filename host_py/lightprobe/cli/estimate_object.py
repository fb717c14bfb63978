"""`lightprobe estimate --probe object:…`: an object whose shape is known, on the printed board."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from lightprobe import daemon
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_probe
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import UsageError
from lightprobe.evaluate import offline
from lightprobe.imaging import metadata
from lightprobe.probe import diffuse, mirror, paper
from lightprobe.probe import object as objects
from lightprobe.probe import object_samples as samples

#: Of the panorama of 384 texels, which are 11° wide.
_WIDTH = 480


def estimate(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    options: Options,
) -> daemon.Once:
    """Estimate the light by an object and its shadows on the board.

    Raises UsageError, ProbeError, and what estimating does. The frame of the estimate is the
    board's; its values are radiance in the picture's units.
    """
    light, rotation_sigma_deg = find_light(files, exposures_us, options)
    return told(light, rotation_sigma_deg, settings)


def find_light(
    files: Sequence[Path], exposures_us: Sequence[float], options: Options
) -> tuple[objects.Light, float]:
    """The light by an object on the board, and 1 sigma of the board's rotation in degrees.

    Raises UsageError and ProbeError.
    """
    shape = samples.parse(options.probe)
    if options.board == "none" or options.square_mm is None:
        raise UsageError(
            "estimate: --probe object: needs the printed board: give --square-mm, the side of its "
            "squares as printed"
        )
    if options.save_camera or options.at:
        raise UsageError("estimate: --save-camera and --ball-at: are for balls")
    board = lens_board.parse(options.board)
    solid = samples.stand(shape, board, options.square_mm)
    exposures_us = exposures_us or metadata.exposures_us([metadata.read(file) for file in files])
    offline.check_exposures(files, exposures_us)
    pinhole = estimate_probe.pinhole_of(options.intrinsics, files[0], mirror.size_of(files))
    pose = estimate_probe.find_pose(files, pinhole, board)
    radiance, clipped = diffuse.merged(files, exposures_us)
    view = samples.View(radiance, clipped, pinhole, pose)
    light = objects.solve(samples.look(view, board, solid), board, shape.albedo)
    return light, pose.sigma_deg


def told(
    light: objects.Light, rotation_sigma_deg: float, settings: offline.Settings
) -> daemon.Once:
    """What the pipeline made of the light, with how well the object tells it."""
    once = estimate_probe.listed(light.panorama(_WIDTH), settings)
    once = estimate_probe.with_sigmas(once, light, rotation_sigma_deg, paper.PAPER_SIGMA)
    albedo = ", ".join(f"{value:.2f}" for value in light.albedo)
    notes = [
        *light.notes,
        f"the object reflects {albedo} of red, green and blue, if paper {paper.PAPER:.2f}",
    ]
    return dataclasses.replace(once, log=[*notes, *once.log])
