"""The process that serves the page: it reads the ring, passes commands on, and lets in whom it knows.

Each page has a WebSocket of ours beside that of NiceGUI. The server sends a page the rows since the last ones, and
nothing more until the page has drawn them. A page that stands still therefore makes nothing grow, and gets the newest
rows when it goes on.

`Entrance` stands before everything else, HTTP and WebSocket alike: it wants a known `Host`, the `Origin` of the page
itself where there is one (always for a WebSocket), and the token of this server, once in the address and then in a
cookie.
"""

import asyncio
import contextlib
import hmac
import json
import os
import secrets
import socket
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import uvicorn
from fastapi import FastAPI
from nicegui import app, ui
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from haptic_fieldbus.running.ring import LiveReader, RingReader
from haptic_fieldbus.view.page import Source, build

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
LOOPBACK = ("127.0.0.1", "localhost")
PICTURE_TIME = 1 / 60
"""Shortest time between two pictures of a page [s]."""
MOST_ROWS = 4000
"""Rows in one picture; of more, every second, third … is sent."""
OLDEST = 12.0
"""Longest time before the present of which rows are sent to a new page [s]."""
USUAL_PORT = 8765
WAITING = 64
"""Messages that wait for a page; of more, the oldest are dropped."""
STEERING_TIME = 5.0
"""Time without an answer after which a page steers no more [s]."""
STEERING = ("change", "pull", "hand", "scene", "speed", "paused", "steps")
"""Commands of the page that steers; every page may stop."""
MOST_COMMANDS = 240.0
"""Commands that a page may send in a second; STOP is always passed on."""
SIGN_OF_LIFE = 0.3
"""Time between two words to a run that ends without a page [s]."""
FAREWELL = 1.0
"""Time in which the pages are told how the run ended [s]."""


