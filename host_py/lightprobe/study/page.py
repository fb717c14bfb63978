"""The page for participants: a static folder that needs no network and tells no method."""

from __future__ import annotations

import hashlib
import io
import json
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from PIL import Image, ImageOps

from lightprobe.errors import LightprobeError
from lightprobe.study.plan import Plan
from lightprobe.study.trials import VERSION, Shown, Study

#: Longest side of a picture: screens of participants show no more.
MOST_PX = 2048
PICTURES = "pictures"
#: Parts of the page, as `make web` builds them.
_HTML, _CSS, _JS = "study.html", "study.css", "study.js"


def read_pictures(plan: Plan, folder: Path) -> dict[str, Image.Image]:
    """Read the pictures that take part, by file, upright, all of one size."""
    found: dict[str, Image.Image] = {}
    first = plan.shown()[0]
    for one in plan.shown():
        picture = _read(folder / one.file, one.words)
        found[one.file] = picture
        size = found[first.file].size
        if picture.size != size:
            raise LightprobeError(
                f"study: {folder / one.file}: {picture.size[0]} × {picture.size[1]} pixels, and "
                f"{folder / first.file} {size[0]} × {size[1]}: all pictures of a study need one "
                "size: cut or scale them"
            )
    return found


def _read(file: Path, words: str) -> Image.Image:
    """Without metadata, which may hold places and names; with its colour profile."""
    try:
        with Image.open(file) as opened:
            if max(opened.size) > MOST_PX:
                raise LightprobeError(
                    f"study: {file}: {opened.size[0]} × {opened.size[1]} pixels: at most {MOST_PX} "
                    "on a side: scale it down"
                )
            upright = ImageOps.exif_transpose(opened)
            picture = upright.convert("RGB")
            # convert() keeps a profile, which holds for RGB alone.
            profile = opened.info.get("icc_profile") if opened.mode == "RGB" else None
    except FileNotFoundError:
        raise LightprobeError(
            f"study: {file}: there is no such file: it is the picture of {words}"
        ) from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise LightprobeError(
            f"study: {file}: cannot be read as a picture ({error}): use PNG, JPEG or WebP"
        ) from None
    picture.info = {"icc_profile": profile} if profile else {}
    return picture


def sums(pictures: Mapping[str, Image.Image]) -> dict[str, str]:
    """SHA-256 of each picture's pixels."""
    return {
        file: hashlib.sha256(repr(one.size).encode() + one.tobytes()).hexdigest()
        for file, one in pictures.items()
    }


def files(
    study: Study, plan: Plan, pictures: Mapping[str, Image.Image], web: Path, *, one_file: bool
) -> dict[str, bytes]:
    """Give the page's files by their names; `web`: where study.html, .css and .js are.

    `one_file`: pictures are in the page itself, so that one can send it.
    """
    by_place = {(one.scene, one.object, one.method): one.file for one in plan.shown()}
    coded = {
        one.id: _png(pictures[by_place[one.scene, one.object, one.method]], one)
        for one in study.pictures
    }
    if one_file:
        places = {key: f"data:image/png;base64,{b64encode(data).decode()}"
                  for key, data in coded.items()}  # fmt: skip
        return {"index.html": _html(study, places, web)}
    places = {key: f"{PICTURES}/{key}.png" for key in coded}
    return {"index.html": _html(study, places, web)} | {
        places[key]: data for key, data in coded.items()
    }


def _png(picture: Image.Image, shown: Shown) -> bytes:
    out = io.BytesIO()
    turned = picture.transpose(Image.Transpose.ROTATE_180) if shown.turned else picture
    turned.save(out, "PNG", icc_profile=picture.info.get("icc_profile"))
    return out.getvalue()


def _html(study: Study, places: Mapping[str, str], web: Path) -> bytes:
    """Put style, script and data into the page: a script of its own file does not run by file:."""
    html, css, js = (_part(web, one) for one in (_HTML, _CSS, _JS))
    for mark, text in (
        ("<title>study</title>", f"<title>{escape(study.title)}</title>"),
        ("/* study.css */", css),
        ("{/* data */}", _for_script(page_data(study, places))),
        # No string of a script ends it: esbuild writes <\/script>.
        ("/* study.js */", js),
    ):
        if html.count(mark) != 1:
            raise LightprobeError(f"study: {web / _HTML}: {mark} is not there once: run `make web`")
        html = html.replace(mark, text)
    return html.encode()


def page_data(study: Study, places: Mapping[str, str]) -> dict[str, Any]:
    """Give what the page knows: nothing of methods, and not which trials are catches."""
    return {
        "version": VERSION, "study": study.hash, "texts": study.texts, "size": study.size_px,
        "pictures": places, "minutes": round(study.minutes()) or 1,
        "trials": [
            {"id": one.id, "kind": one.kind, "pictures": one.pictures}
            | ({"asked": one.right} if isinstance(one.right, int) else {})
            for one in study.trials
        ],
    }  # fmt: skip


def _for_script(data: Any) -> str:
    """Give JSON that no HTML in a string can leave."""
    text = json.dumps(data, ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _part(web: Path, part: str) -> str:
    try:
        return (web / part).read_text(encoding="utf-8")
    except OSError:
        raise LightprobeError(
            f"study: {web / part}: the page is not installed beside this command: run `make web`"
        ) from None
