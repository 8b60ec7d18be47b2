"""Opening python-can interfaces: every one that cannot be opened is told in one sentence, with what to do."""

import errno
import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import can
import pytest
from can.interfaces.virtual import VirtualBus

from haptic_fieldbus.buses.canopen.access import opened
from haptic_fieldbus.buses.canopen.opening import (
    ADVICE,
    LEAKING,
    MULTICAST_ALL,
    NO_CAN,
    OF_A_PACKAGE,
    SERIAL,
    adapter_checks,
    hears_its_group_alone,
    kernel_has_can,
    open_can,
)
from haptic_fieldbus.buses.usb_serial import NO_SERIAL_LINE, NO_SUCH_DEVICE
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CAN_INTERFACES, SIMULATION_INTERFACE, CanSection
from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, require_multicast

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
    """Text of a client in answer to the greeting of the daemon."""
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
    ends = [f"; {ADVICE.get(interface, OF_A_PACKAGE)}"]
    if interface in SERIAL:
        ends = [NO_SERIAL_LINE] if channel == "/dev/null" else [*ends, NO_SUCH_DEVICE]
    elif interface == "socketcan" and not kernel_has_can():
        ends = [NO_CAN]
    assert said.endswith(tuple(ends))
    assert "\n" not in said


def test_every_interface_of_python_can_has_its_advice() -> None:
    assert set(ADVICE) == set(CAN_INTERFACES)
    assert all(any(word in advice for word in ("install", "type", "give")) for advice in ADVICE.values())


@pytest.mark.parametrize("interface", ["slcan", "serial", "robotell"])
def test_a_serial_port_that_is_not_there_is_told_in_words(interface: str) -> None:
    with pytest.raises(BusError) as caught:
        open_can(CanSection(interface, "/dev/ttyACM99"))
    assert str(caught.value) == f"cannot open {interface}:/dev/ttyACM99: {NO_SUCH_DEVICE}"


def test_a_kernel_without_can_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))

    monkeypatch.setattr(socket, "socket", refuse)
    section = CanSection("socketcan", "can0")
    with pytest.raises(BusError) as caught:
        open_can(section)
    assert str(caught.value) == f"cannot open socketcan:can0: {NO_CAN}"
    assert next(adapter_checks(section, tmp_path, lambda _: "")).advice == NO_CAN


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


@pytest.mark.xdist_group("peers")
class TestMulticast:
    """A bus is a group: another one on the same port of this computer is another bus."""

    OTHER = "239.74.163.3"

    @pytest.fixture
    def port(self) -> int:
        port = free_port()
        require_multicast(port)
        return port

    def opened(self, group: str, port: int) -> can.BusABC:
        return open_can(CanSection("udp_multicast", group, arguments={"port": port}))

    @pytest.mark.skipif(not sys.platform.startswith("linux"), reason="IP_MULTICAST_ALL is an option of Linux")
    def test_a_second_bus_on_the_same_port_is_not_heard(self, port: int) -> None:
        with self.opened(GROUP, port) as ours, self.opened(GROUP, port) as same, self.opened(self.OTHER, port) as other:
            for number in range(1, 4):
                other.send(message(0x700 + number))
            same.send(message(0x7F0))
            assert until(0x7F0, ours) == [0x7F0]
            assert ours.channel_info == f"udp_multicast:{GROUP}"

    @pytest.mark.skipif(not sys.platform.startswith("linux"), reason="IP_MULTICAST_ALL is an option of Linux")
    def test_what_came_of_another_bus_while_ours_was_opened_is_dropped(self, port: int) -> None:
        with (
            can.Bus(interface="udp_multicast", channel=GROUP, port=port) as ours,
            self.opened(self.OTHER, port) as other,
        ):
            other.send(message(0x080))
            assert hears_its_group_alone(ours.fileno())
            other.send(message(0x081))
            ours.send(message(0x082))
            assert until(0x082, ours) == [0x082]

    def test_where_the_system_cannot_keep_it_apart_its_name_says_so(
        self, port: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        unknown = {family: (level, 250) for family, (level, _) in MULTICAST_ALL.items()}
        monkeypatch.setattr("haptic_fieldbus.buses.canopen.opening.MULTICAST_ALL", unknown)
        with self.opened(GROUP, port) as bus:
            assert bus.channel_info == f"udp_multicast:{GROUP} ({LEAKING})"
        section = CanSection("udp_multicast", GROUP, listen=0.0, arguments={"port": port})
        with opened(section, {}) as wire:
            assert wire.name == f"udp_multicast:{GROUP} ({LEAKING})"

    def test_a_missing_package_is_named_with_the_extra_that_has_it(self) -> None:
        program = (
            "import sys; sys.modules['msgpack'] = None\n"
            "from haptic_fieldbus.cli import main\n"
            "main(['simulate', '--bus', 'udp_multicast:239.74.163.2@1000000'])"
        )
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "msgpack not installed; install this package with its extra multicast" in done.stderr
        assert "pip install -e '.[multicast]'" in done.stderr
        assert "type a" not in done.stderr, "a group was typed"


def until(last: int, bus: can.BusABC) -> list[int]:
    """The identifiers that a bus hears, up to this one."""
    heard: list[int] = []
    while last not in heard:
        frame = bus.recv(STARTS_WITHIN)
        assert frame is not None, f"{last:03X}h did not come"
        heard.append(frame.arbitration_id)
    return heard


def message(can_id: int) -> can.Message:
    return can.Message(arbitration_id=can_id, is_extended_id=False)
