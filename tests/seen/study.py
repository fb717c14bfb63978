"""`make seen-study`: the pictures of docs/users/seen.md, one by one, for `lightprobe study make`.

Cut from the page's sheets, as JPEG has left them; `make seen` writes them from its renders instead.
Rows and columns of a sheet are those of the page's tables.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/users/seen.md"
OUT = ROOT / "build/seen/study"
#: Black lines around each picture of a sheet.
EDGE_PX = 2
TRUTH = "truth"
#: Methods that a study begins with: all eight would take a participant half an hour.
_CHOSEN = ("no shadow", "main light and ambient", "… with reflection map")
_HEAD = """# The pictures of docs/users/seen.md, for lightprobe study make. Change what you like.
title = "Balls on a table"
reference = "truth"
methods = {methods}
"""

Picture = npt.NDArray[np.uint8]


def names() -> tuple[list[str], list[str]]:
    """Give materials and methods, as the page's first table has them."""
    table = re.search(r"<!-- generated: flip -->\n(.*?)<!-- end -->", PAGE.read_text(), re.S)
    assert table, PAGE
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table[1].splitlines()]
    return rows[0][1:-1], [row[0] for row in rows[2:]]


def cut(sheet: Picture) -> dict[tuple[str, str], Picture] | None:
    """Give the pictures of a sheet by material and method; None: it has other rows or columns."""
    materials, methods = names()
    columns = [TRUTH, *methods]
    height, width = sheet.shape[0] // len(materials), sheet.shape[1] // len(columns)
    # Of 200 × 150 pixels each (tests/seen/room.py).
    if 3 * (width - 2 * EDGE_PX) != 4 * (height - 2 * EDGE_PX):
        return None
    found = {}
    for row, material in enumerate(materials):
        for column, method in enumerate(columns):
            one = sheet[row * height :, column * width :][:height, :width]
            found[material, method] = one[EDGE_PX:-EDGE_PX, EDGE_PX:-EDGE_PX]
    return found


def sheets() -> dict[str, Picture]:
    """Read the page's sheets, by place."""
    found = {}
    for file in sorted(PAGE.parent.glob("seen_*.jpg")):
        sheet = np.asarray(Image.open(file).convert("RGB"))
        if cut(sheet) is not None:
            found[file.stem.removeprefix("seen_").replace("_", " ")] = sheet
    return found


def write(folder: Path, by_place: dict[str, Picture]) -> None:
    """Write the pictures of sheets, by place, and the study's TOML file."""
    methods = ", ".join(json.dumps(one, ensure_ascii=False) for one in _CHOSEN)
    text = _HEAD.format(methods=f"[{methods}]")
    folder.mkdir(parents=True, exist_ok=True)
    for place, sheet in by_place.items():
        for (material, method), picture in (cut(sheet) or {}).items():
            file = re.sub(r"\W+", "_", f"{place} {material} {method}") + ".png"
            Image.fromarray(np.ascontiguousarray(picture)).save(folder / file)
            row = {"file": file, "scene": place, "object": material, "method": method}
            text += "\n[[pictures]]\n"
            text += "".join(
                f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in row.items()
            )
    (folder / "study.toml").write_text(text)


def main() -> None:
    """Cut the sheets of the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=OUT)
    out = parser.parse_args().out
    write(out, sheets())
    print(f"written: {out / 'study.toml'}")


if __name__ == "__main__":
    main()
