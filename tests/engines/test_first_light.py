"""docs/users/first_light.md: its shell lines, as they are printed, in what looks like a clone.

Ports and the simulator's socket are others than on the page, because tests run side by side. What
is downloaded comes from PyPI and npm. Each way prints how long it took. What its code shows is
tested elsewhere: tests/e2e/test_first_light.py, clients/js/test/first_light.test.ts, tests/engines.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from harness import LONG_S, wait_for

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/users/first_light.md").read_text()
#: What the page promises, and what a test waits for at most.
PROMISED_S, PATIENCE_S = 300, 1500


def section(title):
    """A part of the page, from its heading to the next."""
    (found,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.S | re.M)
    return found


def commands(title):
    """Its shell lines: those that are indented, and a `pip` line in the text."""
    text = re.sub(r"```.*?```", "", section(title), flags=re.S)
    return re.findall(r"^    (\S.*)$", text, re.M) + re.findall(r"`(pip .*?)`", text)


def fenced(title, language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", section(title), re.S)
    return found


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class Reader:
    """Somebody who types what the page says, in a clone with everything built."""

    def __init__(self, folder):
        self.clone = folder / "clone"
        self.clone.mkdir()
        for entry in ROOT.iterdir():
            if entry.name != ".git":
                (self.clone / entry.name).symlink_to(entry)
        self.socket, self.tcp, self.web = folder / "sim", free_port(), free_port()
        self.running = []
        self.log = (folder / "log").open("w+")

    def typed(self, line):
        """A line, with addresses of its own."""
        line = line.replace("/tmp/lightprobe-sim.sock", str(self.socket))
        line = re.sub(r"lightprobe simulate$", f"lightprobe simulate --socket {self.socket}", line)
        if "lightprobed" in line and "--publish" not in line:
            line += f" --publish=tcp:127.0.0.1:{self.tcp}"
        return line.replace(":7701", f":{self.web}")

    def run(self, *lines, folder="", path=""):
        """Type lines one after another into one shell; the last folder is that of the next one."""
        script = "\n".join(["set -e", f"cd {self.clone / folder}", *map(self.typed, lines)])
        environment = os.environ | {"PATH": f"{path}{os.environ['PATH']}"}
        subprocess.run(["bash", "-c", script], check=True, timeout=PATIENCE_S, env=environment)

    def start(self, line, folder=""):
        """Type a line in a terminal of its own, where it goes on."""
        script = f"cd {self.clone / folder}; exec {self.typed(line)}"
        self.running.append(
            subprocess.Popen(["bash", "-c", script], stdout=self.log, stderr=self.log)
        )

    def end(self):
        for process in reversed(self.running):
            process.send_signal(signal.SIGTERM)
            process.wait(LONG_S)
        self.log.close()


@pytest.fixture
def reader(tmp_path):
    """With a probe running, as "A probe" says."""
    reader = Reader(tmp_path)
    build, simulate, probe = commands("A probe")
    reader.run(build)
    reader.start(simulate)
    wait_for(reader.socket.exists, "no simulator")
    reader.start(probe)
    yield reader
    reader.end()


def timed(title, start_s):
    seconds = time.monotonic() - start_s
    print(f"first light, {title}: {seconds:.0f} s of the {PROMISED_S} s promised")


def test_python(reader):
    start_s, venv = time.monotonic(), reader.clone / "venv"
    subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    (install,) = commands("Python")
    reader.run(install, path=f"{venv}/bin:")
    code = fenced("Python", "python").replace(":7700", f":{reader.tcp}")
    (reader.clone / "sphere.py").write_text(code)
    reader.run("python sphere.py", path=f"{venv}/bin:")
    assert (reader.clone / "sphere.png").stat().st_size > 1000
    timed("Python", start_s)


def test_a_web_page_with_three_js(reader):
    title, start_s = "A web page with three.js", time.monotonic()
    prepare, install, bundle, serve = commands(title)
    reader.run(prepare, install)
    for name, language in (("index.html", "html"), ("main.js", "js")):
        (reader.clone / "my-page" / name).write_text(fenced(title, language))
    reader.run(bundle, folder="my-page")
    reader.start(serve, folder="my-page")

    def get(path):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{reader.web}/{path}") as answer:
                return answer.read().decode()
        except OSError:
            return ""

    wait_for(lambda: "<canvas" in get(""), "no page")
    assert "WebGLRenderer" in get("bundle.js")
    timed(title, start_s)


def test_blender(reader):
    start_s = time.monotonic()
    (build,) = commands("Blender")
    reader.run(build)
    assert list((reader.clone / "build/blender").glob("lightprobe-blender-*.zip"))
    timed("Blender", start_s)
