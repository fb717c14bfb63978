"""What pictures say of themselves: exposure, part of the sphere, transparency, bits a channel."""

import functools
import zlib
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from lightprobe import daemon
from lightprobe.colour import luminance, srgb_to_linear
from lightprobe.errors import LightprobeError
from lightprobe.estimate import flag_names
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from PIL.TiffImagePlugin import IFDRational

FILES = Path(__file__).resolve().parents[1] / "files"
CODE = 100  # of a uniform picture
GPANO = "http://ns.google.com/photos/1.0/panorama/"
FISHEYE = """[camera]
projection = fisheye
width_px = 256
height_px = 256
[lens.0]
cx_px = 128
cy_px = 128
fx_px = 85
fy_px = 85
max_theta_deg = 85
"""
CROP = """[camera]
projection = equirect
width_px = 256
height_px = 256
[crop]
full_width_px = 512
full_height_px = 256
left_px = 400
"""


def estimate(*files, exposures_us=(), **settings):
    found, notes = offline.estimate_files(
        [Path(file) for file in files], exposures_us, offline.Settings(**settings)
    )
    return found, notes


def sh0(found):
    return float(luminance(found.sh.coefficients[0]))


def sh0_of_code(code, full_scale=255):
    return float(np.sqrt(4 * np.pi) * srgb_to_linear(np.array(code / full_scale)))


def with_exif(source, path, exposure_s, iso=100, f_number=2.0):
    exif = Image.Exif()
    fractions = (
        IFDRational(round(1e6 * exposure_s), 10**6),
        IFDRational(round(1e6 * f_number), 10**6),
    )
    exif.get_ifd(0x8769).update({0x829A: fractions[0], 0x829D: fractions[1], 0x8827: iso})
    Image.open(source).save(path, quality=95, exif=exif.tobytes())


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("by", ["exposure", "iso", "aperture"])
def test_exposures_come_from_exif(tmp_path, suffix, by):
    """As if somebody had typed them; the first picture's aperture is the one that counts."""
    files, exposures = [], [16000, 2000, 250]
    for index, (name, us) in enumerate(zip(["long", "mid", "short"], exposures, strict=True)):
        path = tmp_path / f"IMG_{9 + index}{suffix}"
        settings = {
            "exposure": (us * 1e-6, 100, 2.0),
            "iso": (1e-3, us // 10, 2.0),
            "aperture": (0.016, 100, 2.0 * (16000 / us) ** 0.5),
        }[by]
        with_exif(FILES / f"jpeg/b_{name}.jpg", path, *settings)
        files.append(path)
    read, _ = estimate(*files)
    typed, _ = estimate(*files, exposures_us=exposures)
    assert sh0(read) == pytest.approx(sh0(typed), rel=1e-3)
    assert read.exposure_count == 3
    assert "CLIPPED" not in flag_names(read.flags)
    if suffix == ".jpg":
        alone, _ = daemon.estimate_once([f"--source=file:{tmp_path}", "--preset=accurate"])
        assert sh0(alone) == pytest.approx(sh0(typed), rel=1e-3)


APEX = {
    name: (int(np.log2(1e6 / us) * 1e4), 10000)
    for name, us in (("long", 16000), ("mid", 2000), ("short", 250))
}


def xmp(properties):
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf='
        '"http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
        'xmlns:exif="http://ns.adobe.com/exif/1.0/" xmlns:tiff="http://ns.adobe.com/tiff/1.0/">'
        f"{properties}</rdf:Description></rdf:RDF></x:xmpmeta>"
    )


def as_apex(picture, path, name):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x9201: IFDRational(*APEX[name]), 0x9202: IFDRational(2, 1)})
    picture.save(path, quality=95, exif=exif.tobytes())


def as_xmp(properties, picture, path, name):
    above, below = APEX[name]
    us = {"long": 16000, "mid": 2000, "short": 250}[name]
    said = xmp(properties.format(us=us, above=above, below=below))
    chunks = PngInfo()
    chunks.add_itxt("XML:com.adobe.xmp", said)
    how = {"pnginfo": chunks} if path.suffix == ".png" else {"xmp": said.encode(), "quality": 95}
    picture.save(path, **how)


