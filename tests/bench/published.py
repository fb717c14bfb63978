"""Baselines in Python: the published recipe as its users write it, and SH by a public library.

published.cpp is the same recipe in C++; its head says where it comes from.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import ducc0
import numpy as np
from lightprobe.colour import srgb_table
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.geometry import cap_radius_deg
from numpy.typing import NDArray

KERNEL_PX = 11
Codes = NDArray[np.uint8]


@dataclass(frozen=True)
class Region:
    """A bright region of the picture."""

    direction: NDArray[np.float64]
    colour: NDArray[np.float64]  # mean code, RGB
    area_px: float


def median_of(grey: Codes) -> int:
    """Code at which the histogram's lower half ends."""
    histogram = cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel()
    return int(np.searchsorted(np.cumsum(histogram), grey.size / 2))


def published(jpeg: Codes) -> list[Region]:
    """JPEG bytes to bright regions, the largest first."""
    picture = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
    height, width, _ = picture.shape
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    _, mask = cv2.threshold(grey, median_of(grey), 255, cv2.THRESH_BINARY)
    mask = cv2.GaussianBlur(mask, (KERNEL_PX, KERNEL_PX), 0)
    mask = cv2.erode(mask, np.ones((KERNEL_PX, KERNEL_PX), np.uint8))
    mask = cv2.dilate(mask, np.ones((3 * KERNEL_PX, 3 * KERNEL_PX), np.uint8))
    _, mask = cv2.threshold(mask, 127, 255, cv2.THRESH_BINARY)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    contours = sorted(contours, key=cv2.contourArea, reverse=True)
    regions: list[Region] = []
    for index, contour in enumerate(contours):
        moments = cv2.moments(contour)
        if moments["m00"] <= 0:
            break
        inside = np.zeros_like(grey)
        cv2.drawContours(inside, contours, index, 255, cv2.FILLED)
        colour = np.array(cv2.mean(picture, mask=inside)[2::-1])
        theta = np.pi * (moments["m01"] / moments["m00"] + 0.5) / height
        longitude = 2 * np.pi * ((moments["m10"] / moments["m00"] + 0.5) / width - 0.5)
        sine = np.sin(theta)
        direction = np.array([sine * np.sin(longitude), np.cos(theta), -sine * np.cos(longitude)])
        regions.append(Region(direction, colour, moments["m00"]))
    return regions


def as_estimate(regions: list[Region], size_px: tuple[int, int], exposure_us: float) -> Estimate:
    """Give the published lights the daemon's form, so that both are judged by the same code.

    A region's light is its mean colour, linearised, times the solid angle of its pixels.
    """
    width, height = size_px
    table = srgb_table()
    lights = []
    for number, region in enumerate(regions):
        sine = float(np.hypot(region.direction[0], region.direction[2]))
        solid_angle = region.area_px * (2 * np.pi / width) * (np.pi / height) * sine
        linear = np.interp(region.colour, np.arange(256), table) / (exposure_us * 1e-6)
        radius_deg = float(cap_radius_deg(min(solid_angle, 4 * np.pi)))
        lights.append(Light(number + 1, region.direction, linear * solid_angle, radius_deg))
    return Estimate(
        sequence=1, boot_id=1, capture_time_unix_ns=0, send_delay_us=0, ttl_ms=0,
        flags=EstimateFlag(0), lights=tuple(lights),
        sh=SphericalHarmonics("AMBIENT", 2, np.zeros((9, 3))), predicted_error=None,
        exposure_us=exposure_us, exposure_count=1, cd_m2_per_unit=None,
    )  # fmt: skip


_LINEAR = srgb_table().astype(np.float32)


def project_ducc0(jpeg: Codes) -> NDArray[np.complex64]:
    """JPEG bytes to order-2 SH (3 channels, 6 complex coefficients m >= 0) by ducc0, one thread."""
    picture = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
    linear = np.ascontiguousarray(np.moveaxis(_LINEAR[picture], -1, 0))
    return np.stack(
        [
            ducc0.sht.analysis_2d(
                map=channel[None], lmax=2, mmax=2, spin=0, geometry="F1", nthreads=1
            )[0]
            for channel in linear
        ]
    )
