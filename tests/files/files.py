"""Pictures as people have them: the tests' list, and the table of docs/users/accuracy.md.

Each file is of a kind that real cameras and programs make, and stands beside the light that is in
it, or the words that refuse it. `build/venv/bin/python tests/files/files.py` measures all of them
and writes the table.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lightprobe import daemon, geometry
from lightprobe.colour import luminance
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, flag_names
from lightprobe.evaluate import offline

FOLDER = Path(__file__).resolve().parent
PRESETS = ("fast", "balanced", "accurate", "reference")


@dataclass(frozen=True)
class Light:
    """What is in a picture, whatever reads it."""

    sh0: float  # luminance of coefficient 0, AMBIENT
    lamp: tuple[float, float] | None  # azimuth, elevation of the strongest
    flags: frozenset[str] = frozenset()  # those that must be there
    within: float = 0.02  # of sh0 and of the irradiance
    lamp_within_deg: float = 1.0  # `fast` has cells of 3°, and of 8-bit pictures blocks of 5.6°
    irradiance: tuple[float, float, float] | None = None  # of the lamp; None: not known
    told: str = ""  # among the notes


@dataclass(frozen=True)
class Refused:
    """No estimate, and why: one of these is in the message."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class File:
    """A file, what is special about it, and the right answer."""

    name: str
    what: str
    right: Light | Refused
    exposure_us: float | None = 2000.0


@dataclass(frozen=True)
class Answer:
    """What a file came to, in one way of reading it; of a refusal only `log`."""

    way: str
    log: str
    estimate: Estimate | None = None

    @property
    def sh0(self) -> float:
        """Luminance of coefficient 0."""
        assert self.estimate is not None
        return float(luminance(self.estimate.sh.coefficients[0]))

    @property
    def lamp(self) -> tuple[float, float] | None:
        """Azimuth and elevation of the strongest lamp."""
        assert self.estimate is not None
        lights = self.estimate.lights
        return (lights[0].azimuth_deg, lights[0].elevation_deg) if lights else None

    @property
    def flags(self) -> frozenset[str]:
        """Names of the estimate's flags."""
        assert self.estimate is not None
        return frozenset(flag_names(self.estimate.flags))


#: Sky 30/24/18, floor 6/6/6, a lamp of 5° that clips in 2000 µs.
PLAIN = Light(54.83, (60, 30), frozenset({"CLIPPED"}))
#: What the rest of the sphere holds is not known.
PART = replace(PLAIN, flags=frozenset({"CLIPPED", "PARTIAL_VIEW"}))
STORED = "is not obeyed: pixels count as they are stored"
CUT = Refused(("a picture is cut off or damaged", "is the file complete?"))
DAMAGED = Refused(("the data is damaged or ends too early",))
#: `.jpg`, read by the daemon and by `lightprobe estimate`.
JPEG = (
    File("jpeg/plain.jpg", "a photo", PLAIN),
    File("jpeg/444.jpg", "chroma 4:4:4", PLAIN),
    File("jpeg/422.jpg", "chroma 4:2:2", PLAIN),
    File("jpeg/440.jpg", "chroma 4:4:0", PLAIN),
    File("jpeg/420.jpg", "chroma 4:2:0", PLAIN),
    File("jpeg/411.jpg", "chroma 4:1:1", PLAIN),
    File("jpeg/grey.jpg", "grey", PLAIN),
    File("jpeg/progressive.jpg", "progressive", PLAIN),
    File("jpeg/rgb_adobe.jpg", "RGB, by Adobe's marker", PLAIN),
    File("jpeg/cmyk.jpg", "CMYK", Refused(("Unsupported color conversion request",))),
    File("jpeg/restart.jpg", "restart markers", PLAIN),
    File("jpeg/exif_thumbnail.jpg", "a thumbnail in its Exif", PLAIN),
    File("jpeg/gain_map_grey.jpg", "Ultra HDR: a gain map behind the picture", PLAIN),
    File("jpeg/mpf_preview.jpg", "MPF: a preview behind the picture", PLAIN),
    File("jpeg/trailer_mp4.jpg", "motion photo: a movie behind the picture", PLAIN),
    File("jpeg/trailer_zero.jpg", "zeros behind the picture", PLAIN),
    File("jpeg/trailer_ff.jpg", "ones behind the picture", PLAIN),
    File("jpeg/leading_garbage.jpg", "line ends before the picture", PLAIN),
    File("jpeg/gpano_crop_2to1.jpg", "GPano: a 2:1 part of the sphere", PART),
    File(
        "jpeg/gpano_crop_no_nadir.jpg",
        "GPano: a part without the nadir",
        replace(PART, sh0=56.74),
    ),
    File(
        "jpeg/gpano_window.jpg",
        "GPano: 112°×98° around the lamp",
        replace(PART, sh0=69.2),
    ),
    File("jpeg/gpano_seam.jpg", "GPano: a part across the seam", PART),
    File("jpeg/orientation3.jpg", "Exif orientation 3", replace(PLAIN, told=STORED)),
    File("jpeg/orientation6.jpg", "Exif orientation 6", replace(PLAIN, told=STORED)),
    File("jpeg/cut.jpg", "cut off", CUT),
    File("jpeg/no_eoi.jpg", "without its last two bytes", CUT),
)

