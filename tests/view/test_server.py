"""Access, steering, and the cost of a page that stands still; by raw sockets and plain WebSockets."""

import contextlib
import json
import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import websocket

from haptic_fieldbus import run
from tests.cases import every
from tests.view.served import Served, children, serving

pytestmark = [
    pytest.mark.thorough("starts a server and a run"),
    pytest.mark.skipif(not hasattr(socket, "send_fds"), reason="needs Unix sockets"),
]
SOCKET_IO = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with serving("demo", "--no-browser", "--port", "0") as found:
        yield found


def answer(served: Served, path: str, headers: dict[str, str], method: str = "GET") -> str:
    """Send a request over a raw socket and return head and beginning of the answer."""
    words = {**headers, "Connection": "Upgrade" if "Upgrade" in headers else "close"}
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in words.items())]
    with socket.create_connection(("127.0.0.1", served.port)) as raw:
        raw.sendall("\r\n".join([*lines, "", ""]).encode())
        received = b""
        while b"\r\n\r\n" not in received and (octets := raw.recv(65536)):
            received += octets
    return received.decode("utf-8", "replace")


def upgrade(origin: str | None) -> dict[str, str]:
    """Return the headers of a request for a WebSocket."""
    key = {"Upgrade": "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    return key if origin is None else {**key, "Origin": origin}


def connected(served: Served, name: str) -> websocket.WebSocket:
    """Connect as a page does."""
    return websocket.create_connection(
        f"ws://127.0.0.1:{served.port}/stream?client={name}&token={served.token}", origin=served.origin, timeout=60
    )


def told(page: websocket.WebSocket, name: str) -> Any:
    """Return the content of the next message of a name; pictures are acknowledged."""
    while True:
        received = page.recv()
        if isinstance(received, bytes):
            page.send('{"ack": 1}')
        elif name in (message := json.loads(received)):
            return message[name]


def begun(page: websocket.WebSocket) -> Any:
    """Wait until the torque of the run is enabled, and return its description."""
    hello = told(page, "hello")
    place, width = hello["columns"].index("enabled"), len(hello["columns"])
    while True:
        received = page.recv()
        if isinstance(received, bytes):
            page.send('{"ack": 1}')
            if 1.0 in np.frombuffer(received)[2:].reshape(-1, width)[:, place]:
                return hello


PATHS = ["/", "/assets/client.js", "/_nicegui/anything", SOCKET_IO, "/stream", "/nothing"]


@every("path", PATHS)
def test_nothing_is_given_without_the_token(served: Served, path: str) -> None:
    host = {"Host": f"127.0.0.1:{served.port}"}
    assert answer(served, path, host).startswith("HTTP/1.1 403")
    joint = "&" if "?" in path else "?"
    for wrong in ("", "x", served.token[:-1], served.token + "x", "%00"):
        assert answer(served, f"{path}{joint}token={wrong}", host).startswith("HTTP/1.1 403")
    assert answer(served, path, {**host, "Cookie": f"haptic_fieldbus_{served.port}=x"}).startswith("HTTP/1.1 403")


@every("path", PATHS)
@every("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example", ""])
def test_another_host_is_refused(served: Served, path: str, host: str) -> None:
    joint = "&" if "?" in path else "?"
    told = answer(served, f"{path}{joint}token={served.token}", {"Host": host})
    assert told.startswith(("HTTP/1.1 403", "HTTP/1.1 400"))


