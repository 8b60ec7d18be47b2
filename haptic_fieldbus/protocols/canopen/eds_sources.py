"""The source of each value of a profile that is made from an EDS: file and section, a standard, or an assumption."""

from collections.abc import Iterator
from pathlib import Path

from haptic_fieldbus.drive.cia402 import MappedObject, OptionCode
from haptic_fieldbus.drive.profile import ASSUMED
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.protocols.canopen.eds_pdos import COMMUNICATION, MAPPING, Lack, pdo_shape
from haptic_fieldbus.protocols.canopen.eds_values import number_of, supported_modes
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, PdoSection

LEFT_OUT = "left out"
"""Beginning of the source of a key that a profile does not give."""
AGAINST = "against the file"
"""Beginning of the source of a value that a person trusts more than the vendor's file."""
_NO_UNIT = f"{ASSUMED}: as CiA 402-2 has it; an EDS names no units"
Source = tuple[str, str]
"""Key and source of a value."""


def sources_of(profile: CanopenProfile, eds: Eds, lacks: tuple[Lack, ...]) -> dict[str, str]:
    """Return the source of each value, by key; that of a value which is left out says why."""
    found = Path(eds.source).name
    said = {
        **dict(_identity(eds, found)),
        **dict(_torque(profile, eds, found)),
        **dict(_motion(profile, eds, found)),
        **dict(_pdos(profile.pdo, eds, found)),
        **dict(_sync(profile, found)),
        **dict(_link_loss(profile, found)),
        "timing.torque_bandwidth": f"{ASSUMED}: a usual figure for current loops; to be measured on the bench",
        "timing.control_period": f"{ASSUMED}: a usual figure for servo drives; to be measured on the bench",
        "timing.mode_change_timeout": "chosen here",
    }
    return {"drive.usable": "; ".join(lack for lack, _ in lacks), **said} if lacks else said


def _identity(eds: Eds, found: str) -> Iterator[Source]:
    for subindex, key, name in ((1, "vendor_id", "VendorNumber"), (2, "product_codes", "ProductNumber")):
        given = (eds.device.vendor_number, eds.device.product_number)[subindex - 1]
        if number_of(eds, 0x1018, subindex):
            yield f"identity.{key}", f"{found}, [1018sub{subindex}] DefaultValue"
        else:
            yield f"identity.{key}", f"{found}, [DeviceInfo] {name}" if given else f"{LEFT_OUT}: not in {found}"


def _torque(profile: CanopenProfile, eds: Eds, found: str) -> Iterator[Source]:
    mode = f"{found}, [6502] DefaultValue" if supported_modes(eds) else f"{ASSUMED}: {found} gives no value of 6502h"
    yield "torque.mode_of_operation", mode
    section = profile.torque
    for name, mapped, index in (
        ("target", section.target, 0x6071),
        ("actual", section.actual, 0x6077),
        ("rated", section.rated, 0x6076),
        ("demand", section.demand, 0x6074),
    ):
        if mapped is not None and mapped.object in eds:
            yield from _mapped(f"torque.{name}", mapped, found, _NO_UNIT)
        elif mapped is not None:
            yield f"torque.{name}", f"CiA 402-2, {index:04X}h; not in {found}"
        else:
            why = f"[{index:04X}] cannot be sent in a PDO" if index in eds else f"{index:04X}h is not in the file"
            yield f"torque.{name}", f"{LEFT_OUT}: {found}, {why}"
    if section.slope is not None:
        yield "torque.slope.object", f"{found}, [6087]"
        yield "torque.slope.type", f"{found}, [6087] DataType"
        yield "torque.slope.value", f"{ASSUMED}: in ‰ of rated torque per s, as CiA 402-2 has it; rated torque in 1 ms"
    yield "torque.echo", f"{found}: the first of 6074h and 6077h that a TPDO can carry, else 6071h where it is readable"


