"""Whether this machine is in a network: by the kernel's own tables, so that it costs nothing."""

from __future__ import annotations

import socket
import struct
from pathlib import Path

_SIOCGIFADDR = 0x8915
_GLOBAL_SCOPE = "00"


def connected(sys_net: Path = Path("/sys/class/net")) -> bool:
    """Whether an interface besides the loopback has a carrier, and an address."""
    try:
        interfaces = [path for path in sys_net.iterdir() if path.name != "lo"]
    except OSError:
        return False
    with_ipv6 = _with_ipv6()
    return any(
        _has_carrier(path) and (path.name in with_ipv6 or _has_ipv4(path.name))
        for path in interfaces
    )


def _has_carrier(interface: Path) -> bool:
    try:
        return (interface / "carrier").read_text().strip() == "1"
    except OSError:  # it is down
        return False


def _has_ipv4(name: str) -> bool:
    import fcntl  # not on Windows, where no interface is found above

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            fcntl.ioctl(asked, _SIOCGIFADDR, struct.pack("256s", name.encode()[:15]))
        except OSError:
            return False
    return True


def _with_ipv6() -> set[str]:
    """Names of those with an address that is not for their own cable alone."""
    try:
        rows = [line.split() for line in Path("/proc/net/if_inet6").read_text().splitlines()]
    except OSError:
        return set()
    return {row[5] for row in rows if len(row) == 6 and row[3] == _GLOBAL_SCOPE}
