"""`lightprobe simulate`: the world, a camera in it, and the box with wheel and ring beside it."""

from __future__ import annotations

import json
import math
import signal
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, TextIO

import cv2
import typer

from lightprobe.cli import (
    check,
    scenario,
    simulate_faults,
    simulate_movers,
    simulate_osc,
    simulate_path,
)
from lightprobe.cli.estimate import Film, parse_film
from lightprobe.cli.simulate_control import Desk, illuminated
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.sim import faults as misbehaviour
from lightprobe.sim import response as responses
from lightprobe.sim import scenes
from lightprobe.sim.box import FIRMWARES, Box
from lightprobe.sim.camera import Shot, SimulatedCamera, check_row_time
from lightprobe.sim.control import Control, require_unix_sockets
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.flicker import WAVES, Flicker
from lightprobe.sim.formats import FORMATS
from lightprobe.sim.headset import Headset, HeadsetLog
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.link import Exposure, Link, Surroundings
from lightprobe.sim.movers import Movers
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing
from lightprobe.sim.sensor import CHROMA, FULL_WELL_E, READ_NOISE_E, SensorModel
from lightprobe.sim.surroundings import FixedPolarizer, WheelAndRing, draw_ring
from lightprobe.sim.truth import TruthServer
from lightprobe.sim.world import Behaviour, World

#: Median radiance that scenes are brought to: a quarter of full scale in 1/120 s.
MEDIAN_RADIANCE = 30.0

_exposure = check.number(0, 1e9, "microseconds", above=True)