@every("origin", ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1", "http://localhost"])
def test_another_origin_is_refused_for_pages_polling_and_sockets(served: Served, origin: str) -> None:
    cookie = {"Host": f"127.0.0.1:{served.port}", "Cookie": f"haptic_fieldbus_{served.port}={served.token}"}
    for path, method in (("/", "GET"), (SOCKET_IO, "GET"), (SOCKET_IO, "POST")):
        assert answer(served, path, {**cookie, "Origin": origin}, method).startswith("HTTP/1.1 403")
    for path in ("/stream", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
        assert answer(served, path, {**cookie, **upgrade(origin)}).startswith("HTTP/1.1 403")


def test_a_socket_and_a_post_without_any_origin_are_refused(served: Served) -> None:
    cookie = {"Host": f"127.0.0.1:{served.port}", "Cookie": f"haptic_fieldbus_{served.port}={served.token}"}
    assert answer(served, "/stream", {**cookie, **upgrade(None)}).startswith("HTTP/1.1 403")
    assert answer(served, SOCKET_IO, cookie, "POST").startswith("HTTP/1.1 403")


def test_the_page_is_given_to_its_token_and_may_be_framed_by_nobody(served: Served) -> None:
    given = answer(served, f"/?token={served.token}", {"Host": f"localhost:{served.port}"})
    assert given.startswith("HTTP/1.1 200")
    head = given.partition("\r\n\r\n")[0].lower()
    assert f"set-cookie: haptic_fieldbus_{served.port}=" in head
    for each in ("httponly", "samesite=strict", "x-frame-options: deny", "referrer-policy: no-referrer", "nosniff"):
        assert each in head
    cookie = {"Host": f"127.0.0.1:{served.port}", "Cookie": f"haptic_fieldbus_{served.port}={served.token}"}
    assert answer(served, "/assets/client.js", cookie).startswith("HTTP/1.1 200")
    assert answer(served, "/stream", {**cookie, **upgrade(served.origin)}).startswith("HTTP/1.1 101")


def test_a_browser_is_started_with_a_token_that_opens_the_page_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, program = tmp_path / "started", tmp_path / "browser"
    program.write_text(f'#!/bin/sh\necho "$1" > {started}.part\nmv {started}.part {started}\n', encoding="utf-8")
    program.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(program))
    monkeypatch.setenv("DISPLAY", ":99")
    with serving("demo", "--port", "0") as served:
        patience = time.monotonic() + 30.0
        while not started.exists() and time.monotonic() < patience:
            time.sleep(0.05)
        path, host = urlsplit(started.read_text(encoding="utf-8").strip()), {"Host": f"127.0.0.1:{served.port}"}
        assert path.port == served.port
        assert served.token not in path.query
        given = answer(served, f"/?{path.query}", host)
        assert given.startswith("HTTP/1.1 200")
        kept = given.partition("set-cookie: ")[2].partition(";")[0]
        assert kept == f"haptic_fieldbus_{served.port}={served.token}"
        assert answer(served, f"/?{path.query}", host).startswith("HTTP/1.1 403")
        assert answer(served, f"/?{path.query}", {**host, "Cookie": kept}).startswith("HTTP/1.1 200")


TOKEN = "a; b\"'é=\u2603\n/&"


def test_a_token_of_any_letters_opens_the_page_and_its_cookie_does_too(served: Served) -> None:
    words = ("view", "--run", str(served.process.pid), "--port", "0", "--token", TOKEN)
    with serving(*words) as attached:
        host = {"Host": f"127.0.0.1:{attached.port}"}
        given = answer(attached, f"/?token={attached.token}", host)
        assert given.startswith("HTTP/1.1 200")
        cookie = given.lower().partition("set-cookie: ")[2].partition(";")[0]
        name = f"haptic_fieldbus_{attached.port}="
        assert cookie.startswith(name)
        kept = {**host, "Cookie": name + attached.token}
        assert cookie == (name + attached.token).lower()
        assert answer(attached, "/assets/client.js", kept).startswith("HTTP/1.1 200")
        assert answer(attached, f"/?token={attached.token}x", host).startswith("HTTP/1.1 403")


def test_a_browser_leaves_the_usual_port_of_http_out() -> None:
    from haptic_fieldbus.view.server import hosts_of  # which loads nicegui

    assert "127.0.0.1" not in hosts_of("127.0.0.1", 8080)
    assert hosts_of("Lab", 8080) == {"lab:8080", "127.0.0.1:8080", "localhost:8080"}
    assert hosts_of("Lab", 80) == {"lab:80", "127.0.0.1:80", "localhost:80", "lab", "127.0.0.1", "localhost"}


def test_the_server_listens_on_the_loopback_alone(served: Served) -> None:
    with open("/proc/net/tcp", encoding="ascii") as file:
        local = [line.split()[1] for line in file.read().splitlines()[1:] if line.split()[3] == "0A"]
    assert f"0100007F:{served.port:04X}" in local
    assert f"00000000:{served.port:04X}" not in local


def test_one_page_steers_and_others_look_until_it_leaves() -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        first = connected(served, "first")
        assert begun(first)["simulated"]
        second = connected(served, "second")
        assert told(second, "steers") is False
        second.send('{"change": {"wall.stiffness": 111}, "pull": ["handle", 0.05], "paused": true}')
        second.send('{"steer": 1}')
        first.send('{"change": {"wall.stiffness": 700}}')
        assert told(second, "changed") == {"wall.stiffness": 700}
        first.close()
        second.send('{"steer": 1}')
        while not told(second, "steers"):
            second.send('{"steer": 1}')
        third = connected(served, "third")
        third.send('{"stop": true}')  # every page may stop
        status, out, err = served.ended()
        second.close()
        third.close()
    assert (status, "no trip" in out) == (130, True)
    assert "stopped by you" in err


def test_the_hand_of_a_page_that_steers_no_more_lets_go() -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        first = connected(served, "first")
        hello = begun(first)
        place, width = hello["columns"].index("handle.force"), len(hello["columns"])
        first.send('{"pull": ["handle", 0.035]}')
        second = connected(served, "second")
        steers, forces = False, [0.0]
        deadline = time.monotonic() + 60.0
        while not steers or forces[-1] < -1.0:  # the first one answers no more, so that another one may take over
            assert time.monotonic() < deadline
            received = second.recv()
            if isinstance(received, bytes):
                forces.append(float(np.frombuffer(received)[2:].reshape(-1, width)[-1, place]))
                second.send('{"ack": 1, "steer": 1}')
            else:
                steers = json.loads(received).get("steers", steers)
        assert min(forces) < -1.0
        for page in (first, second):
            page.close()


def test_a_page_that_stands_still_is_sent_one_picture_and_the_newest_rows_when_it_goes_on(served: Served) -> None:
    still, page = connected(served, "still"), connected(served, "page")
    still.send('{"steer": 1}')
    pictures = 0
    while pictures < 40:
        received = page.recv()
        if isinstance(received, bytes):
            pictures += 1
            page.send('{"ack": 1}')
    newest = page.recv_data()[1]
    still.settimeout(1.0)
    waiting: list[object] = []
    with contextlib.suppress(websocket.WebSocketTimeoutException):
        while True:
            waiting.append(still.recv())
    assert sum(isinstance(each, bytes) for each in waiting) == 1
    still.settimeout(60)
    still.send('{"ack": 1}')
    while not isinstance(picture := still.recv(), bytes):
        pass
    assert len(newest) > 0
    assert len(picture) > 0
    page.close()
    still.close()


def test_a_run_goes_on_without_its_server_and_is_attached_to_again() -> None:
    with serving("demo", "--no-browser", "--port", "0") as run:
        server = children(run.process.pid)
        assert len(server) == 1
        os.kill(server[0], signal.SIGKILL)
        for _ in range(2):
            with serving("view", "--run", str(run.process.pid), "--port", "0") as attached:
                page = connected(attached, "page")
                assert begun(page)["scene"] == "wall"
                page.send('{"change": {"wall.position": 0.021}}')
                assert told(page, "changed") == {"wall.position": 0.021}
                page.send('{"change": {"wall.position": 0.02}}')
                assert told(page, "changed") == {"wall.position": 0.02}
                page.close()
        assert run.process.poll() is None
        with serving("view", "--run", str(run.process.pid), "--port", "0") as attached:
            page = connected(attached, "page")
            told(page, "hello")
            page.send('{"stop": true}')
            assert "stopped by you" in told(page, "ended")["text"]
            page.close()
            assert run.ended()[0] == 130
            assert attached.ended()[0] == 0


def test_a_recorded_run_is_repeated_with_its_page_and_its_rows_are_the_same(tmp_path: Path) -> None:
    first, again = tmp_path / "first.csv", tmp_path / "again.csv"
    run("wall", duration=1.0, changes=[(0.5, {"wall.stiffness": 700.0})], record=first)
    with serving("run", "--from", str(first), "--view", "--view-port", "0", "--record", str(again)) as served:
        page = connected(served, "page")
        assert told(page, "hello")["scene"] == "wall"
        page.close()
        assert served.ended()[0] == 0
    assert first.read_bytes() == again.read_bytes()


def test_a_wrong_value_of_a_page_leaves_the_server_with_its_run_and_the_page_steers_on() -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        page = connected(served, "page")
        begun(page)
        for wrong in ('{"speed": NaN}', '{"pull": 5}', '{"change": {"wall.stiffness": NaN}}', '{"steps": 1e999}'):
            page.send(wrong)
            assert "expected" in told(page, "refused")
        page.send('{"change": {"wall.stiffness": 700}}')
        assert told(page, "changed") == {"wall.stiffness": 700}
        page.close()


def test_a_command_that_is_too_long_is_refused_and_a_long_name_is_cut() -> None:
    """The run leaves a server that sends too long a line; as JSON, a letter may be six octets."""
    with serving("demo", "--no-browser", "--port", "0") as served:
        page = connected(served, "page")
        begun(page)
        page.send(json.dumps({"change": {"é" * 31_000: 1}}, ensure_ascii=False))
        assert told(page, "refused") == "the command is too long"
        page.send(json.dumps({"change": {"x" * 31_000: 1}}))
        assert len(told(page, "refused")) < 1000
        page.send('{"change": {"wall.stiffness": 700}}')
        assert told(page, "changed") == {"wall.stiffness": 700}
        page.close()


def test_another_scene_is_begun_by_the_process_of_the_run_which_says_how_each_ended() -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        page = connected(served, "page")
        assert "detents" in begun(page)["scenes"]
        page.send('{"scene": "detents"}')
        hello = begun(page)
        assert [hello["scene"], hello["run"]] == ["detents", 1]
        page.send('{"change": {"detents.amplitude": 0.8}}')
        assert told(page, "changed") == {"detents.amplitude": 0.8}
        page.send('{"stop": true}')
        status, out, _ = served.ended()
        page.close()
    assert status == 130
    assert [line.split()[1] for line in out.splitlines() if line.startswith("scene")] == ["wall:", "detents:"]
    assert out.count("no trip") == 2


PROMISED, LOADED = 10.0, 6.0
"""Processor time of a demo up to its first rows [s], and elapsed time as its multiple on a busy computer."""


def processor_time(pid: int) -> float:
    """Return the processor time that a process has taken [s]."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_demo_shows_a_wall_and_a_hand_by_mouse_within_ten_seconds() -> None:
    began = time.monotonic()
    with serving("demo", "--no-browser", "--port", "0") as served:
        page = connected(served, "page")
        hello = begun(page)
        elapsed = time.monotonic() - began
        taken = sum(map(processor_time, (served.process.pid, *children(served.process.pid))))
        assert taken < PROMISED
        assert elapsed < PROMISED * LOADED
        assert hello["simulated"]
        assert hello["axes"][0]["surfaces"][0]["name"] == "wall"
        place, width = hello["columns"].index("handle.force"), len(hello["columns"])
        page.send('{"pull": ["handle", 0.035]}')
        pushed = 0.0
        while pushed > -1.0:
            received = page.recv()
            if isinstance(received, bytes):
                page.send('{"ack": 1}')
                pushed = float(np.frombuffer(received)[2:].reshape(-1, width)[:, place].min())
        page.close()
