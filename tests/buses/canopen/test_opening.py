"""Opening python-can interfaces: every one that cannot be opened is told in one sentence, with what to do."""

import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import can
import pytest
from can.interfaces.virtual import VirtualBus

from haptic_fieldbus.buses.canopen.opening import ADVICE, OF_A_PACKAGE, open_can
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CAN_INTERFACES, SIMULATION_INTERFACE, CanSection

OPEN = {"virtual", SIMULATION_INTERFACE}
"""Interfaces that need no driver, so that any channel can be opened."""
CLOSED = sorted(set(can.VALID_INTERFACES) - OPEN)


def test_any_python_can_interface_can_be_opened() -> None:
    with open_can(CanSection("virtual", "wire-test")) as bus:
        assert isinstance(bus, can.BusABC)


def test_arguments_reach_the_interface() -> None:
    with open_can(CanSection("virtual", "small", arguments={"rx_queue_size": 3})) as bus:
        assert isinstance(bus, VirtualBus)
        assert bus.queue.maxsize == 3


def test_a_channel_of_digits_is_a_number_for_the_interface() -> None:
    with open_can(CanSection("virtual", "7")) as bus:
        assert isinstance(bus, VirtualBus)
        assert bus.channel_id == 7


def test_a_daemon_is_found_at_its_host_and_port() -> None:
    """By the greeting of socketcand's protocol, on a socket of this computer."""
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as pool:
        heard = pool.submit(greet, server)
        arguments = {"host": "127.0.0.1", "port": server.getsockname()[1]}
        with open_can(CanSection("socketcand", "can3", arguments=arguments)) as bus:
            assert bus.channel_info.startswith("socketcand on can3@127.0.0.1")
        assert heard.result(10.0) == ["< open can3 >", "< rawmode >"]


def greet(server: socket.socket) -> list[str]:
    """What a client says in answer to the greeting of the daemon."""
    server.settimeout(10.0)
    connection, _ = server.accept()
    heard = []
    with connection:
        connection.sendall(b"< hi >")
        for _ in range(2):
            heard.append(connection.recv(100).decode())
            connection.sendall(b"< ok >")
    return heard


def test_an_interface_that_does_not_exist_is_named() -> None:
    with pytest.raises(BusError, match="cannot open no_such_interface:can0"):
        open_can(CanSection("no_such_interface", "can0"))


def test_a_channel_that_does_not_exist_is_named() -> None:
    with pytest.raises((BusError, UsageError), match="cannot open socketcan:no_such_channel"):
        open_can(CanSection("socketcan", "no_such_channel"))


@pytest.mark.thorough("110 cases of one rule", quick=37)
@pytest.mark.parametrize("channel", ["0", "can0", "/dev/null", "", "1" * 400])
@pytest.mark.parametrize("interface", CLOSED)
def test_every_interface_that_cannot_be_opened_says_what_to_install_or_type(interface: str, channel: str) -> None:
    with pytest.raises((BusError, UsageError)) as caught:
        open_can(CanSection(interface, channel))
    said = str(caught.value)
    assert said.startswith(f"cannot open {interface}:{channel}: ")
    assert said.endswith(f"; {ADVICE.get(interface, OF_A_PACKAGE)}")
    assert "\n" not in said


def test_every_interface_of_python_can_has_its_advice() -> None:
    assert set(ADVICE) == set(CAN_INTERFACES)
    assert all("install" in advice or "type" in advice for advice in ADVICE.values())


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("interface", ["kvaser", "neousys"])
def test_the_command_says_it_in_one_line_and_nothing_else(interface: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "haptic_fieldbus", "run", "wall", "--bus", f"{interface}:0@1000000", "--yes", "--force"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"COLUMNS": "1000"},
    )
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert ADVICE[interface] in done.stderr