def _motion(profile: CanopenProfile, eds: Eds, found: str) -> Iterator[Source]:
    if profile.position is not None:
        unit = f"{found}, [60A8] DefaultValue" if number_of(eds, 0x60A8) else f"{ASSUMED}: counts of the encoder"
        yield from _mapped("position.actual", profile.position.actual, found, f"{unit}; 608Fh is not looked at")
    if profile.velocity is not None:
        unit = f"{found}, [60A9] DefaultValue" if 0x60A9 in eds else f"{ASSUMED}: {found} has no 60A9h"
        yield from _mapped("velocity.actual", profile.velocity.actual, found, unit)


def _mapped(key: str, mapped: MappedObject, found: str, unit: str) -> Iterator[Source]:
    yield f"{key}.object", f"{found}, [{mapped.object:04X}]"
    yield f"{key}.type", f"{found}, [{mapped.object:04X}] DataType"
    yield f"{key}.unit", unit


def _pdos(section: PdoSection, eds: Eds, found: str) -> Iterator[Source]:
    for direction, name in ((Direction.TPDO, "tpdo"), (Direction.RPDO, "rpdo")):
        first, numbers = COMMUNICATION[direction].start - 1, sorted(pdo_shape(eds, direction))
        records, mappings = (_span(each, numbers, f"no {direction.value}") for each in (first, first + MAPPING))
        yield f"pdo.{name}s", f"{found}, {records}"
        yield f"pdo.{name}_entries", f"{found}, {mappings}"
        if section.fixed(direction):
            yield f"pdo.{name}_fixed", f"{found}, {mappings}: the mappings that cannot be written"
        clause = "7.5.2.37" if direction is Direction.TPDO else "7.5.2.35"
        yield (
            f"pdo.{name}_types",
            f"{ASSUMED}: those of CiA 301 4.2.0, {clause}, with the defaults of {found}, {records}",
        )
    yield "pdo.entries", f"{found}, 1600h to 1BFFh"
    inhibited = f"{found}, [1800sub3] and on, the longest"
    yield (
        "pdo.inhibit_time_default",
        inhibited if section.inhibit_time_default else f"{found}: no 1800h:03 other than 0",
    )


def _span(first: int, numbers: list[int], otherwise: str) -> str:
    return f"[{first + numbers[0]:04X}] to [{first + numbers[-1]:04X}]" if numbers else otherwise


def _sync(profile: CanopenProfile, found: str) -> Iterator[Source]:
    section = profile.sync
    given = f"{LEFT_OUT}: {found} has no 60C2h that can be written and read"
    yield "sync.interpolation_time", f"{found}, [60C2]" if section.interpolation_time else given
    if section.interpolation_time:
        yield "sync.powers", f"{found}, [60C2sub2]: within its limits, else its default"
        yield "sync.values", f"{found}, [60C2sub1]: within its limits, else 1 to 255"
    period = f"{LEFT_OUT}: {found} has no 1006h that can be written and read"
    yield "sync.cycle_period", f"{found}, [1006]" if section.cycle_period else period


def _link_loss(profile: CanopenProfile, found: str) -> Iterator[Source]:
    section = profile.link_loss
    consumer = section.heartbeat_consumer
    no_consumer = f"{LEFT_OUT}: {found} has no 1016h:01 that can be written"
    yield "link_loss.heartbeat_consumer", no_consumer if consumer is None else f"{found}, [{consumer:04X}sub1]"
    if section.life_guarding:
        yield "link_loss.life_guarding", f"{found}, [100C] and [100D]; there is no 1016h"
    for key, option, index, words in (
        ("abort_connection_option", section.abort_connection_option, 0x6007, "2 is disable voltage: the shaft is free"),
        ("fault_reaction_option", section.fault_reaction_option, 0x605E, "0 is disable drive function, no ramp"),
    ):
        yield from _option(f"link_loss.{key}", option, index, words, found)
    yield "link_loss.deadline", "chosen here: short against a hand, long against the period of the loop"


def _option(key: str, option: OptionCode | None, index: int, words: str, found: str) -> Iterator[Source]:
    if option is None:
        yield key, f"{LEFT_OUT}: {found} has no {index:04X}h that can be written"
        return
    yield f"{key}.object", f"{found}, [{index:04X}]"
    yield f"{key}.value", f"CiA 402-2, {index:04X}h: {words}"
