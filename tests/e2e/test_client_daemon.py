"""The Python client and the real daemon."""

import pytest
from harness import LONG_S, Daemon, jpeg
from lightprobe.client import Client
from lightprobe.wire import Subscription


@pytest.fixture(scope="module")
def uri(tmp_path_factory):
    picture = tmp_path_factory.mktemp("picture") / "a.jpg"
    picture.write_bytes(jpeg())
    with Daemon(f"--source=file:{picture}?rate=30") as daemon:
        yield f"unix:{daemon.socket}"


def take(client: Client, count: int) -> list[tuple[str, int]]:
    got = [client.receive(LONG_S) for _ in range(count)]
    return [(e.sh.kind, e.subscription) for e in got]


def test_the_first_estimate_is_of_the_subscription_asked_for(uri):
    """A probe sends the newest estimate of its defaults at once: that one is not ours."""
    for _ in range(5):
        with Client(uri, Subscription(kind="TOTAL", sh_order=4)) as client:
            assert take(client, 3) == [("TOTAL", 1)] * 3
            assert client.hello is not None
            assert client.hello.protocol_minor >= 1
            # The order that nobody had asked for is computed from the next frame on.
            assert client.wait_for(lambda c: c.receive(LONG_S).sh.order == 4, LONG_S)


def test_after_a_new_subscription_nothing_of_the_former_is_received(uri):
    with Client(uri) as client:
        assert take(client, 2) == [("AMBIENT", 1)] * 2
        for number, kind in enumerate(("TOTAL", "AMBIENT", "TOTAL"), start=2):
            client.subscribe(Subscription(kind=kind, sh_order=1))
            assert take(client, 3) == [(kind, number)] * 3
