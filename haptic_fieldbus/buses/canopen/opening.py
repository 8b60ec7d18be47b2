"""Opening an interface of python-can, and the advice for each one that cannot be opened.

Most interfaces need the driver of a vendor. Without it each fails in its own way, kvaser even by NameError, so here
every exception counts as a refusal.
"""

import errno
import logging
import os
import socket
import sys
from collections.abc import Mapping
from contextlib import suppress
from importlib.util import find_spec
from typing import Any

import can

from haptic_fieldbus.buses.canopen.adapter import SERIAL
from haptic_fieldbus.buses.canopen.errors import FOREIGN, translate
from haptic_fieldbus.buses.usb_serial import NO_SERIAL_LINE, leads_elsewhere
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection

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
    "socketcand": "install nothing, but give the daemon, for example socketcand:can0,host=192.168.1.20,port=29536",
    "systec": f"install the USB-CANmodul driver of SYS TEC, which is for Windows only; {_SOCKETCAN}",
    "udp_multicast": "type a multicast group, for example udp_multicast:239.74.163.2",
    "usb2can": 'install the CANAL driver of 8devices, which is for Windows only, and "pywin32" by pip',
    "vector": "install the XL driver library of Vector, which is for Windows only",
    "virtual": "type virtual:NAME",
}
"""What to install or to type, by the name of the interface."""
PACKAGES: Mapping[str, tuple[str, str]] = {
    "udp_multicast": (
        "msgpack",
        "install this package with its extra multicast (in a checkout: `pip install '.[multicast]'`), or msgpack",
    ),
}
"""Module that an interface imports, and the advice in place of the one above where it is not installed."""
OF_A_PACKAGE = "install what the package of this interface asks for"
"""Advice for an interface that another package adds to python-can."""
SILENT = logging.NullHandler()
"""A single one, however often nothing can be opened; it stays until something can."""
MULTICAST_ALL = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
"""Level and number of IP_MULTICAST_ALL and IPV6_MULTICAST_ALL of Linux, which the module `socket` does not name."""
LEAKING = "hears other groups on its port too: give each bus a port of its own, port=NUMBER"
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
    advice = advice_for(section.interface)
    # python-can warns of a missing driver before it raises, and of a bus half opened when it is forgotten. The error
    # says it all, so these warnings do not fall back to standard error; a program's own handlers still get them.
    logger = logging.getLogger("can")
    logger.addHandler(SILENT)
    try:
        bus = can.Bus(section.channel, section.interface, **given)
    except FOREIGN as error:
        if section.interface in SERIAL and leads_elsewhere(section.channel.partition("@")[0], error):
            raise BusError(f"{subject}: {NO_SERIAL_LINE}") from error
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


def advice_for(interface: str) -> str:
    """Return what to install or to type when an interface cannot be opened."""
    module, install = PACKAGES.get(interface, ("", ""))
    if module and find_spec(module) is None:
        return install
    return ADVICE.get(interface, OF_A_PACKAGE)


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
