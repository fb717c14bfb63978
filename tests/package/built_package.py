"""Wheel and source distribution as for a release, and how the tests of them run programs."""

import subprocess

LONG_S = 900


def run(*command, **popen):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=LONG_S, **popen
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def wheel(built):
    (path,) = built.glob("*.whl")
    return path
