"""Configuration of one drive by SDO: inspect, then write and read back, then start.

Inspection writes nothing, so a wrong drive is refused untouched. The reaction of the drive to the loss of its master is
part of the configuration: a drive that does not confirm it is not started.

Reference: CiA 301 7.5.2 (communication objects); IEC 61800-7-201 (CiA 402-2), 6007h, 6060h, 6061h, 605Eh.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from haptic_fieldbus.buses.bus import DriveFacts
from haptic_fieldbus.buses.canopen.guard import Guard
from haptic_fieldbus.buses.canopen.node import READ_ONLY, NmtState, Node
from haptic_fieldbus.buses.release import FAULTS, poll, standing_fault
from haptic_fieldbus.buses.torque_limits import TorqueLimits, check_rating, checked_rated_torque
from haptic_fieldbus.drive.cia402 import OptionCode
from haptic_fieldbus.drive.profile import ENERGISED, STANDARD, DataType, Identity, ObjectEntry, known_number
from haptic_fieldbus.drive.rig import COUNTS
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import first_enabling
from haptic_fieldbus.planning.limits import HOLDING_SHARE
from haptic_fieldbus.protocols.canopen.pdo import SYNC_COB_ID, Direction, Pdo
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile, ShownObject
from haptic_fieldbus.protocols.canopen.traffic import CanMember, CanTraffic
from haptic_fieldbus.protocols.canopen.watch_traffic import MODE, SHAFT_BRAKES, period_objects, reactions
from haptic_fieldbus.protocols.cia402 import CIA402, DISABLE_VOLTAGE

# Preparation of a drive beyond what all drives need: values that its profile asks for, and what its tool has set.
#
# What is written is read back. A value that is there already is not written, so that a constant that is right is no
# fault. Nothing is stored: 1010h is never written, and a drive that is switched off forgets all of it.

ENCODER_RESOLUTION = tuple(ObjectEntry(0x608F, DataType.UINT32, subindex) for subindex in (1, 2))
"""Position encoder resolution of CiA 402-2: increments, and the revolutions of the motor for which they are."""
MAX_MOTOR_SPEED, MOTOR_SPEED_UNIT = 0x6080, "r/min"
"""Object of CiA 402-2; some drives have it in a unit of their own."""


def prepare(node: Node, profile: CanopenProfile, rate: float) -> None:
    """Make the drive hold what its profile needs before the mode is set, and the period; raises BusError."""
    for each in profile.setup.writes:
        ensure(node, each.entry, each.value)
    for entry, value in period_objects(profile, rate):
        ensure(node, entry, value)
    slope = profile.torque.slope
    if slope is not None:
        ensure(node, slope.entry, slope.value)


def ensure(node: Node, entry: ObjectEntry, value: int) -> None:
    """Write an entry unless it has this value already, and read it back; raises BusError."""
    if node.read(entry) != value:
        node.write(entry, value)


def commissioned(node: Node, profile: CanopenProfile, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence with what the vendor's tool has set, and one for a commutation search.

    Raises BusConfigurationError when a value is missing without which torque means nothing, or when the rated current,
    by which every command is scaled, is not that of the rig.
    """
    section = profile.commissioning
    shown: list[str] = []
    lacking = [source.removeprefix(NO_SUCH) for source in profile.sources.values() if source.startswith(NO_SUCH)]
    told = [f"{profile.title} is a generic profile, and this drive lacks {', '.join(lacking)}"] if lacking else []
    for each in section.shown:
        value = node.optional(each.entry)
        if each.needed and not value:
            raise BusConfigurationError(
                f"{node.label}: {each.name} ({each.entry.object:04X}h:{each.entry.subindex:02X}) is not set, so the "
                f"drive has no motor data. Commission it with {section.tool or 'the tool of its vendor'} first"
            )
        if value is not None:
            shown.append(f"{each.name} {value}{f' {each.unit}' if each.unit else ''}")
            told.extend(_slower(node, each, value, axis))
    if profile.torque.rated_current is not None:
        entry = profile.torque.rated_current.entry
        check_rating(node.label, axis, str(entry), "current", node.read(entry) * 1e-3, axis.rig.rated_current, "A")
    told.extend(_other_counts(node, profile, axis))
    if shown:
        yield f"Set by {section.tool or 'the tool of its vendor'}: {', '.join(shown)}"
    yield from filter(None, [*told, first_enabling(profile)])


