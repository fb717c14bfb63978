"""Participants that are made up, to test the analysis with. They are no people, and say so."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightprobe.study.trials import HIGHEST, VERSION, Study, Trial

_MIDDLE = 5.0


@dataclass(frozen=True)
class Model:
    """How they answer: what they see in a picture is quality + person + person × method + noise."""

    qualities: Mapping[str, float]  # mean rating, by method; absent: 5
    person: float = 1.0  # standard deviation between participants, of all ratings
    taste: float = 0.5  # the same, of a method's
    noise: float = 1.5  # the same, from answer to answer
    careless: int = 0  # participants who do not look at all


def answers(study: Study, model: Model, count: int, seed: int) -> list[dict[str, Any]]:
    """Make up answers files, as the page would write them, but marked as simulated."""
    return [_one(study, model, k, seed) for k in range(count)]


def encode(table: Mapping[str, Any]) -> bytes:
    """Write an answers file."""
    return (json.dumps(table, indent=1) + "\n").encode()


def _one(study: Study, model: Model, index: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([seed, index])
    methods = {one.id: one.method for one in study.pictures}
    turned = {one.id for one in study.pictures if one.turned}
    person = rng.normal(0, model.person)
    tastes = {method: rng.normal(0, model.taste) for method in study.methods}

    def seen(picture: str) -> float:
        if picture in turned:
            return -99.0
        method = methods[picture]
        level = model.qualities.get(method, _MIDDLE) + tastes[method]
        return float(level + rng.normal(0, model.noise))

    def value(trial: Trial) -> int:
        careless = index < model.careless
        if trial.kind == "rating":
            if careless:
                return int(rng.integers(0, HIGHEST + 1))
            if isinstance(trial.right, int):
                return trial.right
            return int(np.clip(np.rint(seen(trial.pictures[0]) + person), 0, HIGHEST))
        if careless or trial.role == "identical":
            return int(rng.integers(0, 2))
        return int(seen(trial.pictures[1]) > seen(trial.pictures[0]))

    return {
        "kind": "lightprobe study answers", "version": VERSION, "study": study.hash,
        "participant": f"simulated-{seed}-{index + 1}", "simulated": True, "seed": seed,
        "answers": [
            {"trial": trial.id, "value": value(trial), "swapped": bool(rng.integers(0, 2)),
             "ms": round(float(rng.lognormal(8, 0.4)))}
            for trial in (study.trials[k] for k in rng.permutation(len(study.trials)))
        ],
    }  # fmt: skip
