# SPDX-License-Identifier: Apache-2.0
"""Run a target in Python under libFuzzer: `atheris_main.py NAME [libFuzzer's arguments]`."""

import importlib
import sys

import atheris

_, name, *arguments = sys.argv
with atheris.instrument_imports(
    include=["lightprobe", "mcap", "json"], enable_loader_override=False
):
    target = importlib.import_module(f"fuzz_{name}")
atheris.Setup([name, *arguments], target.one_input)
atheris.Fuzz()