def _slower(node: Node, shown: ShownObject, value: int, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence when the drive's max motor speed is below the speed at which the run ends.

    No standard says what a drive does there in torque modes: it may reduce the torque, or go to fault.
    """
    if shown.object != MAX_MOTOR_SPEED or shown.unit != MOTOR_SPEED_UNIT:
        return
    allowed = value * 2.0 * math.pi / 60.0 * axis.rig.mechanism.ratio
    limit, unit = axis.limits.speed, f"{axis.workspace.length_unit}/s"
    if allowed < limit:
        yield (
            f"{node.label}: its {shown.name} of {value} {shown.unit} (6080h) is {rounded(allowed)} {unit} at the "
            f"handle, below the trip limit of {exactly(limit)} {unit}. The drive may reduce torque or fault before "
            f"the trip. Raise it with the drive's tool, or lower axis.{axis.name}.limits.speed"
        )


def _other_counts(node: Node, profile: CanopenProfile, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence when the drive tells another encoder than the rig (CiA 402-2, 608Fh).

    It is no refusal, because the factor group of a drive may scale its position besides.
    """
    if profile.position is None or profile.position.actual.unit != COUNTS:
        return
    increments, revolutions = (node.optional(each) for each in ENCODER_RESOLUTION)
    if not increments or not revolutions:
        return
    counts, expected = increments / revolutions, axis.rig.encoder_counts_per_revolution
    if abs(counts - expected) > 0.5:
        hint = ". Are the counts in the rig lines?" if round(counts) == 4 * expected else ""
        yield (
            f"{node.label}: its encoder has {exactly(counts)} counts per revolution (608Fh), the rig {expected} "
            f"(axis.{axis.name}.encoder_counts_per_revolution). Positions, speeds and stiffnesses would be wrong by a "
            f"factor of {rounded(counts / expected)}, unless the drive scales its position{hint}"
        )


# The PDOs of one drive, configured by SDO: those that the plan uses are mapped and switched on, the others are off.
#
# A mapping that is fixed in the drive is read and compared instead of written, and of the other parameters of its PDO
# only those are written that differ.
#
# Reference: CiA 301 7.5.2.35 to 38 (PDO communication and mapping parameters).

COB_ID_INVALID = 0x8000_0000
"""Bit 31 of a PDO's COB-ID: the PDO is switched off."""
COB_ID_NO_RTR = 0x4000_0000
"""Bit 30 of a TPDO's COB-ID: no remote frames. It keeps its value, since many drives have it fixed."""


def map_pdos(node: Node, member: CanMember) -> None:
    """Switch all PDOs of a drive off, and map and switch on those that it exchanges; raises BusError."""
    for direction, pdos in ((Direction.TPDO, member.traffic.tpdos), (Direction.RPDO, member.traffic.rpdos)):
        used = {pdo.number: pdo for pdo in pdos}
        # In the order of the numbers: a PDO beyond the fourth takes the COB-ID of one that is off by then.
        for number, room in sorted(member.profile.pdo.room(direction).items()):
            entry = _communication(direction, number, DataType.UINT32, 1)
            # A PDO without room for a mapping may not be there at all.
            held = node.read(entry) if room else node.optional(entry)
            cob_id = COB_ID_INVALID if held is None else held | COB_ID_INVALID
            if held not in (None, cob_id):
                node.write(entry, cob_id)
            if number in used:
                _map(node, used[number], cob_id, inhibited=bool(member.profile.pdo.inhibit_time_default))


def _map(node: Node, pdo: Pdo, cob_id: int, *, inhibited: bool) -> None:
    """Map a PDO in the order of CiA 301 7.5.2: invalid (done), no entries, entries, their number, type, valid."""
    if pdo.fixed:
        _check_fixed(node, pdo)
    else:
        node.write(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0), 0)
        for subindex, entry in enumerate(pdo.entries, start=1):
            node.write(ObjectEntry(pdo.mapping_index, DataType.UINT32, subindex), entry.mapping)
        node.write(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0), len(pdo.entries))
    write = partial(ensure, node) if pdo.fixed else node.write
    write(_communication(pdo.direction, pdo.number, DataType.UINT8, 2), pdo.transmission_type)
    # By CiA 301 an inhibit time does not delay a synchronous TPDO; not every drive is known to keep to it.
    if pdo.direction is Direction.TPDO and (not pdo.synchronous or inhibited):
        write(_communication(pdo.direction, pdo.number, DataType.UINT16, 3), 0)
    valid = pdo.cob_id | (cob_id & COB_ID_NO_RTR)
    node.write(_communication(pdo.direction, pdo.number, DataType.UINT32, 1), valid)