def command(
    path: Annotated[
        Path, typer.Option("--socket", callback=check.new_socket, help="Unix socket to listen on.")
    ] = Path("/tmp/lightprobe-sim.sock"),
    scene: Annotated[
        list[str],
        typer.Option(
            "--scenes",
            metavar="WHAT",
            help="room, procedural[:N], blender, sky[:ELEVATION], polished:WHAT, FILE, FOLDER.",
        ),
    ] = ["room"],  # noqa: B006 - typer copies it
    act_s: Annotated[
        float,
        typer.Option(callback=check.number(0), help="Seconds per scene; 0: the first for ever."),
    ] = 8.0,
    turn_deg_s: Annotated[
        float, typer.Option(callback=check.number(), help="Scenes turn at this rate.")
    ] = 0.0,
    swing_deg: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 180), help="And to and fro by so much, as before a head."
        ),
    ] = 0.0,
    swing_hz: Annotated[
        float, typer.Option(callback=check.number(0, 5, "Hz"), help="So often.")
    ] = 0.5,
    nod_deg: Annotated[
        float,
        typer.Option(callback=check.number(0, 80), help="And the camera nods, up and down."),
    ] = 0.0,
    nod_hz: Annotated[
        float, typer.Option(callback=check.number(0, 5, "Hz"), help="So often.")
    ] = Behaviour.nod_hz,
    roll_deg: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 180), help="And it rolls about where it looks, by so much."
        ),
    ] = 0.0,
    roll_hz: Annotated[
        float, typer.Option(callback=check.number(0, 5, "Hz"), help="So often.")
    ] = Behaviour.roll_hz,
    motion: Annotated[
        Path | None,
        typer.Option(
            "--path",
            metavar="FILE",
            help="The camera is turned and, in the room, goes as recorded: a file of TUM's or "
            "EuRoC's form. Instead of all other motion.",
        ),
    ] = None,
    switch_s: Annotated[
        float,
        typer.Option(
            callback=check.number(0), help="Switch lamps off in turn, for this many seconds each."
        ),
    ] = 0.0,
    flicker_hz: Annotated[
        float,
        typer.Option(callback=check.number(0, 1e4, "Hz"), help="Lamps flicker; mains: 100 or 120."),
    ] = 0.0,
    flicker_depth: Annotated[
        str, typer.Option(metavar="SHARE,…", help="Share that lamps lose; 1st lamp, 2nd, …")
    ] = "0.3",
    flicker_phase: Annotated[
        str, typer.Option(metavar="PART,…", help="Parts of a period by which lamps are ahead.")
    ] = "0",
    flicker_wave: Annotated[
        str, typer.Option(metavar="WAVE,…", help=f"Of {', '.join(WAVES)}.")
    ] = "sine",
    walk_m: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 2, "metres"),
            help="The camera walks across the room, so far to each side (--scenes room).",
        ),
    ] = 0.0,
    walk_m_s: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 10, "metres a second", above=True),
            help="At this speed in the middle.",
        ),
    ] = 1.0,
    cover_from_s: Annotated[
        float,
        typer.Option(
            callback=check.number(0, unit="seconds"),
            help="From then on somebody covers the right half of the camera's view.",
        ),
    ] = 0.0,
    cover_to_s: Annotated[
        float, typer.Option(callback=check.number(0, unit="seconds"), help="Until then.")
    ] = 0.0,
    walkers: simulate_movers.Walkers = simulate_movers.DEFAULT.walkers,
    walker_m: simulate_movers.Distance = simulate_movers.DEFAULT.walker_m,
    walker_m_s: simulate_movers.Speed = simulate_movers.DEFAULT.walker_m_s,
    walker_deg: simulate_movers.Bearing = simulate_movers.DEFAULT.walker_deg,
    walker_height_m: simulate_movers.Height = simulate_movers.DEFAULT.walker_height_m,
    walker_albedo: simulate_movers.Albedo = simulate_movers.ALBEDO,
    walker_stand_s: simulate_movers.Stand = simulate_movers.DEFAULT.walker_stand_s,
    door_s: simulate_movers.DoorPeriod = simulate_movers.DEFAULT.door_s,
    door_gain: simulate_movers.DoorGain = simulate_movers.DEFAULT.door_gain,
    leaves_deg: simulate_movers.LeavesSize = simulate_movers.DEFAULT.leaves_deg,
    leaves_hz: simulate_movers.LeavesRate = simulate_movers.DEFAULT.leaves_hz,
    screen_deg: simulate_movers.ScreenWidth = simulate_movers.DEFAULT.screen_deg,
    median_radiance: Annotated[
        float,
        typer.Option(
            callback=check.number(0),
            help="Scale scenes to this median (full scale at 1 s = 1); 0: leave them.",
        ),
    ] = MEDIAN_RADIANCE,
    lens: Annotated[
        str, typer.Option("--camera", metavar="equirect|FILE", help="equirect, or a camera file.")
    ] = "equirect",
    size: Annotated[str, typer.Option(metavar="WxH", help="Picture size in pixels.")] = "1920x960",
    rate_hz: Annotated[
        float,
        typer.Option(
            "--rate", callback=check.number(0.1, 1000, "frames a second"), help="Frames per second."
        ),
    ] = 30.0,
    row_time_us: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 1e5, "microseconds"),
            help="Rolling shutter: each row is exposed so much later than the row above.",
        ),
    ] = 0.0,
    pixel_format: Annotated[
        str, typer.Option("--format", help=", ".join(FORMATS) + " (float, no noise).")
    ] = "MJPG",
    quality: Annotated[int, typer.Option(min=1, max=100, help="Quality of the JPEG.")] = 85,
    chroma: Annotated[
        str,
        typer.Option(
            callback=check.one_of(CHROMA), help="Chroma subsampling of the JPEG: 420, 422 or 444."
        ),
    ] = "420",
    exposure_us: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, 1e9, "microseconds", above=True),
            help="Fixed exposure, whatever the limits; default: automatic until commanded.",
        ),
    ] = None,
    exposure_min_us: Annotated[
        float,
        typer.Option(callback=_exposure, help="Shortest exposure that can be commanded."),
    ] = ExposureLimits.least_us,
    exposure_max_us: Annotated[
        float,
        typer.Option(
            callback=_exposure, help="Longest one; never longer than the time between frames."
        ),
    ] = ExposureLimits.most_us,
    exposure_step_us: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 1e9, "microseconds"),
            help="Commands are rounded to this; 0: they are not.",
        ),
    ] = ExposureLimits.step_us,
    bracket: Annotated[
        int,
        typer.Option(min=1, max=8, help="Number of exposures that automatic mode cycles through."),
    ] = 1,
    delay_frames: Annotated[
        int, typer.Option(min=0, max=4, help="Frames from an exposure command to its effect.")
    ] = 2,
    full_well_e: Annotated[
        float,
        typer.Option(
            callback=check.number(*FULL_WELL_E, "electrons"), help="Electrons that fill a pixel."
        ),
    ] = 12000.0,
    read_noise_e: Annotated[
        float,
        typer.Option(
            callback=check.number(*READ_NOISE_E, "electrons"), help="Read noise, electrons."
        ),
    ] = 3.0,
    response: Annotated[
        str | None,
        typer.Option(
            metavar="CURVE", help=f"{responses.HELP}; default: the response of the camera file."
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the noise: the same seed gives the same frames.")
    ] = 0,
    firmware: Annotated[
        str,
        typer.Option(help="Wheel and ring: host, avr (the flashed binary in simavr), or none."),
    ] = "none",
    pty: Annotated[
        Path,
        typer.Option(
            metavar="PATH",
            callback=check.new_socket,
            help="Path of the serial line (pty) to create for the firmware.",
        ),
    ] = Path("/tmp/lightprobe-mcu"),
    eeprom: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=check.new_file(),
            help="File that keeps the firmware's parameters.",
        ),
    ] = None,
    polarizer: Annotated[
        str | None,
        typer.Option(
            metavar="DEG[,DEG…]",
            help="Without firmware: put a fixed polarizer at this angle; several: one behind the "
            "other, the outermost first (90,45,0: the published stack).",
        ),
    ] = None,
    film: Film = None,
    cd_m2_per_unit: Annotated[
        float,
        typer.Option(
            callback=check.number(1e-6, 1e6), help="Luminance of radiance 1, for the ring."
        ),
    ] = 2.0,
    ring_spread: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 2), help="Spread of the LDRs: 0 none, 1 as real ones."
        ),
    ] = 0.0,
    osc: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            min=0,
            max=65535,
            help="A RICOH THETA behind its Web API on this TCP port instead of the socket; "
            "0: any free one.",
        ),
    ] = None,
    osc_model: Annotated[
        str,
        typer.Option(
            callback=check.one_of(simulate_osc.MODELS),
            help=f"With --osc: {', '.join(simulate_osc.MODELS)}. Sizes and rates are the model's.",
        ),
    ] = "x",
    osc_host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="With --osc: the address to listen on.")
    ] = "127.0.0.1",
    osc_password_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="With --osc: ask for a password, as in client mode: a line USER:PASSWORD.",
        ),
    ] = None,
    keep_pictures: Annotated[
        int,
        typer.Option(
            min=0,
            max=64,
            help="While nothing changes, repeat so many pictures of each exposure, noise and all: "
            "for rates that this machine is too slow to draw; 0: all are new.",
        ),
    ] = 0,
    headset: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=check.new_file(),
            help="Write the poses of a headset that carries the probe, for `lightprobe align`: "
            "one JSON line each.",
        ),
    ] = None,
    headset_mount: Annotated[
        str, typer.Option(metavar="X,Y,Z,W", help="How the probe sits on it: probe to head.")
    ] = "0,0,0,1",
    headset_noise_deg: Annotated[
        float, typer.Option(callback=check.number(0, 10), help="Noise of its poses, 1 sigma.")
    ] = Headset.noise_deg,
    headset_late_ms: Annotated[
        float,
        typer.Option(
            callback=check.number(-1000, 1000, "milliseconds"), help="Its poses are stamped late."
        ),
    ] = Headset.late_ms,
    faults: Annotated[
        str,
        typer.Option(
            metavar=scenario.NAMED,
            help="What goes wrong with camera, wheel, ring and line: see --help-faults.",
        ),
    ] = "",
    processing: Annotated[
        str,
        typer.Option(
            metavar=scenario.NAMED,
            help="What the camera does to its pictures, as sharpen=0.7&tone_ev=1: see "
            "--help-scenario.",
        ),
    ] = "",
    lens_defects: Annotated[
        str,
        typer.Option(
            metavar=scenario.NAMED,
            help="What its lens does to light, as glare=0.02&drops=3: see --help-scenario.",
        ),
    ] = "",
    pixel_defects: Annotated[
        str,
        typer.Option(
            metavar=scenario.NAMED,
            help="Pixels that are not as the others, as stuck=12&warm=20&bayer=1: see "
            "--help-scenario.",
        ),
    ] = "",
    scenario_file: Annotated[
        Path | None,
        typer.Option(
            "--scenario",
            metavar="FILE",
            is_eager=True,
            callback=scenario.read,
            help="World, camera, wheel and ring from a file; options count before it.",
        ),
    ] = None,
    help_scenario: Annotated[
        bool,
        typer.Option(
            "--help-scenario",
            is_eager=True,
            callback=scenario.show,
            help="Print such a file, with every key, its default and what it means, and exit.",
        ),
    ] = False,
    help_faults: Annotated[
        bool,
        typer.Option(
            "--help-faults",
            is_eager=True,
            callback=simulate_faults.show,
            help="List all faults, with what each does and may be, and exit.",
        ),
    ] = False,
    control: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH", callback=check.new_socket, help="Unix socket for `lightprobe control`."
        ),
    ] = None,
    truth_publish: Annotated[
        str | None,
        typer.Option(
            metavar="URI",
            help="Publish the truth as a probe of its own: ws:127.0.0.1:PORT or tcp:….",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=check.new_file(),
            help="Write the truth, one JSON line per frame.",
        ),
    ] = None,
    seconds: check.Seconds = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print counters as JSON at the end.")] = (
        False
    ),
) -> None:
    """Simulate a camera in a world, with polarizer wheel and ring, by their physics.

    The daemon connects with --source=sim:SOCKET, and can also ask for faults:
    --source='sim:SOCKET?late_ms=40&drop=0.1'. With --osc PORT the camera is a THETA on the
    network, and the daemon connects with --source=osc:localhost:PORT. With --firmware it finds
    the microcontroller at --rotator=mcu:serial:PTY --ring=mcu:serial:PTY. Ends on Ctrl-C.
    """
    require_unix_sockets("simulate")
    if firmware not in FIRMWARES:
        raise UsageError(f"simulate: --firmware {firmware}: expected {', '.join(FIRMWARES)}")
    if firmware != "none" and polarizer:
        raise UsageError(
            "simulate: --polarizer: the wheel of --firmware turns the polarizer: "
            "leave one of the two out"
        )
    if firmware != "none" and walk_m:
        raise UsageError(
            "simulate: --walk-m: the ring of --firmware cannot walk: leave one of the two out"
        )
    carrier = Headset(
        quaternion("--headset-mount", headset_mount), noise_deg=headset_noise_deg,
        late_ms=headset_late_ms, seed=seed,
    )  # fmt: skip
    if osc is not None:
        if headset is not None:
            raise UsageError("simulate: --headset: not with --osc: leave one of the two out")
        simulate_osc.refuse_others(firmware, polarizer, lens, pixel_format)
    elif firmware == "none":
        misbehaviour.Faults().merged(faults)
    size_px, kind = parse_size(size), parse_format(pixel_format)
    check_row_time(row_time_us, size_px, rate_hz)
    flicker = Flicker(
        flicker_hz, numbers("--flicker-depth", flicker_depth),
        numbers("--flicker-phase", flicker_phase), tuple(flicker_wave.split(",")),
    )  # fmt: skip
    limits = ExposureLimits(exposure_min_us, exposure_max_us, exposure_step_us)
    curve = None if response is None else responses.parse(response)
    optics = lenses.load(lens)
    stack_deg = numbers("--polarizer", polarizer) if polarizer else ()
    if not all(map(math.isfinite, stack_deg)):
        raise UsageError(f"simulate: --polarizer {polarizer}: expected degrees, as 90 or 90,45,0")
    sheet = parse_film(film) or optics.sheet if polarizer or firmware != "none" else None
    movers = Movers(
        walkers, walker_m, walker_m_s, walker_deg, walker_height_m,
        simulate_movers.albedos(walker_albedo), walker_stand_s, door_s, door_gain, leaves_deg,
        leaves_hz, screen_deg,
    )  # fmt: skip
    chosen = scenes.load(scene)
    behaviour = Behaviour(
        act_s, turn_deg_s, swing_deg, swing_hz, switch_s, flicker,
        walk_m, walk_m_s, cover_from_s, cover_to_s, nod_deg, nod_hz, roll_deg, roll_hz,
        simulate_path.read(motion, chosen, firmware != "none"), movers,
    )  # fmt: skip
    world = World(chosen, behaviour, median_radiance or None)
    after = Processing().merged(processing)
    before = LensDefects().merged(lens_defects)
    pixels = PixelDefects().merged(pixel_defects)
    if osc is not None:
        cv2.setNumThreads(1)
        simulate_osc.serve(
            world, osc_model, (osc_host, osc), osc_password_file, faults=faults, seconds=seconds,
            delay_frames=delay_frames, seed=seed, quality=quality, chroma=chroma,
            sensor=SensorModel(full_well_e, read_noise_e), response=curve, truth=truth,
            control=control, as_json=as_json, kept=keep_pictures, processing=after,
            lens_defects=before, pixels=pixels,
        )  # fmt: skip
        return
    simulated = SimulatedCamera(
        world, optics, size_px, rate_hz=rate_hz, pixel_format=kind, quality=quality, chroma=chroma,
        seed=seed,
        model=SensorModel(full_well_e, read_noise_e), sheet=sheet,
        stack_deg=stack_deg if len(stack_deg) > 1 else (),
        response=curve, limits=limits, row_time_us=row_time_us, kept=keep_pictures,
        processing=after, lens_defects=before, pixels=pixels,
    )  # fmt: skip
    fixed = None if exposure_us is None else Shot(exposure_us)
    exposure = Exposure(simulated, bracket, fixed, delay_frames)
    cv2.setNumThreads(1)  # one core is enough; the daemon wants the others
    with ExitStack() as stack:
        log = stack.enter_context(open_truth(truth)) if truth else None
        around: Surroundings | None = None
        if stack_deg:
            around = FixedPolarizer(stack_deg[0])
        light, box = None, None
        if firmware != "none":
            parts, built = draw_ring(ring_spread, seed)
            light = RingLight(world, cd_m2_per_unit, parts if ring_spread else None)
            box = stack.enter_context(Box(firmware, pty, seed, eeprom))
            box.set(**built)
            around = WheelAndRing(box, light)
        link = Link(path, simulated, exposure, truth=log, surroundings=around)
        link.misbehave(faults)
        if truth_publish is not None:
            stack.enter_context(
                TruthServer(truth_publish, lambda: (link.state_now(), simulated.gain))
            )
        if headset is not None:
            log_poses = HeadsetLog(headset, carrier, world, link.begin_ns(0))
            stack.enter_context(log_poses)
        lit = None
        if box is not None and light is not None:
            lit = stack.enter_context(illuminated(link, box, light))
        if control is not None:
            handlers = Desk(link, box, light, lit).handlers()
            stack.enter_context(Control(control, handlers))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: link.stop())
        typer.echo(f"simulate: {path}: waiting for lightprobed --source=sim:{path}", err=True)
        if box is not None:
            uri = f"mcu:serial:{pty}"
            typer.echo(
                f"simulate: {pty}: microcontroller, firmware {firmware}: "
                f"lightprobed --rotator={uri} --ring={uri}",
                err=True,
            )
        link.serve(seconds)
        if lit is not None and lit.error is not None:
            raise lit.error
    counters = asdict(link.counters)
    typer.echo(
        json.dumps(counters)
        if as_json
        else f"simulate: {', '.join(f'{value} {key}' for key, value in counters.items())}"
    )


