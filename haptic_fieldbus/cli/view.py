"""Command `view`, and the option `--view` of `run`: a page in the browser that shows a run."""

import contextlib
import ipaddress
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING
from urllib.parse import unquote

from haptic_fieldbus.cli.options import option_field, options_of
from haptic_fieldbus.cli.screen import show
from haptic_fieldbus.errors import BusError, UsageError, raise_all
from haptic_fieldbus.view import token_for_once

if TYPE_CHECKING:
    from haptic_fieldbus.running.live import Live
    from haptic_fieldbus.scenes.scene import Scene

LOOPBACK = "127.0.0.1"
LAST_PORT = 65_535
STARTING = 60.0
"""Time in which the server must be ready [s]."""
VIEWED_DURATION = 3600.0
"""Duration of a run with a page and without `--duration` [s]."""
ADDRESS = re.compile(r"http://\S+")


def check_view(host: str, port: int | None) -> None:
    """Raise UsageError when no page can be served there."""
    wrong = []
    if find_spec("nicegui") is None:
        wrong.append("the view needs nicegui; in a checkout, run: pip install -e '.[view]'")
    if _everywhere(host):
        wrong.append(f'host "{host}": give the address or the name of one interface of this computer')
    if port is not None and not 0 <= port <= LAST_PORT:
        wrong.append(f"port {port}: expected a whole number from 0 to {LAST_PORT}; 0 is any free port")
    raise_all(wrong)


def _everywhere(host: str) -> bool:
    """Return whether an address stands for all interfaces, however it is written: "0" is 0.0.0.0."""
    try:
        found = socket.getaddrinfo(host or None, 0, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError):
        return False  # no address at all; it is refused when the page is to be served there
    return any(ipaddress.ip_address(str(each[4][0]).partition("%")[0]).is_unspecified for each in found)


@contextmanager
def viewed(
    host: str, port: int | None, required: bool, scene: "Scene | None", *, browser: bool = False
) -> Iterator["Live"]:
    """Serve a page for the run in the block by a process of its own; its address goes to standard error.

    `scene` is that of the file, to whose values the page returns. Raises UsageError when the server does not start.
    """
    check_view(host, port)
    from haptic_fieldbus.running.live import Live
    from haptic_fieldbus.view.description import base_command, describe, values_of

    with Live(describe, required=required) as live:
        live.command = ["haptic-fieldbus", *base_command(sys.argv[1:])]
        live.of_file = {} if scene is None else values_of(scene)
        child = _started(live.path, host, port)
        # The server is waited for when the run is about to begin: it starts while the scene is compiled.
        live.ready = lambda: _announce(_address(child), host, browser)
        try:
            yield live
        except BaseException as error:
            live.end({"text": str(error) if isinstance(error, Exception) else "It was stopped."})
            raise
    if live.lost:
        raise BusError("the page was lost, and --view-required ended the run; the drives are off")


def _started(path: Path, host: str, port: int | None) -> "subprocess.Popen[str]":
    """Start the server: the command `view` in a process of its own."""
    words = ["view", "--run", path.stem, "--host", host, *([] if port is None else ["--port", str(port)])]
    # A session of its own, so that Ctrl-C at the terminal reaches the run alone.
    return subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *words],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip


def _address(child: "subprocess.Popen[str]") -> str:
    """Wait for the server and return the address of its page; raises UsageError when it does not start."""
    patience, said = Timer(STARTING, child.kill), ""
    patience.start()
    try:
        with child.stderr or nullcontext(()) as lines:  # closed, because nobody reads on: a full pipe stops its writer
            for said in lines:
                if found := ADDRESS.search(said):
                    return found[0]
    finally:
        patience.cancel()
    raise UsageError(f"the server of the view did not start: {said.strip()}")


def _announce(address: str, host: str, browser: bool) -> None:
    lines = [("view", address)]
    if host not in (LOOPBACK, "localhost"):
        lines.append(("warning", "every computer that reaches this address may steer and stop the run; keep it secret"))
    show(lines, sys.stderr)
    if browser and (sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        import webbrowser

        page, _, token = address.partition("?token=")
        webbrowser.open(f"{page}?token={token_for_once(unquote(token))}")


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Options of `view`."""

    run: int | None = option_field("PID", "Process of the run.", told="the newest run of this user with --view")
    host: str = option_field("HOST", "Address that the page is served at.", default=LOOPBACK)
    port: int | None = option_field("PORT", "Port of the page.", told="8765, or a free one")
    token: str | None = option_field("TOKEN", "Token of the address.", told="a random one")


@options_of(ViewOptions)
def view(options: ViewOptions) -> None:
    """Show a run that was begun with --view as a page in the browser. To watch drives without torque: `watch`."""
    from haptic_fieldbus.running.live import sockets

    check_view(options.host, options.port)
    found = [path for path in sockets() if options.run is None or path.stem == str(options.run)]
    if not found:
        raise UsageError("no run to view; begin one with: haptic-fieldbus run SCENE --view")
    with contextlib.suppress(OSError):
        os.nice(5)
    from haptic_fieldbus.view.server import serve

    try:
        serve(
            found[0], host=options.host, port=options.port, token=options.token,
            ready=lambda address: _announce(address, options.host, browser=False),
        )  # fmt: skip
    except (FileNotFoundError, ConnectionRefusedError) as gone:
        raise UsageError("the run has ended") from gone
    except OSError as error:
        raise UsageError(f"the page cannot be served at {options.host}: {error.strerror or error}") from error
