"""`lightprobe study`: a page that asks people which pictures look real, and what they answered."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from lightprobe import installation
from lightprobe.cli import check, whole_file
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.study import analysis, page, plan, report, simulate, statistics, trials
from lightprobe.study.trials import Study

app = typer.Typer(
    help="Ask people which pictures look real: make the page, analyse the answers.",
    no_args_is_help=True,
    rich_markup_mode=None,
    add_completion=False,
)
_PAGE = "page"
_StudyFile = Annotated[
    Path, typer.Argument(metavar="STUDY", help="What `study make` wrote: folder or study.json.")
]


@app.command()
def make(
    source: Annotated[
        Path, typer.Argument(metavar="TOML", help="Pictures, questions and rules of the study.")
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", callback=check.new_folder, help="Folder; new or empty.")
    ],
    one_file: Annotated[
        bool, typer.Option("--one-file", help="Pictures within index.html: one file to send.")
    ] = False,
    web: Annotated[
        Path | None,
        typer.Option("--page", help="Folder of study.html; default: the installed one."),
    ] = None,
) -> None:
    """Make the page of a study, from a TOML file that names its pictures.

    OUT/page is for participants: put it on any web server, or open its index.html. It tells no
    method and sends nothing. OUT/study.json is for you alone: it tells which picture is which.
    Example: lightprobe study make study.toml out
    """
    if out.is_dir() and any(out.iterdir()):
        raise UsageError(
            f"study make: {out}: it is not empty, and answers to a page that is gone cannot be "
            "analysed: name another folder"
        )
    wanted = plan.load(source)
    pictures = page.read_pictures(wanted, source.parent)
    one = next(iter(pictures.values()))
    study = trials.design(wanted, page.sums(pictures), one.size)
    folder = web or installation.viewer()
    if folder is None:
        raise LightprobeError(
            "study: the page is not installed beside this command: run `make web`"
        )
    for name, data in page.files(study, wanted, pictures, folder, one_file=one_file).items():
        _write(out / _PAGE / name, data)
    _write(out / trials.NAME, study.encode())
    kinds = {kind: sum(one.kind == kind for one in study.trials) for kind in ("rating", "choice")}
    typer.echo(f"written: {out / _PAGE / 'index.html'}: for participants", err=True)
    typer.echo(f"written: {out / trials.NAME}: for you: keep it, and do not publish it", err=True)
    typer.echo(
        f"{kinds['rating']} ratings and {kinds['choice']} choices for each participant, "
        f"{study.minutes():.0f} minutes about"
    )
    effect = statistics.detectable(analysis.RESEARCH_PEOPLE)
    typer.echo(
        f"{analysis.RESEARCH_PEOPLE} participants would find, in 80 % of such studies, a difference"
        f" of {effect:.2f} standard deviations of the differences between participants"
    )


@app.command()
def analyse(
    study_file: _StudyFile,
    files: Annotated[
        list[Path],
        typer.Argument(metavar="ANSWERS…", help="Answers files, or folders of them."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[Path | None, check.plot("Draw ratings and choices.")] = None,
) -> None:
    """Analyse answers: means, shares, paired tests, and whose answers are left out and why.

    Answers of simulated participants are named so wherever they appear, and never mixed with those
    of people. Example: lightprobe study analyse out answers --plot study.pdf
    """
    study = trials.load(study_file)
    found = analysis.analyse(study, _answers(files))
    if plot is not None:
        from lightprobe.study.plot import draw  # matplotlib is slow to load

        draw(found, plot)
        typer.echo(f"written: {plot}", err=True)
    if as_json:
        typer.echo(json.dumps(found.table(), indent=2))
    else:
        typer.echo("\n".join(report.lines(found)))


@app.command(name="simulate")
def simulated(
    study_file: _StudyFile,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", callback=check.new_folder, help="Folder of answers.")
    ],
    count: Annotated[int, typer.Option(min=1, max=10_000, help="Participants.")] = 33,
    seed: Annotated[int, typer.Option(min=0, help="Other participants with another seed.")] = 1,
    qualities: Annotated[
        list[str] | None,
        typer.Option(
            "--quality",
            metavar="METHOD=RATING",
            help="Mean rating of a method; others: 5. May be repeated.",
        ),
    ] = None,
    careless: Annotated[int, typer.Option(min=0, help="Of them, those who do not look.")] = 0,
) -> None:
    """Make up answers, to test the analysis before people come. They are no study.

    Each file is marked as simulated, and so is all that `study analyse` makes of it.
    Example: lightprobe study simulate out made-up --quality "no shadow=4"
    """
    study = trials.load(study_file)
    model = simulate.Model(_qualities(study, qualities or []), careless=careless)
    for table in simulate.answers(study, model, count, seed):
        _write(out / f"{table['participant']}.json", simulate.encode(table))
    typer.echo(f"written: {out}: {count} files. {report.SIMULATED}", err=True)


def _qualities(study: Study, texts: list[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        method, _, value = text.rpartition("=")
        if method not in study.methods:
            raise UsageError(
                f"study simulate: --quality {text}: expected METHOD=RATING, with a method of "
                f"{', '.join(study.methods)}"
            )
        if not re.fullmatch(r"\d+(\.\d+)?", value) or float(value) > trials.HIGHEST:
            raise UsageError(
                f"study simulate: --quality {text}: expected a rating from 0 to {trials.HIGHEST}"
            )
        found[method] = float(value)
    return found


def _answers(paths: list[Path]) -> list[Path]:
    """Give the files, and those of the folders."""
    found = []
    for path in paths:
        inside = sorted(path.glob("*.json")) if path.is_dir() else [path]
        if not inside:
            raise LightprobeError(f"study: {path}: no *.json in it: name a folder of answers files")
        found += inside
    return found


def _write(file: Path, data: bytes) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LightprobeError(f"study: {file.parent}: {error.strerror}: name another") from None
    whole_file.write("study", file, data)