def numbers(option: str, text: str) -> tuple[float, ...]:
    """Parse numbers with commas between; raises UsageError."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"simulate: {option} {text}: expected numbers, as 0.3,0.9") from None


def quaternion(option: str, text: str) -> tuple[float, float, float, float]:
    """Parse x, y, z, w of a rotation; raises UsageError."""
    values = numbers(option, text)
    if len(values) != 4 or not abs(math.hypot(*values) - 1) < 0.01:
        raise UsageError(
            f"simulate: {option} {text}: expected a unit quaternion X,Y,Z,W, as 0,0.7071,0,0.7071"
        )
    return values[0], values[1], values[2], values[3]


def open_truth(path: Path) -> TextIO:
    """Open the account of what is true; raises UsageError."""
    try:
        return open(path, "w", encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"simulate: --truth {path}: open: {error.strerror}: name another file"
        ) from None


def parse_size(text: str) -> tuple[int, int]:
    """Read `WxH`; raises UsageError."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise UsageError(f"simulate: --size {text}: expected WIDTHxHEIGHT, like 1920x960")
    size = int(width), int(height)
    if any(side % 2 or not 16 <= side <= 8192 for side in size):
        raise UsageError(f"simulate: --size {text}: expected even numbers, 16…8192")
    return size


def parse_format(text: str) -> str:
    """Check a pixel format; raises UsageError."""
    if text.upper() not in FORMATS:
        raise UsageError(f"simulate: --format {text}: expected one of {', '.join(FORMATS)}")
    return text.upper()
