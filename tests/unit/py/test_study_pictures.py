"""The pictures of docs/users/seen.md, cut from its sheets: they make a study. Needs no Mitsuba."""

import numpy as np
import study
from lightprobe.study import page, plan, trials


def test_the_sheets_of_the_page_are_cut_into_a_study(tmp_path):
    materials, methods = study.names()
    study.write(tmp_path, study.sheets())
    wanted = plan.load(tmp_path / "study.toml")
    assert len(wanted.pictures) == 3 * len(materials) * (len(methods) + 1)
    pictures = page.read_pictures(wanted, tmp_path)
    made = trials.design(wanted, page.sums(pictures), (200, 150))
    assert made.minutes() < 15
    for one in wanted.shown():
        assert pictures[one.file].size == (200, 150)
        # Lines between the pictures are black: none is left of them.
        codes = np.asarray(pictures[one.file])
        assert min(side.mean() for side in (codes[0], codes[-1], codes[:, 0], codes[:, -1])) > 20


def test_a_sheet_of_other_rows_is_none():
    assert study.cut(np.zeros((462, 1224, 3), np.uint8)) is None
