"""`lightprobe check-camera`: what does a camera do to its pictures, and is it fit to measure?"""

from __future__ import annotations

import contextlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from lightprobe.calibrate import camera_file
from lightprobe.calibrate.exposure_series import INDEX, ExposureSeries, shoot
from lightprobe.check_camera import balance, exposure, glare, judge, pixels, shade
from lightprobe.check_camera.answers import Answer, Outcome, Verdict, cannot_tell
from lightprobe.check_camera.balance import Colours, Drift
from lightprobe.check_camera.judge import SceneFindings
from lightprobe.check_camera.pixels import ShiningPixels
from lightprobe.cli import calibrate, check, view
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging import camera as cameras

#: Steps that the user does something for, and which may be left out.
STEPS = ("scene", "rest", "colour", "shade", "cover")
_COLOURS = {
    Outcome.FINE: "green", Outcome.DEFECT: "yellow", Outcome.UNFIT: "red",
    Outcome.UNKNOWN: "magenta", Outcome.SKIPPED: "dim",
}  # fmt: skip
_ASK = {
    "scene": "Point the camera at a lit room with bright and dark even surfaces and clear edges. "
    "Keep camera, lamps and people still",
    "rest": "Leave everything as it is, for a minute",
    "colour": "Hold a large, bright red or blue cloth or paper before a third of the view, and "
    "keep it there",
    "shade": "Take that away again, and have the brightest lamp in view (not the sun), and dark "
    "places beside it",
    "hide": "Hide that lamp with a thumb or a small card at arm's length from you, close before "
    "the lens, with the rest of the hand below. Nothing else may move",
    "cover": "Cover the lens with something opaque, such as a cap or black cloth",
}
#: Kept of a long series: pictures a second.
_KEPT_HZ, _COLOUR_S = 1.0, 10.0
_DEVICES = ("v4l2", "libcamera", "osc")


