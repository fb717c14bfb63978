"""A simulated THETA: its commands, its modes, its moods, and the pictures of its live preview."""

from __future__ import annotations

import functools
import hashlib
import json
import math
import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

import numpy as np

from lightprobe.errors import UsageError
from lightprobe.geometry import Array, equirect_solid_angles
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.faults import spoil
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.link import Exposure, account
from lightprobe.sim.osc import models
from lightprobe.sim.osc.faults import OscFaults
from lightprobe.sim.osc.options import (
    MANUAL,
    NEVER,
    PROCESSING,
    Options,
    RefusedError,
    Values,
)
from lightprobe.sim.osc.white_balance import Factors, automatic, factors_of
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing
from lightprobe.sim.sensor import SensorModel
from lightprobe.sim.world import World

#: Makes a camera of a size and rate.
Optics = Callable[[tuple[int, int], float], SimulatedCamera]

_PICTURE_S = 1.0  # a still takes so long
_MODE_S = 1.5  # and so long a change of mode, while commands are refused
_AFTER_OPTIONS_S = 1.0  # commands/camera.set_options.md: what to leave before a live preview
_MOST_LATE_S = 0.5  # frames that this machine is later with are left out
_PREVIEW_PX = (256, 128)

#: Its list of shutter speeds is what limits it.
_ANY_EXPOSURE = ExposureLimits(least_us=1, most_us=60e6, step_us=0)