WAYS = {
    "apex": as_apex,
    "xmp time": functools.partial(
        as_xmp,
        "<exif:ExposureTime>{us}/1000000</exif:ExposureTime><exif:ISOSpeedRatings><rdf:Seq>"
        "<rdf:li>100</rdf:li></rdf:Seq></exif:ISOSpeedRatings>",
    ),
    "xmp apex": functools.partial(
        as_xmp, "<exif:ShutterSpeedValue>{above}/{below}</exif:ShutterSpeedValue>"
    ),
}


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("way", WAYS)
def test_exposures_come_from_apex_values_and_xmp(tmp_path, suffix, way):
    files = [tmp_path / f"{index}{suffix}" for index in range(3)]
    for name, path in zip(APEX, files, strict=True):
        WAYS[way](Image.open(FILES / f"jpeg/b_{name}.jpg"), path, name)
    read, _ = estimate(*files)
    typed, _ = estimate(*files, exposures_us=[16000, 2000, 250])
    assert sh0(read) == pytest.approx(sh0(typed), rel=2e-3)
    assert read.exposure_count == 3
    if suffix == ".jpg":
        alone, _ = daemon.estimate_once([f"--source=file:{tmp_path}", "--preset=accurate"])
        assert sh0(alone) == pytest.approx(sh0(typed), rel=2e-3)


@pytest.mark.parametrize("properties", ["<exif:ExposureBiasValue>1/3</exif:ExposureBiasValue>",
                                        "<exif:ExposureTime>0/1</exif:ExposureTime>"])  # fmt: skip
def test_a_compensation_or_no_time_is_no_exposure(tmp_path, properties):
    files = [tmp_path / f"{index}.jpg" for index in range(3)]
    for name, path in zip(APEX, files, strict=True):
        as_xmp(properties, Image.open(FILES / f"jpeg/b_{name}.jpg"), path, name)
    with pytest.raises(LightprobeError, match=r"not all say .* how they were exposed"):
        estimate(*files)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_an_orientation_in_xmp_is_told(tmp_path, suffix):
    file = tmp_path / f"x{suffix}"
    as_xmp(
        "<tiff:Orientation>6</tiff:Orientation>", Image.open(FILES / "jpeg/plain.jpg"), file, "mid"
    )
    _, notes = estimate(file, exposures_us=[2000])
    assert any("rientation 6 is not obeyed" in note for note in notes)


def test_a_bracket_whose_pictures_do_not_all_say_it_needs_exposures(tmp_path):
    with_exif(FILES / "jpeg/b_long.jpg", tmp_path / "a.jpg", 0.016)
    with pytest.raises(
        LightprobeError, match="not all say in their Exif or XMP how they were exposed"
    ):
        estimate(tmp_path / "a.jpg", FILES / "jpeg/b_mid.jpg")


def clear(picture, kind):
    """Save a uniform grey picture (height, width) that is black and transparent where it is 0."""
    kind, _, suffix = kind.partition(".")
    path = picture.path.with_suffix(f".{suffix}")
    grey = picture.pixels
    rgb, alpha = np.repeat(grey[..., None], 3, axis=2), np.where(grey == 0, 0, 255)[..., None]
    rgba = np.concatenate([rgb, alpha], axis=2).astype(np.uint8)
    if kind == "rgba":
        Image.fromarray(rgba).save(path)
    elif kind == "rgba16":
        cv2.imwrite(str(path), rgba.astype(np.uint16) * 257)
    elif kind == "la":
        Image.fromarray(rgba).convert("LA").save(path)
    elif kind == "palette":
        indexed = Image.fromarray((grey == 0).astype(np.uint8)).convert("P")
        indexed.putpalette([CODE] * 3 + [0] * 3)
        indexed.save(path, transparency=1)
    elif kind == "key":
        Image.fromarray(rgb).save(path, transparency=(0, 0, 0))
    elif kind == "key of grey":
        Image.fromarray(grey).save(path, transparency=0)
    elif kind == "key of 16":
        Image.fromarray(grey.astype(np.uint16) * 257).save(path, transparency=0)
    return path


class Picture:
    """A uniform picture with a hole."""

    def __init__(self, path, width_px, height_px, hole):
        self.path = path
        self.pixels = np.full((height_px, width_px), CODE, np.uint8)
        self.pixels[hole] = 0


HOLES = {
    "nadir": np.s_[90:],
    "a hole": np.s_[40:61, 101:134],
    "across the seam": np.s_[10:20, ::64],
    "left half": np.s_[:, :128],
}


@pytest.mark.parametrize("hole", HOLES)
def test_transparent_pixels_are_not_seen(tmp_path, hole):
    """Not black: what is seen is uniform, and so is the light."""
    file = clear(Picture(tmp_path / "x", 256, 128, HOLES[hole]), "rgba.png")
    found, notes = estimate(file)
    assert sh0(found) == pytest.approx(sh0_of_code(CODE), rel=0.005)
    assert "PARTIAL_VIEW" in flag_names(found.flags)
    assert any("transparent pixels are not seen" in note for note in notes)


@pytest.mark.parametrize(
    "kind",
    ["rgba.tif", "rgba16.png", "rgba16.tif", "la.png", "la.tif", "palette.png", "key.png",
     "key of grey.png", "key of 16.png"],
)  # fmt: skip
def test_every_kind_of_transparency_is_known(tmp_path, kind):
    found, _ = estimate(clear(Picture(tmp_path / "x", 256, 128, HOLES["a hole"]), kind))
    assert sh0(found) == pytest.approx(sh0_of_code(CODE), rel=0.005)
    assert "PARTIAL_VIEW" in flag_names(found.flags)


