"""A simulated THETA announces itself in the network, as a real one does in client mode.

What is announced is what owners of a THETA V have seen (DNS-SD): the service `_osc._tcp`, called
THETA with the serial number, without properties. RICOH's published interface does not mention it.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from zeroconf import Error, InterfaceChoice, ServiceInfo, Zeroconf

from lightprobe.errors import LightprobeError

SERVICE_TYPE = "_osc._tcp.local."
_MULTICAST = ("224.0.0.251", 5353)


@contextmanager
def announced(serial: str, host: str, port: int) -> Iterator[str]:
    """Announce a camera that listens there as long as the `with` block lasts; gives its name.

    `host` "" or 0.0.0.0 is all addresses of this machine: it announces the one that others reach.
    Raises LightprobeError when mDNS cannot be used.
    """
    try:
        own = socket.gethostbyname(host or "0.0.0.0")
        everywhere = ipaddress.ip_address(own).is_unspecified
        address = _reachable() if everywhere else own
        network = Zeroconf(interfaces=InterfaceChoice.Default if everywhere else [address])
    except (OSError, ValueError, RuntimeError) as error:
        raise LightprobeError(f"simulate: announce {host}: mDNS: {error}") from None
    with network:
        name = f"THETA{serial}"
        info = ServiceInfo(
            SERVICE_TYPE, f"{name}.{SERVICE_TYPE}", port=port, server=f"{name}.local.",
            addresses=[socket.inet_aton(address)],
        )  # fmt: skip
        try:
            network.register_service(info, allow_name_change=True)
        except (OSError, Error) as error:
            raise LightprobeError(f"simulate: announce {name}: mDNS: {error}") from None
        yield info.name.removesuffix(f".{SERVICE_TYPE}")
        network.unregister_all_services()


def _reachable() -> str:
    """Address of this machine in the network that multicast goes to; raises OSError."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(_MULTICAST)
        return str(probe.getsockname()[0])
