"""The sockets of this package's small servers."""

from __future__ import annotations

import os
import socket

from lightprobe.errors import LightprobeError


def listen(who: str, network: bool, port: int) -> socket.socket:
    """Listen for the network, by IPv6 too where there is, or for this machine alone.

    Raises LightprobeError in the name of `who`.
    """
    where = (
        ("::", port)
        if network and socket.has_dualstack_ipv6()
        else ("0.0.0.0" if network else "127.0.0.1", port)
    )
    try:
        return socket.create_server(
            where, family=socket.AF_INET6 if ":" in where[0] else socket.AF_INET,
            dualstack_ipv6=":" in where[0],
        )  # fmt: skip
    except OSError as error:
        # create_server() adds what the caller knows.
        words = os.strerror(error.errno) if error.errno else str(error)
        raise LightprobeError(f"{who}: port {port}: {words}: name another port") from None
