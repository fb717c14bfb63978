"""Client, simulator and tool box of lightprobe, the appliance that measures real light for AR."""

from lightprobe.client import AsyncClient, Client
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, Light
from lightprobe.wire import Subscription

__version__ = "0.1.0"

__all__ = ["AsyncClient", "Client", "Estimate", "Light", "LightprobeError", "Subscription"]
