"""Properties by which the nodes of different models differ, and the PDOs after power-on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
from haptic_fieldbus.protocols.canopen.pdo import Direction, FixedPdo
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.pdos import pdo_shape
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.canopen.services.cob_id import INVALID, NO_RTR
from haptic_fieldbus.sim.canopen.services.pdo import PdoDefaults
from haptic_fieldbus.sim.drive.settings import DriveSettings

_PREDEFINED = range(1, 5)
"""Numbers of the PDOs of each direction that have a predefined identifier (CiA 301, table 39)."""


@dataclass(frozen=True)
class NodeOptions:
    """Properties of a model: its PDOs, the object of its heartbeat consumers, when RPDOs act, how long a reset takes.

    `consumer` is the index of the heartbeat consumer object, None when the model has none.
    """

    rpdos: list[PdoDefaults]
    tpdos: list[PdoDefaults]
    consumer: int | None = 0x1016
    acts_at_sync: bool = False
    reset_ns: int = 0


def node_options(node: int, profile: CanopenProfile, settings: DriveSettings) -> NodeOptions:
    """Return the options of a node as its profile and settings describe them.

    After power-on all PDOs are event-driven, with the predefined identifiers; only the first of each direction is
    valid.
    """
    signals = profile.entries()
    status, control = signals[Signal.STATUSWORD], signals[Signal.CONTROLWORD]
    # Seconds to the steps of 100 µs of 1800h:03.
    inhibit = round(profile.pdo.inhibit_time_default * 1e4)
    measured = signals.get(Signal.POSITION) or signals[Signal.VELOCITY]
    first = 0x200 + node, 0x180 + node
    rpdos = _defaults(_shape(profile, Direction.RPDO), first[0], 0, control, signals[Signal.TARGET_TORQUE])
    tpdos = _defaults(_shape(profile, Direction.TPDO), first[1], inhibit, status, measured)
    if not isinstance(profile, EdsProfile):  # the file of the vendor says more of the PDOs, and is taken over later
        rpdos += _fixed(profile.pdo.rpdo_fixed, first[0], 0)
        tpdos += _fixed(profile.pdo.tpdo_fixed, first[1], inhibit)
    return NodeOptions(
        rpdos=[replace(rpdo, sync_honoured=profile.simulation.sync_honoured) for rpdo in rpdos],
        tpdos=tpdos,
        consumer=profile.link_loss.heartbeat_consumer,
        acts_at_sync=profile.pdo.rpdo_acts == "next_sync",
        reset_ns=settings.reset_ns,
    )


def _shape(profile: CanopenProfile, direction: Direction) -> dict[int, int]:
    """Return the number of mapping entries of each PDO that the model has, by the number of the PDO."""
    if isinstance(profile, EdsProfile):
        return pdo_shape(profile.eds, direction)
    return {number: room for number, room in profile.pdo.room(direction).items() if room}


def _defaults(
    shape: dict[int, int], first_id: int, inhibit: int, word: ObjectEntry, value: ObjectEntry
) -> list[PdoDefaults]:
    """Return the PDOs of one direction.

    PDO 1 maps the word, PDO 2 word and value if its mapping has room for two, the others nothing.
    """
    mappings = {1: (word.mapping,), 2: (word.mapping, value.mapping)}
    return [
        PdoDefaults(
            number=number,
            cob_id=_cob_id(first_id, number),
            mapping=mappings[number] if len(mappings.get(number, ())) in range(1, entries + 1) else (),
            max_entries=entries,
            inhibit_time=inhibit,
        )
        for number, entries in shape.items()
    ]


def _fixed(pdos: Sequence[FixedPdo], first_id: int, inhibit: int) -> list[PdoDefaults]:
    """Return the PDOs with mappings that cannot be written."""
    return [
        PdoDefaults(each.number, _cob_id(first_id, each.number), each.maps, len(each.maps), inhibit, fixed=True)
        for each in pdos
    ]


def _cob_id(first_id: int, number: int) -> int:
    identifier = first_id + 0x100 * (number - 1) if number in _PREDEFINED else 0
    return (0 if number == 1 else INVALID) | NO_RTR | identifier
