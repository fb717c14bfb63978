"""Soak: simulated frames as fast as the daemon takes them; its memory must stay flat.

    soak.py [--frames N]    default: an hour of a 30 Hz camera

A closed loop: the next frame goes out when the last one's estimate has come, so that none is
dropped and time is compressed as far as the machine allows. Clients come and go meanwhile, some of
them badly, the camera is unplugged now and then, and damaged frames are mixed in.
"""

import argparse
import sys
import time

from harness import Daemon, camera, jpeg, panorama

HOUR = 30 * 3600
ALLOWED_KIB = 1024
WIDTH, HEIGHT = 256, 128
PICTURES = [jpeg(panorama(WIDTH, level=40 + 5 * i, lamp_column=i / 16)) for i in range(16)]


def exchange(cam, client, number):
    """One frame out, its estimate back."""
    cam.send(PICTURES[number % 16], width=WIDTH, height=HEIGHT, exposure_us=1000 + number % 7)
    client.until(lambda e: not e.flags & 1)


def disturb(daemon, cam, number):
    """What happens on some day or other."""
    if number % 50 == 0:
        cam.send(PICTURES[0][: 200 + number % 400], width=WIDTH, height=HEIGHT)
    if number % 20 == 0:
        with daemon.client(sh_order=number % 5, max_lights=number % 9) as visitor:
            if number % 40 == 0:
                visitor.next("estimate")
    if number % 500 == 250:
        with daemon.client() as visitor:
            visitor.socket.sendall(b"\x05\xff\xff\xff\xff\xff")
            visitor.wait_closed()


def soak(frames: int) -> int:
    """Run; returns how many KiB resident memory grew after a tenth of the frames."""
    begin = time.monotonic()
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", "--ttl-ms=60000", variant="release") as daemon,
        daemon.client() as client,
        daemon.client(rate_hz=0.001, health_period_ms=100) as watcher,
    ):
        cam.accept()
        before = 0
        for number in range(frames):
            exchange(cam, client, number)
            disturb(daemon, cam, number)
            if number % 1000 == 999:
                cam.unplug()
                cam.accept()
            if number == frames // 10:
                before = watcher.until(lambda h: h.uptime_ms > 0, "health").rss_kib
                watcher.messages.clear()
        done = watcher.until(lambda h, n=frames: h.estimates >= n, "health")
    seconds = time.monotonic() - begin
    growth_kib = done.rss_kib - before
    print(
        f"soak: {frames} frames ({frames / 30 / 60:.0f} min at 30 Hz) in {seconds:.0f} s, "
        f"{done.frames_rejected} damaged, {done.source_reconnects} reconnects, "
        f"rss {before} -> {done.rss_kib} KiB ({growth_kib:+d})"
    )
    return growth_kib


def main() -> int:
    """Exit status 1 when memory grew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=HOUR)
    growth_kib = soak(parser.parse_args().frames)
    if growth_kib > ALLOWED_KIB:
        print(f"soak: memory grew by {growth_kib} KiB, more than {ALLOWED_KIB}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
