"""Opening Modbus lines, and the questions to a unit that come before a plan."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from haptic_fieldbus.buses import scan_result
from haptic_fieldbus.buses.access import ANSWER_TIMEOUT, Axes, BusAccess, Logs, checks_on, look_at, profiles_of
from haptic_fieldbus.buses.modbus.exchange import listen
from haptic_fieldbus.buses.modbus.framing import Question
from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.setup import ADVICE
from haptic_fieldbus.buses.modbus.transport import SerialTransport, TcpTransport, Transport
from haptic_fieldbus.buses.modbus.unit import RefusedError, UnitClient
from haptic_fieldbus.buses.scan_result import Check, DriveReading, FoundNode, Scan
from haptic_fieldbus.buses.torque_limits import rated_torque
from haptic_fieldbus.buses.usb_serial import SYS, latency_timer
from haptic_fieldbus.buses.writing import FRAME_SUFFIXES
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, ForeignMasterError, UsageError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, characters, line_of, modbus_section
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Register, modbus_profile
from haptic_fieldbus.protocols.modbus.protocol import PROTOCOL
from haptic_fieldbus.signals import Signal

# Checks of a Modbus line: the rights to a serial port, its latency timer, and the way to a unit and back.

SLOW = {
    True: "the adapter delays octets, or the drive answers late: see usb_latency_timer, and the delay set in the drive",
    False: "the network or the drive answers late: connect the drive directly to this computer",
}
"""Whether the line is a serial one → what to do about answers that come late."""


def adapter_checks(section: ModbusSection, root: Path = SYS) -> Iterator[Check]:
    """Yield the checks of the adapter, from what the system tells of it."""
    if not section.serial:
        yield Check("usb_latency_timer", None, "none: the line is a network")
        return
    device = section.channel
    if not Path(device).exists():
        yield Check("serial_access", False, f"no {device}", "plug the adapter in; ports are listed by: ls /dev/tty*")
    elif os.access(device, os.R_OK | os.W_OK):
        yield Check("serial_access", True, f"{device} can be read and written")
    else:
        advice = f"add this user to the group of {device} (ls -l), often: usermod -aG dialout USER; then log in again"
        yield Check("serial_access", False, f"no permission to open {device}", advice)
    yield latency_timer(device, root)


def round_trip_checks(unit: UnitClient, profile: ModbusProfile, rate: float) -> tuple[Check, Check]:
    """Ask for the status many times, and check the round trip and its jitter for a loop of this rate [Hz].

    Raises BusError when the line is dead.
    """
    requester, asked = unit.requester, scan_result.QUESTIONS
    times: list[float] = []
    for _ in range(asked):
        requester.ask(unit.reading(profile.power.status))
        if requester.answer(requester.sent_ns + scan_result.ANSWER_NS) is not None:
            times.append((requester.arrived_ns - requester.sent_ns) * 1e-9)
        elif not times:
            break  # a unit that is not there
        requester.forget()
    serial = requester.transport.serial
    return scan_result.timing_checks(unit.label, times, asked, rate, silent=ADVICE[serial], slow=SLOW[serial])


# Looking at drives without touching them: their registers are read, and nothing is written.
#
# Reading feeds no watchdog, but it takes the line: as soon as octets come on a serial line that nobody here asked for,
# somebody else uses it, and nothing more is asked. On TCP another master is not disturbed.


class LineObserver:
    """Observer of the drives of one line. It listens before it sends anything. Raises BusError."""

    def __init__(self, requester: Requester, drives: Mapping[str, tuple[int, ModbusProfile]]) -> None:
        self.masters = ""
        self._requester = requester
        self._drives = {
            axis: (UnitClient(requester, unit, f"unit {unit} (axis {axis})", profile.line), profile)
            for axis, (unit, profile) in drives.items()
        }
        try:
            self.listened = listen(requester)
        except ForeignMasterError as error:
            self.listened = self.masters = str(error)

    def look(self) -> dict[str, DriveReading]:
        """Return what each drive says now; raises BusError when the line is dead."""
        return {axis: self._look_at(*drive) for axis, drive in self._drives.items()}

    def _look_at(self, unit: UnitClient, profile: ModbusProfile) -> DriveReading:
        requester = self._requester
        if requester.transport.serial and requester.unasked and not self.masters:
            self.masters = f"another master on {requester.name}: received octets without a request"
        now_ns = requester.clock.now_ns
        if self.masters:
            return DriveReading(now_ns(), note="not asked")
        return look_at(
            profile.registers(),
            lambda register: unit.read(register, ANSWER_TIMEOUT, 1),
            now_ns,
            arrived_ns=lambda: requester.arrived_ns,
            power=PROTOCOL.power_table(profile),
            error=profile.power.error,
            silent=ADVICE[requester.transport.serial],
        )


# Opening the line of a rig: a connection or a serial port.


def open_line(section: ModbusSection, clock: Clock) -> Transport:
    """Open a real line; raises BusError when it cannot be opened, UsageError for one that is simulated."""
    name = f"{section.interface}:{section.channel}"
    if section.simulated:
        real = "real interfaces are modbus-tcp and modbus-rtu"
        raise UsageError(f"{section.interface} exists only in a simulated run; {real}")
    if not section.serial:
        return TcpTransport(name, section.address, clock)
    return SerialTransport(name, section.channel, clock)


# Finding units by reading alone: only those that somebody names are asked.
#
# A unit that answers is there, be it with an exception. Modbus has no registers that all devices share, so what is read
# are the registers of the known profiles: a profile fits when the unit has all of them, and the values that tell its
# model are those of the profile. Where a profile names no such values, the unit must lack a register between those of
# the profile: a server that has every register would fit each profile.
#
# Reference: Modbus application protocol 1.1b3, 6.3 and 7.

THERE_NS = 200_000_000
"""Time that a unit has for its first answer [ns]."""
GAPS_TRIED = 3
"""Gaps between the registers of a profile of which one register is read."""
NO_PROFILE = "no matching profile: the drive lacks registers of each profile, or is another model"
OTHERS_TOO = (
    ", but also other registers between them, as any server may have. If you know the drive, use --drive PROFILE"
)
MODEL_MATCHES = "likely: the model registers match the profile"
REGISTERS_MATCH = "possible match: it has the registers of the profile, and none between them"


CHECKED = {
    True: "the power of the drive, the wiring, the baud rate, the parity and the unit id",
    False: "the power of the drive, the address, the port and the unit id",
}
"""Checks for a serial line (True) or TCP (False) on which no unit answers."""


def scan_line(requester: Requester, units: Iterable[int], profiles: Sequence[ModbusProfile]) -> Scan:
    """Ask these units who they are; `profiles` are those that may fit. Raises BusError."""
    try:
        listened = listen(requester)
    except ForeignMasterError as error:
        return Scan(requester.name, (), str(error), f"{error}; no requests were sent")
    asked = sorted(set(units))
    found = [found for unit in asked if (found := _found(requester, unit, profiles)) is not None]
    named = f"unit {', '.join(map(str, asked))}"
    told = f"Requested: {named}; others with --node, as in --node 1-8"
    silent = f"no answer from {named} on {requester.name}: check {CHECKED[requester.transport.serial]}"
    return Scan(requester.name, tuple(found), f"{listened}. {told}", silent=silent)


def _found(requester: Requester, number: int, profiles: Sequence[ModbusProfile]) -> FoundNode | None:
    """Read the registers that the profiles name from a unit; None when it does not answer."""
    requester.ask(Question(number, READ_HOLDING, 0, 1))
    if requester.answer(requester.clock.now_ns() + THERE_NS) is None:
        requester.forget()
        return None
    fitting = [profile for profile in profiles if _fits(_unit(requester, number, profile), profile)]
    usable = [profile for profile in fitting if profile.drive.usable]
    # One that is known by its values comes before one that is known by its registers alone.
    best = next((profile for profile in usable if _tells(profile)), None)
    best = best or next((each for each in usable if _lacks_others(_unit(requester, number, each), each)), None)
    if best is None and not fitting:
        return FoundNode(number, sure=NO_PROFILE)
    if best is None:
        why = f"no profile proposed: the drive has the registers of {', '.join(map(_named, fitting))}"
        return FoundNode(number, sure=why + (OTHERS_TOO if usable else ""))
    unit = _unit(requester, number, best)
    known = {each.name: unit.optional(each) for each in best.identity}
    vendor, product, revision = (known.get(name) for name in ("vendor", "product code", "revision"))
    serial = None if best.serial is None else unit.optional(best.serial)
    sure = MODEL_MATCHES if _tells(best) else REGISTERS_MATCH
    if len(fitting) > 1:
        sure += f"; {', '.join(_named(profile) for profile in fitting if profile is not best)} would match too"
    state = PROTOCOL.power_table(best).state(unit.read(best.power.status)).value
    return FoundNode(number, vendor, product, revision, serial, None, best.name, sure, power_state=state)


def _named(profile: ModbusProfile) -> str:
    return profile.name if profile.drive.usable else f"{profile.name} (cannot render force)"


def _lacks_others(unit: UnitClient, profile: ModbusProfile) -> bool:
    """Return whether a unit refuses a register between those of a profile. A unit that has no other registers does."""
    taken = sorted((each.address, each.address + each.count) for each in profile.registers().values())
    gaps = [(end, begin) for (_, end), (begin, _) in pairwise(taken) if begin > end]
    widest = sorted(gaps, key=lambda gap: gap[0] - gap[1])[:GAPS_TRIED]
    middles = [Register((end + begin) // 2, DataType.UINT16) for end, begin in widest]
    return any(not _readable(unit, register) for register in middles)


def _unit(requester: Requester, number: int, profile: ModbusProfile) -> UnitClient:
    return UnitClient(requester, number, f"unit {number}", profile.line)


def _tells(profile: ModbusProfile) -> bool:
    """Whether the profile names values by which its model is known."""
    return any(each.values for each in profile.identity)


def _fits(unit: UnitClient, profile: ModbusProfile) -> bool:
    """Whether a unit has the registers of a profile, with the values that tell its model."""
    read = [register for signal, register in profile.registers().items() if signal is not Signal.CONTROLWORD]
    try:
        models = all(not each.values or unit.read(each) in each.values for each in profile.identity)
        return models and all(_readable(unit, register) for register in read)
    except (BusTimeoutError, RefusedError):
        return False


def _readable(unit: UnitClient, register: Register) -> bool:
    try:
        return unit.optional(register) is not None
    except BusConfigurationError:
        return False


class ModbusAccess(BusAccess):
    """The I/O half of Modbus. It has no log of its own: rows hold all that is exchanged."""

    def logs(self, record: Path | None, buses: Sequence[str], *, simulated: bool) -> Logs:
        """Return no logs; raises UsageError when `record` is a file of CAN frames."""
        if record is not None and record.suffix in FRAME_SUFFIXES:
            raise UsageError(
                f"cannot record {', '.join(buses)} to {record}: {record.suffix} is for CAN frames. For Modbus record "
                "one row per period, as .csv"
            )
        return nullcontext({})

    def open_bus(self, section: BusSection, clock: Clock, log: Any) -> ModbusBus:
        own = modbus_section(section)
        return ModbusBus(open_line(own, clock), clock, own)

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        profile = load_profile(axis.profile)
        if not isinstance(profile, ModbusProfile) or profile.torque.rated is None:
            return None
        register = profile.torque.rated
        with opened(modbus_section(section), [profile]) as requester:
            listen(requester)
            unit = UnitClient(requester, axis.node, f"unit {axis.node} (axis {name})", profile.line)
            return rated_torque(profile.title, str(register), register.unit, unit.read(register))

    def scan(self, section: BusSection, axes: Axes, profiles: str | Path | None, nodes: Sequence[int] = ()) -> Scan:
        own = modbus_section(section)
        transport = "rtu" if own.serial else "tcp"
        fitting = [each for each in profiles_of(ModbusProfile, profiles) if transport in each.line.transports]
        on_it = [modbus_profile(load_profile(axis.profile, profiles)) for axis in axes.values()]
        with opened(own, on_it) as requester:
            return scan_line(requester, nodes or [axis.node for axis in axes.values()], fitting)

    @contextmanager
    def onlooker(self, section: BusSection, axes: Axes) -> Iterator[LineObserver]:
        drives = {name: (axis.node, modbus_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        with opened(modbus_section(section), [profile for _, profile in drives.values()]) as requester:
            yield LineObserver(requester, drives)

    def checks(self, section: BusSection, axes: Axes, rate: float) -> tuple[Check, ...]:
        own = modbus_section(section)
        profiles = [modbus_profile(load_profile(axis.profile)) for axis in axes.values()]
        first = next(iter(axes.values()))
        further = partial(_on_the_line, axis=first, profile=profiles[0], rate=rate)
        return checks_on(opened(own, profiles), adapter_checks(own), further)


@contextmanager
def opened(section: ModbusSection, profiles: Sequence[ModbusProfile]) -> Iterator[Requester]:
    """Open a line for as long as the block lasts, set up as the rig says or else these profiles.

    Raises UsageError or BusError.
    """
    clock = MonotonicClock()
    transport = open_line(section, clock)
    try:
        if section.serial:
            transport.tune(*characters(section, profiles))
        requester = Requester(transport, clock, echo=section.echo)
        requester.silence_ns = round(1e9 * line_of(section, profiles).silence)
        yield requester
    finally:
        transport.close()


def _on_the_line(requester: Requester, axis: RigAxis, profile: ModbusProfile, rate: float) -> tuple[Check, ...]:
    """Check that no other master uses the line, then measure the round trip to a unit; raises BusError."""
    try:
        alone = Check("other_masters", True if requester.transport.serial else None, listen(requester))
    except ForeignMasterError as error:
        return scan_result.another_master(str(error))
    unit = UnitClient(requester, axis.node, f"unit {axis.node}", profile.line)
    return alone, *round_trip_checks(unit, profile, rate)


ACCESS = ModbusAccess()
