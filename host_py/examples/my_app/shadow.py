"""A small app: the strongest lamp casts the shadow of a virtual object."""

from __future__ import annotations

from dataclasses import dataclass

from lightprobe import Client, Estimate, EstimateFlag, Subscription, fallback_estimate

#: What the app asks the probe for.
WISH = Subscription(max_lights=4)
#: Light with one of these flags is not good enough for a shadow.
UNFIT = EstimateFlag.STALE | EstimateFlag.RING_ONLY | EstimateFlag.NO_LIGHT


@dataclass(frozen=True)
class Shadow:
    """A shadow on the table."""

    azimuth_deg: float  # of the lamp: 0 ahead, positive to the right
    elevation_deg: float
    darkness: float  # 0…1


def shadow_of(estimate: Estimate) -> Shadow | None:
    """Give the shadow that the strongest lamp casts; None where no lamp is known well enough."""
    if estimate.flags & UNFIT or not estimate.lights:
        return None
    lamp = estimate.lights[0]
    return Shadow(lamp.azimuth_deg, lamp.elevation_deg, lamp.shadow_strength or 0.0)


class App:
    """The app with its own client."""

    def __init__(self, uri: str) -> None:
        """Connect to a probe; it tries again until there is one."""
        self._client = Client(uri, WISH)
        self._last: Estimate | None = None

    def __enter__(self) -> App:
        """Connect."""
        self._client.__enter__()
        return self

    def __exit__(self, *reason: object) -> None:
        """Leave."""
        self._client.__exit__(None, None, None)

    def light(self, timeout_s: float = 20.0) -> Estimate:
        """Give the newest light, or one that fades out when none comes in time."""
        try:
            self._last = self._client.receive(timeout_s)
        except TimeoutError:
            return fallback_estimate(self._last)
        return self._last
