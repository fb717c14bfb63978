"""The Python in the documents runs as it is printed, against a probe on its address."""

import contextlib
import re
import sys
from pathlib import Path

import pytest
from lightprobe import wire
from lightprobe_proto import lightprobe_pb2 as pb
from scripted_probe import Probe, estimate, hello, polarized, serve

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = (
    "README.md",
    "host_py/README.md",
    "docs/users/clients.md",
    "docs/maintainers/one_estimate.md",
)
BLOCK = re.compile(r"```python\n(.*?)```", re.S)
ADDRESS = "127.0.0.1:7700"


class Enough(Exception):  # noqa: N818 - not an error
    """The example has printed something: it works, and would go on for ever."""


def examples():
    for name in DOCUMENTS:
        for number, block in enumerate(BLOCK.findall((ROOT / name).read_text())):
            yield pytest.param(block, id=f"{name}-{number}")


def lit(number):
    """An estimate with a lamp, for the first subscription."""
    message = pb.FromProbe.FromString(estimate(number, subscription=1)[1:])  # below 128 bytes
    message.estimate.lights.add(id=1, direction=[0, 1, 0], irradiance=[3, 2, 1])
    return wire.delimit(message.SerializeToString())


@pytest.mark.parametrize("code", list(examples()))
def test_examples_run_as_printed(code, monkeypatch):
    printed = []

    def enough(*words):
        printed.append(words)
        raise Enough

    monkeypatch.setitem(sys.modules, "lightprobe_pb2", pb)  # as protoc would have made it
    script = polarized() if "sweep()" in code else serve(hello(minor=3), estimate(1), lit(2))
    with Probe(script) as probe:
        host, _, port = probe.uri.removeprefix("tcp:").rpartition(":")
        if ADDRESS in code:
            code = code.replace(ADDRESS, f"{host}:{port}")
        else:
            assert '("127.0.0.1", 7700)' in code
            code = code.replace('("127.0.0.1", 7700)', f'("{host}", {port})')
        with contextlib.suppress(Enough):
            exec(compile(code, "example", "exec"), {"print": enough, "__name__": "example"})
    assert printed, "it said nothing"


def test_there_are_examples():
    assert len(list(examples())) >= 3
