"""What the set-up page runs: commands of `lightprobe`, as data. Nothing is implemented twice."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lightprobe.errors import UsageError
from lightprobe.setup import card

#: Of a value that becomes a word of a command line.
_LONGEST = 400
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


@dataclass(frozen=True)
class Field:
    """What the user says before a task begins."""

    name: str
    label: str
    kind: str  # source, port, probe, camera-file, number, choice, upload (UPLOAD is the file)
    initial: str = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Task:
    """One command, and what comes before and after it."""

    name: str
    title: str
    words: str  # what it is for, and what has to be done before
    command: tuple[str, ...]  # {FIELD} and {FOLDER} are filled in
    fields: tuple[Field, ...] = ()
    takes_devices: bool = False  # the daemon ends meanwhile, and starts again afterwards
    asks: bool = False  # it waits for Enter between its steps
    ends_by_itself: bool = False  # it must not be cut off
    minutes: float = 0.2
    files: tuple[str, ...] = ()  # that it writes into its folder, to be shown
    writes: str = ""  # field whose camera file it writes
    setting: str = ""  # of the daemon, that the file is for
    next_step: str = ""
    restarts: bool = False  # this machine, when it has ended well
    of_card: bool = False  # only where the whole system is on a card of `make image`

    @property
    def takes_file(self) -> bool:
        """Whether the owner sends a file before."""
        return any(field.kind == "upload" for field in self.fields)


_SOURCE = Field("source", "Camera", "source")
_PORT = Field("port", "Microcontroller", "port")
_OUTPUT = Field("output", "Name of the camera file", "camera-file", "my")
_PROBE = Field("probe", "Probe", "probe")

TASKS = (
    Task(
        "doctor", "Look", "What is installed and connected, and how the probe is.",
        ("doctor", "{probe}"), (_PROBE,),
    ),
    Task(
        "check-camera", "Check the camera",
        "What the camera does to its pictures by itself, and whether it is fit. Point it at a lit "
        "room. It asks for something coloured, for a lamp to be hidden, and for the lens to be "
        "covered.",
        ("check-camera", "{source}", "--output={output}", "--plot={FOLDER}/checked.png"),
        (_SOURCE, _OUTPUT), takes_devices=True, asks=True, minutes=5, files=("checked.png",),
        writes="output", setting="camera", next_step="Use the camera file, then measure the delay.",
    ),
    Task(
        "exposure", "Measure the camera's delay",
        "How many pictures pass until a new exposure counts. Point the camera at a lit scene at "
        "rest.",
        ("calibrate", "exposure", "{source}", "--output={output}"), (_SOURCE, _OUTPUT),
        takes_devices=True, minutes=1, writes="output", setting="camera",
        next_step="Use the camera file. If the delay was not found, exposures stay fixed.",
    ),
    Task(
        "response", "Measure the camera's response",
        "How codes become light. Needs a scene at rest with even surfaces from dark to bright.",
        ("calibrate", "response", "{source}", "--output={output}", "--plot={FOLDER}/response.png"),
        (_SOURCE, _OUTPUT), takes_devices=True, minutes=2, files=("response.png",),
        writes="output", setting="camera", next_step="Use the camera file.",
    ),
    Task(
        "scale", "Measure lux",
        "So that light is sent in lux and cd/m². Put a lux meter beside the camera, and do not "
        "stand in its light.",
        ("calibrate", "scale", "{probe}", "--lux={lux}", "--facing={facing}", "--output={output}"),
        (
            _PROBE, Field("lux", "The lux meter reads", "number"),
            Field("facing", "It looks", "choice", "up",
                  ("up", "down", "front", "back", "right", "left")),
            _OUTPUT,
        ),
        writes="output", setting="camera", next_step="Use the camera file.",
    ),
    Task(
        "wheel", "Measure the wheel",
        "Gain, zero and backlash of the servo. Nothing may touch the wheel. The result is saved in "
        "the microcontroller.",
        ("calibrate", "wheel", "--port={port}", "--save"), (_PORT,),
        takes_devices=True, minutes=1.5,
    ),
    Task(
        "ring", "Measure the ring by the camera",
        "Turn the box slowly for five minutes, in a room with ordinary lamps. The daemon must run "
        "without the ring: leave the setting Ring empty before.",
        ("calibrate", "ring", "--from-camera={probe}", "--port={port}",
         "--output={FOLDER}/ring.ini", "--plot={FOLDER}/ring.png"),
        (_PROBE, _PORT), minutes=6, files=("ring.png", "ring.ini"),
        next_step="Keep ring.ini beside the configuration, and name it: "
        "ring = mcu:…?calibration=FILE.",
    ),
    Task(
        "hil", "Check the box",
        "Whether wheel, sensors, clock and messages of the microcontroller work. The wheel turns: "
        "take your fingers out.",
        ("hil", "{port}", "--moves", "--html={FOLDER}/box.html", "--json={FOLDER}/box.json"),
        (_PORT,), takes_devices=True, minutes=1, files=("box.html", "box.json"),
        next_step="The report is the evidence that this box works. Keep it.",
    ),
    Task(
        "flash", "Update the microcontroller",
        "Writes the firmware that belongs to this version. Calibration stays. When the new one "
        "does not answer, the former one is written back.",
        ("mcu", "flash", "--port={port}"), (_PORT,), takes_devices=True, ends_by_itself=True,
        minutes=0.5,
    ),
    Task(
        "pair", "Let clients on the network in",
        "Makes key, certificate and token, and shows the address for clients. Who has it can read "
        "the light, and change nothing.",
        ("pair", "--dir={PAIR}"), next_step="Run what it says under next on the probe, then scan "
        "the code.",
    ),
    Task(
        "update", "Update this probe",
        "Another version of the whole system: a file .raucb of the maker of this card. Settings "
        "and calibration stay. The probe restarts.",
        ("update", "{UPLOAD}"), (Field("file", "Update", "upload"),),
        ends_by_itself=True, minutes=3, of_card=True, restarts=True,
        next_step="If the new version does not run well, the former one is back after six minutes.",
    ),
    Task(
        "find-cameras", "Find cameras on the network",
        "A RICOH THETA in client mode announces itself.", ("find", "--cameras"),
    ),
)  # fmt: skip


def offered() -> list[Task]:
    """Give those that this machine can do."""
    return [task for task in TASKS if not task.of_card or card.can_update()]


def named(name: str) -> Task:
    """Give a task; raises UsageError."""
    for task in offered():
        if task.name == name:
            return task
    raise UsageError(f"setup: {name[:40]!r}: no such task")


def words(
    task: Task, given: Mapping[str, str], folders: Mapping[str, Path], cameras: Path
) -> list[str]:
    """The command line of a task, without its program; raises UsageError.

    `folders`: FOLDER, for what is shown, PAIR, of key, certificate and tokens, and UPLOAD, the file
    that was sent; `cameras`: for camera files, of which only names are given.
    """
    if task.takes_file and not folders["UPLOAD"].is_file():
        raise UsageError(f"setup: {task.name}: no file was sent before")
    filled = {name: str(folder) for name, folder in folders.items()}
    for field in task.fields:
        if field.kind == "upload":  # its name elsewhere
            continue
        value = str(given.get(field.name, field.initial)).strip()
        filled[field.name] = _checked(task, field, value, cameras)
    return [
        re.sub(r"\{(\w+)\}", lambda match: filled[match[1]], word) for word in task.command
    ]  # fmt: skip


def _checked(task: Task, field: Field, value: str, cameras: Path) -> str:
    where = f"setup: {task.name}: {field.label}"
    if not value or len(value) > _LONGEST or not value.isprintable():
        raise UsageError(f"{where}: expected 1 to {_LONGEST} characters")
    if value.startswith("-"):
        raise UsageError(f"{where}: {value}: begins like an option")
    if field.kind == "camera-file":
        if not _FILE_NAME.fullmatch(value):
            raise UsageError(f"{where}: {value}: letters, digits, - and _, without .camera")
        return str(cameras / f"{value}.camera")
    if field.kind == "choice" and value not in field.choices:
        raise UsageError(f"{where}: {value}: one of {', '.join(field.choices)}")
    if field.kind == "number":
        try:
            float(value)
        except ValueError:
            raise UsageError(f"{where}: {value}: expected a number") from None
    return value
