"""Opening an interface of python-can, and the advice for each one that cannot be opened.

Most interfaces need the driver of a vendor. Without it each fails in its own way, kvaser even by NameError, so here
every exception counts as a refusal.
"""

import errno
import json
import logging
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can

from haptic_fieldbus.buses import usb_serial
from haptic_fieldbus.buses.canopen.errors import FOREIGN, translate
from haptic_fieldbus.buses.scan_result import Check
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection

# Checks of a CAN adapter, from what the system tells of it, and of the way to a drive and back.
#
# Under Linux, /sys and `ip -details -json link show` know driver, state, bit rate and queue of a SocketCAN interface,
# and the latency timer of a serial port. Everywhere else only the round trip can be measured.
#
# Reference: Documentation/networking/can.rst of Linux.

SHORTEST_QUEUE, ADVISED_QUEUE = 100, 1000
"""Transmit queue [frames]: below the first, a burst of SDO and PDO frames of some axes is refused."""
VIRTUAL = ("vcan", "vxcan")
HEALTHY = ("ERROR-ACTIVE",)
NOT_HEALTHY = (
    "frames are lost or not acknowledged: check power and bit rate of a second node, CAN high and CAN low, and both "
    "120 Ω terminators (60 Ω between the lines)"
)
SERIAL = ("slcan", "serial", "robotell", "seeedstudio")
"""Interfaces of python-can whose channel is a serial port."""
NO_CAN = "this kernel has no CAN: type modprobe -a can can_raw, or haptic-fieldbus vcan -- in front of the command"
"""Advice where the kernel does not know the address family of SocketCAN."""
Show = Callable[[str], str]
"""Function that returns what `ip` tells of an interface, as JSON; empty when it tells nothing."""


def shown_by_ip(channel: str) -> str:
    """Return the details of a network interface as `ip` prints them; empty without `ip`, or such an interface."""
    try:
        command = ["ip", "-details", "-json", "link", "show", channel]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=5).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def kernel_has_can() -> bool:
    """Return whether the kernel knows the address family of SocketCAN, or whether that is unknown."""
    try:
        with socket.socket(getattr(socket, "AF_CAN", socket.AF_INET), socket.SOCK_RAW):
            return True
    except OSError as error:
        return error.errno != errno.EAFNOSUPPORT


def adapter_checks(section: CanSection, root: Path = usb_serial.SYS, show: Show = shown_by_ip) -> Iterator[Check]:
    """Yield the checks of the adapter of a bus; those that do not apply to its interface are missing or None."""
    if section.interface == "socketcan":
        yield from _socketcan_checks(section, root / "class" / "net" / section.channel, _details(show(section.channel)))
    else:
        yield Check("driver", None, f"{section.interface}, by python-can")
        told = f"{section.bitrate} bit/s requested; the adapter does not report its bit rate"
        yield Check("bit_rate", None, told)
        yield Check("queue", None, f"{section.interface} reports no queue")
    if section.interface in SERIAL:
        yield usb_serial.latency_timer(section.channel.split("@")[0], root)
    else:
        yield Check("usb_latency_timer", None, "the bus uses no serial port")


def _socketcan_checks(section: CanSection, folder: Path, details: dict[str, Any]) -> Iterator[Check]:
    """Yield the checks of a SocketCAN interface, as its folder in sysfs and `ip` describe it."""
    channel, link = section.channel, details.get("linkinfo", {})
    virtual, controller = link.get("info_kind") in VIRTUAL, link.get("info_data", {})
    up = f"ip link set {channel} down; ip link set {channel} up type can bitrate {section.bitrate} restart-ms 100"
    if folder.exists():
        driver = folder / "device" / "driver"
        yield Check("driver", True, driver.resolve().name if driver.exists() else "virtual")
    else:
        listed = f"no {channel}: plug the adapter in; to list names: ip -details link show type can"
        yield Check("driver", False, f"no interface {channel}", listed if kernel_has_can() else NO_CAN)
    # The interface must be up, and its controller take part in the bus.
    state = controller.get("state", "virtual" if virtual else "unknown")
    if not details:
        yield Check("state", None, "unknown: no output of `ip`", "install iproute2 to read the state")
    elif "UP" not in details.get("flags", []):
        yield Check("state", False, "down", f"bring it up: {f'ip link set {channel} up' if virtual else up}")
    elif state in HEALTHY or virtual:
        yield Check("state", True, f"up, {state.lower()}")
    else:
        yield Check("state", False, f"up, {state.lower()} ({channel})", f"{NOT_HEALTHY}; then: {up}")
    asked, found = section.bitrate, controller.get("bittiming", {}).get("bitrate")
    if found is None:
        yield Check("bit_rate", None, "none: a virtual bus has no bit rate" if virtual else "unknown")
    else:
        advice = "" if found == asked else f"set it: {up}"
        yield Check("bit_rate", found == asked, f"{found} bit/s, requested {asked}", advice)
    yield _queue_check(channel, folder)