def _check_fixed(node: Node, pdo: Pdo) -> None:
    """Raise BusConfigurationError when the drive maps otherwise than its profile says."""
    count = node.read(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0))
    places = [ObjectEntry(pdo.mapping_index, DataType.UINT32, each) for each in range(1, count + 1)]
    held, said = [node.read(place) for place in places], [entry.mapping for entry in pdo.entries]
    if held != said:
        raise BusConfigurationError(
            f"{node.label}: {pdo.mapping_index:04X}h maps {_mappings(held)} into {pdo.name}, but the profile says "
            f"{_mappings(said)}. Correct pdo.{pdo.direction.value.lower()}_fixed in the profile"
        )


def _mappings(values: Sequence[int]) -> str:
    return ", ".join(f"{value:08X}h" for value in values) or "nothing"


def _communication(direction: Direction, number: int, kind: DataType, subindex: int) -> ObjectEntry:
    return ObjectEntry((0x1800 if direction is Direction.TPDO else 0x1400) + number - 1, kind, subindex)


DEVICE_TYPE = ObjectEntry(0x1000, DataType.UINT32)
SYNC_ID = ObjectEntry(0x1005, DataType.UINT32)
IDENTITY = tuple(ObjectEntry(0x1018, DataType.UINT32, subindex) for subindex in range(1, 5))
VENDOR_ID, PRODUCT_CODE, REVISION, SERIAL = IDENTITY
ERROR_CODE = ObjectEntry(0x603F, DataType.UINT16)
CONTROLWORD = ObjectEntry(0x6040, DataType.UINT16)
STATUSWORD = ObjectEntry(0x6041, DataType.UINT16)
MODE_DISPLAY = ObjectEntry(0x6061, DataType.INT8)
TORQUE_LIMITS = tuple(ObjectEntry(index, DataType.UINT16) for index in (0x6072, 0x60E0, 0x60E1))
"""Max torque, positive and negative torque limit value (CiA 402-2), all in ‰ of rated torque."""
TORQUE_OFFSET = ObjectEntry(0x60B2, DataType.INT16)
SIGNED_LIMIT = ObjectEntry(0x60E1, DataType.INT16)
"""Negative torque limit value of a drive that counts it below zero."""

DRIVE_PROFILE = 0x0192  # low word of the device type: CiA 402
SYNC_PRODUCER = 0x4000_0000  # bit 30 of 1005h: the device sends SYNC itself
COB_ID_MASK = 0x7FF
SHAFT_FREE = 2  # abort connection option code (6007h): disable voltage
SHAFT_WORDS = {1: "the drive faults", SHAFT_FREE: "the shaft is free", SHAFT_BRAKES: "the drive begins to brake"}
NO_ANSWER_ADVICE = "check the power and the node-ID of the drive, the bit rate, the wiring and both 120 Ω terminators"
HEARTBEATS_TO_CONFIRM = 3  # the time for an NMT command, in heartbeat periods of the node
DISABLE_TIMEOUT = 1.0  # [s]; for a drive that an earlier master left enabled
STILL_ENABLED = "is still enabled after the command disable voltage"


