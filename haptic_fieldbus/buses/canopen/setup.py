"""Configuration of one drive by SDO: inspect, then write and read back, then start.

Inspection writes nothing, so a wrong drive is refused untouched. The reaction of the drive to the loss of its master is
part of the configuration: a drive that does not confirm it is not started.

Reference: CiA 301 7.5.2 (communication objects); IEC 61800-7-201 (CiA 402-2), 6007h, 6060h, 6061h, 605Eh.
"""

from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.buses.bus import DriveFacts
from haptic_fieldbus.buses.canopen.asking import check_asked
from haptic_fieldbus.buses.canopen.guard import Guard
from haptic_fieldbus.buses.canopen.mapping import map_pdos
from haptic_fieldbus.buses.canopen.node import READ_ONLY, SDO_TIMEOUT, NmtState, Node
from haptic_fieldbus.buses.canopen.preparing import check_rated_torque, commissioned, prepare
from haptic_fieldbus.buses.torque_limits import TorqueLimits
from haptic_fieldbus.drive.cia402 import OptionCode
from haptic_fieldbus.drive.identity import Identity, known_number
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.drive.power import ENERGISED, PowerState
from haptic_fieldbus.drive.profile import STANDARD
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, DriveFaultError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.protocols.canopen.beside import MODE, SHAFT_BRAKES, reactions
from haptic_fieldbus.protocols.canopen.pdo import SYNC_COB_ID
from haptic_fieldbus.protocols.canopen.traffic import BusMember, CanTraffic
from haptic_fieldbus.protocols.cia402 import CIA402, DISABLE_VOLTAGE

DEVICE_TYPE = ObjectEntry(0x1000, DataType.UINT32)
SYNC_ID = ObjectEntry(0x1005, DataType.UINT32)
VENDOR_ID, PRODUCT_CODE, REVISION, SERIAL = (ObjectEntry(0x1018, DataType.UINT32, sub) for sub in range(1, 5))
ERROR_CODE = ObjectEntry(0x603F, DataType.UINT16)
CONTROLWORD = ObjectEntry(0x6040, DataType.UINT16)
STATUSWORD = ObjectEntry(0x6041, DataType.UINT16)
MODE_DISPLAY = ObjectEntry(0x6061, DataType.INT8)
TORQUE_LIMITS = tuple(ObjectEntry(index, DataType.UINT16) for index in (0x6072, 0x60E0, 0x60E1))
"""Max torque, positive and negative torque limit value (CiA 402-2), all in ‰ of rated torque."""

DRIVE_PROFILE = 0x0192  # low word of the device type: CiA 402
SYNC_PRODUCER = 0x4000_0000  # bit 30 of 1005h: the device sends SYNC itself
COB_ID_MASK = 0x7FF
SHAFT_FREE = 2  # abort connection option code (6007h): disable voltage
SHAFT_WORDS = {1: "the drive faults", SHAFT_FREE: "the shaft is free", SHAFT_BRAKES: "the drive brakes by quick stop"}
NO_ANSWER_ADVICE = "check that the drive has power, its node-ID, the bit rate, the wiring and both 120 Ω terminators"
HEARTBEATS_TO_CONFIRM = 3  # the time for an NMT command, in heartbeat periods of the node
POLL_NS = 5_000_000
DISABLE_TIMEOUT = 1.0  # [s]; for a drive that an earlier master left enabled


