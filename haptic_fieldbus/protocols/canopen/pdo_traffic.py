"""The process data of one node: its PDOs and what is asked of it by SDO, with the texts of its faults."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen import beside
from haptic_fieldbus.protocols.canopen.cob_ids import cob_id_words
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.pdo import Direction, Pdo, bits_beyond
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import LinkFlag, Signal


@dataclass(frozen=True)
class PdoTraffic:
    """The PDOs of one node; incoming and outgoing are meant from the side of the master."""

    node: int
    tpdos: tuple[Pdo, ...]
    rpdos: tuple[Pdo, ...]
    asked: tuple[MappedSignal, ...] = field(default=(), kw_only=True)
    """Signals that are asked by SDO now and then; in the process image they follow those of the TPDOs."""
    life_guarding: bool = field(default=False, kw_only=True)

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.tpdos) + self.asked

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.rpdos)

    @property
    def pdos(self) -> tuple[Pdo, ...]:
        """All PDOs, TPDOs first."""
        return self.tpdos + self.rpdos

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield each PDO with COB-ID, transmission type and size, followed by its objects."""
        for key, pdos in (("in", self.tpdos), ("out", self.rpdos)):
            yield from _lines(key, pdos)
        if self.asked:
            yield "ask", f"SDO upload every {exactly(1e3 * beside.ASK_EVERY)} ms at most: {self.asked[0].address}"

    def summary(self) -> Iterator[str]:
        """Yield a line for each PDO with its signals."""
        for pdo in self.pdos:
            way = "in " if pdo.direction is Direction.TPDO else "out"
            yield f"{way} {pdo.name} {', '.join(signal.value for signal, *_ in pdo.needed)}"
        if self.asked:
            yield f"ask SDO {self.asked[0].signal.value}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Return the `pdos` of `plan --json`."""
        return {
            "pdos": [
                {
                    "name": pdo.name,
                    "bus": bus,
                    "node": pdo.node,
                    "cob_id": pdo.cob_id,
                    "transmission_type": pdo.transmission_type,
                    "octets": pdo.size,
                    "mapped": [str(entry) for entry in pdo.entries],
                    "fixed": pdo.fixed,
                    "not_needed": [str(entry) for entry, _ in pdo.unneeded],
                }
                for pdo in self.pdos
            ]
        }

    def fault_text(self, flag: LinkFlag, code: int, bus: str = "the bus") -> str:
        """Return a link fault in the terms of CANopen; raises KeyError for STALE, which is no fault."""
        if flag is LinkFlag.EMERGENCY:
            return f"node {self.node} sent emergency {code:04X}h ({emergency_meaning(code)})"
        unheard = self.life_guarding and flag is LinkFlag.NO_SIGN_OF_LIFE
        text = NO_ANSWER if unheard else FAULT_TEXTS[flag]
        return text.format(node=self.node, frame=cob_id_words(code), bus=bus)


FAULT_TEXTS = {
    LinkFlag.BUS_OFF: "the CAN controller went bus-off: check wiring, terminators and bit rate",
    LinkFlag.BOOT_UP: "node {node} restarted",
    LinkFlag.NO_SIGN_OF_LIFE: "the heartbeat of node {node} stayed away",
    LinkFlag.NOT_OPERATIONAL: "node {node} is not operational, says its heartbeat",
    LinkFlag.EXCEPTION: "node {node} sent a malformed PDO, or the bus refused our frames",
    LinkFlag.FOREIGN: "another master on {bus}: {frame} came, and not from us; end that master, and put axes that "
    "share a bus into one rig",
    LinkFlag.DUPLICATE: "{frame} came more often than SYNC asked for it: two devices have the node-ID {node}",
}

NO_ANSWER = "node {node} answered no request of node guarding within its life time, or repeated its toggle bit"
"""Instead of a heartbeat that stayed away, where the drive is guarded."""


def asked_signals(profile: CanopenProfile) -> tuple[MappedSignal, ...]:
    """Return the signals of an echo that is asked by SDO: the target torque, and the periods that the answer took."""
    value = profile.offers()[Signal.TARGET_ASKED]
    return value, MappedSignal(Signal.ASKED_PERIODS, value.address, DataType.UINT16)


def _mapped(pdos: tuple[Pdo, ...]) -> tuple[MappedSignal, ...]:
    """Return the signals of the PDOs in the order of their octets."""
    return tuple(
        MappedSignal(signal, str(entry), entry.type, entry.unit) for pdo in pdos for signal, entry, _ in pdo.needed
    )


def _lines(key: str, pdos: tuple[Pdo, ...]) -> Iterator[tuple[str, str]]:
    """Yield the PDOs of one direction with their objects, and what fixed mappings cost."""
    for pdo in pdos:
        when = "every SYNC" if pdo.transmission_type == 1 else "synchronous" if pdo.synchronous else "event-driven"
        fixed = ", fixed mapping" if pdo.fixed else ""
        yield key, f"{pdo.name} {pdo.cob_id:03X}h, type {pdo.transmission_type} ({when}), {pdo.size} octets{fixed}"
        for signal, entry in zip(pdo.signals, pdo.entries, strict=True):
            yield "", f"  {entry}" if signal else f"  {entry} (not needed)"
    if any(pdo.fixed for pdo in pdos) and bits_beyond(pdos):
        named = ", ".join(pdo.name for pdo in pdos)
        yield "", f"  cost of fixed mappings ({named}): {bits_beyond(pdos)} bits a period more than is needed"
