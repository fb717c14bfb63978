"""Client, simulator and tool box of lightprobe, the appliance that measures real light for AR.

>>> from lightprobe import Client
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightprobe.client import AsyncClient, Client
    from lightprobe.errors import IncompatibleProbe, LightprobeError, ProbeError, ProbeTimeout
    from lightprobe.estimate import Estimate, EstimateFlag, Light, LightFlag, Room
    from lightprobe.fallback import fallback_estimate
    from lightprobe.reflection_map import ReflectionMap
    from lightprobe.wire import Subscription, SubscriptionError

__version__ = "0.1.0"

__all__ = [
    "AsyncClient", "Client", "Estimate", "EstimateFlag", "IncompatibleProbe", "Light", "LightFlag",
    "LightprobeError", "ProbeError", "ProbeTimeout", "ReflectionMap", "Room",
    "Subscription", "SubscriptionError", "fallback_estimate",
]  # fmt: skip

_HOMES = {
    "client": ("AsyncClient", "Client"),
    "errors": ("IncompatibleProbe", "LightprobeError", "ProbeError", "ProbeTimeout"),
    "estimate": ("Estimate", "EstimateFlag", "Light", "LightFlag", "Room"),
    "fallback": ("fallback_estimate",),
    "reflection_map": ("ReflectionMap",),
    "wire": ("Subscription", "SubscriptionError"),
}


def __getattr__(name: str) -> Any:
    """Load a name's module when it is first used: `lightprobe --help` needs none of them."""
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"lightprobe.{module}"), name)
    raise AttributeError(f"module 'lightprobe' has no attribute {name!r}")


def __dir__() -> list[str]:
    """What there is to be used, loaded or not."""
    return sorted({*globals(), *__all__})
