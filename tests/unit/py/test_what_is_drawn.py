"""What is drawn: words of the command line, fields of the wire, and what is not met."""

from pathlib import Path

import pytest
from lightprobe import drawn, wire
from lightprobe.errors import UsageError
from lightprobe.trade import DRAWS
from lightprobe.wire import Subscription, SubscriptionError
from lightprobe_proto import lightprobe_pb2 as pb

GOLDEN = Path(__file__).resolve().parents[3] / "proto" / "golden"


def sent(**fields):
    data = wire.encode_subscription(Subscription(**fields), 1)
    return pb.FromClient.FromString(data[1:]).subscribe


def test_the_words_are_those_of_trade():
    assert tuple(DRAWS) == drawn.THINGS
    assert drawn.parse("matt:2%, shadows:5%,metal:0.5 %,chrome:10%", "watch") == {
        "diffuse": 0.02, "shadows": 0.05, "glossy": 0.005, "mirrors": 0.1,
    }  # fmt: skip


@pytest.mark.parametrize("wrong", ["glass:2%", "chrome", "chrome:2", "chrome:0%", "chrome:200%"])
def test_other_words_are_refused(wrong):
    with pytest.raises(UsageError, match=r"watch: --draws .*: expected"):
        drawn.parse(wrong, "watch")


@pytest.mark.parametrize("wrong", [{"glass": 0.1}, {"diffuse": 0.0}, {"diffuse": float("nan")}])
def test_a_subscription_that_no_probe_could_serve(wrong):
    with pytest.raises(SubscriptionError, match=r"subscription: draws = "):
        Subscription(draws=wrong)


def test_bounds_are_the_most_there_is_unless_said():
    wish = Subscription(draws={"mirrors": 0.1})
    assert (wish.sh_order, wish.max_lights, wish.reflection_map_size) == (4, 8, 64)
    wish = Subscription(draws={"diffuse": 0.1}, sh_order=2, max_lights=4)
    assert (wish.sh_order, wish.max_lights, wish.reflection_map_size) == (2, 4, 0)
    plain = Subscription()
    assert (plain.sh_order, plain.max_lights, plain.reflection_map_size) == (2, 4, 0)


def test_what_is_sent():
    wish = sent(draws={"diffuse": 0.02, "mirrors": 0.1}, reflection_map_size=16)
    assert (wish.draws.diffuse_permille, wish.draws.mirrors_permille) == (20, 100)
    assert not wish.draws.HasField("glossy_permille")
    assert wish.reflection_map.size == 16
    assert not sent().HasField("draws")
    none = sent(draws={"mirrors": 0.1}, reflection_map_size=0)  # none may be sent
    assert none.HasField("reflection_map")
    assert none.reflection_map.size == 0


def test_what_comes_back():
    (estimate,) = wire.Decoder().feed((GOLDEN / "estimate_drawn.bin").read_bytes())
    assert estimate.drawn == {"diffuse": 0.021, "shadows": 0.0, "mirrors": 1000.0}
    assert estimate.to_json()["model"]["drawn"] == estimate.drawn
    (mirrored,) = wire.Decoder().feed((GOLDEN / "reflection_map_drawn.bin").read_bytes())
    assert mirrored.drawn == {"glossy": 0.003, "mirrors": 0.109}
    asked = {"diffuse": 0.02, "shadows": 0.01, "glossy": 0.5}
    assert drawn.unmet(asked, estimate.drawn) == ("diffuse", "glossy")
    assert drawn.words(asked, estimate.drawn) == (
        "diffuse 2.1 % (asked: 2 %), shadows 0.0 %, glossy unknown (asked: 50 %)"
    )
