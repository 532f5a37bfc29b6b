"""The server of `stochvi explore`: one page on this machine, behind a token.

A page of another site may send requests to 127.0.0.1 too, under a name of its own (DNS rebinding).
So Host and Origin have to be this server, and everything but the page asks for the token. It
stands in the fragment of the address, which no browser sends, and comes back in a header.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Callable

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from stochvi.explorer.onefile import STATIC
from stochvi.explorer.turns import Explorer, told

FILES = {"/": "index.html"} | {
    f"/{name}": name
    for name in (
        "page.js", "explore.js", "box.js", "figures.js", "motion.js", "pictures.js", "explore.css",
        "icon.svg", "uPlot.iife.min.js", "uPlot.min.css",
    )
}  # fmt: skip
"""What is served without the token, by its path: nothing here is made of a scene."""

MEDIA = {
    ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml",
}  # fmt: skip
"""What a file is, by the ending of its name."""

HEADERS = {
    "content-security-policy": "default-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; object-src 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}

TOKEN = "x-stochvi-token"
TOKEN_BYTES = 24  # 192 bits

LARGEST = 256 * 1024
"""Largest request, bytes: a table of a PSD has some kilobytes."""

BODY_SECONDS = 10.0
"""Time within which a request has to be read, s."""

TOO_MUCH = f"a request must have at most {LARGEST // 1024} kB and come within {BODY_SECONDS:.0f} s"

LEFT_SECONDS = 10.0
"""Time for which the server stays after its last tab is closed, s: a reload takes less."""

BEAT_SECONDS = 2.0
"""Time between two signs of life to a tab, s: a closed one is noticed at the next."""


class Guard:
    """Refuses what does not come from the page of this server, before anything is read of it."""

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self.app, self.token = app, token.encode()
        self.hosts = {f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost")}
        self.origins = {b"http://" + host for host in self.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":  # neither websockets nor a lifespan
            return
        if not self._allowed(scope):
            await PlainTextResponse("forbidden", 403, HEADERS)(scope, receive, send)
            return
        await self.app(scope, receive, send)

    def _allowed(self, scope: Scope) -> bool:
        given: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            given.setdefault(name.lower(), []).append(value)
        hosts, origins = given.get(b"host", []), given.get(b"origin", [])
        if len(hosts) != 1 or hosts[0] not in self.hosts or not self.origins.issuperset(origins):
            return False
        if scope["method"] == "GET" and scope["path"] in FILES:
            return True
        tokens = given.get(TOKEN.encode(), [])
        return len(tokens) == 1 and secrets.compare_digest(tokens[0], self.token)


class Tabs:
    """The open tabs: each holds a request that is answered as long as it is open."""

    def __init__(self, end: Callable[[], None]) -> None:
        self.open, self.end = 0, end
        self.ending: asyncio.TimerHandle | None = None

    async def beats(self) -> AsyncIterator[str]:
        """Signs of life for a tab."""
        self.open += 1
        if self.ending is not None:  # else the next tab has what is left of the time of this one
            self.ending.cancel()
        try:
            while True:
                yield "\n"
                await asyncio.sleep(BEAT_SECONDS)
        finally:
            self.open -= 1
            if not self.open:
                loop = asyncio.get_running_loop()
                self.ending = loop.call_later(LEFT_SECONDS, self.end)


async def body_of(request: Request) -> bytes | None:
    """The body of a request; None if it is too large or comes too slowly."""
    body = b""
    try:
        async with asyncio.timeout(BODY_SECONDS):
            async for part in request.stream():
                body += part
                if len(body) > LARGEST:
                    return None
    except TimeoutError:
        return None
    return body


def app_of(explorer: Explorer, port: int, token: str, end: Callable[[], None]) -> ASGIApp:
    """The application that serves a scene at a port, to those who know the token."""
    tabs = Tabs(end)

    async def file(request: Request) -> Response:
        path = STATIC / FILES[request.url.path]
        text = path.read_text(encoding="utf-8")
        return Response(text, headers=HEADERS, media_type=MEDIA[path.suffix])

    async def alive(_: Request) -> Response:
        return StreamingResponse(tabs.beats(), headers=HEADERS, media_type="text/plain")

    async def ask(request: Request) -> Response:
        body = await body_of(request)
        if body is None:
            return PlainTextResponse(TOO_MUCH, 413, HEADERS)
        try:
            answers = explorer.answers(json.loads(body))
        except (ValueError, RecursionError) as reason:
            return PlainTextResponse(f"no message: {reason}"[:300], 400, HEADERS)
        lines = (json.dumps(each, allow_nan=False) + "\n" for each in told(answers))
        return StreamingResponse(lines, headers=HEADERS, media_type="application/x-ndjson")

    routes = [Route(path, file, methods=["GET"]) for path in FILES]
    routes += [Route("/alive", alive), Route("/ask", ask, methods=["POST"])]
    return Guard(Starlette(routes=routes), port, token)


def serve(explorer: Explorer, tell: Callable[[str], None], browser: bool = True) -> None:
    """Serve the page until its last tab is closed, or Ctrl-C.

    Parameters
    ----------
    tell
        Is told the address, with its token.
    browser
        Whether to open it.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()  # from now on, as the address is told now
        port, token = listening.getsockname()[1], secrets.token_urlsafe(TOKEN_BYTES)

        def end() -> None:
            server.should_exit = True

        config = uvicorn.Config(
            app_of(explorer, port, token, end), log_level="critical", lifespan="off", ws="none",
            limit_concurrency=64, timeout_graceful_shutdown=2, server_header=False,
            h11_max_incomplete_event_size=16 * 1024, http="h11",
        )  # fmt: skip
        server = uvicorn.Server(config)
        address = f"http://127.0.0.1:{port}/#{token}"
        tell(address)
        threading.Thread(target=explorer.warm_up, daemon=True).start()
        if browser:
            threading.Timer(0.3, webbrowser.open, [address]).start()
        server.run(sockets=[listening])