def _queue_check(channel: str, folder: Path) -> Check:
    try:
        length = int((folder / "tx_queue_len").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return Check("queue", None, "unknown")
    if length >= SHORTEST_QUEUE:
        return Check("queue", True, f"{length} frames")
    rule = f'ACTION=="add", SUBSYSTEM=="net", KERNEL=="{channel}", ATTR{{tx_queue_len}}="{ADVISED_QUEUE}"'
    longer = f"lengthen it: ip link set {channel} txqueuelen {ADVISED_QUEUE}"
    advice = f"{longer}; for good, write {rule} into /etc/udev/rules.d/99-can.rules"
    return Check("queue", False, f"{length} frames", advice)


def _details(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text or "[]")
    except ValueError:
        return {}
    return found[0] if isinstance(found, list) and found and isinstance(found[0], dict) else {}


_SOCKETCAN = "under Linux type socketcan:can0"
_PORT = "and type the serial port that is there, for example"
ADVICE: Mapping[str, str] = {
    "canalystii": 'install "python-can[canalystii]" by pip, and type canalystii:0 or canalystii:1',
    "cantact": 'install "python-can[cantact]" by pip, and type cantact:0',
    "etas": "install ETAS BOA, which is for Windows only",
    "gs_usb": f'install "python-can[gs-usb]" by pip, or {_SOCKETCAN}',
    "iscan": "install the isCAN driver of Thorsis, which is for Windows only",
    "ixxat": f"install the VCI driver of IXXAT, which is for Windows only; {_SOCKETCAN}",
    "kvaser": f"install CANlib of Kvaser, and type kvaser:0; {_SOCKETCAN} without it",
    "neousys": "install the WDT_DIO driver of Neousys",
    "neovi": 'install "python-can[neovi]" by pip, and the driver of Intrepid Control Systems',
    "nican": "install the NI-CAN driver, which is for 32-bit Python under Windows only",
    "nixnet": 'install the NI-XNET driver, which is for Windows only, and "python-can[nixnet]" by pip',
    "pcan": f"install PCAN-Basic of PEAK, and type pcan:PCAN_USBBUS1; {_SOCKETCAN} without it",
    "robotell": f'install "python-can[serial]" by pip, {_PORT} robotell:/dev/ttyUSB0',
    "seeedstudio": f'install "python-can[seeedstudio]" by pip, {_PORT} seeedstudio:/dev/ttyUSB0',
    "serial": f'install "python-can[serial]" by pip, {_PORT} serial:/dev/ttyUSB0',
    "slcan": f'install "python-can[serial]" by pip, {_PORT} slcan:/dev/ttyACM0',
    "socketcan": "type an interface that is up, as `ip -details link show type can` lists them",
    "socketcand": "no driver needed; give the daemon, for example socketcand:can0,host=192.168.1.20,port=29536",
    "systec": f"install the USB-CANmodul driver of SYS TEC, which is for Windows only; {_SOCKETCAN}",
    "udp_multicast": "type a multicast group and a port of 1 to 65535, for example udp_multicast:239.74.163.2 or "
    "udp_multicast:239.74.163.2,port=43113",
    "usb2can": 'install the CANAL driver of 8devices, which is for Windows only, and "pywin32" by pip',
    "vector": "install the XL driver library of Vector, which is for Windows only",
    "virtual": "type virtual:NAME",
}
"""Package to install or bus name to type, by the name of the interface."""
NO_MODULE = "install this package with its extra multicast (in a checkout: `pip install -e '.[multicast]'`), or msgpack"
"""Advice for udp_multicast in place of the one above, where the module that it imports is not installed."""
OF_A_PACKAGE = "install the driver that the package of this interface requires"
"""Advice for an interface that another package adds to python-can."""
SILENT = logging.NullHandler()
"""A single one, however often nothing can be opened; it stays until something can."""
MULTICAST_ALL = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
"""Level and number of IP_MULTICAST_ALL and IPV6_MULTICAST_ALL of Linux, which the module `socket` does not name."""
LEAKING = "receives other groups on its port too: give each bus its own port, port=NUMBER"
"""Addition to the name of a bus that cannot be kept apart from others."""
_MOST_DRAINED = 10_000
_NO_DRIVER = (NameError, AttributeError, ImportError)
"""Exceptions of an interface that begins to use a library which is not there."""


def open_can(section: CanSection) -> can.BusABC:
    """Open the python-can interface of a rig; raises UsageError for impossible settings, BusError for the rest.

    Both name the bus, the reason and what to install or to type, in one sentence.
    """
    given: dict[str, Any] = {**section.arguments, "bitrate": section.bitrate}
    subject = f"cannot open {section.interface}:{section.channel}"
    advice = ADVICE.get(section.interface, OF_A_PACKAGE)
    if section.interface == "udp_multicast" and find_spec("msgpack") is None:
        advice = NO_MODULE
    # python-can warns of a missing driver before it raises, and of a bus half opened when it is forgotten. The error
    # says it all, so these warnings do not fall back to standard error; a program's own handlers still get them.
    logger = logging.getLogger("can")
    logger.addHandler(SILENT)
    try:
        bus = can.Bus(section.channel, section.interface, **given)
    except FOREIGN as error:
        if section.interface in SERIAL and usb_serial.leads_elsewhere(section.channel.partition("@")[0], error):
            raise BusError(f"{subject}: {usb_serial.NO_SERIAL_LINE}") from error
        if section.interface in SERIAL and usb_serial.is_missing(error):
            raise BusError(f"{subject}: {usb_serial.NO_SUCH_DEVICE}") from error
        if section.interface == "socketcan" and not kernel_has_can():
            raise BusError(f"{subject}: {NO_CAN}") from error
        raise type(ours := translate(error, subject))(f"{ours}; {advice}") from error
    except _NO_DRIVER as error:
        raise BusError(f"{subject}: its driver is missing ({error}); {advice}") from error
    except (ValueError, TypeError) as error:  # how interfaces refuse settings that they cannot have
        raise UsageError(f"{subject}: {error}; {advice}") from error
    except Exception as error:
        raise BusError(f"{subject}: {type(error).__name__}: {error}; {advice}") from error
    logger.removeHandler(SILENT)
    if bus.channel_info == can.BusABC.channel_info:  # "unknown", which is no name for a person
        bus.channel_info = f"{section.interface}:{section.channel}"
    if section.interface == "udp_multicast" and not hears_its_group_alone(bus.fileno()):
        bus.channel_info += f" ({LEAKING})"
    return bus


def hears_its_group_alone(descriptor: int) -> bool:
    """Let a socket of udp_multicast hear its own group alone; return False where the system cannot do that.

    python-can binds the socket to all addresses of its port. Linux then delivers each group that any program of this
    computer has joined, unless IP_MULTICAST_ALL is 0 (ip(7)). Frames from before are dropped.
    """
    if not sys.platform.startswith("linux"):
        return False
    with socket.socket(fileno=os.dup(descriptor)) as ours:
        try:
            ours.setsockopt(*MULTICAST_ALL[ours.family], 0)
        except OSError as error:
            if error.errno not in (errno.ENOPROTOOPT, errno.EINVAL):
                raise
            return False
        with suppress(BlockingIOError):
            for _ in range(_MOST_DRAINED):
                ours.recv(1, socket.MSG_DONTWAIT)
    return True
