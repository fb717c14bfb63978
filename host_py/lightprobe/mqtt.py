"""A probe's messages from an MQTT broker: `mqtt://` and, with TLS, `mqtts://`.

The probe publishes below one topic (docs/users/fleets.md), and hears nothing: a client reads what
its owner has chosen. MQTT itself is the package `paho-mqtt`, which is imported when such an address
is used.
"""

from __future__ import annotations

import asyncio
import ssl
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, unquote, urlsplit

from lightprobe.errors import MissingPackage, ProbeError

if TYPE_CHECKING:
    from paho.mqtt.client import Client

_PORTS = {"mqtt": 1883, "mqtts": 8883}
_STATE = "state"
#: Below the probe's topic; all else there is none of ours.
_TOPICS = (_STATE, "hello", "estimate", "health")
#: As the daemon: a broker that is silent for longer is lost.
_KEEPALIVE_S = 10
#: Less than AsyncClient waits for a connection, so that the reason is this module's.
_CONNECT_S, _ANSWER_S = 3.0, 4.5
#: A reader that is slower than the probe loses the oldest.
_MOST_WAITING = 256


@dataclass(frozen=True)
class BrokerAddress:
    """`mqtt://HOST[:PORT]/TOPIC#login=FILE&ca=FILE`.

    `login`: a file with the user name in its first line and the password in its second one. `ca`:
    the certificate of the authority that vouches for the broker; None: those of the system.
    """

    scheme: str  # mqtt or mqtts
    host: str
    port: int
    topic: str
    login: str | None = None
    ca: str | None = None

    @classmethod
    def parse(cls, uri: str) -> BrokerAddress:
        """Read an address; raises :class:`ProbeError` that says what is wrong with it."""
        try:
            parts = urlsplit(uri)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise ProbeError(f"{uri}: address: {error}") from None
        topic = unquote(parts.path).removeprefix("/")
        if not host or parts.username is not None:
            raise ProbeError(
                f"{parts.scheme}: address: expected {parts.scheme}://HOST[:PORT]/TOPIC; user name "
                "and password are in a file: #login=FILE"
            )
        if not topic or set("+#") & set(topic) or "" in topic.split("/"):
            raise ProbeError(f"{uri}: address: {topic!r} is no topic of one probe")
        if parts.query:
            raise ProbeError(f"{uri}: address: ?{parts.query}: such keys are those of lightprobed")
        extra = parse_qs(parts.fragment)
        login, ca = (extra.get(name, [None])[0] for name in ("login", "ca"))
        if ca and parts.scheme != "mqtts":
            raise ProbeError(f"{uri}: address: ca= is for mqtts:")
        return cls(parts.scheme, host, port or _PORTS[parts.scheme], topic, login, ca)

    async def connect(self) -> MqttStream:
        """Connect, and wait until the probe is there; raises :class:`ProbeError`, OSError."""
        stream = MqttStream(self)
        try:
            await stream.open()
        except BaseException:
            stream.close()
            raise
        return stream

    def set_up(self, client: Client) -> None:
        """Give the client what it shows the broker, and what it wants of the broker."""
        if self.login:
            client.username_pw_set(*self._login())
        if self.scheme == "mqtts":
            try:
                context = ssl.create_default_context(cafile=self.ca)
            except OSError as error:  # ssl.SSLError is one
                raise ProbeError(f"{self}: ca: {self.ca}: {error.strerror or error}") from None
            client.tls_set_context(context)

    def _login(self) -> tuple[str, str]:
        try:
            user, password = Path(self.login or "").read_text(encoding="utf-8").splitlines()[:2]
        except OSError as error:
            raise ProbeError(f"{self}: login: {self.login}: {error.strerror}") from None
        except ValueError:
            raise ProbeError(
                f"{self}: login: {self.login}: needs two lines: the user name, and the password"
            ) from None
        return user, password

    def __str__(self) -> str:
        """Address without the files: fit for messages and logs."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}/{self.topic}"


class MqttStream:
    """What a probe publishes, as a stream of delimited messages, as on `tcp:`. Hello comes first.

    It ends when the probe says that it goes, or the broker that it has gone (its last will).
    """

    def __init__(self, address: BrokerAddress) -> None:
        """Connect with :meth:`open`."""
        self._address = address
        #: What read() gave last had been kept by the broker: it may be old.
        self.retained = False
        self._waiting: deque[tuple[str, bytes, bool]] = deque(maxlen=_MOST_WAITING)
        self._is_online: bool | None = None  # None: the broker knows nothing of the probe
        self._is_greeted = False
        self._error: ProbeError | None = None
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._client: Client | None = None

    async def open(self) -> None:
        """Connect, subscribe to the topics, and wait for the probe for some seconds."""
        try:
            from paho.mqtt.client import Client, MQTTv311
            from paho.mqtt.enums import CallbackAPIVersion
        except ModuleNotFoundError:
            raise MissingPackage(
                f"{self._address}: connect: needs the package paho-mqtt: pip install paho-mqtt"
            ) from None
        until_s = time.monotonic() + _ANSWER_S
        client = self._client = Client(
            CallbackAPIVersion.VERSION2, protocol=MQTTv311, reconnect_on_failure=False
        )
        client.connect_timeout = _CONNECT_S
        client.on_connect = self._on_connect
        client.on_subscribe = self._on_subscribe
        client.on_message = self._on_message
        client.on_disconnect = self._on_disconnect
        self._address.set_up(client)
        try:
            await asyncio.to_thread(
                client.connect, self._address.host, self._address.port, _KEEPALIVE_S
            )
        except ssl.SSLCertVerificationError as error:
            raise ProbeError(
                f"{self._address}: certificate: {error.verify_message}: name the certificate of "
                "the broker's authority with #ca=FILE, and the broker as its certificate does"
            ) from None
        except ConnectionRefusedError:
            raise ProbeError(f"{self._address}: connect: no broker listens there") from None
        client.loop_start()
        await self._until_online(until_s)

    async def _until_online(self, until_s: float) -> None:
        while not self._is_online:
            self._news.clear()
            if self._error is not None:
                raise self._error
            try:
                async with asyncio.timeout(until_s - time.monotonic()):
                    await self._news.wait()
            except TimeoutError:
                raise ProbeError(self._why_not()) from None

    def _why_not(self) -> str:
        if self._is_online is None:
            return (
                f"{self._address}: topic: no probe has published there: is the topic right, and may"
                " this user read it?"
            )
        return f"{self._address}: state: the probe is offline: does its lightprobed run?"

    async def read(self, _limit: int = 0) -> bytes:
        """Messages that have come, each after its length; all retained, or none."""
        from lightprobe.wire import delimit

        while True:
            if messages := self._take():
                return b"".join(delimit(one) for one in messages)
            if self._error is not None:
                raise self._error
            self._news.clear()
            await self._news.wait()

    def _take(self) -> list[bytes]:
        """Hello alone, then all of a kind that wait."""
        if not self._is_greeted:
            hello = next((one for one in self._waiting if one[0] == "hello"), None)
            if hello is None:
                return []
            self._waiting.remove(hello)
            self._is_greeted = True
            return [hello[1]]
        taken: list[bytes] = []
        while self._waiting and (not taken or self._waiting[0][2] == self.retained):
            _, payload, self.retained = self._waiting.popleft()
            taken.append(payload)
        return taken

    def write(self, _delimited: bytes) -> None:
        """Do nothing: the probe does not hear its clients."""

    async def drain(self) -> None:
        """Nothing is written."""

    def close(self) -> None:
        """Close; the thread of the package then ends by itself."""
        if self._client is not None:
            self._client.on_disconnect = None
            self._client.disconnect()

    # ------------------------------------------------------------ in the thread of the package

    def _on_connect(self, client: Client, _data: Any, _flags: Any, code: Any, _p: Any) -> None:
        if code.is_failure:
            step = "is the file of #login= right?" if self._address.login else "use #login=FILE"
            self._tell(self._fail, f"connect: the broker refuses: {code}: {step}")
            return
        client.subscribe([(f"{self._address.topic}/{name}", 0) for name in _TOPICS])

    def _on_subscribe(self, _client: Client, _data: Any, _mid: int, codes: Any, _p: Any) -> None:
        if any(code.is_failure for code in codes):
            self._tell(self._fail, "subscribe: the broker does not let this user read the topic")

    def _on_message(self, _client: Client, _data: Any, message: Any) -> None:
        name = message.topic.removeprefix(f"{self._address.topic}/")
        self._tell(self._note, name, message.payload, message.retain)

    def _on_disconnect(self, *_: Any) -> None:
        self._tell(self._fail, "receive: the broker has closed the connection")

    def _tell(self, what: Any, *arguments: Any) -> None:
        try:
            self._loop.call_soon_threadsafe(what, *arguments)
        except RuntimeError:  # the loop has ended meanwhile
            self.close()

    # ------------------------------------------------------------ in the event loop

    def _note(self, name: str, payload: bytes, retained: bool) -> None:
        if name == _STATE:
            was_online, self._is_online = self._is_online, payload == b"online"
            if was_online and not self._is_online:
                self._fail("state: the probe has gone: does its lightprobed run?")
        elif payload:  # empty: the broker is to forget
            self._waiting.append((name, payload, retained))
        self._news.set()

    def _fail(self, why: str) -> None:
        self._error = self._error or ProbeError(f"{self._address}: {why}")
        self._news.set()
