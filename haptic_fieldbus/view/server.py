"""The process that serves the page: it reads the ring, passes commands on, and lets in whom it knows.

Each page has a WebSocket of ours beside that of NiceGUI. The server sends a page the rows since the last ones, and
nothing more until the page has drawn them. A page that stands still therefore makes nothing grow, and gets the newest
rows when it goes on.

`Entrance` stands before everything else, HTTP and WebSocket alike: it wants a known `Host`, the `Origin` of the page
itself where there is one (always for a WebSocket), and the token of this server, in the address or in a cookie. A
browser that the command starts gets a token for one use.

NiceGUI draws the controls of the page, `assets/client.js` its pictures. A control sends its command through the
WebSocket of the page (`haptic.send` of the script), so that one place decides who steers. Answers come back to
`Controls.show`, which sets the values that are in force.
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
from functools import partial
from html import escape
from pathlib import Path
from time import monotonic
from typing import Any
from urllib.parse import quote

import numpy as np
import uvicorn
from fastapi import FastAPI
from nicegui import app, ui
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from haptic_fieldbus.numerals import rounded, rounded_limit
from haptic_fieldbus.running.ring import LONGEST_LINE, LiveReader, RingReader
from haptic_fieldbus.view import token_for_once

ASSETS = Path(__file__).parent / "assets"
SPEEDS = {"real time": 1.0, "1/4": 0.25, "1/10": 0.1, "1/50": 0.02}
SPANS = {"2 s": 2, "5 s": 5, "10 s": 10}
_html = partial(ui.html, sanitize=False)
STARTING = 60.0
"""Time for which a page waits for the run to begin [s]."""
HANDS_SHOWN = {"push": "push", "tap": "tap", "push, then release": "release", "none (drag the handle)": "none"}
NO_TRIGGER = "hold at a trip"
FACTS = ("drive", "link", "lateness", "bus load", "energy", "pictures")
CHARTS = (("position", "Position"), ("force", "Force asked and given"), ("error", "Error: given less asked"))


def build(hub: "Hub") -> None:
    """Register the page; `hub` is what is between it and the run."""
    app.add_static_files("/assets", ASSETS)

    @ui.page("/", response_timeout=STARTING)
    async def page() -> None:
        await asyncio.wait_for(hub.known.wait(), STARTING - 1.0)
        client = ui.context.client
        hub.controls[client.id] = Controls(hub.hello, hub.first)
        client.on_delete(lambda: hub.controls.pop(client.id, None))
        ui.add_head_html('<link rel="stylesheet" href="/assets/page.css">')
        ui.add_body_html(
            f'<script>window.hapticClient = "{client.id}";</script><script src="/assets/client.js"></script>'
        )


class Controls:
    """The controls of one page."""

    def __init__(self, hello: dict[str, Any], first: dict[str, float]) -> None:
        """Draw them in the present context of NiceGUI."""
        self._sliders: dict[str, tuple[ui.slider, ui.input, ui.html]] = {}
        self._first = first
        self._steered: list[Any] = []
        ui.query(".nicegui-content").classes("page")
        with ui.element("header"):
            self._head(hello)
        _html('<div id="lost" role="alert" hidden></div><div id="trip" role="alert" hidden></div>')
        with ui.element("main"):
            self._pictures(hello)
            with ui.element("aside"):
                self._facts(hello)
                self._parameters(hello)
                if hello["simulated"]:
                    self._simulation(hello)

    def _head(self, hello: dict[str, Any]) -> None:
        bench, scene = hello["bench"], escape(hello["scene_text"], quote=True)
        kind = "simulation" if hello["simulated"] else "real drive"
        _html(
            f"<h1 title='{scene}'>{scene}</h1><p title='{escape(bench, quote=True)}'>"
            f"<b class='is-{kind.split()[0]}'>{kind}</b> {escape(bench)}</p>"
        ).classes("title")
        _html('<span id="state" role="status">–</span><span id="time">–</span>').classes("state")
        _button("contrast", "Light or dark", "haptic.theme()")
        _html(
            '<button id="stop" type="button">STOP<small>Esc</small></button>'
            "<small>no emergency stop: it needs this page and the computer</small>"
        ).classes("stop")

    def _pictures(self, hello: dict[str, Any]) -> None:
        with ui.element("section").classes("pictures"):
            with ui.element("div").classes("handles"):
                for axis in hello["axes"]:
                    _canvas("handle", axis["name"], f"Handle of axis {axis['name']} and what it touches")
            with ui.element("div").classes("laws"):
                for axis in hello["axes"]:
                    _canvas("law", axis["name"], f"Force over position of axis {axis['name']}")
            with ui.element("div").classes("charts"):
                with ui.element("div").classes("tools"):
                    _button("pause", "Hold the charts; the run goes on (key H)", "haptic.hold()", "hold")
                    _button(None, "Save the window as CSV", "haptic.saveCsv()", text="CSV")
                    _button(None, "Save the window as PNG", "haptic.savePng()", text="PNG")
                    columns = {name: name for name in hello["columns"]}
                    triggers = {NO_TRIGGER: None, **columns}
                    _choice(triggers, NO_TRIGGER, "Column that holds the charts", "haptic.arm({column: value})")
                    level = ui.number(placeholder="level").props('dense borderless step=any aria-label="Level"')
                    level.on("update:model-value", js_handler=_JS_LEVEL)
                    _html('<span id="cursor"></span>')
                    _choice(SPANS, "5 s", "Time that is shown", "haptic.span(value)")
                for name, title in CHARTS:
                    with ui.element("div").classes("chart"):
                        _canvas("chart", name, title)
                        label, script = f"Columns of the chart {name}", f"haptic.columns({json.dumps(name)}, value)"
                        choice = _choice(columns, None, label, script, many=True)
                        choice.props('display-value="columns"').classes("columns")

    def _facts(self, hello: dict[str, Any]) -> None:
        rows = "".join(f"<dt>{name}</dt><dd id='fact-{name.replace(' ', '-')}'>–</dd>" for name in FACTS)
        _html(f"<h2>State</h2><dl>{rows}</dl>").classes("card facts")

    def _parameters(self, hello: dict[str, Any]) -> None:
        with ui.element("div").classes("card parameters"):
            _html("<h2>Parameters</h2><p id='role' role='status'></p>")
            self._limits = _html(_limits(hello))
            with ui.element("div").classes("list"):
                for each in hello["parameters"]:
                    self._parameter(each)
            _html('<p id="waits" role="status"></p><p id="answer" role="status" aria-live="polite"></p>')
            with ui.element("div").classes("buttons"):
                self._steered += [_button("undo", "Back to the values of the file", "haptic.reset()", text="reset")]
                _button("content_copy", "Copy the command line with these values", "haptic.copy()", text="copy command")

    def _parameter(self, told: dict[str, Any]) -> None:
        """Draw name, number, slider and scale of one parameter."""
        name = told["name"]
        with ui.element("div").classes("parameter") as row:
            _html(f"<label>{escape(name).replace('.', '.<wbr>').replace('_', '_<wbr>')}</label>")
            number = ui.input(value=rounded_limit(told["value"])).props(
                f'dense borderless type=number step=any suffix="{told["unit"]}" aria-label="{name}"'
            )
            slider = ui.slider(min=told["low"], max=told["high"], step=told["step"], value=told["value"])
            slider.props(f'dense aria-label="{name}" data-name="{name}"')
            scale = _html(_scale(told)).classes("scale")
        asked = json.dumps(name)
        slider.on("update:model-value", js_handler=f"(value) => haptic.meant({asked}, value)")
        slider.on("change", js_handler=f"(value) => haptic.change({asked}, value)")
        number.on("change", js_handler=f"(value) => haptic.change({asked}, value)")
        self._sliders[name] = slider, number, scale
        if told["fixed"]:
            row.props(f'title="{told["fixed"]}: begin a new run for this parameter"')
            slider.disable()
            number.disable()
        else:
            self._steered += [slider, number]

    def _simulation(self, hello: dict[str, Any]) -> None:
        with ui.element("div").classes("card simulation"):
            _html("<h2>Simulation</h2>")
            with ui.element("div").classes("buttons"):
                self._steered += [
                    _button("pause", "Pause or go on (key P)", "haptic.pause()", "pause", text="pause"),
                    _button("skip_next", "One period forward (key N)", "haptic.step()", text="step"),
                ]
            pace = next((name for name, speed in SPEEDS.items() if speed == hello["speed"]), "real time")
            hands = {value: name for name, value in HANDS_SHOWN.items()}
            held = hands.setdefault(hello["hand"], hello["hand"])
            chosen = [
                _choice(SPEEDS, pace, "Speed", "haptic.send({speed: value})"),
                _choice({name: value for value, name in hands.items()}, held, "Hand", "haptic.send({hand: value})"),
            ]
            if scenes := {name: name for name in [hello["scene"], *hello["scenes"]] if hello["scenes"]}:
                label = "Scene; ends this run and begins anew"
                chosen += [_choice(scenes, hello["scene"], label, "haptic.scene(value)")]
            for each in chosen:
                each.props(f'outlined :borderless=false label="{each.props["aria-label"]}"')
            self._steered += chosen

    # What comes back.

    def show(self, hello: dict[str, Any], message: dict[str, Any]) -> None:
        """Show the values in force after a change, or after one that was refused."""
        if "scene" in message or "refused" in message:
            self._limits.set_content(_limits(hello))
            for told in hello["parameters"]:
                slider, number, scale = self._sliders[told["name"]]
                slider.props.update(min=told["low"], max=told["high"], step=told["step"])
                slider.set_value(told["value"])
                number.set_value(rounded_limit(told["value"]))
                slider.update()  # also where the page has moved it meanwhile
                number.update()
                scale.set_content(_scale(told))

    def enable(self, steers: bool) -> None:
        """Let the controls act, or not, in a page that only looks."""
        for each in self._steered:
            each.set_enabled(steers)


_JS_LEVEL = "(value) => haptic.arm({level: value === '' || value === null ? NaN : Number(value)})"


def _choice(options: dict[str, Any], value: str | None, label: str, script: str, *, many: bool = False) -> ui.select:
    """Return a list that runs a script with the `value` of the option that is chosen, or with those of many."""
    choice = ui.select([*options], value=value, multiple=many)
    choice.props(f'dense options-dense borderless aria-label="{label}"')
    chosen = "option.map((each) => options[each.label])" if many else "options[option.label]"
    handler = f"(option) => {{ const options = {json.dumps(options)}, value = {chosen}; {script}; }}"
    return choice.on("update:model-value", js_handler=handler)


def _button(icon: str | None, label: str, script: str, name: str = "", *, text: str = "") -> ui.button:
    """Return a small button that runs a script; the label is its tooltip and its name for a screen reader."""
    button = ui.button(text, icon=icon, color=None).props(f'flat dense no-caps aria-label="{label}" title="{label}"')
    if name:
        button.props(f'id="{name}"')
    return button.on("click", js_handler=f"() => {script}")


def _canvas(kind: str, name: str, label: str) -> None:
    attributes = f'data-kind="{kind}" data-name="{escape(name, quote=True)}" aria-label="{escape(label, quote=True)}"'
    _html(f"<canvas {attributes} role='img' tabindex='0'></canvas>").classes(f"picture {kind}")


def _limits(hello: dict[str, Any]) -> str:
    """Return the limits of the scene, a line for each group of axes."""
    return "".join(f"<p class='limit'>Limit: {escape(text)}</p>" for text in hello["limits"])


def _scale(told: dict[str, Any]) -> str:
    """Return the scale below a slider: its ends, and the limit with the part above it hatched."""
    low, high, limit = told["low"], told["high"], told["limit"]
    marks = f"<i>{rounded(low)}</i><i class='end'>{rounded(high)}</i>"
    if limit is None or not low < limit < high:
        return marks
    place = 100.0 * (limit - low) / (high - low)
    title = f"limit {rounded_limit(limit)} {told['unit']}".rstrip()
    return (
        f"<s style='left:{place:.2f}%'></s>"
        f"<b style='left:{place:.2f}%' data-limit='{limit!r}'>{escape(title)}</b>"
        f"<i>{rounded(low)}</i>"
    )


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
USUAL_PORT, HTTP_PORT = 8765, 80
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
        # As in the address: a cookie holds no ";", and a header no letter beyond Latin 1.
        self._hosts, self._token, self._cookie = frozenset(hosts), quote(token, safe=""), cookie
        self._once: str | None = token_for_once(token)
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
        if self._once and hmac.compare_digest(given.encode(), self._once.encode()):
            self._once = None
            return ""
        held = quote(given, safe=""), asked.cookies.get(self._cookie, "")
        known = any(hmac.compare_digest(each.encode(), self._token.encode()) for each in held)
        return "" if known else "no valid token in the address"


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
    run: int
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


class Hub:
    """Connection between the run and its pages."""

    def __init__(self, path: Path) -> None:
        """Connect to a run; raises OSError."""
        self.hello: dict[str, Any] = {}
        """Description of the run from which pages are made, once it is known."""
        self.first: dict[str, float] = {}
        """Values of the parameters in the file of the scene."""
        self.controls: dict[str, Controls] = {}
        """Controls of the pages by their clients."""
        self.known = asyncio.Event()
        self.run = LiveReader(path)
        self.over = asyncio.Event()
        self._ring: RingReader
        self._pages: list[Page] = []
        self._steers: Page | None = None
        self._answered = 0.0
        """Time of the last answer of a page."""

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
        """Say to a run that requires a page when one has answered, and ask the pages; called again and again."""
        if self.hello.get("required"):
            pages = [page for page in self._pages if page.run == self.hello["run"]]
            self._answered = max([self._answered, *(page.answered for page in pages)])
            if self._answered:
                self._send({"page": monotonic() - self._answered})
            self.tell({"alive": 1})  # rows may stand still for long, and a page draws nothing then

    def take(self, message: dict[str, Any], fd: int | None) -> None:
        """Take a message of the run and pass it on to the pages and their controls."""
        if fd is not None:
            self._ring = RingReader(fd)
            os.close(fd)
            self.hello = message["hello"]
            self.first = {each["name"]: each["value"] for each in self.hello["parameters"]} | self.hello["first"]
            self.controls.clear()  # each page draws itself anew, and answers for this run then
            self._answered = 0.0
            self.known.set()
        kept = {kind: message[kind] for kind in ("ended", "trip") if kind in message}
        self.hello |= message.get("later", {}) | message.get("pace", {}) | kept
        self.tell(message)
        for controls in [*self.controls.values()]:
            controls.show(self.hello, message)

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
        page = Page(websocket, websocket.query_params.get("client", ""), self.hello["run"], answered=monotonic())
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
            if passed and not may:
                self.tell({"refused": "too many commands at once; try again"}, page)
            elif len(json.dumps(passed)) >= LONGEST_LINE:  # the run would leave the server, and all its pages
                self.tell({"refused": "the command is too long"}, page)
            elif passed:
                self._send(passed)

    def _choose(self, chosen: Page | None = None) -> None:
        """Let the page that was chosen steer, or else the only one; tell all of them. The hand of another lets go."""
        before, only = self._steers, self._pages[0] if len(self._pages) == 1 else None
        self._steers = chosen or (before if before in self._pages else only)
        if before not in (None, self._steers):
            for axis in self.hello["axes"]:
                self._send({"pull": [axis["name"], None]})
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


def hosts_of(shown: str, port: int) -> set[str]:
    """Return the hosts by which a browser may name the server; it leaves the usual port of HTTP out."""
    names = {shown.lower(), *LOOPBACK}
    return {f"{name}:{port}" for name in names} | (names if port == HTTP_PORT else set())


def serve(path: Path, *, host: str, port: int | None, token: str | None, ready: Callable[[str], None]) -> None:
    """Serve the run behind a socket until it ends; `ready` is called with the address of the page. Raises OSError."""
    token = token or secrets.token_urlsafe(24)
    hub, door = Hub(path), listening(host, port)
    number = door.getsockname()[1]
    shown = f"[{host}]" if ":" in host else host
    hosts = hosts_of(shown, number)
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
        # Who comes before the first answer waits at the socket.
        ready(f"http://{shown}:{number}/?token={quote(token, safe='')}")
        hub.follow()
        await hub.over.wait()
        await asyncio.sleep(FAREWELL)
        server.should_exit = True

    app.on_startup(follow)
    app.timer(SIGN_OF_LIFE, hub.vouch)
    server.run(sockets=[door])