@pytest.mark.parametrize("hole", HOLES)
@pytest.mark.parametrize("how", ["alpha", "window"])
def test_what_an_exr_does_not_show_is_not_seen(tmp_path, hole, how):
    """Neither what is black and transparent, nor what lies outside of the data window."""
    height, width = 128, 256
    shown = np.ones((height, width), bool)
    shown[HOLES[hole]] = False
    file, header = tmp_path / "x.exr", {"displayWindow": ((0, 0), (width - 1, height - 1))}
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    window = (columns[0], rows[0]), (columns[-1], rows[-1])
    if how == "window" and shown.sum() == len(rows) * len(columns):
        header["dataWindow"] = window
        shown = shown[window[0][1] : window[1][1] + 1, window[0][0] : window[1][0] + 1]
    pixels = np.where(shown, 0.5, 0).astype(np.float32)
    OpenEXR.File(header, {name: pixels for name in "RGB"} | {"A": shown.astype(np.float32)}).write(
        str(file)
    )
    found, notes = estimate(file)
    assert sh0(found) == pytest.approx(0.5 * np.sqrt(4 * np.pi), rel=0.005)
    assert flag_names(found.flags) == ["PARTIAL_VIEW"]
    assert any("not seen" in note for note in notes)


@pytest.mark.parametrize("masked", [False, True])
def test_transparent_pixels_of_a_lens_are_not_seen(tmp_path, masked):
    """Beside those that the camera file's own mask leaves out, named relative to that file."""
    (tmp_path / "lens").mkdir()
    mask = np.full((256, 256), 255, np.uint8)
    mask[120:140, 120:140] = 0
    cv2.imwrite(str(tmp_path / "lens/own.pgm"), mask)
    lens = tmp_path / "lens/fish.camera"
    lens.write_text(FISHEYE + ("mask = own.pgm\n" if masked else ""))
    picture = Picture(tmp_path / "x", 256, 256, np.s_[60:120, 60:120])
    if masked:
        picture.pixels[120:140, 120:140] = 1  # as good as black, and opaque
    found, _ = estimate(clear(picture, "rgba.png"), camera=str(lens))
    assert sh0(found) == pytest.approx(sh0_of_code(CODE), rel=0.01)


def test_what_is_wholly_transparent_is_refused(tmp_path):
    file = clear(Picture(tmp_path / "x", 256, 128, np.s_[:]), "rgba.png")
    with pytest.raises(LightprobeError, match=r"x\.png: all of its pixels are transparent"):
        estimate(file)


@pytest.mark.parametrize("kind", ["rgb.png", "rgb.tif", "rgba.png", "grey.png", "grey.tif"])
@pytest.mark.parametrize("code", [2345, 25700.4, 65535])
def test_sixteen_bits_have_a_full_scale_and_keep_the_mean(tmp_path, kind, code):
    """At full scale they are clipped; below, light is what all 16 bits say."""
    kind, _, suffix = kind.partition(".")
    shape = {"rgb": (128, 256, 3), "rgba": (128, 256, 4), "grey": (128, 256)}[kind]
    pixels = np.full(shape, int(code), np.uint16)
    if kind == "rgba":
        pixels[..., 3] = 65535
    file = tmp_path / f"x.{suffix}"
    cv2.imwrite(str(file), pixels)
    found, notes = estimate(file)
    assert sh0(found) == pytest.approx(sh0_of_code(int(code), 65535), rel=0.01)
    assert ("CLIPPED" in flag_names(found.flags)) == (code == 65535)
    assert any("16 bits a channel are read as 8" in note for note in notes)


def save(picture, path, **properties):
    """Save a picture with photo sphere metadata."""
    said = " ".join(f'GPano:{name}="{value}"' for name, value in properties.items())
    xmp = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
        f'xmlns:GPano="{GPANO}" {said}/></rdf:RDF></x:xmpmeta>'
    )
    chunks = PngInfo()
    chunks.add_itxt("XML:com.adobe.xmp", xmp)
    told = {"pnginfo": chunks} if path.suffix == ".png" else {"xmp": xmp.encode(), "quality": 95}
    picture.save(path, **told)
    return path


def gpano(path, width_px, height_px, **properties):
    """A uniform photo with photo sphere metadata."""
    picture = Image.fromarray(np.full((height_px, width_px, 3), CODE, np.uint8))
    return save(picture, path, **properties)


def crop(left, top, width, height, full=4096):
    return {
        "FullPanoWidthPixels": full, "FullPanoHeightPixels": full // 2,
        "CroppedAreaLeftPixels": left, "CroppedAreaTopPixels": top,
        "CroppedAreaImageWidthPixels": width, "CroppedAreaImageHeightPixels": height,
    }  # fmt: skip