#: `.mjpg`, as cameras send it.
MJPEG = (
    File("mjpeg/plain.mjpg", "a frame", PLAIN),
    File("mjpeg/avi1_no_dht.mjpg", "without Huffman tables (AVI1)", PLAIN),
    File("mjpeg/optimised_tables.mjpg", "with Huffman tables of its own", PLAIN),
    File("mjpeg/ids_0_1_2.mjpg", "components numbered from 0", PLAIN),
    File("mjpeg/com_after_sof.mjpg", "a comment behind the frame header", PLAIN),
    File("mjpeg/q100_444.mjpg", "quality 100, 4:4:4", PLAIN),
    File(
        "mjpeg/q1.mjpg", "quality 1",
        Light(54.83, (60, 30), PLAIN.flags, within=0.08),
    ),
    File(
        "mjpeg/odd_size.mjpg", "501×250: the plain picture without its right and lower edge",
        Light(56.08, (65.28, 28.64), PLAIN.flags),
    ),
    File("mjpeg/size_changes.mjpg", "another size in between", PLAIN),
    File("mjpeg/app4_h264.mjpg", "H.264 in APP4 (Logitech C920)", PLAIN),
    File("mjpeg/app4_between.mjpg", "the same between the tables", PLAIN),
    File("mjpeg/app4_twice.mjpg", "two pictures in APP4 before the frame", PLAIN),
    File("mjpeg/restart.mjpg", "restart markers", PLAIN),
    File(
        "mjpeg/restart_extraneous_bytes.mjpg",
        "bytes before restart markers (Logitech C270, C910)", PLAIN,
    ),
    File("mjpeg/restart_ff_fill.mjpg", "fill bytes before restart markers", PLAIN),
    File("mjpeg/restart_zero_dri.mjpg", "a restart interval of 0", PLAIN),
    File(
        "mjpeg/restart_missing_marker.mjpg", "a restart marker is missing",
        DAMAGED,
    ),
    File(
        "mjpeg/restart_numbers_from_1.mjpg", "restart markers that begin at 1",
        DAMAGED,
    ),
    File(
        "mjpeg/restart_declared_none_used.mjpg", "restart markers stated, and none there",
        DAMAGED,
    ),
    File("mjpeg/ff_before_eoi.mjpg", "fill bytes before the end", PLAIN),
    File("mjpeg/double_eoi.mjpg", "two ends", PLAIN),
    File("mjpeg/zero_padding.mjpg", "zeros behind the frame", PLAIN),
    File("mjpeg/ff_padding.mjpg", "ones behind the frame", PLAIN),
    File("mjpeg/empty_jpegs_before.mjpg", "empty JPEGs before the frame (capture cards)", PLAIN),
    File("mjpeg/two_first_without_eoi.mjpg", "two frames, the first without its end", PLAIN),
    File("mjpeg/no_eoi.mjpg", "without its last two bytes", CUT),
    File(
        "mjpeg/no_eoi_zero_padding.mjpg", "the same, zeros behind it",
        CUT,
    ),
    File("mjpeg/truncated_80.mjpg", "cut off", CUT),
    File(
        "mjpeg/truncated_50_then_eoi.mjpg", "half of it, and an end",
        DAMAGED,
    ),
)  # fmt: skip