class OscCamera:
    """Everything but HTTP. All methods may be called from any thread."""

    def __init__(
        self,
        world: World,
        model: str = "x",
        *,
        faults: OscFaults | None = None,
        delay_frames: int = 4,
        seed: int = 0,
        quality: int = 85,
        chroma: str = "420",
        sensor: SensorModel | None = None,
        response: Array | None = None,
        truth: TextIO | None = None,
        kept: int = 0,
        processing: Processing | None = None,
        lens_defects: LensDefects | None = None,
        pixels: PixelDefects | None = None,
    ) -> None:
        """`model`: a key of models.MODELS. `truth` gets one JSON line per frame. `kept`: pictures
        that are repeated while nothing changes, as :class:`SimulatedCamera` has it; `processing`
        `lens_defects` and `pixels` too."""
        self.world, self.faults = world, faults or OscFaults()
        self.model = models.MODELS[model]
        if self.faults.old_firmware:
            self.model = models.old(self.model)
        if self.faults.other_make:
            self.model = models.of_another_make()
        self.serial = "YN10100001"
        self.options = Options(self.model, self.faults.sleep_s)
        self.frames = 0  # sent so far
        self.commands = 0
        self._optics: Optics = functools.cache(self._make)
        self._about = {"quality": quality, "chroma": chroma, "seed": seed, "model": sensor,
                       "response": response, "kept": kept, "processing": processing,
                       "lens_defects": lens_defects, "pixels": pixels}  # fmt: skip
        self._delay_frames, self._truth = delay_frames, truth
        self._chance = random.Random(seed)
        self._lock = threading.RLock()
        self._command = threading.Lock()
        self._start_ns = time.monotonic_ns()
        self._operated_s = self._changed_s = self._busy_until_s = -math.inf
        self._stream = 0  # number of the live preview that runs
        self._exposure: Exposure | None = None  # of that preview
        self._taking: dict[str, float] = {}  # when each still is done, by its command
        self.files: dict[str, bytes] = {}
        self._network_lost_s: float | None = None
        self._size_changed = False
        self.operate()

    def _make(self, size_px: tuple[int, int], rate_hz: float) -> SimulatedCamera:
        return SimulatedCamera(
            self.world, lenses.load("equirect"), size_px, rate_hz=rate_hz, limits=_ANY_EXPOSURE,
            **self._about,  # type: ignore[arg-type]
        )  # fmt: skip

    def prepare(self, size_px: tuple[int, int], rate_hz: float) -> None:
        """Draw the world for a preview already now: a real camera does not need that time."""
        camera = self._optics(size_px, rate_hz)
        camera.frame(0, camera.automatic(0)[0])

    # What the network and the power say.

    def is_asleep(self) -> bool:
        """Tell whether it has switched its network off, because nobody operated it."""
        delay_s = float(self.options.get("sleepDelay"))
        return delay_s != NEVER and time.monotonic() - self._operated_s > delay_s

    def operate(self) -> None:
        """Wake it up, or keep it awake: a command, or a finger on its button."""
        self._operated_s = time.monotonic()

    def network_is_lost(self) -> bool:
        """Tell whether nothing gets through, and nobody is told so."""
        with self._lock:
            lost_s = self._network_lost_s
            if lost_s is None:
                return False
            if self.faults.network_s and time.monotonic() - lost_s > self.faults.network_s:
                self._network_lost_s = None
                return False
            return True

    # What it answers.

    def info(self) -> Values:
        """GET /osc/info."""
        m = self.model
        return {
            "manufacturer": m.manufacturer, "model": m.name, "serialNumber": self.serial,
            "firmwareVersion": m.firmware, "supportUrl": "https://theta360.com/en/support/",
            "gps": True, "gyro": True, "uptime": int((time.monotonic_ns() - self._start_ns) / 1e9),
            "api": ["/osc/info", "/osc/state", "/osc/checkForUpdates", "/osc/commands/execute",
                    "/osc/commands/status"],
            "endpoints": {"httpPort": 80, "httpUpdatesPort": 80}, "apiLevel": [2],
        }  # fmt: skip

    def state(self) -> Values:
        """POST /osc/state."""
        f, busy = self.faults, bool(self._unfinished())
        state: Values = {
            "_batteryState": "charging" if f.charging else "disconnect",
            "_captureStatus": "shooting" if busy else "idle", "_apiVersion": 2,
            "_cameraError": ["HIGH_TEMPERATURE"] if f.hot else [],
            "_latestFileUrl": list(self.files)[-1] if self.files else "",
        }  # fmt: skip
        if not math.isnan(f.battery):
            state["batteryLevel"] = f.battery
        if self.model.reports_temperature:
            state |= {"_boardTemp": round(f.temperature_c), "_batteryTemp": 30}
        digest = hashlib.md5(json.dumps(state).encode()).hexdigest()
        return {"fingerprint": f"FIG_{digest[:8]}", "state": state}

    def execute(self, name: str, parameters: Values) -> Values:
        """Carry out a command but the live preview; give the answer. Raises RefusedError."""
        with self._one_command():
            self._answer_late()
            if name == "camera.getOptions":
                names = parameters.get("optionNames")
                if not isinstance(names, list):
                    raise RefusedError("missingParameter", "optionNames is missing")
                return _done(name, {"options": {key: self.options.get(key) for key in names}})
            if name == "camera.setOptions":
                if not isinstance(parameters.get("options"), dict):
                    raise RefusedError("missingParameter", "options is missing")
                self._set_options(parameters["options"])
                return _done(name)
            if name == "camera.takePicture":
                return self._take_picture()
            if name == "camera.reset":
                with self._lock:
                    self.end_preview()
                    self.options.reset()
                return _done(name)
            raise RefusedError("unknownCommand", f"{name}: is not known")

    def status(self, command_id: str) -> Values:
        """POST /osc/commands/status; raises :class:`RefusedError`."""
        name = "camera.takePicture"
        if command_id not in self._taking:
            raise RefusedError("invalidParameterValue", f"id {command_id}: no such command")
        if command_id in self._unfinished():
            return {"name": name, "state": "inProgress", "id": command_id,
                    "progress": {"completion": 0.5}}  # fmt: skip
        return _done(name, {"fileUrl": f"/files/{command_id}.JPG"})

    def begin_preview(self) -> Iterator[bytes]:
        """Start the live preview; gives its pictures until it ends. Raises RefusedError."""
        with self._one_command():
            self._answer_late()
            f = self.faults
            if f.other_make or not self.model.formats:
                raise RefusedError("unknownCommand", "camera.getLivePreview: is not known")
            if f.charging or f.hot or self.options.get("captureMode") == "_liveStreaming":
                raise RefusedError("disabledCommand", "the camera's state does not allow it")
            if self.model.has_camera_mode and self.options.get("_cameraMode") != "capture":
                raise RefusedError("disabledCommand", "the camera shows another screen")
            if self.options.mode == "video" and not self.model.has_video:
                raise RefusedError("disabledCommand", "no live preview in the movie mode")
            if time.monotonic() - self._changed_s < _AFTER_OPTIONS_S or self._unfinished():
                raise RefusedError("serviceUnavailable", "options have just been set: try again")
            with self._lock:
                self._stream += 1
                return self._preview(self._stream)

    # What happens to it.

    def end_preview(self) -> None:
        """End the live preview, as operating the camera does."""
        with self._lock:
            self._stream += 1

    def press(self, button: str) -> None:
        """Somebody operates the camera: "shutter", "mode", "playback" or "capture"; UsageError."""
        self.operate()
        with self._lock:
            if button == "shutter":
                self._take_picture()
            elif button == "mode":
                self._change_mode("video" if self.options.mode == "image" else "image")
            elif button in ("playback", "capture") and self.model.has_camera_mode:
                self.end_preview()
                self.options.force("_cameraMode", button)
            else:
                raise UsageError(
                    f"simulate: osc {button}: expected shutter, mode, playback or capture"
                )

    def misbehave(self, query: str) -> None:
        """Misbehave from now on; raises UsageError."""
        with self._lock:
            self.faults = self.faults.merged(query)
            self._network_lost_s = None
            if self.faults.hot or self.faults.charging:
                self.end_preview()
            if self.faults.playback:
                self.press("playback")

    # Commands, inside.

    @contextmanager
    def _one_command(self) -> Iterator[None]:
        busy = self._chance.random() < self.faults.busy or time.monotonic() < self._busy_until_s
        if busy or not self._command.acquire(blocking=False):
            raise RefusedError("serviceUnavailable", "another command is under way: try again")
        try:
            self.commands += 1
            self.operate()
            yield
        finally:
            self._command.release()

    def _answer_late(self) -> None:
        if self.faults.slow_ms:
            time.sleep(1e-3 * self.faults.slow_ms * self._chance.random())

    def _set_options(self, changes: Values) -> None:
        with self._lock:
            f = self.faults
            if f.refuse_processing and PROCESSING.keys() & changes.keys():
                raise RefusedError("invalidParameterValue", "image processing: cannot be changed")
            if f.keep_processing:
                changes = {k: v for k, v in changes.items() if k not in PROCESSING}
            mode, form = self.options.mode, changes.get("previewFormat")
            self.options.set({k: v for k, v in changes.items() if k != "captureMode"})
            if changes.get("captureMode", mode) != mode:
                self.options.set({"captureMode": changes["captureMode"]})
                self._change_mode(changes["captureMode"])
            elif form is not None:
                self.end_preview()
            self._changed_s = time.monotonic()
            if self._exposure is not None:
                f = self.faults
                late = self._chance.randint(0, f.delay_jitter_frames) + (
                    self._delay_frames if f.delay_frames < 0 else f.delay_frames
                )
                if not f.ignore_exposure:
                    self._exposure.command(self._shot(), self._frame_now() + 1, late)
                self._exposure.camera.white_balance = self._white_balance()

    def _change_mode(self, mode: str) -> None:
        self.end_preview()
        self.options.force("captureMode", mode)
        self._busy_until_s = time.monotonic() + _MODE_S

    def _take_picture(self) -> Values:
        with self._lock:
            self.end_preview()
            number = f"R{len(self._taking) + 1:07d}"
            form = self.model.formats[-1] if self.model.formats else (512, 256, 30)
            camera = self._optics(form[:2], float(form[2]))
            shot = self._shot() or camera.automatic(self._frame_now())[0]
            self.files[f"/files/{number}.JPG"] = camera.frame(self._frame_now(), shot)
            self._taking[number] = time.monotonic() + _PICTURE_S
        return {"name": "camera.takePicture", "state": "inProgress", "id": number,
                "progress": {"completion": 0.0}}  # fmt: skip

    def _unfinished(self) -> list[str]:
        now_s = time.monotonic()
        return [name for name, done_s in self._taking.items() if done_s > now_s]

    # Pictures, inside.

    def _shot(self) -> Shot | None:
        """Exposure that the options say; None: automatic. No longer than a frame lasts."""
        get = self.options.get
        if get("exposureProgram") != MANUAL:
            return None
        longest_s = 1 / get("previewFormat")["framerate"]
        return Shot(1e6 * min(get("shutterSpeed"), longest_s), get("iso") / self.model.iso[0])

    def _white_balance(self) -> Factors:
        kind = self.options.get("whiteBalance")
        if kind == "_colorTemperature":
            return factors_of(self.options.get("_colorTemperature"))
        if kind != "auto":
            return factors_of(5500)
        state = self.world.at(self._elapsed_s())
        radiance = state.scene.render(*_PREVIEW_PX).compose(state.powers)
        weight = equirect_solid_angles(*_PREVIEW_PX)[:, None, None]
        return automatic(np.mean(np.minimum(radiance, 1e3) * weight, axis=(0, 1)))

    def _elapsed_s(self) -> float:
        return (time.monotonic_ns() - self._start_ns) / 1e9

    def _frame_now(self) -> int:
        rate_hz = self.options.get("previewFormat")["framerate"] if self.model.formats else 30
        return math.floor(self._elapsed_s() * rate_hz)

    def _lose_network(self) -> None:
        with self._lock:
            if self._network_lost_s is None:
                self._network_lost_s = time.monotonic()

    def _preview(self, stream: int) -> Iterator[bytes]:
        form = self.options.get("previewFormat")
        size_px, rate_hz = (form["width"], form["height"]), float(form["framerate"])
        camera = self._optics(size_px, rate_hz)
        with self._lock:
            self._exposure = exposure = Exposure(camera, fixed=self._shot())
            camera.white_balance = self._white_balance()
        sent, next_frame, last_s, silent_s = 0, self._frame_now() + 1, 0.0, 0.0
        while True:
            f = self.faults
            if stream != self._stream or self.is_asleep() or (f.end_after and sent >= f.end_after):
                return
            if f.size_after and sent >= f.size_after and not self._size_changed:
                self._size_changed = True
                camera = self._optics((size_px[0] // 2, size_px[1] // 2), rate_hz)
                camera.white_balance = exposure.camera.white_balance
                exposure.camera = camera
            frame = max(next_frame, self._frame_now() - math.ceil(rate_hz * _MOST_LATE_S))
            next_frame = frame + 1
            shot = exposure.shot(frame)
            chance = np.random.default_rng([camera.sensor.seed, frame])
            picture = camera.frame(frame, shot)
            late_s = 1e-3 * (f.late_ms + f.jitter_ms * chance.random())
            due_s = max((frame + 1) / rate_hz + late_s, last_s)
            if f.burst_ms and due_s % 1 < 1e-3 * f.burst_ms:
                due_s = math.floor(due_s) + 1e-3 * f.burst_ms
            time.sleep(max(due_s - self._elapsed_s(), 0))
            last_s = due_s
            if f.stall_after and sent >= f.stall_after:
                silent_s = silent_s or self._elapsed_s()
                if not f.stall_s or self._elapsed_s() - silent_s < f.stall_s:
                    continue
                sent, silent_s = 0, 0.0
            if chance.random() < f.drop:
                continue
            self._log_truth(camera, frame, shot)
            yield spoil(picture, f, chance)
            sent += 1
            self.frames += 1
            if f.network_after and sent >= f.network_after:
                self._lose_network()

    def _log_truth(self, camera: SimulatedCamera, frame: int, shot: Shot) -> None:
        if self._truth is not None:
            start_ns = self._start_ns + round(1e9 * frame / camera.rate_hz)
            self._truth.write(json.dumps(account(camera, frame, shot, start_ns)) + "\n")
            self._truth.flush()


def _done(name: str, results: Values | None = None) -> Values:
    answer: Values = {"name": name, "state": "done"}
    return answer if results is None else answer | {"results": results}
