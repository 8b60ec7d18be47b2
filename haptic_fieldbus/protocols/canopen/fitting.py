"""A profile of no particular drive, fitted to the drive that it meets.

Nearly all objects of CiA 402-2 are optional, so no drive has them all. What the drive has is used as the profile says;
what it lacks is left out, and where the standards have a second way, that one is taken: profile torque mode, torque
actual value as the echo, life guarding. Nothing takes the place of a guard that is not there: without one the plan caps
the torque, or is refused (decision 0036).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from enum import Enum
from typing import TypeVar

from haptic_fieldbus.drive.cia402 import MappedObject, OptionCode, PositionSection, TorqueSection
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.protocols.canopen.eds_pdos import carries, torque_mode
from haptic_fieldbus.protocols.canopen.eds_values import BY_KEY, number_of, supported_modes
from haptic_fieldbus.protocols.canopen.from_eds import LEFT_OUT, profile_from_eds
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile, LinkLossSection, SyncSection

# Which profiles fit a device, by what it says of itself, and how sure that is.


class MatchQuality(Enum):
    """How well a profile fits a device, the best first; the value is the words for people."""

    PRODUCT = "certain: vendor and product code match the profile"
    MODEL = "likely: the vendor matches, and the device name contains the model"
    VENDOR = "possible: the vendor matches; the profile has no product codes"
    DRIVE = "possible match: a CiA 402 drive of a vendor without a profile"


ORDER = tuple(MatchQuality)


def fitting(
    profiles: Iterable[CanopenProfile], vendor_id: int | None, product_code: int | None, name: str | None
) -> list[tuple[CanopenProfile, MatchQuality]]:
    """Return the profiles that may be that of a CiA 402 drive, the surest first."""
    graded = [(profile, _sureness(profile, vendor_id, product_code, name or "")) for profile in profiles]
    found = [(profile, sureness) for profile, sureness in graded if sureness is not None]
    return sorted(found, key=lambda each: ORDER.index(each[1]))


def _sureness(
    profile: CanopenProfile, vendor_id: int | None, product_code: int | None, name: str
) -> MatchQuality | None:
    expected = profile.identity
    if expected.vendor_id is None and not expected.product_codes:
        return MatchQuality.DRIVE
    if expected.vendor_id is not None and expected.vendor_id != vendor_id:
        return None
    if expected.product_codes:
        return MatchQuality.PRODUCT if product_code in expected.product_codes else None
    model = profile.drive.model.split()[0].casefold()
    return MatchQuality.MODEL if model in name.casefold() else MatchQuality.VENDOR


Named = TypeVar("Named", MappedObject, OptionCode)
_TOLD = ("torque.mode_of_operation", "torque.slope.object", "torque.slope.value", "torque.echo",
         "position.actual.unit", "pdo.tpdos", "pdo.rpdos", "pdo.tpdo_fixed", "pdo.rpdo_fixed",
         "pdo.inhibit_time_default", "sync.interpolation_time", "sync.powers", "sync.values",
         "sync.cycle_period", "link_loss.life_guarding")  # fmt: skip
"""Keys whose values the drive tells."""
_LACKED = ("torque.actual", "torque.demand", "torque.rated", "torque.rated_current",
           "link_loss.abort_connection_option", "link_loss.fault_reaction_option",
           "link_loss.heartbeat_consumer")  # fmt: skip
"""Keys whose objects the drive may lack."""


def fitted(profile: CanopenProfile, eds: Eds) -> CanopenProfile:
    """Return the profile fitted to the drive, by the objects that were uploaded from it.

    It is not usable for force where the drive lacks what force needs. Raises EdsError for no CiA 402 drive.
    """
    mode, modes = profile.torque.mode_of_operation, supported_modes(eds)
    if mode > 0 and modes and not modes >> mode - 1 & 1:  # the drive names its modes, and not this one
        mode = torque_mode(eds)
    made = profile_from_eds(eds, mode)
    position = _position(profile, made, eds)
    own = replace(
        profile,
        drive=replace(profile.drive, usable=made.drive.usable),
        torque=_torque(profile.torque, made.torque, eds),
        position=position,
        velocity=profile.velocity or (made.velocity if position is None else None),
        pdo=replace(
            profile.pdo,
            tpdos=made.pdo.tpdos,
            rpdos=made.pdo.rpdos,
            tpdo_entries=made.pdo.tpdo_entries,
            rpdo_entries=made.pdo.rpdo_entries,
            tpdo_fixed=made.pdo.tpdo_fixed,
            rpdo_fixed=made.pdo.rpdo_fixed,
            inhibit_time_default=made.pdo.inhibit_time_default,
        ),
        sync=made.sync if profile.sync == SyncSection() else profile.sync,
        link_loss=_link_loss(profile.link_loss, made.link_loss, eds),
    )
    return replace(own, sources={**profile.sources, **dict(_sources(profile, own, made))})


def _torque(own: TorqueSection, made: TorqueSection, eds: Eds) -> TorqueSection:
    demand, actual = _sent(own.demand, eds), _sent(own.actual, eds)
    has_echo = {"demand": demand is not None, "actual": actual is not None}.get(own.echo, True)
    return replace(
        own,
        mode_of_operation=made.mode_of_operation,
        actual=actual,
        rated=_kept(own.rated, eds),
        demand=demand,
        echo=own.echo if has_echo else made.echo,
        rated_current=_kept(own.rated_current, eds),
        slope=own.slope or made.slope,
    )


def _position(profile: CanopenProfile, made: CanopenProfile, eds: Eds) -> PositionSection | None:
    """Return the position of the profile, in the unit that the drive tells; None where the drive has none."""
    if profile.position is None or _kept(profile.position.actual, eds) is None:
        return None
    is_told = made.position is not None and number_of(eds, 0x60A8)
    return made.position if is_told else profile.position


def _link_loss(own: LinkLossSection, made: LinkLossSection, eds: Eds) -> LinkLossSection:
    """Return the guard that the drive has: the one of the profile, else life guarding, else none."""
    index = own.heartbeat_consumer
    has_consumer = index is not None and eds.find(index, 1) is not None
    return replace(
        own,
        heartbeat_consumer=index if has_consumer else None,
        life_guarding=own.life_guarding or (index is not None and not has_consumer and made.life_guarding),
        abort_connection_option=_kept(own.abort_connection_option, eds),
        fault_reaction_option=_kept(own.fault_reaction_option, eds),
    )


def _kept(named: Named | None, eds: Eds) -> Named | None:
    """Return the objects of the profile that the drive has."""
    subindex = named.subindex if isinstance(named, MappedObject) else 0
    return named if named is not None and eds.find(named.object, subindex) is not None else None


def _sent(named: MappedObject | None, eds: Eds) -> MappedObject | None:
    """Return the objects of the profile that a TPDO of the drive carries or can carry."""
    entry = eds.find(named.object, named.subindex) if named is not None else None
    return named if entry is not None and carries(eds, Direction.TPDO, entry) else None


def _sources(profile: CanopenProfile, own: CanopenProfile, made: CanopenProfile) -> Iterator[tuple[str, str]]:
    """Yield key and source of each value that the drive has told, with the reason of each that is left out."""
    if not own.drive.usable:
        yield "drive.usable", made.sources["drive.usable"]
    for key in _LACKED:
        before = BY_KEY[key].named(profile)
        if before is not None and BY_KEY[key].named(own) is None:
            # The sub-index of a signal is that of its axis, and is not told.
            subindex = BY_KEY[key].subindex
            yield key, f"{NO_SUCH}{ObjectEntry(before.object, DataType.UINT8, subindex)}"
    told = {key: made.sources[key] for key in _TOLD if key in made.sources}
    yield from ((key, source) for key, source in told.items() if not source.startswith(LEFT_OUT))