UNUSABLE = {
    "cylinder": {"ProjectionType": "cylindrical"},
    "cut": {"FullPanoWidthPixels": 4096},
    "beyond": crop(0, 1024, 2048, 2048),
    "wider than the whole": crop(0, 0, 5000, 2048),
}


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("what", UNUSABLE)
def test_parts_that_cannot_be_used_are_refused_by_name(tmp_path, what, suffix):
    file = gpano(tmp_path / f"x{suffix}", 256, 128, **UNUSABLE[what])
    with pytest.raises(LightprobeError, match=rf"x{suffix}: GPano: "):
        estimate(file)
    if suffix == ".jpg":
        with pytest.raises(LightprobeError, match="its GPano metadata name a projection"):
            daemon.estimate_once([f"--source=file:{file}"])


@pytest.mark.parametrize("kind", ["fisheye", "part"])
def test_a_picture_of_another_shape_than_its_camera_s_is_refused(tmp_path, kind):
    """It is another part of the lens, and nobody knows which."""
    camera = tmp_path / "x.camera"
    camera.write_text(FISHEYE if kind == "fisheye" else CROP)
    file = gpano(tmp_path / "x.jpg", 320, 128)
    with pytest.raises(LightprobeError, match="a picture of 320x128, but the camera file is for "):
        daemon.estimate_once([f"--source=file:{file}", f"--camera={camera}"])


def test_a_camera_file_counts_more_than_the_photo(tmp_path):
    """A fisheye's picture may say what it likes; so may one of a camera file with a [crop]."""
    lens, part = tmp_path / "fish.camera", tmp_path / "part.camera"
    lens.write_text(FISHEYE)
    file = gpano(tmp_path / "x.jpg", 256, 256, **UNUSABLE["cylinder"])
    found, _ = estimate(file, camera=str(lens))
    assert sh0(found) == pytest.approx(sh0_of_code(CODE), rel=0.01)
    part.write_text(CROP)
    found, _ = estimate(file, camera=str(part))
    assert sh0(found) == pytest.approx(sh0_of_code(CODE), rel=0.005)
    assert "PARTIAL_VIEW" in flag_names(found.flags)


def test_a_turned_whole_is_turned(tmp_path):
    """All columns, but the left edge is elsewhere: the lamp is where the metadata say."""
    stored = image.read_srgb8(FILES / "jpeg/plain.jpg")
    width = stored.shape[1]
    plain, _ = estimate(FILES / "jpeg/plain.jpg", exposures_us=[2000])
    turned = Image.fromarray(np.ascontiguousarray(np.roll(stored, -width // 4, axis=1)))
    save(turned, tmp_path / "x.jpg", **crop(1024, 0, 4096, 2048))
    found, _ = estimate(tmp_path / "x.jpg", exposures_us=[2000])
    assert found.lights[0].azimuth_deg == pytest.approx(plain.lights[0].azimuth_deg, abs=0.5)
    assert sh0(found) == pytest.approx(sh0(plain), rel=0.01)


def test_transparency_within_a_part(tmp_path):
    """Half of the width and of the height, across the seam, and the right of it transparent."""
    file = clear(Picture(tmp_path / "x", 256, 128, np.s_[:, 200:]), "rgba.png")
    save(Image.open(file), file, **crop(3072, 512, 2048, 1024))
    seen, _ = estimate(file)
    assert sh0(seen) == pytest.approx(sh0_of_code(CODE), rel=0.005)
    assert "PARTIAL_VIEW" in flag_names(seen.flags)


def test_codes_that_are_no_srgb_are_refused_unless_a_camera_file_says_what_they_are(tmp_path):
    grey = np.full((128, 256, 3), CODE, np.uint8)
    data = cv2.imencode(".png", grey)[1].tobytes()
    gamma = b"gAMA" + (100000).to_bytes(4, "big")
    chunk = (4).to_bytes(4, "big") + gamma + zlib.crc32(gamma).to_bytes(4, "big")
    file = tmp_path / "x.png"
    file.write_bytes(data[:33] + chunk + data[33:])
    with pytest.raises(LightprobeError, match=r"x\.png: gAMA 1: expected sRGB: convert it"):
        estimate(file)
    np.savetxt(tmp_path / "linear.txt", np.repeat(np.arange(256)[:, None] / 255, 3, axis=1))
    camera = tmp_path / "linear.camera"
    camera.write_text("[camera]\nprojection = equirect\n[response]\ntable = linear.txt\n")
    found, _ = estimate(file, camera=str(camera))
    assert sh0(found) == pytest.approx(np.sqrt(4 * np.pi) * CODE / 255, rel=0.01)