LONE_SYNCS, LONE_PERIODS = 10, 20
"""So often a drive may answer a SYNC late before it is refused, and for so many periods each answer is waited for."""


@dataclass(frozen=True)
class NodeSetup:
    """Setup of one axis of the plan on its node; `bus` is the traffic of the whole bus, `member` that of this axis."""

    node: Node
    axis: AxisPlan
    bus: CanTraffic
    member: CanMember
    guard: Guard
    """The drive's watch on us."""
    torque_limits: TorqueLimits[ObjectEntry]
    warn: Callable[[str], None]

    def inspect(self) -> DriveFacts:
        """Check that the node is the drive of the profile, healthy and rated as in the rig; write nothing.

        Raises BusTimeoutError, BusConfigurationError, DriveFaultError.
        """
        self._check_device_type()
        vendor, product = self._check_identity()
        state = CIA402.state(self.node.read(STATUSWORD))
        if state in FAULTS:
            way = "write 6040h = 0 and then 80h with the drive's own tool"
            raise standing_fault(self.node.label, state, self.node.optional(ERROR_CODE), "603Fh", way)
        sync = self.node.optional(SYNC_ID)
        if sync is not None and (sync & COB_ID_MASK != SYNC_COB_ID or sync & SYNC_PRODUCER):
            consumer = f"a SYNC consumer at {SYNC_COB_ID:03X}h is required"
            raise BusConfigurationError(f"{self.node.label}: {SYNC_ID} is {sync:08X}h; {consumer}")
        numbers = (vendor, product, self.node.optional(REVISION), self.node.optional(SERIAL))
        identity = Identity(*map(known_number, numbers))
        limits = self._limits()
        self.torque_limits.entries = tuple(limits)
        self.torque_limits.inspect(identity, limits.get)
        if self.member.traffic.asked:
            self._check_asked()
        profile = self.member.profile
        rated = None if profile.torque.rated is None else profile.torque.rated.entry
        rating, lost = checked_rated_torque(self.node, profile.title, self.axis, rated), self._link_loss_words()
        changes = (*self.torque_limits.sentences, *commissioned(self.node, profile, self.axis))
        if state in ENERGISED:
            left = "A master that died may have left it so, or another one commands it"
            changes = (f"It was found in {state.value}, and is switched off first. {left}", *changes)
        return DriveFacts(self.axis.name, self.node.id, profile.title, identity, rating, lost, changes)

    def configure(self) -> None:
        """Write all entries and read each back; the node is then pre-operational and torque-free. Raises BusError."""
        self.node.take_answers()  # an earlier `stop` took them for its own requests
        self.node.booted = False  # restarts from before do not count
        self.node.command(NmtState.PRE_OPERATIONAL)
        self.guard.hear()
        self.node.confirm(NmtState.PRE_OPERATIONAL, self._confirmation_time)
        self._disable()
        self._guard_link()
        self.torque_limits.configure()
        prepare(self.node, self.member.profile, self.bus.rate)
        self._set_mode()
        map_pdos(self.node, self.member)
        self._clear_offset()  # by now no PDO of another master can set it again

    def start(self) -> None:
        """Set the node operational, confirmed by its sign of life, with its guard engaged.

        Raises BusError, also when it restarted meanwhile.
        """
        self.node.command(NmtState.OPERATIONAL)
        self.node.confirm(NmtState.OPERATIONAL, self._confirmation_time)
        self.guard.engage()
        if self.node.booted:
            raise BusConfigurationError(f"{self.node.label} restarted while it was configured: is its supply stable?")

    def check_answers(self, period_ns: int) -> None:
        """Refuse a drive that answers SYNC after more than a period [ns]; raises BusConfigurationError, and BusError.

        Where SYNC comes each period, such an answer looks like a prompt one to the next SYNC. One SYNC alone tells.
        """
        cob_ids = {pdo.cob_id for pdo in self.member.traffic.tpdos}
        self.node.wait(period_ns)  # it may send some as it becomes operational
        took_ns = 0
        for _ in range(LONE_SYNCS):
            took_ns = self.node.answer_ns(cob_ids, LONE_PERIODS * period_ns)
            if took_ns <= period_ns:
                return
        raise BusConfigurationError(
            f"{self.node.label} answers SYNC after {rounded(1e-6 * took_ns)} ms, and a period lasts "
            f"{rounded(1e-6 * period_ns)} ms. Each answer would be taken for that to the SYNC after it, and its "
            "position for a newer one than it is. Ask for a lower rate"
        )

    @property
    def _confirmation_time(self) -> float:
        return HEARTBEATS_TO_CONFIRM * self.bus.node_heartbeat_ms * 1e-3

    def _limits(self) -> dict[ObjectEntry, int]:
        """Return the values of the torque limits that the drive has [steps]; raises BusTimeoutError.

        CiA 402-2 has an UNSIGNED16 in 60E1h. Some drives have an INTEGER16 of −1000 there (Ingenia Everest XCR), and to
        them +1000 would be a lowest torque. A number above 32767 is a negative one, unless 60E0h has the same.
        """
        held: dict[ObjectEntry, int] = {}
        for entry in TORQUE_LIMITS:
            try:
                value = self.node.optional(entry)
            except BusConfigurationError as error:  # with which some drives refuse an object that they lack
                self.warn(f"{error}. Only the loop applies the limit of the axis there")
                continue
            if value is not None:
                held[entry] = value
        *_, positive, negative = TORQUE_LIMITS
        most = SIGNED_LIMIT.type.limits[1]
        if held.get(negative, 0) > most and held[negative] != held.get(positive):
            held[SIGNED_LIMIT] = SIGNED_LIMIT.type.unpack(negative.type.pack(held.pop(negative)))
        return held

    def _clear_offset(self) -> None:
        """Set the torque offset to 0, which the drive would add to each set-point (CiA 402-2); raises BusError.

        Its type is another one in some drives.
        """
        try:
            octets = self.node.found(TORQUE_OFFSET.object, 0)
        except BusConfigurationError as error:  # as for a limit
            self.warn(f"{error}. So it is not known whether the drive adds a torque offset to each set-point")
            return
        if octets and any(octets):
            type = DataType.INT16 if len(octets) == DataType.INT16.size else DataType.INT32
            held, entry = int.from_bytes(octets, "little", signed=True), replace(TORQUE_OFFSET, type=type)
            self.node.write(entry, 0)
            self.warn(f"{self.node.label}: {entry} was {held}, and is 0 now: the drive adds it to each set-point")

    def _check_device_type(self) -> None:
        try:
            device_type = self.node.read(DEVICE_TYPE)
        except BusTimeoutError as error:
            raise BusTimeoutError(
                f"{self.node.label} does not answer on {self.axis.rig.bus} at {self.bus.bitrate} bit/s: "
                f"{NO_ANSWER_ADVICE}"
            ) from error
        if device_type & 0xFFFF != DRIVE_PROFILE:
            raise BusConfigurationError(
                f"{self.node.label} is not a CiA 402 drive: its device type 1000h is {device_type:08X}h; that of a "
                f"drive ends in {DRIVE_PROFILE:04X}h"
            )

    def _check_identity(self) -> tuple[int, int]:
        vendor, product = self.node.read(VENDOR_ID), self.node.read(PRODUCT_CODE)
        profile = self.member.profile
        expected = profile.identity
        wrong_vendor = expected.vendor_id is not None and vendor != expected.vendor_id
        wrong_product = bool(expected.product_codes) and product not in expected.product_codes
        if wrong_vendor or wrong_product:
            wanted = f"vendor {expected.vendor_id or 0:08X}h"
            if expected.product_codes:
                wanted += ", product " + " or ".join(f"{code:08X}h" for code in expected.product_codes)
            raise BusConfigurationError(
                f"{self.node.label} is another drive: 1018h has vendor {vendor:08X}h, product {product:08X}h; the "
                f"profile {profile.name or profile.title} expects {wanted}. Nothing was written"
            )
        return vendor, product

    def _check_asked(self) -> None:
        """Read once what the loop will read back; raises BusConfigurationError, with advice, when that is refused."""
        try:
            self.node.read(self.member.profile.torque.target.entry)
        except BusConfigurationError as error:
            raise BusConfigurationError(
                f'{error}; its profile has torque.echo = "asked". With "none" torque is limited to '
                f"{percent(HOLDING_SHARE)} of rated"
            ) from error

    def _disable(self) -> None:
        """Switch the power stage off if an earlier master left it on."""
        if self.energised():
            self.node.send(CONTROLWORD, DISABLE_VOLTAGE)
        poll(self.node, DISABLE_TIMEOUT, lambda: not self.energised(), lambda: STILL_ENABLED)

    def energised(self) -> bool:
        """Read the statusword; True when the motor can carry torque. Raises BusError."""
        return CIA402.state(self.node.read(STATUSWORD)) in ENERGISED

    def _guard_link(self) -> None:
        """Arm the drive's watchdog, and set reactions to the loss of the master that leave no torque."""
        if not self.member.profile.guarded:
            if self.axis.rig.emergency_stop == "power":
                return  # the plan permits little torque then
            raise BusConfigurationError(
                f"{self.member.profile.title} has no watchdog, or no reaction to a lost master (profile: link_loss). "
                "It could hold the last torque when the cable breaks; refused"
            )
        self.guard.arm()
        for option, value in self._reactions:
            self._write_option(option, value)

    def _write_option(self, option: OptionCode, value: int) -> None:
        """Write a reaction; raises BusConfigurationError when it is not kept.

        A profile of no particular drive leaves out the reaction to a fault where the drive lets it only be read, as a
        draft from the vendor's file does, if there is the reaction to a lost link beside it.
        """
        entry, section = option.entry, self.member.profile.link_loss
        try:
            self.node.write(entry, value)
        except BusConfigurationError as error:
            alone = option is not section.fault_reaction_option or section.abort_connection_option is None
            read_only = getattr(error.__cause__, "code", None) == READ_ONLY
            if alone or not read_only or self.member.profile.drive.evidence != STANDARD:
                raise
            self.warn(f"{self.node.label}: {entry} is read-only and stays {self.node.read(entry)}")

    def final_writes(self) -> tuple[tuple[ObjectEntry, int], ...]:
        """Return the entries to write at the end: they switch the guard off and restore the former limits."""
        return (*self.guard.disarming, *self.torque_limits.before.items())

    @property
    def _reactions(self) -> tuple[tuple[OptionCode, int], ...]:
        return reactions(self.member.profile.link_loss, brakes=self.axis.rig.on_link_loss == "brake")

    def _link_loss_words(self) -> str:
        if not self.member.profile.guarded:
            return "on link loss the motor keeps its torque until its power is cut"
        option = self.member.profile.link_loss.abort_connection_option
        # Without 6007h a lost link is a fault, after which 605Eh says the same of the shaft.
        reaction = SHAFT_FREE if option is None else self._reactions[0][1]
        words = SHAFT_WORDS.get(reaction, f"reaction of the drive as configured ({reaction})")
        return f"on link loss {words} within {self.guard.milliseconds} ms"

    def _set_mode(self) -> None:
        node, profile, mode = self.node, self.member.profile, self.member.profile.torque.mode_of_operation
        node.write(MODE, mode)
        wrong = f"did not accept mode of operation {mode}: {MODE_DISPLAY} is"
        timeout = profile.timing.mode_change_timeout
        poll(node, timeout, lambda: node.read(MODE_DISPLAY) == mode, lambda: f"{wrong} {node.read(MODE_DISPLAY)}")
