"""Finding units by reading alone: only those that somebody names are asked.

A unit that answers is there, be it with an exception. Modbus has no registers that all devices share, so what is read
are the registers of the known profiles: a profile fits when the unit has all of them, and the values that tell its
model are those of the profile. Where a profile names no such values, the unit must lack a register between those of the
profile: a server that has every register would fit each profile.

Reference: Modbus application protocol 1.1b3, 6.3 and 7.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

from haptic_fieldbus.buses.found import FoundNode, Scan
from haptic_fieldbus.buses.modbus.foreign import listen
from haptic_fieldbus.buses.modbus.framing import Question
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.unit import RefusedError, UnitClient
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, ForeignMasterError
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Register
from haptic_fieldbus.signals import Signal

THERE_NS = 200_000_000
"""Time that a unit has for its first answer [ns]."""
GAPS_TRIED = 3
"""Gaps between the registers of a profile of which one register is read."""
NO_PROFILE = "no profile fits: it lacks registers of each, or is another model"


def scan_line(requester: Requester, units: Iterable[int], profiles: Sequence[ModbusProfile]) -> Scan:
    """Ask these units who they are; `profiles` are those that may fit. Raises BusError."""
    try:
        listened = listen(requester)
    except ForeignMasterError as error:
        return Scan(requester.name, (), str(error), f"{error}; nothing was asked")
    asked = sorted(set(units))
    found = [_found(requester, unit, profiles) for unit in asked if _answers(requester, unit)]
    told = f"Asked: unit {', '.join(str(unit) for unit in asked)}; others with --node, as in --node 1-8"
    return Scan(requester.name, tuple(found), f"{listened}. {told}")


def _answers(requester: Requester, unit: int) -> bool:
    requester.ask(Question(unit, READ_HOLDING, 0, 1))
    answer = requester.answer(requester.clock.now_ns() + THERE_NS)
    if answer is None:
        requester.forget()
    return answer is not None


def _found(requester: Requester, number: int, profiles: Sequence[ModbusProfile]) -> FoundNode:
    """Ask a unit that is there for the registers of the profiles."""
    fitting = [profile for profile in profiles if _fits(_unit(requester, number, profile), profile)]
    usable = [profile for profile in fitting if profile.drive.usable]
    # One that is known by its values comes before one that is known by its registers alone.
    best = next((profile for profile in usable if _tells(profile)), None)
    best = best or next((each for each in usable if _lacks_others(_unit(requester, number, each), each)), None)
    if best is None:
        return FoundNode(number, sure=_why_none(fitting))
    unit = _unit(requester, number, best)
    known = {each.name: unit.read(each) for each in best.identity}
    also = ", ".join(_named(profile) for profile in fitting if profile is not best)
    return FoundNode(
        number,
        known.get("vendor"),
        known.get("product code"),
        known.get("revision"),
        None if best.serial is None else unit.read(best.serial),
        profile=best.name,
        sure=_sure(best) + (f"; {also} would fit as well" if also else ""),
        power_state=_power(best).state(unit.read(best.power.status)).value,
    )


def _why_none(fitting: Sequence[ModbusProfile]) -> str:
    """Return why no profile is proposed, with those whose registers the unit has."""
    if not fitting:
        return NO_PROFILE
    has = f"no profile is proposed: it has the registers of {', '.join(map(_named, fitting))}"
    if not any(profile.drive.usable for profile in fitting):
        return has
    return (
        f"{has}, but others between them too, as a server of any kind may have. If you know the drive, name its "
        "profile with --drive"
    )


def _named(profile: ModbusProfile) -> str:
    return profile.name if profile.drive.usable else f"{profile.name} (cannot render force)"


def _lacks_others(unit: UnitClient, profile: ModbusProfile) -> bool:
    """Return whether a unit refuses a register between those of a profile, as one does that has no others."""
    taken = sorted((each.address, each.address + each.count) for each in profile.registers().values())
    gaps = [(end, begin) for (_, end), (begin, _) in pairwise(taken) if begin > end]
    widest = sorted(gaps, key=lambda gap: gap[0] - gap[1])[:GAPS_TRIED]
    middles = [Register((end + begin) // 2, DataType.UINT16) for end, begin in widest]
    return any(not _readable(unit, register) for register in middles)


def _unit(requester: Requester, number: int, profile: ModbusProfile) -> UnitClient:
    return UnitClient(requester, number, f"unit {number}", profile.line)


def _power(profile: ModbusProfile) -> PowerTable:
    return CIA402 if profile.power.table == "cia402" else PowerTable(profile.power.rows, profile.power.off)


def _tells(profile: ModbusProfile) -> bool:
    """Whether the profile names values by which its model is known."""
    return any(each.values for each in profile.identity)


def _sure(profile: ModbusProfile) -> str:
    if _tells(profile):
        return "likely: the values that tell its model are those of the profile"
    return "no more than a guess: it has the registers of the profile, and not those between them"


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
