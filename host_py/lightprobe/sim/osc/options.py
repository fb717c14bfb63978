"""The options of a simulated THETA: what may be asked and set, separately for each mode."""

from __future__ import annotations

from typing import Any, ClassVar

from lightprobe.sim.osc.models import Model

Values = dict[str, Any]

MANUAL, NORMAL, SHUTTER_PRIORITY, ISO_PRIORITY = 1, 2, 4, 9
NEVER = 65535  # of sleepDelay and offDelay
DEFAULT_SLEEP_S = 180
#: Kept apart for stills and movies (options/exposure_program.md and others).
_PER_MODE = ("exposureProgram", "shutterSpeed", "iso", "whiteBalance", "_colorTemperature",
             "exposureCompensation")  # fmt: skip
_WHITE_BALANCES = (
    "auto", "daylight", "shade", "cloudy-daylight", "incandescent", "_warmWhiteFluorescent",
    "_dayLightFluorescent", "_dayWhiteFluorescent", "fluorescent", "_bulbFluorescent",
    "_colorTemperature",
)  # fmt: skip


#: What the camera does to its pictures, and the values of it that do nothing.
PROCESSING = {"_filter": "off", "_topBottomCorrection": "Disapply"}
_CORRECTIONS = ("Apply", "ApplyAuto", "ApplySave", "ApplyLoad", "Disapply")


class RefusedError(Exception):
    """A command is refused, with one of the published codes (protocols/errors.md)."""

    STATUS: ClassVar = {"unknownCommand": 400, "disabledCommand": 403, "missingParameter": 400,
              "invalidParameterName": 400, "invalidParameterValue": 400, "notFound": 404,
              "serviceUnavailable": 503, "unexpected": 503}  # fmt: skip

    def __init__(self, code: str, message: str) -> None:
        """`code`: one of those in STATUS."""
        super().__init__(message)
        self.code = code