@dataclass(frozen=True)
class Setup:
    """Setup of one axis of the plan on its node; `bus` is the traffic of the whole bus, `member` that of this axis."""

    node: Node
    axis: AxisPlan
    bus: CanTraffic
    member: BusMember
    torque_limits: TorqueLimits[ObjectEntry]
    warn: Callable[[str], None]

    def inspect(self) -> DriveFacts:
        """Check that the node is the drive of the profile, healthy and rated as in the rig; write nothing.

        Raises BusTimeoutError, BusConfigurationError, DriveFaultError.
        """
        self._check_device_type()
        vendor, product = self._check_identity()
        self._check_no_fault()
        self._check_sync()
        revision, serial = self.node.optional(REVISION), self.node.optional(SERIAL)
        identity = Identity(known_number(vendor), known_number(product), known_number(revision), known_number(serial))
        self.torque_limits.inspect(identity, self.node.optional)
        if self.member.traffic.asked:
            check_asked(self.node, self.member.profile.torque.target.entry)
        return DriveFacts(
            axis=self.axis.name,
            node=self.node.id,
            title=self.member.profile.title,
            identity=identity,
            rated_torque=check_rated_torque(self.node, self.member.profile, self.axis),
            link_loss=self._link_loss_words(),
            changes=(*self.torque_limits.sentences, *commissioned(self.node, self.member.profile, self.axis)),
        )

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

    def start(self) -> None:
        """Set the node operational, confirmed by its sign of life, with its guard engaged.

        Raises BusError, also when it restarted meanwhile.
        """
        self.node.command(NmtState.OPERATIONAL)
        self.node.confirm(NmtState.OPERATIONAL, self._confirmation_time)
        self.guard.engage()
        if self.node.booted:
            raise BusConfigurationError(f"{self.node.label} restarted while it was configured: is its supply stable?")

    @property
    def _confirmation_time(self) -> float:
        return HEARTBEATS_TO_CONFIRM * self.bus.node_heartbeat_ms * 1e-3

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
                f"{self.node.label} is not a CiA 402 drive: its device type 1000h is {device_type:08X}h, "
                f"a drive's ends in {DRIVE_PROFILE:04X}h"
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
                f"{self.node.label} is another drive: 1018h says vendor {vendor:08X}h, product {product:08X}h; "
                f"the profile {profile.name or profile.title} expects {wanted}. Nothing was written"
            )
        return vendor, product

    def _check_no_fault(self) -> None:
        statusword = self.node.read(STATUSWORD)
        if CIA402.state(statusword) not in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            return
        code = self.node.optional(ERROR_CODE)
        cause = "" if code is None else f", error code {code:04X}h (603Fh)"
        raise DriveFaultError(
            f"{self.node.label} is in the state {CIA402.state(statusword).value}{cause}. Remove the cause, then clear "
            "it: switch the drive off and on, or write 6040h = 0 and then 80h with the drive's own tool"
        )

    def _check_sync(self) -> None:
        sync = self.node.optional(SYNC_ID)
        if sync is None:
            return
        if sync & COB_ID_MASK != SYNC_COB_ID or sync & SYNC_PRODUCER:
            raise BusConfigurationError(
                f"{self.node.label}: {SYNC_ID} is {sync:08X}h; a SYNC consumer at {SYNC_COB_ID:03X}h is needed"
            )

    def _disable(self) -> None:
        """Switch the power stage off if an earlier master left it on."""
        if self.energised():
            self.node.send(CONTROLWORD, DISABLE_VOLTAGE)
        self._poll(
            lambda: not self.energised(),
            DISABLE_TIMEOUT,
            lambda: "was found enabled and stays so although it was told to disable voltage",
        )

    def energised(self, timeout: float = SDO_TIMEOUT) -> bool:
        """Read the statusword within `timeout` [s]; True when the motor can carry torque. Raises BusError."""
        return CIA402.state(self.node.read(STATUSWORD, timeout)) in ENERGISED

    def _guard_link(self) -> None:
        """Arm the drive's guard on us, and set the reactions to our loss, which leave no torque."""
        if not self.member.profile.guarded:
            if self.axis.rig.emergency_stop == "power":
                return  # the plan permits little torque then
            raise BusConfigurationError(
                f"{self.member.profile.title} has no watch on its master, or no reaction to its loss (profile: "
                "link_loss): it could hold the last torque when the cable breaks; refused"
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
            self.warn(f"{self.node.label}: {entry} can only be read, and stays {self.node.read(entry)}")

    @property
    def guard(self) -> Guard:
        """The drive's watch on us."""
        section, bus = self.member.profile.link_loss, self.bus
        return Guard(self.node, section, self._deadline_ms, bus.master_node, bus.node_heartbeat_ms)

    def parting(self) -> tuple[tuple[ObjectEntry, int], ...]:
        """Return what is written at the end: no watch on us, so that leaving is no error, and the limits of before."""
        return (*self.guard.disarming, *self.torque_limits.restoring)

    @property
    def _deadline_ms(self) -> int:
        return round(self.bus.guard(self.axis.name) * 1e3)

    @property
    def _reactions(self) -> tuple[tuple[OptionCode, int], ...]:
        return reactions(self.member.profile.link_loss, brakes=self.axis.rig.on_link_loss == "brake")

    def _link_loss_words(self) -> str:
        if not self.member.profile.guarded:
            return "on link loss the motor keeps its torque until its power is cut"
        option = self.member.profile.link_loss.abort_connection_option
        # Without 6007h a lost link is a fault, after which 605Eh says the same of the shaft.
        reaction = SHAFT_FREE if option is None else self._reactions[0][1]
        words = SHAFT_WORDS.get(reaction, f"the drive reacts as it was set up ({reaction})")
        return f"on link loss {words} within {self._deadline_ms} ms"

    def _set_mode(self) -> None:
        mode = self.member.profile.torque.mode_of_operation
        self.node.write(MODE, mode)
        self._poll(
            lambda: self.node.read(MODE_DISPLAY) == mode,
            self.member.profile.timing.mode_change_timeout,
            lambda: f"did not take over mode of operation {mode}: {MODE_DISPLAY} says {self.node.read(MODE_DISPLAY)}",
        )

    def _poll(self, reached: Callable[[], bool], timeout: float, complaint: Callable[[], str]) -> None:
        deadline_ns = self.node.now_ns() + round(timeout * 1e9)
        while not reached():
            if self.node.now_ns() >= deadline_ns:
                raise BusConfigurationError(f"{self.node.label} {complaint()} (waited {exactly(timeout)} s)")
            self.node.wait(POLL_NS)
