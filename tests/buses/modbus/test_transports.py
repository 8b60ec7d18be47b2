"""Octets over a real socket and a real pseudo-terminal: dropped, sent, received in time; a dead line is told."""

import os
import pty
import select
import socket
import struct
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.buses.modbus.access import open_line
from haptic_fieldbus.buses.modbus.transport import DELAYED_ACK, SerialTransport, TcpTransport, Transport
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.modbus.bus import ModbusSection

CLOCK = MonotonicClock()
SOON = 2_000_000_000


@dataclass
class Ends:
    """Our end of a line, and what the other end does."""

    ours: Transport
    put: Callable[[bytes], object]
    take: Callable[[], bytes]
    end: Callable[[], None]


def tcp_ends(*, nagle: bool = False) -> Iterator[Ends]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        ours = TcpTransport(f"modbus-tcp:127.0.0.1:{port}", ("127.0.0.1", port), CLOCK)
        theirs, _ = listener.accept()
        theirs.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, not nagle)

        def reset() -> None:
            theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            theirs.close()

        with theirs:
            yield Ends(ours, theirs.sendall, lambda: theirs.recv(4096), reset)
        ours.close()


def rtu_ends() -> Iterator[Ends]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    ours = SerialTransport(f"modbus-rtu:{name}", name, CLOCK)
    os.close(slave)
    ends = [master]

    def end() -> None:
        while ends:
            os.close(ends.pop())

    yield Ends(ours, lambda octets: os.write(master, octets), lambda: os.read(master, 4096), end)
    ours.close()
    end()


@pytest.fixture(params=[tcp_ends, rtu_ends], ids=["tcp", "rtu"])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    yield from request.param()


def received(ours: Transport, size: int) -> bytes:
    """So many octets, however many came at once."""
    octets = b""
    while len(octets) < size:
        octets += ours.receive(CLOCK.now_ns() + SOON)
    return octets


def test_all_octets_pass_in_both_directions(ends: Ends) -> None:
    every = bytes(range(256))
    ends.ours.tune(115200, "even", 1)
    ends.ours.send(every)
    assert ends.take() == every
    ends.put(every)
    assert received(ends.ours, 256) == every


def test_a_deadline_ends_the_wait_and_one_that_is_over_does_not_wait(ends: Ends) -> None:
    for wait_ns in (3_000_000, -1):
        began_ns = CLOCK.now_ns()
        assert ends.ours.receive(began_ns + wait_ns) == b""
        assert wait_ns <= CLOCK.now_ns() - began_ns