class Entrance:
    """An ASGI application that passes on what comes from our own page, and refuses all else."""

    def __init__(self, application: Any, hosts: Iterable[str], token: str, cookie: str) -> None:
        self._application = application
        self._hosts, self._token, self._cookie = frozenset(hosts), token, cookie
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        given = HTTPConnection(scope).query_params.get("token", "")
        refused = self._refused(HTTPConnection(scope), given)
        if refused:
            await PlainTextResponse(f"refused: {refused}\n", 403)(scope, receive, send)
            return

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if given:
                    headers.append("set-cookie", f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict")
            await send(message)

        await self._application(scope, receive, with_headers)

    def _refused(self, asked: HTTPConnection, given: str) -> str:
        """Return why a request is refused; empty for one that is not."""
        hosts, origins = asked.headers.getlist("host"), asked.headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return "unknown host"
        needs_origin = asked.scope["type"] == "websocket" or asked.scope["method"] not in ("GET", "HEAD")
        if len(origins) > 1 or (origins and origins[0].lower() not in self._origins) or (needs_origin and not origins):
            return "another origin"
        kept = given or asked.cookies.get(self._cookie, "")
        return "" if hmac.compare_digest(kept.encode(), self._token.encode()) else "no valid token in the address"


_HEADERS = {
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": "frame-ancestors 'none'; object-src 'none'; base-uri 'none'; form-action 'none'",
}
"""No other page may frame ours, and the token leaves in no Referer."""


@dataclass(eq=False)
class Page:
    """A page with its WebSocket."""

    socket: WebSocket
    client: str
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when there may be something to send."""
    drawn: bool = True
    """Whether the page has drawn its last picture."""
    waiting: deque[str] = field(default_factory=lambda: deque(maxlen=WAITING))
    next_row: int = -1
    answered: float = 0.0
    credit: float = MOST_COMMANDS
    """Commands that the page may send at once."""

    def may_command(self) -> bool:
        """Count a command; False when the page sends too many."""
        now, before = monotonic(), self.answered
        self.answered = now
        self.credit = min(MOST_COMMANDS, self.credit + MOST_COMMANDS * (now - before))
        self.credit -= self.credit >= 1.0
        return self.credit >= 1.0


class Hub(Source):
    """Connection between the run and its pages."""

    def __init__(self, path: Path) -> None:
        """Connect to a run; raises OSError."""
        super().__init__()
        self.run = LiveReader(path)
        self.over = asyncio.Event()
        self._ring: RingReader
        self._pages: list[Page] = []
        self._steers: Page | None = None

    def follow(self) -> None:
        """Take the messages of the run in a thread of their own, until the run ends."""
        loop = asyncio.get_running_loop()

        def work() -> None:
            for message, fd in self.run.messages():
                loop.call_soon_threadsafe(self.take, message, fd)
            with contextlib.suppress(RuntimeError):  # the server ended first
                loop.call_soon_threadsafe(self.over.set)

        threading.Thread(target=work, name="messages of the run", daemon=True).start()

    def vouch(self) -> None:
        """Say to a run that requires a page that one is shown; called again and again."""
        shown = sum(monotonic() - page.answered < 2 * SIGN_OF_LIFE for page in self._pages)
        if self.hello.get("required") and shown:
            self._send({"pages": shown})

    def take(self, message: dict[str, Any], fd: int | None) -> None:
        """Take a message of the run and pass it on to the pages and their controls."""
        if fd is not None:
            self._ring = RingReader(fd)
            os.close(fd)
            self.hello = message["hello"]
            self.first = {each["name"]: each["value"] for each in self.hello["parameters"]} | self.hello["first"]
            self.known.set()
        kept = {kind: message[kind] for kind in ("ended", "trip") if kind in message}
        self.hello |= message.get("scene", {}) | message.get("pace", {}) | kept
        for controls in [*self.controls.values()]:
            controls.show(self.hello, message)
        self.tell(message)

    def tell(self, message: dict[str, Any], page: Page | None = None) -> None:
        """Queue a message for one page, or for all."""
        for each in self._pages if page is None else [page]:
            each.waiting.append(json.dumps(message))
            each.wake.set()

    def _send(self, command: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # the run has ended; the thread that follows it says so
            self.run.send(command)

    # A page.

    async def serve(self, websocket: WebSocket) -> None:
        """Serve one page until it leaves."""
        await self.known.wait()
        await websocket.accept()
        page = Page(websocket, websocket.query_params.get("client", ""), answered=monotonic())
        self._pages.append(page)
        self._choose()
        self.tell({"hello": self.hello, "first": self.first, "steers": self._steers is page}, page)
        sender = asyncio.create_task(self._pictures(page))
        try:
            while True:
                self._obey(page, await websocket.receive_json())
        except (WebSocketDisconnect, ValueError, KeyError, TypeError, AttributeError, RuntimeError):
            pass
        finally:
            sender.cancel()
            self._pages.remove(page)
            if self._steers is page:
                self._steers = None
                for axis in self.hello.get("axes", ()):
                    self._send({"pull": [axis["name"], None]})
            self._choose()
            with contextlib.suppress(RuntimeError):
                await websocket.close()

    async def _pictures(self, page: Page) -> None:
        """Send what a page has not seen, whenever it has drawn what came before."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
            while True:
                while page.waiting:
                    await page.socket.send_text(page.waiting.popleft())
                picture = self._picture(page) if page.drawn else None
                if picture is not None:
                    page.drawn = False
                    await page.socket.send_bytes(picture)
                await asyncio.sleep(PICTURE_TIME)
                if not page.drawn and not page.waiting:
                    page.wake.clear()
                    await page.wake.wait()

    def _picture(self, page: Page) -> bytes | None:
        """Return the numbers of the first row and of the next one, and the rows; None when there is no new row."""
        ring = self._ring
        oldest = ring.pushed - round(OLDEST * self.hello["rate"])
        first, rows = ring.since(max(page.next_row, oldest))
        if not len(rows):
            return None
        page.next_row = first + len(rows)
        stride = 1 + len(rows) // MOST_ROWS
        chosen = rows[(len(rows) - 1) % stride :: stride]
        return np.concatenate(([first, page.next_row], chosen.ravel())).tobytes()

    def _obey(self, page: Page, command: dict[str, Any]) -> None:
        """Pass on a command of a page; one that only looks may stop the run, and ask to steer."""
        may = page.may_command()
        if "ack" in command:
            page.drawn = True
            page.wake.set()
        if "stop" in command:
            self._send({"stop": True})
        if "steer" in command and (self._steers is None or monotonic() - self._steers.answered > STEERING_TIME):
            self._choose(page)
        if page is self._steers:
            passed = {name: command[name] for name in STEERING if name in command}
            if passed and may:
                self._send(passed)
            elif passed:
                self.tell({"refused": "too many commands at once; try again"}, page)

    def _choose(self, chosen: Page | None = None) -> None:
        """Let the page that was chosen steer, or else the only one; tell all of them."""
        self._steers = chosen or self._steers or (self._pages[0] if len(self._pages) == 1 else None)
        for page in self._pages:
            self.tell({"steers": page is self._steers}, page)
            if page.client in self.controls:
                self.controls[page.client].enable(page is self._steers)


def listening(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens; without a port at the usual one, or at any where that is taken. Raises OSError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    if port is None:
        with contextlib.suppress(OSError):
            return socket.create_server((host, USUAL_PORT), family=family, backlog=64)
    return socket.create_server((host, port or 0), family=family, backlog=64)


def serve(path: Path, *, host: str, port: int | None, token: str | None, ready: Callable[[str], None]) -> None:
    """Serve the run behind a socket until it ends; `ready` is called with the address of the page. Raises OSError."""
    token = token or secrets.token_urlsafe(24)
    hub, door = Hub(path), listening(host, port)
    number = door.getsockname()[1]
    shown = f"[{host}]" if ":" in host else host
    hosts = {f"{name}:{number}" for name in ({*LOOPBACK} if host in LOOPBACK else {shown.lower(), *LOOPBACK})}
    application = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    application.add_api_websocket_route("/stream", hub.serve)
    build(hub)
    ui.run_with(application, title="haptic_fieldbus", dark=None, reconnect_timeout=300.0, show_welcome_message=False,
                tailwind=False, message_history_length=100)  # fmt: skip
    server = uvicorn.Server(uvicorn.Config(
        Entrance(application, hosts, token, f"haptic_fieldbus_{number}"), log_level="error", access_log=False,
        ws_ping_interval=None, ws_max_size=65_536, server_header=False, timeout_graceful_shutdown=1, lifespan="on",
    ))  # fmt: skip

    async def follow() -> None:
        ready(f"http://{shown}:{number}/?token={token}")  # who comes before the first answer waits at the socket
        hub.follow()
        await hub.over.wait()
        await asyncio.sleep(FAREWELL)
        server.should_exit = True

    app.on_startup(follow)
    app.timer(SIGN_OF_LIFE, hub.vouch)
    server.run(sockets=[door])