#: Read by `lightprobe estimate` alone.
PNG = (
    File("png/rgb8.png", "8 bits a channel", PLAIN),
    File("png/palette.png", "a palette", PLAIN),
    File("png/grey8.png", "grey", PLAIN),
    File("png/la.png", "grey with alpha", PLAIN),
    File("png/bits1.png", "1 bit", Light(317.77, None, frozenset({"CLIPPED"}))),
    File("png/rgb.bmp", "BMP", PLAIN),
    File("png/lzw.tif", "TIFF, LZW", PLAIN),
    File("png/rgb16.png", "16 bits a channel", PLAIN),
    File(
        "png/transparent_nadir.png",
        "a transparent nadir",
        replace(PART, sh0=56.4, told="transparent pixels are not seen"),
    ),
    File("png/cmyk.tif", "TIFF, CMYK", PLAIN),
    File("png/orientation3.png", "Exif orientation 3", replace(PLAIN, told=STORED)),
    File("png/orientation3.tif", "TIFF, orientation 3", replace(PLAIN, told=STORED)),
    File("png/rgb8.webp", "WebP", Refused(("unknown kind",))),
)

#: Sky .5/.4/.3, floor .1/.1/.1, a lamp of 4°; read by `lightprobe estimate` alone, too.
FLOAT = Light(0.911, (60.15, 29.98), lamp_within_deg=0.2, irradiance=(6.04, 4.53, 3.02))
CONVERTED = replace(FLOAT, told="primaries converted to Rec. 709")
DIVIDED = replace(FLOAT, told="pixels divided by EXPOSURE and COLORCORR")
#: What lies outside of the data window is as bright as the mean inside, as far as anybody knows.
WINDOW = replace(FLOAT, flags=frozenset({"PARTIAL_VIEW"}), told="the rest is not seen")
EXR = (
    ("plain", "half floats, ZIP", FLOAT),
    ("b44", "compressed by B44", FLOAT),
    ("dwaa", "compressed by DWAA", FLOAT),
    ("dwab", "compressed by DWAB", FLOAT),
    ("piz", "compressed by PIZ", FLOAT),
    ("pxr24", "compressed by PXR24", FLOAT),
    ("rle", "compressed by run lengths", FLOAT),
    ("decreasing_y", "rows from the bottom", FLOAT),
    ("lower_case", "channels r g b", FLOAT),
    ("luminance_chroma", "luminance and chroma", FLOAT),
    ("blender_layers", "Blender's layers", replace(FLOAT, told="ViewLayer.Combined is the")),
    ("aces_ap0", "primaries of ACES", CONVERTED),
    ("white_luminance", "a stated luminance of 1", replace(FLOAT, told="--cd-m2-per-unit 100")),
    ("uint", "whole numbers, in units of 0.01",
     replace(FLOAT, sh0=91.1, irradiance=(604.0, 453.0, 302.0))),
    ("cropped", "a data window of a quarter", replace(WINDOW, sh0=1.141)),
    ("cropped_nadir", "a data window without the nadir", replace(WINDOW, sh0=0.982)),
    ("lamp_is_inf", "half floats that overflow in the lamp",
     replace(FLOAT, flags=frozenset({"CLIPPED"}), irradiance=None)),
    ("nan_inf_negative", "one pixel each of NaN, infinity and below 0",
     Light(0.911, None, frozenset({"CLIPPED", "INVALID_INPUT"}), told="3 negative samples")),
    ("deep", "deep samples", Refused(("flatten the picture first",))),
)  # fmt: skip
HDR = (
    ("plain", "new run lengths", FLOAT),
    ("flat", "not compressed", FLOAT),
    ("oldrle", "old run lengths", FLOAT),
    ("exposure_half", "EXPOSURE", DIVIDED),
    ("exposure_twice", "EXPOSURE, twice", DIVIDED),
    ("colorcorr", "COLORCORR", DIVIDED),
    # its samples are those of Rec. 709: whoever believes the header sees other colours
    ("primaries2020", "PRIMARIES of Rec. 2020", replace(CONVERTED, irradiance=None)),
    ("xyze", "CIE X, Y, Z", CONVERTED),
    ("bottom_up", "rows from the bottom", FLOAT),
    ("mirrored", "columns from the right", FLOAT),
    ("autopano", "the header of a stitching program", FLOAT),
    ("crlf", "lines that end as on Windows", FLOAT),
    ("long_header", "a long header", FLOAT),
    ("rgbe_magic", "#?RGBE", FLOAT),
    ("truncated", "cut off", Refused(("is the file complete?",))),
)

