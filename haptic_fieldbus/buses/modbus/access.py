"""Opening Modbus lines, and the questions to a unit that come before a plan."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from haptic_fieldbus.buses.access import BusAccess
from haptic_fieldbus.buses.found import Check, Scan
from haptic_fieldbus.buses.log_file import FRAME_SUFFIXES
from haptic_fieldbus.buses.modbus.adapter import adapter_checks, round_trip_checks
from haptic_fieldbus.buses.modbus.foreign import listen
from haptic_fieldbus.buses.modbus.looking import UnitLook
from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.buses.modbus.opening import open_line
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.scanning import scan_line
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.buses.rating import rated_torque
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import BusError, DocumentError, ForeignMasterError, UsageError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.folders import known_names
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, modbus_section
from haptic_fieldbus.protocols.modbus.layout import characters, line_of
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.protocol import PROTOCOL


class ModbusAccess(BusAccess):
    """The I/O half of Modbus. It has no log of its own: rows hold all that is exchanged."""

    def logs(
        self, record: Path | None, buses: Sequence[str], *, simulated: bool
    ) -> AbstractContextManager[Mapping[str, Any]]:
        """Return no logs; raises UsageError when `record` is a file of CAN frames."""
        if record is not None and record.suffix in FRAME_SUFFIXES:
            raise UsageError(
                f"cannot record {', '.join(buses)} to {record}: {record.suffix} is for CAN frames, and a Modbus line "
                "has none. Record the rows of all periods, as .csv"
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

    def scan(
        self, section: BusSection, axes: Mapping[str, RigAxis], profiles: str | Path | None, nodes: Sequence[int] = ()
    ) -> Scan:
        own = modbus_section(section)
        fitting = _profiles_for(own, profiles)
        on_it = [modbus_profile(load_profile(axis.profile, profiles)) for axis in axes.values()]
        with opened(own, on_it) as requester:
            return scan_line(requester, nodes or [axis.node for axis in axes.values()], fitting)

    @contextmanager
    def onlooker(self, section: BusSection, axes: Mapping[str, RigAxis]) -> Iterator[UnitLook]:
        profiles = {name: modbus_profile(load_profile(axis.profile)) for name, axis in axes.items()}
        drives = {
            name: (axis.node, profiles[name], PROTOCOL.power_table(profiles[name])) for name, axis in axes.items()
        }
        with opened(modbus_section(section), list(profiles.values())) as requester:
            yield UnitLook(requester, drives)

    def checks(self, section: BusSection, axes: Mapping[str, RigAxis], rate: float) -> tuple[Check, ...]:
        own = modbus_section(section)
        told = tuple(adapter_checks(own))
        profiles = [modbus_profile(load_profile(axis.profile)) for axis in axes.values()]
        try:
            with opened(own, profiles) as requester:
                line = Check("adapter", True, f"{requester.name} is open")
                return line, *told, *_on_the_line(requester, next(iter(axes.values())), profiles[0], rate)
        except BusError as error:
            return Check("adapter", False, str(error), "see the other checks of the adapter"), *told


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
    """Check that nobody else uses the line, and only then ask a unit for the round trip; raises BusError."""
    try:
        alone = Check("other_masters", True if requester.transport.serial else None, listen(requester))
    except ForeignMasterError as error:
        advice = "end the other master; while it is there nothing is asked, and the round trip is not measured"
        return Check("other_masters", False, str(error), advice), Check("round_trip", None, "not measured")
    unit = UnitClient(requester, axis.node, f"unit {axis.node}", profile.line)
    return alone, *round_trip_checks(requester, unit, profile, rate)


def _profiles_for(section: ModbusSection, profiles: str | Path | None) -> list[ModbusProfile]:
    """Return all profiles of drives on such a line that can be read."""
    found = []
    for name in known_names(profiles):
        try:
            profile = load_profile(name, profiles)
        except (DocumentError, UsageError):
            continue  # `profiles list` tells what is wrong with it
        if isinstance(profile, ModbusProfile) and ("rtu" if section.serial else "tcp") in profile.line.transports:
            found.append(profile)
    return found


ACCESS = ModbusAccess()
