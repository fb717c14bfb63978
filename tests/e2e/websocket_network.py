"""Run by test_websocket_tls.py in a network namespace: wss: on an address that is not loopback."""

import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

from harness import LONG_S, Daemon, jpeg, run
from lightprobe import Client
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

ADDRESS, PORT = "192.0.2.10", 7702


def main(folder: Path) -> None:
    """Print one line for each case."""
    import test_websocket_tls
    import web_daemon

    for command in ("link set lo up", f"addr add {ADDRESS}/24 dev lo"):
        subprocess.run(["ip", *command.split()], check=True)
    pair, picture = folder / "pair", folder / "a.jpg"
    picture.write_bytes(jpeg())
    url = test_websocket_tls.make_pair(pair, "--host", ADDRESS, "--port", str(PORT))["url"]
    source = f"--source=file:{picture}?rate=30"
    with Daemon(source, f"--publish=wss:{ADDRESS}:{PORT}?pair={pair}"):
        with Client(url) as client:
            client.receive(LONG_S)
        print("with the address of pair: an estimate")
        fingerprint = url.split("sha256=")[1]
        refusal = test_websocket_tls.refusal_of(f"wss://{ADDRESS}:{PORT}/#sha256={fingerprint}")
        if "the token is missing" in refusal:
            print("without token: refused")
        token = url.split("token=")[1].split("&")[0]
        try:
            connect(
                f"wss://{ADDRESS}:{PORT}/",
                origin="https://evil.example",
                subprotocols=["lightprobe.v1", f"token.{token}"],
                ssl=web_daemon.unverified(),
                open_timeout=LONG_S,
            )
        except InvalidStatus as refused:
            print(f"a page of another origin: {refused.response.status_code}")
    status, _, _ = run(source, f"--publish=tcp:{ADDRESS}:7700")
    print(f"tcp: beyond loopback: status {status}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
