"""What the fixtures are made of; a test module may override the fixture `probe_options`."""

from __future__ import annotations

from dataclasses import dataclass, field

from lightprobe.sim.world import Behaviour
from lightprobe.wire import Subscription

#: Luminance, cd/m², of radiance 1 in the simulated room.
CD_M2_PER_UNIT = 10.0


def _everything() -> Subscription:
    return Subscription(max_lights=8, sh_order=4, health_period_ms=200)


def _still() -> Behaviour:
    return Behaviour(act_s=0)


@dataclass(frozen=True)
class Options:
    """Camera, box and daemon of one test.

    @pytest.fixture
    def probe_options():
        return Options(lens="packaging/cameras/theta_s.camera", box=False)
    """

    size_px: tuple[int, int] = (480, 240)  # of the camera's pictures, both even
    rate_hz: float = 15.0  # of the camera
    lens: str = "equirect"  # or a camera file, which the daemon gets, too
    ambient: float = 30.0  # radiance of the room; 30 is a lit room, 300 cd/m²
    behaviour: Behaviour = field(default_factory=_still)  # how the probe turns, lamps flicker, …
    box: bool = True  # whether there are wheel and ring
    film: bool = True  # whether the wheel carries a polarizing film
    firmware: str = "host"  # or avr: the flashed binary in simavr
    daemon: tuple[str, ...] = ()  # more options of lightprobed
    subscription: Subscription = field(default_factory=_everything)  # of the connected client
    #: The time is this machine's: for apps that compare time stamps with a clock of their own.
    real_time: bool = False
    seed: int = 0  # of all noise