def test_no_wait_is_asked_for_that_goes_beyond_the_deadline(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    waits, select_ = list[float](), select.select

    def noted(*asked: Any) -> Any:
        waits.append(asked[3])
        return select_(*asked)

    monkeypatch.setattr(select, "select", noted)
    for wait_ns in (200_000, 900_000, 3_400_000):
        waits.clear()
        assert ends.ours.receive(CLOCK.now_ns() + wait_ns) == b""
        assert waits
        assert sum(waits) <= 1e-9 * wait_ns


def test_what_came_is_taken_after_the_deadline_too(ends: Ends) -> None:
    ends.put(b"late")
    assert received(ends.ours, 1) + ends.ours.receive(0) == b"late"


def test_what_waits_is_dropped_and_told(ends: Ends) -> None:
    assert ends.ours.discard() == b""
    ends.put(b"a")
    assert received(ends.ours, 1) == b"a"
    ends.put(b"old")
    dropped = b""
    until = time.monotonic() + 2.0
    while len(dropped) < 3 and time.monotonic() < until:
        dropped += ends.ours.discard()
    assert dropped == b"old"
    assert ends.ours.receive(0) == b""


def test_a_dead_line_raises_in_a_sentence_whatever_is_asked_of_it(ends: Ends) -> None:
    ends.end()
    with pytest.raises(BusError, match=r"connection|gone"):
        received(ends.ours, 1)
    with pytest.raises(BusError, match=rf"^{ends.ours.name}: "):
        ends.ours.discard()
    ends.ours.close()
    actions: tuple[Callable[[], object], ...] = (lambda: ends.ours.send(b"x"), ends.ours.discard)
    for action in actions:
        with pytest.raises(BusError, match="closed"):
            action()


@pytest.mark.skipif(not hasattr(socket, "TCP_QUICKACK"), reason="this system has no TCP_QUICKACK")
def test_a_peer_that_waits_for_our_acknowledgement_gets_it_when_more_is_waited_for() -> None:
    """Nagle's algorithm holds the second piece back; without an acknowledgement it comes 40 ms later."""
    for ends in tcp_ends(nagle=True):
        for _ in range(50):  # the kernel acknowledges at once until it takes the connection for a dialogue
            ends.ours.send(b"question")
            assert ends.take() == b"question"
            ends.put(b"answer")
            assert received(ends.ours, 6) == b"answer"
        for _ in range(3):
            ends.ours.send(b"question")
            assert ends.take() == b"question"
            ends.put(b"head")
            ends.put(b"tail")
            assert received(ends.ours, 4) == b"head"
            assert ends.ours.receive(CLOCK.now_ns() + round(0.5e9 * DELAYED_ACK)) == b"tail"


def test_tcp_connects_again() -> None:
    for ends in tcp_ends():
        ends.end()
        with pytest.raises(BusError):
            received(ends.ours, 1)
        ends.ours.reopen()
        ends.ours.send(b"x")


def test_tcp_looks_up_the_name_of_a_drive_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name server that is gone answers after seconds, and a drive with torque would wait for them."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = TcpTransport("modbus-tcp:drive", ("localhost", listener.getsockname()[1]), CLOCK)
        lookups, look_up = list[str](), socket.getaddrinfo

        def noted(host: str, *rest: Any, **named: Any) -> Any:
            lookups.append(host)
            return look_up(host, *rest, **named)

        monkeypatch.setattr(socket, "getaddrinfo", noted)
        for _ in range(2):
            ours.reopen()
            ours.send(b"x")
        assert all(ip_address(host) for host in lookups), "an address by numbers needs no name server"
        listener.close()
        with pytest.raises(BusError, match="cannot connect to modbus-tcp:drive"):
            ours.reopen()


def local_host() -> str:
    """Return a link-local address of this computer with its interface; the loopback where it has none."""
    lines = [line.split() for line in Path("/proc/net/if_inet6").read_text().splitlines()]
    found = [f"{ip_address(int(line[0], 16))}%{line[5]}" for line in lines if line[0].startswith("fe80")]
    return found[0] if found else "::1"


def test_tcp_finds_a_drive_on_a_link_local_address_again() -> None:
    """Such an address means nothing without the interface that the connection goes through."""
    *_, address = socket.getaddrinfo(local_host(), 0, type=socket.SOCK_STREAM)[0]
    with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as listener:
        listener.bind(address)
        listener.listen()
        ours = TcpTransport("modbus-tcp:drive", (local_host(), listener.getsockname()[1]), CLOCK)
        listener.accept()[0].close()
        ours.reopen()
        ours.send(b"x")
        with listener.accept()[0] as peer:
            assert peer.recv(1) == b"x"
        ours.close()


def test_a_peer_that_takes_nothing_is_told_and_octets_do_not_wait() -> None:
    for ends in tcp_ends():
        for _ in range(2):
            with pytest.raises(BusError, match="accepts no more"):
                filled(ends.ours)


def filled(ours: Transport) -> None:
    for _ in range(1000):
        ours.send(bytes(100_000))


def test_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(BusError, match=rf"cannot connect to modbus-tcp:127.0.0.1:{port}: no server at this address"):
        open_line(ModbusSection("modbus-tcp", f"127.0.0.1:{port}"), CLOCK)


def test_a_host_without_a_name_and_a_port_that_is_not_there_are_told() -> None:
    with pytest.raises(BusError, match="no such host"):
        open_line(ModbusSection("modbus-tcp", "no.such.host.invalid"), CLOCK)
    with pytest.raises(BusError, match="no such device; plug the adapter in"):
        open_line(ModbusSection("modbus-rtu", "/dev/no_such_port"), CLOCK)


def test_a_simulated_line_is_not_opened() -> None:
    with pytest.raises(UsageError, match="only in a simulated run"):
        open_line(ModbusSection("sim-modbus-tcp", "sim"), CLOCK)


def test_a_serial_port_is_held_by_one_program_alone() -> None:
    for ends in rtu_ends():
        with pytest.raises(BusError, match="another program has it open"):
            open_line(ModbusSection("modbus-rtu", ends.ours.name.partition(":")[2]), CLOCK)


def test_a_bit_rate_that_the_port_does_not_have_is_told() -> None:
    for ends in rtu_ends():
        with pytest.raises(BusError, match="-5 bit/s"):
            ends.ours.tune(-5, "even", 1)


@pytest.mark.parametrize("device", ["/dev/null", "/dev/zero", "folder", "file", "socket"])
def test_a_device_that_is_no_serial_line_says_so(device: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("", encoding="utf-8")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket"))
        path = tmp_path / device  # an absolute path stays as it is
        with pytest.raises(BusError) as refused:
            open_line(ModbusSection("modbus-rtu", str(path)), CLOCK)
    expected = "it is no serial device; expected the device of an adapter, such as /dev/ttyUSB0"
    assert str(refused.value) == f"cannot open modbus-rtu:{path}: {expected}"


def test_a_device_that_is_not_there_is_told_as_such() -> None:
    with pytest.raises(BusError, match="no such device"):
        open_line(ModbusSection("modbus-rtu", "/dev/nowhere"), CLOCK)


@pytest.mark.parametrize("host", ["192.168.0..10", ".local", 64 * "a" + ".example"])
def test_a_name_that_no_host_can_have_is_told_as_one(host: str) -> None:
    with pytest.raises(BusError, match="no such host; check its name"):
        TcpTransport(f"modbus-tcp:{host}", (host, 502), CLOCK)
