"""`lightprobe align lamps`: the mount by lamps that head and probe know."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from lightprobe.align import lamps
from lightprobe.align.lamps import Lamps
from lightprobe.align.mount import Mount
from lightprobe.align.track import AlignError
from lightprobe.cli import align
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.colour import luminance
from lightprobe.wire import Subscription

_PATIENCE_S = 10.0
_NEXT_STEP = 'expected {"lights": [{"direction": [x, y, z], "irradiance": [r, g, b]}, …]}'


def command(
    head: Annotated[Path, typer.Argument(metavar="HEAD", help="Lamps in the head's frame (JSON).")],
    probe: Annotated[
        str, typer.Argument(metavar="[PROBE]", help="Address of the probe, or a file alike.")
    ] = DEFAULT_URI,
    output: align.Output = None,
    as_json: align.AsJson = False,
) -> None:
    """Find the mount by lamps whose directions both head and probe know, from one place, at rest.

    HEAD is JSON with "lights" as `lightprobe estimate --json` and `lightprobe watch --json` print
    them: "direction" towards each lamp (+X right, +Y up, -Z forward), and "irradiance" if known. At
    least two lamps; two need different strength, or a third.
    Example: lightprobe align lamps headset.json --output mount.ini
    """
    found = lamps.match(of_file(head), of_file(Path(probe)) if is_file(probe) else of_probe(probe))
    remark = f"{len(found.pairs)} lamps match within {found.residual_deg:.2f}° (RMS)"
    align.finish(Mount(found.rotation, found.sigma_deg), found.to_json(), remark, output, as_json)


def is_file(probe: str) -> bool:
    """Tell a file from an address."""
    return Path(probe).suffix.lower() in (".json", ".jsonl")


def of_file(path: Path) -> Lamps:
    """Lamps of a JSON file; of JSON lines those of the last one. Raises :class:`AlignError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no text"
        raise AlignError(f"align: {path}: read: {reason}: name a JSON file") from None
    try:
        value = _parse(text)
        lights = value["lights"] if "lights" in value else value["estimate"]["lights"]
        directions = np.array([light["direction"] for light in lights], np.float64).reshape(-1, 3)
        irradiance = np.array([_strength(light.get("irradiance")) for light in lights], np.float64)
        sigma = [light.get("direction_sigma_deg") or np.nan for light in lights]
        return Lamps.of(str(path), directions, irradiance, np.array(sigma, np.float64))
    except (ValueError, LookupError, TypeError, AttributeError):
        raise AlignError(f"align: {path}: not understood: {_NEXT_STEP}") from None


def _parse(text: str) -> dict[str, Any]:
    try:
        return dict(json.loads(text))
    except json.JSONDecodeError:
        return dict(json.loads(text.strip().splitlines()[-1]))


def _strength(irradiance: object) -> float:
    return np.nan if irradiance is None else float(luminance(np.array(irradiance, np.float64)))


def of_probe(uri: str) -> Lamps:
    """Lamps of a probe now."""
    with Client(uri, Subscription(max_lights=8)) as probe:
        lights = probe.receive(_PATIENCE_S).lights
    sigma = [np.nan if light.direction_sigma_deg is None else light.direction_sigma_deg
             for light in lights]  # fmt: skip
    directions = np.array([light.direction for light in lights]).reshape(-1, 3)
    irradiance = np.array([_strength(light.irradiance) for light in lights])
    return Lamps.of(uri, directions, irradiance, np.array(sigma, np.float64))
