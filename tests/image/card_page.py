# SPDX-License-Identifier: Apache-2.0
"""The set-up page of an emulated machine, as a browser asks it."""

from __future__ import annotations

import http.client
import json
import re
import ssl
import time
from typing import Any

from machine import Card, Machine

_START_S = 900


def ask(one: Machine, token: str, method: str, path: str, body: Any = None) -> tuple[int, str]:
    """Status and answer; 0 as long as nothing answers. The body: bytes, or what becomes JSON."""
    context = ssl._create_unverified_context()  # the certificate is its own
    connection = http.client.HTTPSConnection(
        "127.0.0.1", one.ports[7703], timeout=300, context=context
    )
    try:
        text = body if body is None or isinstance(body, bytes) else json.dumps(body)
        connection.request(method, f"/api/{path}", text, {"Authorization": f"Bearer {token}"})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    except (OSError, http.client.HTTPException) as failure:
        return 0, str(failure)
    finally:
        connection.close()


def state(one: Machine, owner: str) -> dict[str, Any]:
    """What the set-up page shows."""
    status, text = ask(one, owner, "GET", "state")
    assert status == 200, text
    return dict(json.loads(text))


def token(card: Card) -> str:
    """What the owner reads on the card."""
    found = re.search(r"#owner=(\S+)", card.read("access.txt"))
    assert found is not None
    return found[1]


def wait_for_page(one: Machine) -> None:
    """Until it asks who is there."""
    began = time.monotonic()
    while ask(one, "", "GET", "state")[0] != 401:
        assert one.process.poll() is None, one.said()[-4000:]
        assert time.monotonic() - began < _START_S, one.said()[-4000:]
        time.sleep(2)
