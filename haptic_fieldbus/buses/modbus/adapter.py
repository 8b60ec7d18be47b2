"""Checks of a Modbus line: the rights to a serial port, its latency timer, and the way to a unit and back."""

import os
from collections.abc import Iterator
from pathlib import Path

from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.set_up import ADVICE
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.buses.timing import timing_checks
from haptic_fieldbus.buses.usb_serial import SYS, latency_timer
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile

QUESTIONS = 200
ANSWER_NS = 100_000_000
SLOW = {
    True: "the adapter holds octets back, or the drive answers late: see usb_latency_timer, and the drive's own delay",
    False: "the network or the drive answers late: connect the drive to this computer by a cable of its own",
}
"""Whether the line is a serial one → what to do about answers that come late."""


def adapter_checks(section: ModbusSection, root: Path = SYS) -> Iterator[Check]:
    """Yield the checks of the adapter, from what the system tells of it."""
    if not section.serial:
        yield Check("usb_latency_timer", None, "none, the line is a network")
        return
    yield _access(section.channel)
    yield latency_timer(section.channel, root)


def _access(device: str) -> Check:
    """Check that this user may read and write the serial port."""
    if not Path(device).exists():
        return Check("serial_access", False, f"no {device}", "plug the adapter in; ports are listed by: ls /dev/tty*")
    if os.access(device, os.R_OK | os.W_OK):
        return Check("serial_access", True, f"{device} may be read and written")
    advice = f"add this user to the group of {device} (ls -l), often: usermod -aG dialout USER; then log in anew"
    return Check("serial_access", False, f"{device} may not be opened", advice)


def round_trip_checks(
    requester: Requester, unit: UnitClient, profile: ModbusProfile, rate: float
) -> tuple[Check, Check]:
    """Ask for the status many times, and check the round trip and its jitter for a loop of this rate [Hz].

    Raises BusError when the line is dead.
    """
    times: list[float] = []
    for _ in range(QUESTIONS):
        requester.ask(unit.reading(profile.power.status))
        if requester.answer(requester.sent_ns + ANSWER_NS) is not None:
            times.append((requester.arrived_ns - requester.sent_ns) * 1e-9)
        elif not times:
            break  # a unit that is not there
        requester.forget()
    serial = requester.transport.serial
    return timing_checks(f"unit {unit.id}", times, QUESTIONS, rate, silent=ADVICE[serial], slow=SLOW[serial])