#: Radiance 0.2159 all over what the lens sees; what it does not see is nothing else.
EVEN = Light(0.765, None, frozenset({"PARTIAL_VIEW"}))
#: Beside each its camera file; read by the daemon and by `lightprobe estimate`.
FISHEYE = (
    File("fisheye/fish176.jpg", "a lens of 176°", EVEN, None),
    File("fisheye/fish194.jpg", "a lens of 194°", EVEN, None),
)

FILES = (
    *JPEG, *MJPEG, *PNG, *FISHEYE,
    *(File(f"exr/{name}.exr", what, right, None) for name, what, right in EXR),
    *(File(f"hdr/{name}.hdr", what, right, None) for name, what, right in HDR),
)  # fmt: skip


def answers(file: File) -> Iterator[Answer]:
    """What every way of reading a file makes of it."""
    path = FOLDER / file.name
    kind = path.parent.name
    exposure = f"?exposures_us={file.exposure_us:g}" if file.exposure_us else ""
    camera = str(path.with_suffix(".camera")) if kind == "fisheye" else "equirect"
    if kind in ("jpeg", "mjpeg", "fisheye"):
        for preset in PRESETS:
            try:
                source = f"--source=file:{path}{exposure}"
                once = daemon.run_once([source, f"--preset={preset}", f"--camera={camera}"])
                yield Answer(preset, "\n".join(once.log), once.estimate)
            except LightprobeError as error:
                yield Answer(preset, str(error))
    if kind != "mjpeg":
        try:
            exposures_us = [file.exposure_us] if file.exposure_us else []
            settings = offline.Settings(camera=camera)
            estimate, log = offline.estimate_files([path], exposures_us, settings)
            yield Answer("estimate", "\n".join(log), estimate)
        except LightprobeError as error:
            yield Answer("estimate", str(error))


def fault(file: File, answer: Answer) -> str:
    """What is wrong with an answer; empty: nothing."""
    right = file.right
    if isinstance(right, Refused):
        if answer.estimate is not None:
            return f"{answer.way}: an estimate, but expected a refusal: {right.words[0]}"
        named = any(words in answer.log for words in right.words)
        return "" if named else f"{answer.way}: {answer.log}"
    if answer.estimate is None:
        return f"{answer.way}: refused: {answer.log}"
    if abs(answer.sh0 / right.sh0 - 1) > right.within:
        return f"{answer.way}: sh0 {answer.sh0:.4g}, expected {right.sh0:.4g}"
    if not right.flags <= answer.flags:
        return f"{answer.way}: flags {sorted(answer.flags)}, expected {sorted(right.flags)}"
    if wrong := _lamp_fault(right, answer):
        return wrong
    if right.told not in answer.log:
        return f"{answer.way}: expected a note: {right.told}: {answer.log}"
    return ""


def _lamp_fault(right: Light, answer: Answer) -> str:
    if not right.lamp:
        return ""
    if not (answer.lamp and _apart_deg(answer.lamp, right.lamp) < right.lamp_within_deg):
        return f"{answer.way}: lamp at {answer.lamp}, expected {right.lamp}"
    assert answer.estimate is not None
    found = answer.estimate.lights[0].irradiance
    if right.irradiance and not np.allclose(found, right.irradiance, rtol=right.within):
        return f"{answer.way}: irradiance {found}, expected {right.irradiance}"
    return ""


def _apart_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    return float(
        geometry.angle_deg(
            geometry.direction_from_angles(*one), geometry.direction_from_angles(*other)
        )
    )


HEAD = ["file", "what it is", "answer", "light off by", "flags"]


def row(file: File) -> list[str]:
    """Measure a file for the table; SystemExit when an answer is wrong."""
    found = list(answers(file))
    for answer in found:
        if wrong := fault(file, answer):
            raise SystemExit(f"{file.name}: {wrong}")
    if isinstance(file.right, Refused):
        return [file.name, file.what, f"refused: {file.right.words[0]}", "–", "–"]
    off = max(abs(answer.sh0 / file.right.sh0 - 1) for answer in found)
    flags = ", ".join(f"`{name}`" for name in sorted(found[0].flags)) or "–"
    return [file.name, file.what, "estimate", f"{100 * off:.1f} %", flags]


def main() -> None:
    """Measure all files; write and print the table."""
    sys.path.insert(0, str(FOLDER.parent / "accuracy"))
    from page import ACCURACY, put
    from recording import markdown

    text = markdown(HEAD, [row(file) for file in FILES])
    put(ACCURACY, {"files": text})
    print(text)


if __name__ == "__main__":
    main()
