"""The C# package, compiled and run by mono: what its tests share."""

import json
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
from lightprobe.imaging import image

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "clients/csharp"
COMPILER = ("mcs", "-langversion:7.2", "-codepage:utf8", "-warnaserror")


def compiled(out, *sources, options=()):
    files = [str(file) for source in sources for file in sorted(source.parent.glob(source.name))]
    subprocess.run([*COMPILER, *options, f"-out:{out}", *files], check=True, timeout=300)
    return out


def ask(program, *words, given=""):
    done = subprocess.run(
        ["mono", program, *words], input=given, capture_output=True, text=True, timeout=300
    )
    assert not done.stderr, done.stderr
    return [
        json.loads(line, strict=False) if line[0] in '{["' else line
        for line in done.stdout.split("\n")[:-1]
    ]


def room(folder):
    picture = np.full((64, 128, 3), 0.2, np.float32)
    picture[15:18, 94:98] = [400, 300, 200]  # 45° up, 90° to the right
    image.write_pfm(str(folder / "room.pfm"), picture)
    return folder / "room.pfm"


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def said(client, condition, within_s=60):
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        one = json.loads(client.stdout.readline())
        if condition(one):
            return one
    raise AssertionError(f"not said within {within_s} s")
