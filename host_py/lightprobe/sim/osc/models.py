"""What each THETA model offers, as RICOH publishes it (github.com/ricohapi/theta-api-specs)."""

from __future__ import annotations

from dataclasses import dataclass, replace

#: Shutter speeds in seconds, with the digits that the cameras print (options/shutter_speed.md).
_STILL_S = (
    0.00004, 0.00005, 0.0000625, 0.00007812, 0.00008, 0.0001, 0.000125, 0.00015625, 0.0002,
    0.00025, 0.0003125, 0.0004, 0.0005, 0.000625, 0.0008, 0.001, 0.00125, 0.0015625, 0.002, 0.0025,
    0.003125, 0.004, 0.005, 0.00625, 0.008, 0.01, 0.0125, 0.01666666, 0.02, 0.025, 0.03333333,
    0.04, 0.05, 0.06666666, 0.07692307, 0.1, 0.125, 0.16666666, 0.2, 0.25, 0.33333333, 0.4, 0.5,
    0.625, 0.76923076, 1, 1.3, 1.6, 2, 2.5, 3.2, 4, 5, 6, 8, 10, 13, 15, 20, 25, 30, 40, 50, 60,
)  # fmt: skip
_LONGEST_VIDEO_S = 0.034
_ISO = (50, 64, 80, 100, 125, 160, 200, 250, 320, 400, 500, 640, 800, 1000, 1250, 1600,
        2000, 2500, 3200, 4000, 5000, 6400)  # fmt: skip

#: Width and height in pixels, frames a second.
Format = tuple[int, int, int]


@dataclass(frozen=True)
class Model:
    """One model with one firmware."""

    name: str
    firmware: str
    formats: tuple[Format, ...]  # options/preview_format.md
    fastest_s: float
    iso: tuple[int, ...]
    not_s: tuple[float, ...] = ()  # shutter speeds that this model leaves out
    manufacturer: str = "RICOH"
    has_video: bool = True  # manual exposure, and live preview, in the movie mode
    has_camera_mode: bool = False
    reports_temperature: bool = True
    filters: tuple[str, ...] = ()  # options/_filter.md; beside "off", in the mode for stills
    #: options/_top_bottom_correction.md: in which modes it can be set; none: it has no such option.
    corrects_in: tuple[str, ...] = ()

    def shutter_speeds_s(self, mode: str) -> list[float]:
        """Give those for manual exposure in the mode "image" or "video", shortest first."""
        longest = _LONGEST_VIDEO_S if mode == "video" else max(_STILL_S)
        return [s for s in _STILL_S if self.fastest_s <= s <= longest and s not in self.not_s]


def _iso(low: int, high: int) -> tuple[int, ...]:
    return tuple(iso for iso in _ISO if low <= iso <= high)


MODELS = {
    "x": Model(
        "RICOH THETA X", "2.71.1",
        ((3840, 1920, 30), (1920, 960, 30), (1024, 512, 30), (512, 512, 30)),
        1 / 16000, _iso(50, 3200), not_s=(0.00008,), has_camera_mode=True,
        filters=("Noise Reduction", "hdr", "Hh hdr"), corrects_in=("image", "video"),
    ),
    "z1": Model(
        "RICOH THETA Z1", "3.20.1",
        ((1920, 960, 8), (1024, 512, 30), (1024, 512, 8), (640, 320, 30), (640, 320, 8)),
        1 / 25000, _iso(80, 6400), not_s=(0.00007812,),
        filters=("DR Comp", "Noise Reduction", "hdr", "Hh hdr"), corrects_in=("image",),
    ),
    "v": Model(
        "RICOH THETA V", "3.82.1",
        ((1920, 960, 8), (1024, 512, 30), (1024, 512, 8), (640, 320, 30), (640, 320, 8)),
        1 / 25000, _iso(64, 3200), not_s=(0.00007812,), reports_temperature=False,
        filters=("DR Comp", "Noise Reduction", "hdr", "Hh hdr"), corrects_in=("image",),
    ),
    "sc": Model(
        "RICOH THETA SC", "1.20", ((640, 320, 10),), 1 / 8000, _iso(100, 1600),
        not_s=(0.00007812, 0.00008, 40, 50), has_video=False, reports_temperature=False,
        filters=("DR Comp", "Noise Reduction", "hdr"),
    ),
}  # fmt: skip


def old(model: Model) -> Model:
    """Give the model with its first firmware: smaller previews, automatic exposure in movies."""
    formats = tuple(f for f in model.formats if f[0] <= 1024 and f[2] <= 30)
    return replace(model, firmware="1.00.1", formats=formats, reports_temperature=False)


def of_another_make() -> Model:
    """Give a camera that follows OSC and has no live preview, as those of other makes."""
    return Model(
        "Insta360 X4", "1.1.6", (), 1 / 8000, _iso(100, 3200),
        manufacturer="Arashi Vision", has_video=False,
    )  # fmt: skip