def command(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="v4l2:/dev/video0, sim:PATH, …")],
    output: calibrate.Output = None,
    camera: calibrate.SourceCamera = None,
    plot: Annotated[
        Path | None, check.plot("Draw what the verdict rests on (png, svg, pdf).")
    ] = None,
    skip: Annotated[
        str, typer.Option(metavar="STEP,…", help=f"Leave out steps: of {', '.join(STEPS)}.")
    ] = "",
    frames: Annotated[int, typer.Option(min=8, max=200, help="Frames after each command.")] = 12,
    rest_s: Annotated[
        float,
        typer.Option(callback=check.number(5, 300, "seconds"), help="Seconds of rest to watch."),
    ] = 60.0,
    patience_s: calibrate.Patience = 15.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Check what a camera does to its pictures by itself, and whether it is fit to measure light.

    Guides through some steps, each begun with Enter: a lit room, a minute of rest, something
    coloured before the lens, the brightest lamp hidden, the lens covered. Looks for exposures that
    are not obeyed, local tone mapping, another response, sharpening, noise reduction, a white
    balance that moves, veiling glare, and pixels that shine by themselves. --output writes what
    can be corrected into a camera file. Takes four minutes. The daemon must not be running on the
    same camera. The exit code is 1 for a camera that is unfit, 3 when something could not be told.
    Example: lightprobe check-camera v4l2:/dev/video0 --output my.camera --plot checked.png
    """
    if not calibrate.is_source(source) or source.startswith(("file:", "ptp:")):
        raise UsageError(
            f"check-camera: {source}: expected a live camera, like v4l2:/dev/video0 or sim:PATH"
        )
    session = _Session(
        source, camera or (str(output) if output is not None and output.exists() else "equirect"),
        _steps(skip), frames, rest_s, patience_s,
    )  # fmt: skip
    verdict = session.run()
    if as_json:
        typer.echo(json.dumps(verdict.to_json(), indent=2))
    else:
        show(verdict)
    if plot is not None and session.scene is not None:
        from lightprobe.check_camera import plot as pictures  # matplotlib is slow to load

        pictures.draw(
            verdict, session.scene, session.table, session.drift, session.veil, session.shining,
            plot,
        )  # fmt: skip
        typer.echo(f"plot: {plot}", err=True)
    if output is not None:
        for line in session.write(output, verdict):
            typer.echo(line, err=True)
    raise typer.Exit(verdict.status)


def _steps(skip: str) -> tuple[str, ...]:
    """Steps that are left; UsageError for unknown ones."""
    without = [word.strip() for word in skip.split(",") if word.strip()]
    unknown = [word for word in without if word not in STEPS]
    if unknown:
        raise UsageError(f"check-camera: --skip {unknown[0]}: expected some of {', '.join(STEPS)}")
    return tuple(step for step in STEPS if step not in without)


@dataclass
class _Session:
    """One camera, step by step."""

    source: str
    camera: str
    steps: tuple[str, ...]
    frames: int
    rest_s: float
    patience_s: float
    answers: list[Answer] = field(default_factory=list)
    scene: SceneFindings | None = None
    drift: Drift | None = None
    veil: glare.Veil | None = None
    shining: ShiningPixels | None = None
    before: Colours | None = None  # anything coloured is held before the lens
    size_px: tuple[int, int] = (0, 0)
    rate_hz: float = 30.0
    processing: tuple[str, ...] | None = None
    console: Console = field(default_factory=lambda: Console(stderr=True))

    def __post_init__(self) -> None:
        known = self.known = cameras.load(self.camera)
        self.of_file = known.response is not None
        self.table: Array = known.response_table()

    def run(self) -> Verdict:
        """Go through all steps."""
        settable = self._look()
        self._scene(settable)
        self._balance(settable)
        self._shade(settable)
        self._cover(settable)
        self.answers.append(_processing(self.processing))
        return Verdict(self.source, tuple(self.answers))

    def _look(self) -> bool:
        """Take a few frames as they come: what the camera can do; tells whether it is settable."""
        with self._series((), 8, "first frames") as series:
            first = series.frames[0]
            self.size_px = first.width_px, first.height_px
            times = [frame.t_read_ns for frame in series.frames]
            if len(times) > 1 and times[-1] > times[0]:
                self.rate_hz = min(1e9 * (len(times) - 1) / (times[-1] - times[0]), 120.0)
            self.processing = series.processing
            return series.settable

    def _scene(self, settable: bool) -> None:
        if not self._ready("scene", judge.QUESTIONS):
            return
        if not settable:
            self.answers.append(exposure.not_settable())
            why = "that takes exposures that can be set"
            self.answers += cannot_tell(judge.QUESTIONS[1:], why)
            return
        with self._series(judge.SCENE_US, self.frames, "exposures") as series:
            self.console.print("looking at them …")
            self.scene = judge.judge(series, self.table, self.of_file)
        self.answers += self.scene.answers

    def _balance(self, settable: bool) -> None:
        scene = self.scene
        for step, question in zip(("rest", "colour"), judge.BALANCE, strict=True):
            if step not in self.steps or not settable or scene is None:
                self.answers.append(_skipped(question))
            elif scene.trouble:
                self.answers += cannot_tell((question,), scene.trouble, scene.next_step)
            elif step == "rest":
                self._rest(scene)
            else:
                self._colour(scene)

    def _rest(self, scene: SceneFindings) -> None:
        self.console.print(f"[bold]{_ASK['rest']}[/]")
        best_us = scene.scene.best_us()
        with self._series((best_us,), self._frames(self.rest_s), "rest", thin=True) as series:
            self.before = balance.colours(series, self.table)
        self.drift = balance.drift(self.before)
        self.answers.append(balance.judge_drift(self.drift))

    def _colour(self, scene: SceneFindings) -> None:
        if self.before is None:
            why = "the step rest was left out, to which it is compared"
            self.answers += cannot_tell((balance.ADAPTS,), why)
            return
        if not self._ready("colour", (balance.ADAPTS,)):
            return
        best_us = scene.scene.best_us()
        with self._series((best_us,), self._frames(_COLOUR_S), "colour", thin=True) as series:
            found = balance.adaption(self.before, balance.colours(series, self.table))
        drifts = self.drift.size if self.drift else 0.0
        self.answers.append(balance.judge_adaption(found, drifts))

    def _shade(self, settable: bool) -> None:
        scene, questions = self.scene, (glare.QUESTION,)
        if "shade" not in self.steps or not settable or scene is None:
            self.answers.append(_skipped(glare.QUESTION))
            return
        trouble = scene.trouble or glare.hindrance(scene.answers)
        if trouble:
            self.answers += cannot_tell(questions, trouble, scene.next_step)
            return
        if not self._ready("shade", questions):
            return
        with self._series(shade.SHADE_US, self.frames, "lamp in view") as before:
            if not self._asked("shade", _ASK["hide"], questions):
                return
            with self._series(shade.SHADE_US, self.frames, "lamp hidden") as after:
                table = glare.table_of(scene.answers, scene.power, self.table)
                veil = glare.look(self.known, before, after, table)
                self.veil = None if isinstance(veil, str) else veil
                self.answers.append(glare.judge(veil))

    def _cover(self, settable: bool) -> None:
        if not self._ready("cover", (pixels.QUESTION,)):
            return
        schedule = pixels.SCHEDULE_US if settable else ()
        with self._series(schedule, max(self.frames, 12), "covered") as series:
            self.shining = pixels.find(series)
        self.answers.append(pixels.judge(self.shining))

    def _frames(self, seconds: float) -> int:
        return min(max(round(seconds * self.rate_hz), 12), 10000)

    def _ready(self, step: str, questions: tuple[str, ...]) -> bool:
        """Ask for a step; False: it is left out, and the answers say so."""
        if step not in self.steps:
            self.answers += [_skipped(question) for question in questions]
            return False
        return self._asked(step, _ASK[step], questions)

    def _asked(self, step: str, words: str, questions: tuple[str, ...]) -> bool:
        self.console.print(f"[bold]{words}[/], then press Enter (s and Enter: leave it out).")
        line = sys.stdin.readline()
        if not line:
            why = "nobody pressed Enter: input has ended"
            self.answers += cannot_tell(questions, why, f"--skip {step} in scripts")
            return False
        if line.strip().lower() == "s":
            self.answers += [_skipped(question) for question in questions]
            return False
        return True

    @contextlib.contextmanager
    def _series(
        self, exposures_us: tuple[float, ...], frames: int, what: str, *, thin: bool = False
    ) -> Iterator[ExposureSeries]:
        """A series under a progress bar; its frames last as long as the block."""
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
            folder = Path(name) / "series"
            with Progress(*columns, console=self.console, transient=True) as bar:
                task = bar.add_task(what, total=frames * max(len(exposures_us), 1))
                every = max(round(self.rate_hz / _KEPT_HZ), 1) if thin else 1
                taken = shoot(
                    self.source, folder, exposures_us, frames=frames, camera=self.camera,
                    patience_s=self.patience_s, progress=_progress(bar, task, folder, every),
                )  # fmt: skip
            _thin(folder, every)
            yield taken

    # ------------------------------------------------------------ the camera file

    def write(self, path: Path, verdict: Verdict) -> Iterator[str]:
        """Write what was measured; gives a line for each."""
        delay = next(
            (one.numbers["delay_frames"] for one in verdict.answers
             if one.question == exposure.OBEYS and "delay_frames" in one.numbers), None,
        )  # fmt: skip
        scheme = self.source.partition(":")[0]
        if delay is not None and scheme in (*_DEVICES, "sim"):
            section = scheme if scheme in _DEVICES else "v4l2"
            values: dict[str, str | None] = {"exposure_delay_frames": f"{delay:.0f}"}
            camera_file.save(path, self.size_px, section, values)
            yield f"written: {path}: [{section}] exposure_delay_frames = {delay:.0f}"
        outcomes = {one.question: one.outcome for one in verdict.answers}
        power = self.scene.power if self.scene else None
        if (
            outcomes.get("response") is Outcome.DEFECT
            and not any(outcomes.get(one) in _MOVING for one in judge.BALANCE)
            and power is not None and power.fitted is not None
        ):  # fmt: skip
            residual = 100 * power.fitted.residual_full_scale.max()
            note = calibrate.remark(f"response, residual {residual:.2f} % of full scale")
            table = camera_file.save_response(
                path, self.size_px, power.fitted.table, note, self.processing
            )
            yield f"written: {path}: [response] table = {table.name}"
        veil = next((one.numbers for one in verdict.answers if one.question == glare.QUESTION), {})
        stated = self.known.glare.even + self.known.glare.around > 0
        found = outcomes.get(glare.QUESTION)
        if found is Outcome.DEFECT or (found is Outcome.FINE and stated):
            measured = cameras.Glare(veil["even"], veil["around"], veil["width_deg"])
            camera_file.save_glare(path, self.size_px, measured)
            yield f"written: {path}: [glare] even = {measured.even:.4f}, …"
        if self.shining is not None and outcomes.get(pixels.QUESTION) is Outcome.DEFECT:
            listed = camera_file.save_stuck(path, self.size_px, self.shining.places_px)
            yield f"written: {path}: [camera] stuck_pixels = {listed.name}"


_MOVING = (Outcome.DEFECT, Outcome.UNFIT)


def _skipped(question: str) -> Answer:
    return Answer(question, Outcome.SKIPPED, "left out")


def _processing(names: tuple[str, ...] | None) -> Answer:
    """What the driver says of the camera's processing."""
    question = "processing"
    if names is None:
        return Answer(question, Outcome.SKIPPED, "its driver does not tell")
    if not names:
        return Answer(question, Outcome.FINE, "all that the camera has a control for is off")
    return Answer(
        question, Outcome.DEFECT, f"processing that stays on ({', '.join(names)})",
        "the log of lightprobed says why; docs/users/cameras.md has the controls",
    )  # fmt: skip


def _progress(bar: Progress, task: Any, folder: Path, every: int) -> Callable[[int], None]:
    def told(count: int) -> None:
        bar.update(task, completed=count)
        if every > 1:
            _thin(folder, every, before=count - 2)

    return told


def _thin(folder: Path, every: int, before: int | None = None) -> None:
    """Delete all frames but each `every`-th, so that a minute of them does not fill the disk."""
    if every <= 1:
        return
    for path in folder.glob("[0-9]*.*"):
        number = int(path.stem) if path.stem.isdecimal() else 0
        gone = number % every != 0 and (before is None or number < before)
        if gone and path.name != INDEX:
            path.unlink(missing_ok=True)


def show(verdict: Verdict) -> None:
    """Print a line for each question, its next step, and the verdict."""
    console = view.console()
    for one in verdict.answers:
        colour = _COLOURS[one.outcome]
        console.print(
            f"[{colour}]{one.outcome.value:11}[/] [bold]{one.question}[/] {escape(one.words)}"
        )
        if one.next_step and one.outcome is not Outcome.FINE:
            console.print(f"            → {escape(one.next_step)}")
    console.print(f"\n[bold]{escape(verdict.words)}[/]")
