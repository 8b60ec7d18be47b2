"""Opening an interface of python-can, and the advice for each one that cannot be opened.

Most interfaces need the driver of a vendor. Without it each fails in its own way, kvaser even by NameError, so here
every exception counts as a refusal.
"""

import logging
from collections.abc import Mapping
from typing import Any

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, translate
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
    "udp_multicast": 'install "python-can[multicast]" by pip, and type a group, for example udp_multicast:239.74.163.2',
    "usb2can": 'install the CANAL driver of 8devices, which is for Windows only, and "pywin32" by pip',
    "vector": "install the XL driver library of Vector, which is for Windows only",
    "virtual": "type virtual:NAME",
}
"""What to install or to type, by the name of the interface."""
OF_A_PACKAGE = "install what the package of this interface asks for"
"""Advice for an interface that another package adds to python-can."""
SILENT = logging.NullHandler()
"""A single one, however often nothing can be opened; it stays until something can."""
_NO_DRIVER = (NameError, AttributeError, ImportError)
"""Exceptions of an interface that begins to use a library which is not there."""


def open_can(section: CanSection) -> can.BusABC:
    """Open the python-can interface of a rig; raises UsageError for impossible settings, BusError for the rest.

    Both name the bus, the reason and what to install or to type, in one sentence.
    """
    given: dict[str, Any] = {**section.arguments, "bitrate": section.bitrate}
    subject = f"cannot open {section.interface}:{section.channel}"
    advice = ADVICE.get(section.interface, OF_A_PACKAGE)
    # python-can warns of a missing driver before it raises, and of a bus half opened when it is forgotten. The error
    # says it all, so these warnings do not fall back to standard error; a program's own handlers still get them.
    logger = logging.getLogger("can")
    logger.addHandler(SILENT)
    try:
        bus = can.Bus(section.channel, section.interface, **given)
    except FOREIGN as error:
        raise type(ours := translate(error, subject))(f"{ours}; {advice}") from error
    except _NO_DRIVER as error:
        raise BusError(f"{subject}: its driver is missing ({error}); {advice}") from error
    except (ValueError, TypeError) as error:  # how interfaces refuse settings that they cannot have
        raise UsageError(f"{subject}: {error}; {advice}") from error
    except Exception as error:
        raise BusError(f"{subject}: {type(error).__name__}: {error}; {advice}") from error
    logger.removeHandler(SILENT)
    return bus