class Options:
    """Values by their names."""

    def __init__(self, model: Model, sleep_s: float) -> None:
        """`sleep_s`: sleepDelay at first; 0: the camera's own."""
        self.model = model
        self._first_sleep_s = sleep_s or DEFAULT_SLEEP_S
        self.reset()

    def reset(self) -> None:
        """Everything as it left the factory."""
        automatic = {"exposureProgram": NORMAL, "shutterSpeed": 0, "iso": 0, "whiteBalance": "auto",
                     "_colorTemperature": 5000, "exposureCompensation": 0.0}  # fmt: skip
        self._by_mode: dict[str, Values] = {"image": dict(automatic), "video": dict(automatic)}
        self._common: Values = {
            "captureMode": "image", "sleepDelay": self._first_sleep_s, "offDelay": 600,
            "clientVersion": 2, "remainingPictures": 1000, "_function": "normal",
        }  # fmt: skip
        if self.model.formats:
            self._common["previewFormat"] = _preview(self.model.formats[-1])
        if self.model.has_camera_mode:
            self._common["_cameraMode"] = "capture"
        if self.model.filters:
            self._common["_filter"] = "off"
        if self.model.corrects_in:
            self._common["_topBottomCorrection"] = "Apply"

    @property
    def mode(self) -> str:
        """Say which mode it is in: "image" or "video"."""
        return str(self._common["captureMode"])

    def get(self, name: str) -> Any:
        """Value of an option, or of NAMESupport; raises :class:`RefusedError`."""
        self._check_mode(name)
        values = self._common | self._by_mode[self.mode]
        if name in values:
            return values[name]
        support = self._support().get(name.removesuffix("Support"))
        if not name.endswith("Support") or support is None:
            raise RefusedError("invalidParameterName", f"{name}: no such option")
        return support

    def set(self, changes: Values) -> None:
        """Set all or none; raises :class:`RefusedError`."""
        before = dict(self._common), {mode: dict(v) for mode, v in self._by_mode.items()}
        try:
            # What decides about the others comes first.
            for name in sorted(changes, key=_order):
                self._set(name, changes[name])
        except RefusedError:
            self._common, self._by_mode = before
            raise

    def _set(self, name: str, value: Any) -> None:
        mine = self._by_mode[self.mode] if name in _PER_MODE else self._common
        if name not in mine:
            raise RefusedError("invalidParameterName", f"{name}: no such option")
        self._check_mode(name)
        if name == "_topBottomCorrection" and self.mode not in self.model.corrects_in:
            raise RefusedError("disabledCommand", f"{name}: cannot be set in the mode {self.mode}")
        if not self._allows(name, value):
            raise RefusedError("invalidParameterValue", f"{name}: {value!r} is not supported")
        if name == "exposureProgram" and self.has_filter:
            value = NORMAL  # "it takes priority over the exposure program"
        if name == "exposureProgram" and value != mine[name]:
            mine["shutterSpeed"] = 0.008 if value in (MANUAL, SHUTTER_PRIORITY) else 0
            mine["iso"] = self.model.iso[0] if value in (MANUAL, ISO_PRIORITY) else 0
        mine[name] = value
        if name == "_filter" and self.has_filter:
            self._set("exposureProgram", NORMAL)

    @property
    def has_filter(self) -> bool:
        """True while an image filter is on, which works for stills alone."""
        return self.mode == "image" and self._common.get("_filter", "off") != "off"

    def _check_mode(self, name: str) -> None:
        """Refuse what is known in the mode for stills alone ("Access during video capture")."""
        if name.removesuffix("Support") == "_filter" and self.mode == "video":
            raise RefusedError("disabledCommand", f"{name}: not in the movie mode")

    def _allows(self, name: str, value: Any) -> bool:
        if isinstance(value, bool):
            return False
        if name in ("sleepDelay", "offDelay"):
            least = 60 if name == "sleepDelay" else 600
            off = name == "offDelay" and value == 0
            return isinstance(value, int) and (off or least <= value <= NEVER)
        if name == "_colorTemperature":
            return isinstance(value, int) and 2500 <= value <= 10000 and value % 100 == 0
        if name == "previewFormat":
            known = [_preview(f) for f in self.model.formats]
            return value in known
        support = self._support().get(name)
        if support is None:
            raise RefusedError("invalidParameterName", f"{name}: cannot be set")
        return value in support

    def _support(self) -> dict[str, Any]:
        """What may be set, by the mode and the exposure program in force."""
        model, mode = self.model, self.mode
        program = self._by_mode[mode]["exposureProgram"]
        modes = ["image", "video"] if model.has_video else ["image"]
        programs = [MANUAL, NORMAL, SHUTTER_PRIORITY, ISO_PRIORITY]
        if mode == "video" and model.firmware == "1.00.1":
            programs = [NORMAL]
        known: dict[str, Any] = {
            "captureMode": modes,
            "exposureProgram": programs,
            "shutterSpeed": model.shutter_speeds_s(mode)
            if program in (MANUAL, SHUTTER_PRIORITY)
            else [0],
            "iso": list(model.iso) if program in (MANUAL, ISO_PRIORITY) else [0],
            "whiteBalance": list(_WHITE_BALANCES),
            "_colorTemperature": {
                "minTemperature": 2500, "maxTemperature": 10000, "stepSize": 100,
            },
            "exposureCompensation": [-2.0, -1.0, 0.0, 1.0, 2.0],
            "clientVersion": [1, 2],
            "_function": ["normal"],
        }  # fmt: skip
        if model.formats:
            known["previewFormat"] = [_preview(f) for f in model.formats]
        if model.has_camera_mode:
            known["_cameraMode"] = ["capture"]
        if model.filters:
            known["_filter"] = ["off", *model.filters]
        if model.corrects_in:
            known["_topBottomCorrection"] = list(_CORRECTIONS)
        return known

    def force(self, name: str, value: Any) -> None:
        """Set what only the camera's own buttons can."""
        self._common[name] = value


def _order(name: str) -> int:
    """What decides about the others comes first; a filter decides last."""
    first = ("captureMode", "exposureProgram")
    return 0 if name in first else 2 if name == "_filter" else 1


def _preview(form: tuple[int, int, int]) -> dict[str, int]:
    width, height, rate = form
    return {"width": width, "height": height, "framerate": rate}
