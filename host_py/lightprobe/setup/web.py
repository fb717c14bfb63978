"""The set-up page's server: for the owner's token alone, one task at a time.

Each request under /api/ carries `Authorization: Bearer TOKEN`, which no other page can send: it
would need an answer to a preflight, and there is none. A request from a page of elsewhere is
refused besides, by its Origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import socket
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from aiohttp import web

from lightprobe import __version__
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.network.wifi import Wifi
from lightprobe.setup import card, choices, door, service, settings, tasks
from lightprobe.setup.job import Job
from lightprobe.setup.network import Networks
from lightprobe.setup.upload import Upload

#: Characters of the owner's token.
LEAST_TOKEN = 32
_MOST_BYTES = 65536
#: After a wrong token, so that nobody tries many.
_WRONG_TOKEN_S = 1.0
_POLL_S = 1.0
#: A file that no task has taken by then goes.
_UNUSED_S = 120.0
#: By then the page knows that the task has ended well.
_RESTART_S = 5.0
_PAGE = "setup.html"
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Setup:
    """What the page may see and do."""

    def __init__(
        self,
        token: str,
        config: Path,
        daemon: service.Service,
        page: Path,
        pair: Path,
        wifi: Wifi,
    ) -> None:
        """`token`: the owner's, of at least 32 characters; `page`: the folder with setup.html.

        `pair`: of key, certificate and tokens.
        """
        if len(token) < LEAST_TOKEN:
            raise LightprobeError("setup: the owner's token is too short to be one: use --new")
        self._token, self._config, self._daemon, self._page = token, config, daemon, page
        self._pair, self._networks = pair, Networks(wifi)
        self._upload = Upload(config.parent)
        self._unused: asyncio.TimerHandle | None = None
        self._job: Job | None = None
        self._running: asyncio.Task[None] | None = None
        self._busy = asyncio.Lock()

    def application(self) -> web.Application:
        """Give the routes."""
        app = web.Application(middlewares=[self._guard], client_max_size=_MOST_BYTES)
        app.add_routes([
            web.get("/api/state", self._state), web.put("/api/settings", self._set),
            web.post("/api/restart", self._restart), web.put("/api/upload", self._receive),
            web.post("/api/job", self._begin),
            web.get("/api/job", self._told), web.post("/api/job/answer", self._answer),
            web.post("/api/job/stop", self._stop), web.get("/api/network", self._network),
            web.post("/api/network/join", self._join),
            web.post("/api/network/forget", self._forget),
            web.get("/api/job/files/{name}", self._file), web.get("/", self._index),
            web.get("/{name:setup[.](?:html|js|css)|style[.]css}", self._static),
        ])  # fmt: skip
        app.on_startup.append(self._on_start)
        app.on_shutdown.append(self._on_end)
        return app

    # ------------------------------------------------------------ who may

    @web.middleware
    async def _guard(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        try:
            if request.path.startswith("/api/"):
                await self._check_owner(request)
                door.prove(request)
            response = await handler(request)
        except web.HTTPException as error:
            response = _problem(error.status, error.text or error.reason)
        except UsageError as error:
            response = _problem(422, str(error))
        except LightprobeError as error:
            response = _problem(409, str(error))
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        return response

    async def _check_owner(self, request: web.Request) -> None:
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"{request.scheme}://{request.host}":
            await asyncio.sleep(_WRONG_TOKEN_S)
            raise web.HTTPForbidden(text="setup: a page of elsewhere may not set up this probe")
        kind, _, given = request.headers.get("Authorization", "").partition(" ")
        if kind != "Bearer" or not hmac.compare_digest(
            given.encode(errors="replace"), self._token.encode()
        ):
            await asyncio.sleep(_WRONG_TOKEN_S)
            raise web.HTTPUnauthorized(
                text="setup: not the owner's token: open the address that `lightprobe setup` prints"
            )

    # ------------------------------------------------------------ settings

    async def _state(self, _request: web.Request) -> web.Response:
        text = self._text()
        folder = self._config.parent
        found = settings.values(text)
        return web.json_response({
            "name": found.get("name", [socket.gethostname()])[0], "version": __version__,
            "card": card.version(), "boot": service.boot(),
            "config": str(self._config), "settings": found, "text": text,
            "runs": await asyncio.to_thread(lambda: self._daemon.runs),
            "log": await asyncio.to_thread(self._daemon.log),
            "probe": service.local_address(found),
            "sources": [asdict(one) for one in choices.sources()],
            "ports": [asdict(one) for one in choices.ports()],
            "cameras": [asdict(one) for one in choices.camera_files(folder)],
            "tasks": [asdict(task) for task in tasks.offered()],
        })  # fmt: skip

    def _text(self) -> str:
        return settings.read(self._config)

    async def _set(self, request: web.Request) -> web.Response:
        """Take {"set": {NAME: [VALUE, …]}} or {"text": the whole file}."""
        wanted = await _json(request)
        if isinstance(wanted.get("text"), str):
            text = wanted["text"]
        else:
            text = settings.changed(self._text(), _lists(wanted.get("set")))
        async with self._alone():
            await asyncio.to_thread(service.apply, self._daemon, self._config, text)
        return web.json_response({})

    async def _restart(self, _request: web.Request) -> web.Response:
        async with self._alone():
            found = settings.values(self._text())
            await asyncio.to_thread(service.restart, self._daemon, found)
        return web.json_response({})

    async def _receive(self, request: web.Request) -> web.Response:
        """Take a file for the task that is begun next, soon."""
        if not any(task.takes_file for task in tasks.offered()):
            raise UsageError("setup: upload: no task of this machine takes a file")
        async with self._alone():
            await self._upload.receive(request)
        if self._unused:
            self._unused.cancel()
        self._unused = asyncio.get_running_loop().call_later(_UNUSED_S, self._forget_unused)
        return web.json_response({})

    def _forget_unused(self) -> None:
        if not self._works and not self._busy.locked():
            self._upload.remove()

    @contextlib.asynccontextmanager
    async def _alone(self) -> Any:
        """No task runs meanwhile, and nobody else changes anything."""
        if self._busy.locked() or self._works:
            raise LightprobeError("setup: something else is running: wait for it, or stop it")
        async with self._busy:
            yield

    # ------------------------------------------------------------ tasks

    async def _begin(self, request: web.Request) -> web.Response:
        """Take {"task": NAME, "fields": {NAME: VALUE}}."""
        wanted = await _json(request)
        task = tasks.named(str(wanted.get("task")))
        given = {name: str(value) for name, value in _dict(wanted.get("fields")).items()}
        card.ensure_settled()
        async with self._alone():
            job = Job(task, None)
            folders = {
                "FOLDER": Path(job.folder.name),
                "PAIR": self._pair,
                "UPLOAD": self._upload.path,
            }
            words = tasks.words(task, given, folders, self._config.parent)
            if task.writes:
                field = next(one for one in task.fields if one.name == task.writes)
                name = given.get(task.writes, field.initial).strip()
                job.writes = self._config.parent / f"{name}.camera"
            former, self._job = self._job, job
            if former:
                former.folder.cleanup()
            self._running = asyncio.create_task(self._run(job, words))
        return web.json_response({})

    async def _run(self, job: Job, words: list[str]) -> None:
        """Run it; the daemon ends meanwhile where it uses the same devices."""
        frees = False
        try:
            if job.task.takes_devices:
                frees = await asyncio.to_thread(lambda: self._daemon.runs)
                await asyncio.to_thread(self._daemon.stop)
            await job.run(words)
        except LightprobeError as error:
            job.say(str(error))
            job.end(1)
        finally:
            if job.task.takes_file:
                self._upload.remove()
            if job.task.restarts and job.status == 0:
                asyncio.get_running_loop().call_later(_RESTART_S, service.restart_machine)
            if frees:
                try:
                    await asyncio.to_thread(self._daemon.start)
                except LightprobeError as error:
                    job.say(str(error))

    @property
    def _works(self) -> bool:
        """Whether a task runs, or the daemon is being started after it."""
        return self._running is not None and not self._running.done()

    def _present(self) -> Job:
        if self._job is None:
            raise web.HTTPNotFound(text="setup: no task has been begun")
        return self._job

    async def _told(self, request: web.Request) -> web.Response:
        """Lines behind ?after=N, as soon as there are any, or when it has ended."""
        job = self._present()
        after = request.query.get("after", "0")
        said = int(after) if after.isascii() and after.isdigit() else 0
        for _ in range(round(_POLL_S / 0.1)):
            if job.said != said or not self._works:
                break
            await asyncio.sleep(0.1)
        told = job.told(said)
        if self._works:
            told["status"] = None
        return web.json_response(told)

    async def _answer(self, request: web.Request) -> web.Response:
        if not self._present().answer(skip=(await _json(request)).get("skip") is True):
            raise LightprobeError("setup: it has not asked")
        return web.json_response({})

    async def _stop(self, _request: web.Request) -> web.Response:
        await self._present().stop()
        return web.json_response({})

    async def _file(self, request: web.Request) -> web.StreamResponse:
        job = self._present()
        name = request.match_info["name"]
        path = Path(job.folder.name) / name
        if name not in job.task.files or not path.is_file():
            raise web.HTTPNotFound(text=f"setup: {name[:60]}: no file of this task")
        # A report may hold scripts: they get no rights of this page.
        return web.FileResponse(path, headers={"Content-Security-Policy": "sandbox allow-scripts"})

    # ------------------------------------------------------------ networks

    async def _network(self, request: web.Request) -> web.Response:
        return web.json_response(await self._networks.state(request))

    async def _join(self, request: web.Request) -> web.Response:
        self._networks.join(await _json(request))
        return web.json_response({})

    async def _forget(self, request: web.Request) -> web.Response:
        self._networks.forget(await _json(request))
        return web.json_response({})

    # ------------------------------------------------------------ page, begin and end

    async def _index(self, _request: web.Request) -> web.StreamResponse:
        raise web.HTTPFound(f"/{_PAGE}")

    async def _static(self, request: web.Request) -> web.StreamResponse:
        path = self._page / request.match_info["name"]
        if not path.is_file():
            raise web.HTTPNotFound(text=f"setup: {path.name}: is not installed: run `make web`")
        return web.FileResponse(path)

    async def _on_start(self, _app: web.Application) -> None:
        """Start the daemon: a task that was cut off may have left it ended."""
        self._upload.remove()
        with contextlib.suppress(LightprobeError):  # its log says why, and the page shows that
            await asyncio.to_thread(self._daemon.start)

    async def _on_end(self, _app: web.Application) -> None:
        await self._networks.end()
        if self._job and self._running:
            await self._job.stop()
            await self._running
            self._job.folder.cleanup()


def _problem(status: int, words: str) -> web.Response:
    return web.json_response({"problem": words}, status=status)


async def _json(request: web.Request) -> dict[str, Any]:
    try:
        return _dict(await request.json())
    except (ValueError, LookupError, RecursionError):
        raise web.HTTPBadRequest(text="setup: expected JSON") from None


def _dict(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise web.HTTPBadRequest(text="setup: expected an object of JSON")
    return value


def _lists(value: Any) -> dict[str, list[str]]:
    wanted = _dict(value)
    for values in wanted.values():
        if not isinstance(values, list) or not all(isinstance(one, str) for one in values):
            raise web.HTTPBadRequest(text="setup: expected lists of texts")
    return wanted
