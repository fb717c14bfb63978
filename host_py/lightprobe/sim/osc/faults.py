"""How the simulated THETA and its network misbehave when asked to, as real ones do unasked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lightprobe.sim.faults import PictureFaults


@dataclass(frozen=True)
class OscFaults(PictureFaults):
    """Options of `simulate --osc PORT --faults`."""

    RANGES: ClassVar[dict[str, tuple[float, float]]] = {
        **PictureFaults.RANGES,
        **dict.fromkeys(
            ("busy", "wrong_length", "no_length", "bare_boundary", "pieces", "charging", "hot",
             "playback", "old_firmware", "other_make", "battery"), (0, 1)
        ),
        "temperature_c": (-10, 100),
    }  # fmt: skip

    slow_ms: float = 0.0  # each command is answered up to this late
    busy: float = 0.0  # share of commands refused with serviceUnavailable
    delay_jitter_frames: int = 0  # options take effect up to so many frames later still
    burst_ms: float = 0.0  # once a second the network holds everything back for this long
    pieces: int = 0  # 1: what is sent is cut anywhere, headers and boundaries too
    wrong_length: float = 0.0  # share of pictures with a wrong Content-Length
    no_length: int = 0  # 1: pictures have no Content-Length
    bare_boundary: int = 0  # 1: boundaries come without the two dashes of RFC 2046
    end_after: int = 0  # frames until the camera ends the stream, each time; 0: never
    size_after: int = 0  # frames until the stream changes its size, once; 0: never
    network_after: int = 0  # frames until the network is lost without a word; 0: never
    network_s: float = 0.0  # how long it stays lost; 0: for ever
    sleep_s: float = 0.0  # idle seconds until the camera sleeps, at first; 0: its default, 180
    nonce_uses: int = 0  # requests until a password's nonce is stale; 0: never
    charging: int = 0  # 1: it charges, and refuses the live preview
    playback: int = 0  # 1: its screen shows the playback
    hot: int = 0  # 1: it is too hot to work
    battery: float = 0.8  # level, 0…1; NaN: it does not tell
    temperature_c: float = 41.0  # of its board
    old_firmware: int = 0  # 1: the first one
    other_make: int = 0  # 1: a camera of another make, which knows OSC and no live preview
