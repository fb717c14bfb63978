"""Every command with every bad input: one sentence, exit status 1 or 2, before any work is done.

Run in this process, so that a traceback of whatever kind is a failure of its own, and nothing that
should have been refused can take minutes.
"""

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe import __main__ as program
from lightprobe.imaging import image

TOO_MUCH_WORK = "work was begun before the input was checked"


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    """A folder to stand in, with good and bad files; nothing in it may be written over."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    light = cv2.GaussianBlur(rng.random((64, 128, 3)), (0, 0), 6)
    light = (light - light.min()) / np.ptp(light)
    for name, gain in (("dark", 60), ("middle", 120), ("bright", 240)):
        cv2.imwrite(f"{name}.jpg", np.uint8(gain * light))
    good = cv2.imread("middle.jpg")
    cv2.imwrite("small.jpg", cv2.resize(good, (64, 32)))
    cv2.imwrite("square.jpg", good[:, :64])
    image.write_pfm("square.pfm", np.ones((8, 8, 3)))
    data = Path("middle.jpg").read_bytes()
    Path("cut.jpg").write_bytes(data[: len(data) // 3])
    Path("garbage.jpg").write_bytes(rng.bytes(5000))
    Path("empty.jpg").touch()
    Path("words.txt").write_text("words")
    Path("a_folder").mkdir()
    return tmp_path


@pytest.fixture
def _no_work(monkeypatch):
    """Fail when scenes are loaded, or a daemon, painter or client is started."""

    def fail(*_args, **_kwargs):
        raise AssertionError(TOO_MUCH_WORK)

    for name in (
        "sim.scenes.load", "daemon.Daemon.__enter__", "daemon.estimate_once",
        "cli.demo.Painter.__enter__", "client.Client.__enter__", "mcu.session.Session.__init__",
        "calibrate.exposure_series.subprocess.Popen",
    ):  # fmt: skip
        monkeypatch.setattr(f"lightprobe.{name}", fail)


def command(capsys, *words):
    """(exit status, stdout, stderr) of `lightprobe WORDS`."""
    before, sys.argv = sys.argv, ["lightprobe", *map(str, words)]
    try:
        with pytest.raises(SystemExit) as done:
            program.main()
    finally:
        sys.argv = before
    out, err = capsys.readouterr()
    return done.value.code, out, err


def assert_one_sentence(status, out, err):
    assert status in (1, 2), err
    assert out == ""
    assert err.startswith("lightprobe: ")
    assert err.count("\n") == 1, err
    assert "/tmp/lightprobe-" not in err, "a temporary file is named instead of the user's"


NO_FOLDER = "nowhere/x"
#: Words of the command, and what the answer names.
REFUSED = [
    ("nothing-such", "No such command 'nothing-such'"),
    ("watch --seconds -3", "--seconds -3: expected more than 0 seconds"),
    ("watch --seconds nan", "--seconds nan"),
    ("watch --rate -1", "--rate -1: expected 0…1000"),
    ("watch --rate inf", "--rate inf"),
    ("watch --tolerance 50", "--tolerance 50: expected 0…1"),
    ("watch --tolerance nan", "--tolerance nan"),
    ("watch --order 9", "--order"),
    ("watch --lights 2.5", "--lights"),
    ("watch --count 0", "--count"),
    ("watch --kind both", "--kind both: expected AMBIENT or TOTAL"),
    ("watch tcp://127.0.0.1:7700", "expected tcp:HOST:PORT (without //)"),
    ("watch 127.0.0.1:7700", "expected tcp:HOST:PORT, unix:PATH, ws://HOST:PORT/"),
    ("doctor --wait nan", "--wait nan: expected 0.1…3600 seconds"),
    ("doctor --wait 0", "--wait 0"),
    ("demo --output words.txt", "--output words.txt: expected a folder"),
    ("demo --output words.txt/x", "--output words.txt/x: expected a folder"),
    ("demo --seconds nan", "--seconds nan"),
    ("demo --every-s 0", "--every-s 0: expected 1 or more seconds"),
    ("mcu watch --rate nan", "watch: --rate nan: expected 0.5…100 rings a second"),
    ("mcu watch --seconds -1", "--seconds -1: expected 0…1e+09 seconds"),
    ("mcu watch --seconds nan", "--seconds nan"),
    ("mcu move nan", "angle_deg nan: expected -327…327 degrees"),
    ("mcu move 400", "angle_deg 400"),
    ("mcu move 90 --slew-deg-s nan", "--slew-deg-s nan: expected 0…6553 degrees a second"),
    ("mcu move 90 --slew-deg-s -5", "--slew-deg-s -5"),
    ("mcu move 90 --hold-s nan", "--hold-s nan: expected 0…6553 seconds"),
    ("mcu ring --seconds nan", "--seconds nan: expected 0.05…100000 seconds"),
    ("mcu ring --seconds -2", "--seconds -2"),
    ("mcu flash --boot-baud -1", "--boot-baud"),
    ("calibrate supply nan", "calibrate supply: volts nan: expected 2.7…5.5 volts"),
    ("calibrate supply -- -3", "volts -3"),
    ("simulate --rate 0", "--rate 0: expected 0.1…1000 frames a second"),
    ("simulate --rate nan", "--rate nan"),
    ("simulate --chroma 411", "--chroma 411: expected 420, 422, 444"),
    ("simulate --act-s -1", "--act-s -1: expected 0 or more"),
    ("simulate --switch-s -1", "--switch-s -1"),
    ("simulate --turn-deg-s inf", "--turn-deg-s inf: expected a finite number"),
    ("simulate --flicker-hz -5", "--flicker-hz -5: expected 0…10000 Hz"),
    ("simulate --flicker-depth 2", "flicker: depths 2: expected shares, 0…1"),
    ("simulate --flicker-depth 0.3,x", "--flicker-depth 0.3,x: expected numbers"),
    ("simulate --flicker-phase nan", "flicker: phases nan: expected parts of a period"),
    ("simulate --flicker-wave saw", "flicker: wave saw: expected sine, rectified, square"),
    ("simulate --walk-m 3", "--walk-m 3: expected 0…2 metres"),
    ("simulate --walk-m 1 --firmware host", "--walk-m: the ring of --firmware cannot walk"),
    ("simulate --cover-to-s -1", "--cover-to-s -1: expected 0 or more"),
    ("simulate --row-time-us -1", "--row-time-us -1: expected 0"),
    ("simulate --row-time-us 50", "50 µs for each of 960 rows at 30 frames per second"),
    ("simulate --median-radiance -1", "--median-radiance -1"),
    ("simulate --full-well-e -1", "--full-well-e -1: expected 100…50000 electrons"),
    ("simulate --full-well-e 1e6", "--full-well-e 1e+06"),
    ("simulate --read-noise-e -1", "--read-noise-e -1"),
    ("simulate --exposure-us -5", "--exposure-us -5: expected more than 0, at most 1e+09"),
    ("simulate --exposure-us 0", "--exposure-us 0"),
    ("simulate --exposure-min-us 0", "--exposure-min-us 0: expected more than 0"),
    ("simulate --exposure-step-us -1", "--exposure-step-us -1: expected 0"),
    ("simulate --exposure-min-us 200 --exposure-max-us 100", "exposures of 200…100 µs: the least"),
    ("simulate --exposure-us nan", "--exposure-us nan"),
    ("simulate --seconds -1", "--seconds -1"),
    ("simulate --seed -1", "--seed"),
    ("simulate --quality 0", "--quality"),
    ("simulate --bracket 0", "--bracket"),
    ("simulate --polarizer nan", "--polarizer nan"),
    ("simulate --ring-spread 3", "--ring-spread 3"),
    ("simulate --cd-m2-per-unit 0", "--cd-m2-per-unit 0"),
    ("simulate --size 100", "--size 100: expected WIDTHxHEIGHT"),
    ("simulate --size 33x16", "expected even numbers"),
    ("simulate --format H264", "--format H264: expected one of"),
    ("simulate --response gamma:nan", "--response gamma:nan"),
    ("simulate --camera words.txt", "words.txt"),
    ("simulate --firmware big", "--firmware big: expected"),
    ("simulate --faults drop=-1", "drop=-1: expected a number, 0…1"),
    ("simulate --faults drop=nan", "drop=nan: expected a number"),
    ("simulate --faults late_ms=-5", "late_ms=-5: expected a number, 0 or more"),
    ("simulate --faults stall_after=1.5", "stall_after=1.5: expected a whole number"),
    ("simulate --faults hide_exposure=7", "hide_exposure=7: expected a whole number, 0…1"),
    ("simulate --faults sing=1", "unknown option sing"),
    ("simulate --truth nowhere/x", "--truth nowhere/x: expected a file that can be written"),
    ("simulate --truth a_folder", "it is a folder"),
    ("simulate --socket nowhere/x", "--socket nowhere/x: expected a path in a folder that exists"),
    ("simulate --control nowhere/x", "--control nowhere/x"),
    ("simulate --pty nowhere/x", "--pty nowhere/x"),
    ("simulate --eeprom nowhere/x", "--eeprom nowhere/x"),
    ("evaluate --json-file nowhere/x.json", "--json-file nowhere/x.json: expected a file"),
    ("evaluate --json-file a_folder", "it is a folder"),
    ("evaluate --plot nowhere/x.png", "--plot nowhere/x.png: expected a file that can be written"),
    ("evaluate --plot x.docx", "--plot x.docx: expected a name that ends in .png, .svg, .pdf"),
    ("evaluate --brackets 99", "--brackets 99"),
    ("evaluate --ring-parts good", "--ring-parts good: expected calibrated or uncalibrated"),
    ("evaluate --ring-parts calibrated --ring-sigma 0.1", "leave one of the two out"),
    ("evaluate --settings nonsense=1", "--settings nonsense=1"),
    ("evaluate --settings lights=many", "expected a whole number"),
    ("evaluate --seed -1", "--seed"),
    ("evaluate --jobs 0", "--jobs"),
    ("evaluate --response nothing", "--response nothing"),
    ("estimate", "Missing argument"),
    ("estimate nothing.jpg", "nothing.jpg: open: no such file"),
    ("estimate a_folder", "a_folder: open: no such file"),
    ("estimate words.txt", "words.txt: unknown kind"),
    ("estimate garbage.jpg", "garbage.jpg"),
    ("estimate empty.jpg", "empty.jpg"),
    ("estimate cut.jpg", "cut.jpg"),
    ("estimate square.jpg", "square.jpg: 64×64: an equirectangular picture is twice as wide"),
    ("estimate square.pfm", "square.pfm: 8×8: an equirectangular picture is twice as wide"),
    ("estimate dark.jpg bright.jpg", "their exposures with --exposure-us"),
    ("estimate dark.jpg bright.jpg --exposure-us 100", "one for each file"),
    (f"estimate {'dark.jpg ' * 33} --exposure-us {','.join(['100'] * 33)}",
     "33 files: at most 32 in one bracket"),
    ("estimate dark.jpg bright.jpg --exposure-us 0,100", "expected microseconds above 0"),
    ("estimate dark.jpg bright.jpg --exposure-us nan,100", "expected microseconds above 0"),
    ("estimate dark.jpg bright.jpg --exposure-us x", "expected numbers"),
    ("estimate dark.jpg small.jpg bright.jpg --exposure-us 100,400,1600",
     "small.jpg: 64×32, but dark.jpg: 128×64"),
    ("estimate bright.jpg middle.jpg dark.jpg --exposure-us 100,400,1600",
     "middle.jpg (400 us) is darker than bright.jpg (100 us)"),
    ("estimate dark.jpg bright.jpg middle.jpg --exposure-us 100,400,1600",
     "middle.jpg (1600 us) is darker than bright.jpg (400 us)"),
    ("estimate middle.jpg --kind both", "expected AMBIENT or TOTAL"),
    ("estimate middle.jpg --camera nowhere.camera", "nowhere.camera"),
    ("export", "Missing argument"),
    ("export x.png", "x.png: expected a name that ends in .hdr, .exr, .pfm, .glb"),
    ("export nowhere/x.hdr", "nowhere/x.hdr: expected a file that can be written"),
    ("export x.hdr --width 15", "--width"),
    ("export x.hdr --width 101", "--width 101: expected an even number"),
    ("export x.glb --key-light --reflection-map", "reflections would count it twice"),
    ("export x.hdr --width 102 --layout cross", "--width 102: expected a multiple of 4"),
    ("export x.hdr --layout sphere", "--layout sphere: expected equirect"),
    ("export x.glb --layout cross", "--layout cross: a .glb file has no layout"),
    ("export x.hdr --wait nan", "--wait nan"),
    ("export x.hdr --from tcp://h:1", "expected tcp:HOST:PORT (without //)"),
    ("bake words.txt x.png", "x.png: expected a name that ends in .npz, .ply, .glb"),
    ("bake words.txt x.ply", "words.txt: cannot be read as a mesh"),
    ("bake nowhere.obj x.npz", "nowhere.obj: cannot be read as a mesh"),
    ("bake nowhere.npz x.ply", "nowhere.npz: not a baked mesh"),
    ("bake words.txt x.npz --directions 65", "--directions 65: expected an even number"),
    ("bake words.txt x.ply --at 1,nan,2", "--at 1,nan,2: expected X,Y,Z in metres"),
    ("bake x.npz y.ply --flip", "x.npz is baked: give it with the mesh itself"),
    ("control status nowhere/x", "nowhere/x: No such file"),
    ("calibrate exposure words.txt", "expected a camera"),
    ("calibrate exposure sim:x --output words.txt/x.camera", "--output words.txt/x.camera"),
    ("calibrate exposure sim:x --patience-s nan", "--patience-s nan"),
    ("calibrate exposure sim:x --keep words.txt", "--keep words.txt: expected a folder"),
    ("calibrate response sim:x --plot nowhere/x.png", "--plot nowhere/x.png"),
    ("calibrate response sim:x --plot x.txt", "--plot x.txt: expected a name that ends in"),
    ("calibrate response sim:x --output a_folder", "it is a folder"),
    ("calibrate response dark.jpg --exposures x", "expected numbers"),
    ("calibrate response nothing.jpg --exposures 8", "nothing.jpg: open: no such file"),
    ("calibrate ring", "expected --levels LUX,LUX,… or --against URI"),
    ("calibrate ring --levels 10,100 --output words.txt/x", "words.txt is not a folder"),
    ("calibrate ring --levels 10,100 --seconds nan", "--seconds nan"),
    ("calibrate ring --levels 10,100 --divider-ohm 0", "--divider-ohm 0"),
    ("calibrate ring --levels dark", "--levels dark: expected lux above 0"),
    ("calibrate wheel --output words.txt/x", "words.txt is not a folder"),
]  # fmt: skip


@pytest.mark.usefixtures("_no_work", "pictures")
@pytest.mark.parametrize(("words", "message"), REFUSED, ids=[words for words, _ in REFUSED])
def test_bad_input_is_refused_at_once(words, message, capsys):
    status, out, err = command(capsys, *words.split())
    assert_one_sentence(status, out, err)
    assert message in err


@pytest.mark.usefixtures("_no_work")
def test_nothing_of_the_user_s_is_touched(pictures, capsys):
    def content():
        return {path: path.read_bytes() for path in pictures.rglob("*") if path.is_file()}

    before = content()
    for words, _ in REFUSED:
        command(capsys, *words.split())
    assert content() == before


@pytest.mark.usefixtures("_no_work", "pictures")
@pytest.mark.parametrize(
    "words", ["evaluate --plot a_folder/x.png", "demo --output a_folder/x", "simulate --truth x"]
)
def test_a_folder_without_permission(words, capsys, monkeypatch):
    """As for a user; the tests may run as root, who may write everywhere."""
    may = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK and may(path, mode))
    status, out, err = command(capsys, *words.split())
    assert_one_sentence(status, out, err)
    assert "permission denied" in err or "a folder that can be written" in err
