"""A client as a developer writes one, and a probe in thirty lines to try it with.

use_client.py GOLDEN: also decodes the frozen bytes in that folder. Needs the package and no more.
"""

import socket
import sys
import threading
from pathlib import Path

from lightprobe import Client, Estimate, Subscription
from lightprobe.convert import adapter
from lightprobe.wire import Decoder


def varint(value: int) -> bytes:
    """Base-128 varint."""
    data = bytearray()
    while value > 0x7F:
        data.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*data, value])


def probe(listener: socket.socket, golden: Path) -> None:
    """Greet as protocol 1.1, then send a frozen estimate that answers subscription 1."""
    connection, _ = listener.accept()
    hello = b"\x08\x01\x10\x01\x1a\x04test"  # protocol_major 1, protocol_minor 1, software
    connection.sendall(varint(len(hello) + 2) + b"\x0a" + varint(len(hello)) + hello)
    connection.recv(4096)
    estimate = (golden / "estimate_subscription.bin").read_bytes()
    # Field 16 of the estimate, a varint: 300 in the frozen bytes, 1 here, as long as it was.
    assert estimate.count(b"\x80\x01\xac\x02") == 1
    connection.sendall(estimate.replace(b"\x80\x01\xac\x02", b"\x80\x01\x81\x00"))
    connection.recv(4096)


def light_up(estimate: Estimate) -> list[float]:
    """Irradiance of the brightest lamp, in Unity's unit."""
    lights = sorted(estimate.lights, key=lambda light: -float(light.irradiance.sum()))
    return [float(value) for value in adapter("unity").light(lights[0].irradiance)]


def main() -> None:
    """Receive one estimate; decode all frozen messages of a probe."""
    golden = Path(sys.argv[1])
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=probe, args=(listener, golden), daemon=True).start()
        uri = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        with Client(uri, Subscription(kind="TOTAL", max_lights=8)) as client:
            estimate = client.receive(30.0)
            print(f"received {len(estimate.lights)} of subscription {estimate.subscription}")
            print(light_up(estimate))
    files = [path for path in sorted(golden.glob("*.bin")) if "from_client" not in path.name]
    messages = [message for path in files for message in Decoder().feed(path.read_bytes())]
    assert len(messages) == len(files)
    print(f"decoded {len(messages)}")


if __name__ == "__main__":
    main()
