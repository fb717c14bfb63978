"""`lightprobe study`: from pictures to tables, and what it says of bad input."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.cli.main import app
from lightprobe.errors import LightprobeError
from lightprobe.study import analysis, answers, page, plan, report, simulate, trials
from lightprobe.study.plan import Picture, Plan
from PIL import Image
from typer.testing import CliRunner

METHODS = ("real", "one lamp", "packet")
WEB = {
    "study.html": "<title>study</title><style>/* study.css */</style>"
    "<script>{/* data */}</script><script>/* study.js */</script>",
    "study.css": "p { color: red }", "study.js": "start();",
}  # fmt: skip


def head(**more):
    keys = {"title": "Balls", "reference": "real", **more}
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())


def rows(folder, scenes=("hall", "garden"), objects=("chalk", "glass"), methods=METHODS):
    """Write pictures, and give their tables."""
    text = ""
    for k, (scene, thing, method) in enumerate(
        (s, o, m) for s in scenes for o in objects for m in methods
    ):
        Image.new("RGB", (16, 12), (10 * k, 90, 200)).save(folder / f"{k}.png")
        text += "[[pictures]]\n" + "".join(
            f"{key} = {json.dumps(value)}\n"
            for key, value in
            (("file", f"{k}.png"), ("scene", scene), ("object", thing), ("method", method))
        )  # fmt: skip
    return text


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "study.toml").write_text(head() + rows(tmp_path))
    (tmp_path / "web").mkdir()
    for name, text in WEB.items():
        (tmp_path / "web" / name).write_text(text)
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, ["study", *map(str, words)])


def made(folder, *more):
    done = run("make", folder / "study.toml", folder / "out", "--page", folder / "web", *more)
    assert done.exception is None, done.exception
    return trials.load(folder / "out")


def filled(folder, count=12, **qualities):
    """Make the study, and answers in a folder."""
    study = made(folder)
    (folder / "answers").mkdir()
    model = simulate.Model({key.replace("_", " "): value for key, value in qualities.items()})
    for k, table in enumerate(simulate.answers(study, model, count, 1)):
        (folder / "answers" / f"{k:02}.json").write_bytes(simulate.encode(table))
    return study, sorted((folder / "answers").iterdir())


def refused(*words):
    """What is said of bad input, in one sentence."""
    done = run(*words)
    assert isinstance(done.exception, LightprobeError), (done.exception, done.output)
    said = str(done.exception)
    assert said.startswith("study")
    assert "\n" not in said
    return said


# ------------------------------------------------------------------ what is shown


def test_every_picture_is_rated_and_each_method_chosen_against_the_real_one(folder):
    study = made(folder)
    by_id = {one.id: one for one in study.pictures}
    main = [one for one in study.trials if one.role == "main"]
    rated = [by_id[one.pictures[0]] for one in main if one.kind == "rating"]
    assert len({(one.scene, one.object, one.method) for one in rated}) == len(rated) == 12
    for one in (one for one in main if one.kind == "choice"):
        first, second = (by_id[key] for key in one.pictures)
        assert (first.scene, first.object) == (second.scene, second.object)
        assert second.method == "real"
        assert first.method in METHODS[1:]
    roles = [(one.kind, one.role) for one in study.trials]
    assert roles.count(("rating", "catch")) == roles.count(("choice", "catch")) == 3
    assert roles.count(("choice", "identical")) == 2
    assert roles.count(("rating", "repeat")) == roles.count(("choice", "repeat")) == 3


def test_no_two_trials_have_the_same_id(folder):
    """Otherwise no answers file could be read: each trial is answered once."""
    study = made(folder)
    assert len({one.id for one in study.trials}) == len(study.trials)
    twice = replace(small_plan(), pairs=(("packet", "real"),) * 2)
    with pytest.raises(AssertionError, match="trials of the same id"):
        trials.design(twice, {f"{k}": f"{k}" for k in range(12)}, (16, 12))


def test_the_page_tells_no_method_and_its_pictures_neither(folder):
    study = made(folder)
    html = (folder / "out/page/index.html").read_text()
    for word in (*METHODS[1:], "chalk", "garden", "catch", "identical"):
        assert word not in html
    assert study.hash in html
    files = {file.stem for file in (folder / "out/page/pictures").iterdir()}
    assert files == {one.id for one in study.pictures}


def test_an_obviously_wrong_picture_is_the_real_one_upside_down(folder):
    Image.fromarray(np.arange(16 * 12 * 3, dtype=np.uint8).reshape(12, 16, 3)).save(
        folder / "0.png"
    )
    study = made(folder)
    wrong = next(one for one in study.pictures if one.turned and one.object == "chalk")
    right = next(
        one for one in study.trials if one.role == "catch" and wrong.id in one.pictures
    ).pictures[0]
    a, b = (
        np.asarray(Image.open(folder / f"out/page/pictures/{key}.png")) for key in (right, wrong.id)
    )
    assert np.array_equal(a[::-1, ::-1], b)


def test_one_file_needs_no_other(folder):
    made(folder, "--one-file")
    assert [file.name for file in (folder / "out/page").iterdir()] == ["index.html"]
    assert "data:image/png;base64," in (folder / "out/page/index.html").read_text()


def test_metadata_of_photos_is_not_published_and_they_stand_upright(folder):
    exif = Image.Exif()
    exif[0x0112], exif[0x010E] = 6, "at my home"  # turned; a description
    for k in range(12):
        Image.new("RGB", (12, 16), (9, 9, 9)).save(folder / f"{k}.png", exif=exif)
    study = made(folder)
    assert study.size_px == (16, 12)
    for file in (folder / "out/page/pictures").iterdir():
        assert b"at my home" not in file.read_bytes()


@given(
    st.text(max_size=60), st.text(st.sampled_from("<>&/!-scriptSCRIPT\"'`\\\u2028"), max_size=60)
)
def test_no_text_leaves_the_script_that_it_is_in(one, other):
    text = page._for_script({"title": one + other})
    assert not set(text) & set("<>&\u2028")
    assert json.loads(text) == {"title": one + other}


# ------------------------------------------------------------------ what is found


def test_a_difference_that_is_there_is_found_and_its_interval_holds_it(folder):
    study, files = filled(folder, 20, real=7, one_lamp=4, packet=7)
    found = analysis.analyse(study, files)
    lamp, packet = (one for one in found.comparisons if one.kind == "rating")
    assert lamp.value.low < -3 < lamp.value.high
    assert lamp.p_holm < 0.001
    assert packet.p > 0.01
    chosen = {one.first: one for one in found.comparisons if one.kind == "choice"}
    assert chosen["one lamp"].value.high < 0.3
    assert chosen["packet"].value.low < 0.5 < chosen["packet"].value.high
    assert chosen["one lamp"].p_holm < 0.001


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_where_methods_are_alike_few_studies_find_a_difference(seed):
    """The whole way, with the correction for several comparisons: in at most a fifth of 15."""
    study = trials.design(small_plan(), {f"{k}": f"{k}" for k in range(12)}, (16, 12))
    wrong = 0
    for k in range(15):
        tables = simulate.answers(study, simulate.Model({}), 8, 100 * seed + k)
        people = [read(study, table) for table in tables]
        data = analysis._Data(study, people)
        compared = analysis._holm(
            [analysis._compare_ratings(data, *pair) for pair in study.compared]
        )
        wrong += min(one.p_holm for one in compared) <= 0.05
    assert wrong <= 5  # of a binomial with 0.05 in 15: once in 20 000


def small_plan():
    places = [(s, o, m) for s in ("hall", "garden") for o in ("chalk", "glass") for m in METHODS]
    return Plan("Balls", "real", tuple(Picture(f"{k}", *one) for k, one in enumerate(places)))


def read(study, table):
    known = {one.id: one for one in study.trials}
    return answers.Participant(
        None, table["participant"], True,
        tuple(
            answers.Answer(known[row["trial"]], row["value"], row["swapped"], row["ms"])
            for row in table["answers"]
        ),
    )  # fmt: skip


def test_who_does_not_look_is_left_out_and_named_with_the_reason(folder):
    study = made(folder)
    done = run("simulate", folder / "out", folder / "answers", "--count", 9, "--careless", 2)
    assert done.exit_code == 0
    found = run("analyse", folder / "out", folder / "answers").output
    assert "7 simulated participants, 2 left out" in found
    assert "simulated-1-1: missed" in found
    assert f"catch trials (most: {study.exclude.missed})" in found


def test_simulated_ones_are_named_on_each_table_and_in_json_and_the_plot(folder):
    study, _ = filled(folder, 4)
    text = run("analyse", folder / "out", folder / "answers").output
    tables = text.count("\n## ")
    assert tables == 4
    assert text.count(f"**{report.SIMULATED}**\n\n## ") == tables
    plot = folder / "plot.svg"
    done = run("analyse", folder / "out", folder / "answers", "--json", "--plot", plot)
    assert json.loads(done.stdout)["simulated"] is True
    assert "simulated" in plot.read_text()
    assert study.title


def test_all_ratings_equal_say_nothing_and_break_nothing(folder):
    study, files = filled(folder, 5)
    for file in files:
        edit(file, lambda table: [row.update(value=1 if is_choice(study, row) else 5)
                                  for row in table["answers"]
                                  if not is_catch(study, row)])  # fmt: skip
    done = run("analyse", folder / "out", *files, "--plot", folder / "plot.png")
    assert done.exception is None
    assert (
        "| one lamp | real | 0.00 (0.00 … 0.00) | – | 1.0000 | 1.0000 | 1.0000 | – |" in done.output
    )
    assert (folder / "plot.png").stat().st_size > 10_000


def test_one_participant_gets_means_and_no_tests(folder):
    _, files = filled(folder, 1)
    done = run("analyse", folder / "out", *files, "--plot", folder / "plot.png")
    assert done.exception is None
    assert "One participant tells nothing of others: no intervals, and no tests." in done.output
    assert " … " not in done.output
    table = json.loads(run("analyse", folder / "out", *files, "--json").stdout)
    assert {one["virtual"]["low"] for one in table["ratings"]} == {None}
    assert {one["value"]["high"] for one in table["comparisons"]} == {None}


def test_a_side_that_attracts_is_told(folder):
    study, files = filled(folder, 6)
    for file in files:
        edit(file, lambda table: [row.update(value=int(row["swapped"]))
                                  for row in table["answers"]
                                  if is_choice(study, row)
                                  and not is_catch(study, row)])  # fmt: skip
    found = analysis.analyse(study, files)
    assert found.consistency.first_place.value == 1
    assert found.consistency.first_place_all.low > 0.5


def trial(study, row):
    return next(one for one in study.trials if one.id == row["trial"])


def is_choice(study, row):
    return trial(study, row).kind == "choice"


def is_catch(study, row):
    return trial(study, row).role == "catch"


def edit(file, change):
    table = json.loads(file.read_text())
    change(table)
    file.write_text(json.dumps(table))


# ------------------------------------------------------------------ what cannot be used


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.update(study="0" * 64), "of another study"),
        (lambda t: t.update(version=9), "version 9"),
        (lambda t: t.update(kind="recipe"), "not an answers file"),
        (lambda t: t["answers"].pop(), "trials answered"),
        (lambda t: t["answers"].append(t["answers"][0]), "is answered twice"),
        (lambda t: t["answers"][0].update(trial="nothing"), "does not have"),
        (lambda t: t["answers"][0].update(value=11), "expected a whole number"),
        (lambda t: t["answers"][0].update(value=True), "expected a whole number"),
        (lambda t: t["answers"][0].update(ms=float("nan")), "ms"),
        (lambda t: t["answers"][0].update(swapped=1), "swapped"),
        (lambda t: t.update(answers={}), "no list of answers"),
        (lambda t: t.update(participant="\x1b[2J"), "participant"),
        (lambda t: t.update(simulated="no"), "simulated"),
        (lambda t: t.update(simulated=False), "analyse them apart"),
        (lambda t: t.update(participant="simulated-1-1"), "as is"),
    ],
)
def test_an_answers_file_that_cannot_be_used_is_named(folder, change, words):
    _, files = filled(folder, 3)
    edit(files[2], change)
    said = refused("analyse", folder / "out", *files)
    assert str(files[2]) in said or words == "analyse them apart"
    assert words in said


def test_broken_json_is_named(folder):
    _, files = filled(folder, 2)
    files[1].write_text(files[1].read_text()[:200])
    assert f"{files[1]}: broken JSON" in refused("analyse", folder / "out", *files)
    files[1].write_text("[" * 100_000)
    assert str(files[1]) in refused("analyse", folder / "out", *files)


@settings(max_examples=60)
@given(st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.sampled_from(["kind", "answers", "study", "trial"]), inner, max_size=4),
))  # fmt: skip
def test_any_json_is_refused_in_a_sentence(tmp_path_factory, data):
    study = trials.design(small_plan(), {f"{k}": f"{k}" for k in range(12)}, (16, 12))
    file = tmp_path_factory.getbasetemp() / "any.json"
    file.write_text(json.dumps(data))
    with pytest.raises(LightprobeError, match=r"any\.json"):
        answers.load(study, [file])


def test_rules_that_were_changed_afterwards_are_told(folder):
    _, files = filled(folder, 2)
    edit(folder / "out/study.json", lambda table: table["exclude"].update(missed=4))
    assert "was changed after" in refused("analyse", folder / "out", *files)


def test_all_left_out_is_said(folder):
    made(folder)
    run("simulate", folder / "out", folder / "answers", "--count", 2, "--careless", 2)
    assert "all of 2 participants are left out" in refused(
        "analyse", folder / "out", folder / "answers"
    )


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"catches": 0}, "catches: 0: without catch trials"),
        ({"reference": "unreal"}, "no picture has the method 'unreal'"),
        ({"ratings": False, "choices": False}, "nothing would be asked"),
        ({"exclude": {}}, ""),
        ({"colour": "red"}, "colour: no such key"),
        ({"title": 3}, "title: expected a text"),
        ({"repeats": -1}, "repeats: expected a whole number from 0 to 50"),
        ({"pairs": [["real", "real"]]}, "two methods that take part"),
        ({"pairs": [["real"]]}, "pairs: expected two texts"),
        ({"pairs": [["packet", "real"]] * 2}, "study.toml: pairs: 'packet', 'real': named twice"),
        ({"pairs": [["packet", "real"], ["real", "packet"]]}, "name each pair once"),
        ({"methods": ["real"]}, "no method takes part beside"),
        ({"scenes": ["sea"]}, "no picture has the scene 'sea'"),
    ],
)
def test_a_plan_that_cannot_be_shown_is_refused(folder, keys, words):
    if keys == {"exclude": {}}:
        text, words = head() + "[exclude]\nmissed = 6\n", "nobody would be left out"
    else:
        text = head(**keys)
    (folder / "study.toml").write_text(text + rows(folder))
    said = refused("make", folder / "study.toml", folder / "out", "--page", folder / "web")
    assert words in said
    assert not (folder / "out").exists()


def test_pictures_that_are_missing_or_of_other_sizes_or_none_are_named(folder):
    words = ("make", folder / "study.toml", folder / "out", "--page", folder / "web")
    Image.new("RGB", (20, 12)).save(folder / "5.png")
    assert f"{folder / '5.png'}: 20 × 12 pixels" in refused(*words)
    (folder / "5.png").write_bytes(b"\x89PNG\r\n\x1a\nno more")
    assert f"{folder / '5.png'}: cannot be read as a picture" in refused(*words)
    (folder / "5.png").unlink()
    assert "the picture of 'glass' in scene 'hall' by 'packet'" in refused(*words)
    (folder / "study.toml").write_text(head() + rows(folder).rpartition("[[pictures]]")[0])
    assert "none by 'packet'" in refused(*words)
    (folder / "study.toml").write_text(head() + 2 * rows(folder, ["hall"]))
    assert "two: 0.png and 0.png" in refused(*words)
    (folder / "study.toml").write_text("title = ")
    assert "not TOML" in refused(*words)


def test_a_folder_that_is_not_empty_is_left_as_it_is(folder):
    made(folder)
    assert "it is not empty" in refused(
        "make", folder / "study.toml", folder / "out", "--page", folder / "web"
    )


@pytest.mark.parametrize("words", [["one lamp=11"], ["two lamps=3"], ["packet"], ["packet=nan"]])
def test_a_quality_that_is_none_is_refused(folder, words):
    made(folder)
    done = run("simulate", folder / "out", folder / "answers", "--quality", *words)
    assert "--quality" in str(done.exception)


def test_hostile_names_stay_in_their_cells(folder):
    names = {"objects": ("<b>a|b</b>\x1b[31m",), "methods": ("real", "$x$ | `rm`\nx")}
    (folder / "study.toml").write_text(head(title="# $a_b$ <i>") + rows(folder, **names))
    _, files = filled(folder, 3)
    done = run("analyse", folder / "out", *files, "--plot", folder / "plot.png")
    assert done.exception is None
    assert "\x1b" not in done.output
    tables = [line for line in done.output.splitlines() if line.startswith("|")]
    assert all("\\|" in line for line in tables if "rm" in line)
    assert plan.load(folder / "study.toml").title == "# $a_b$ <i>"
