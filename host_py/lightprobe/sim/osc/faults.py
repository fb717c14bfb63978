"""How the simulated THETA and its network misbehave when asked to, as real ones do unasked."""

from __future__ import annotations

from dataclasses import dataclass

from lightprobe.sim.faults import PictureFaults, fault


@dataclass(frozen=True)
class OscFaults(PictureFaults):
    """Options of `simulate --osc PORT --faults`."""

    slow_ms: float = fault(0.0, "each command is answered up to this late")
    busy: float = fault(0.0, "share of commands refused with serviceUnavailable", 0, 1)
    delay_jitter_frames: int = fault(0, "options take effect up to so many frames later still")
    burst_ms: float = fault(0.0, "once a second the network holds everything back for this long")
    pieces: int = fault(0, "1: what is sent is cut anywhere, headers and boundaries too", 0, 1)
    wrong_length: float = fault(0.0, "share of pictures with a wrong Content-Length", 0, 1)
    no_length: int = fault(0, "1: pictures have no Content-Length", 0, 1)
    bare_boundary: int = fault(0, "1: boundaries come without the two dashes of RFC 2046", 0, 1)
    end_after: int = fault(0, "frames until the camera ends the stream, each time; 0: never")
    size_after: int = fault(0, "frames until the stream changes its size, once; 0: never")
    network_after: int = fault(0, "frames until the network is lost without a word; 0: never")
    network_s: float = fault(0.0, "how long it stays lost; 0: for ever")
    sleep_s: float = fault(
        0.0, "idle seconds until the camera sleeps, at first; 0: its default, 180"
    )
    nonce_uses: int = fault(0, "requests until a password's nonce is stale; 0: never")
    charging: int = fault(0, "1: it charges, and refuses the live preview", 0, 1)
    playback: int = fault(0, "1: its screen shows the playback", 0, 1)
    hot: int = fault(0, "1: it is too hot to work", 0, 1)
    battery: float = fault(0.8, "level of its battery", 0, 1)
    temperature_c: float = fault(41.0, "of its board", -10, 100)
    old_firmware: int = fault(0, "1: the first one", 0, 1)
    refuse_processing: int = fault(
        0, "1: options that switch its image processing off are refused", 0, 1
    )
    keep_processing: int = fault(0, "1: they are accepted, and nothing changes", 0, 1)
    other_make: int = fault(
        0, "1: a camera of another make, which knows OSC and no live preview", 0, 1
    )
