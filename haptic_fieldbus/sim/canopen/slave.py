"""A simulated drive on CAN: the drive together with its CANopen node.

Pure: it takes frames and times [ns] and sends frames through `send`.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.protocols.canopen.eds_values import number_of, velocity_unit
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.model import extend, install_described, node_options
from haptic_fieldbus.sim.canopen.node import SDO_REQUEST_ID, Node
from haptic_fieldbus.sim.canopen.services.basics import INVALID
from haptic_fieldbus.sim.canopen.services.lss import REQUEST_ID
from haptic_fieldbus.sim.canopen.services.nmt import DRIVE, HEARTBEAT_ID
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.dictionary import Dictionary, Entry
from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.hand import Hand

# Quirks: deviations of real drives from the standards, by the keys of a profile's [simulation].
#
# Each quirk changes the profile or the settings that the simulated drive is built from, or its dictionary once it is
# built. The master never reads this section, so it meets the quirk unprepared, as on the real drive. The README of the
# profiles lists all keys; inhibit times of TPDOs after power-on are set by `pdo.inhibit_time_default` instead.


_NS = 1_000_000_000
_HEARTBEAT_CONSUMER = 0x1016
_APPLICATION = range(0x6000, 0x6800)
_FIRST_MANUFACTURER_BIT = 16
_TARGETS = {1: 0x607A, 3: 0x60FF, 4: 0x6071, 6: 0x6098, 8: 0x607A, 9: 0x60FF, 10: 0x6071}
"""Mode of operation → the object that commands it (CiA 402-2)."""
_PDO_COMMUNICATION = (range(0x1400, 0x1600), range(0x1800, 0x1A00))


def with_quirks(profile: CanopenProfile, settings: DriveSettings) -> tuple[CanopenProfile, DriveSettings]:
    """Return the profile and the settings with the quirks of the profile applied, to build the drive from."""
    quirks, link_loss, torque = profile.simulation, profile.link_loss, profile.torque
    absent = frozenset(quirks.absent)
    boot_ns = round(quirks.boot_time * _NS)
    settings = replace(
        settings,
        without=settings.without | absent | _not_in_file(profile),
        modes=_modes(profile) if settings.modes is None else settings.modes,
        velocity_unit=_velocity_unit(profile),
        mode_change_ns=max(settings.mode_change_ns, round(quirks.mode_change_time * _NS)),
        start_delay_ns=settings.start_delay_ns + boot_ns,
        reset_ns=settings.reset_ns + boot_ns,
    )
    # The drive is built without an absent object, so that its effects are missing too, not only the entry.
    abort, reaction = link_loss.abort_connection_option, link_loss.fault_reaction_option
    link_loss = replace(
        link_loss,
        heartbeat_consumer=None if _HEARTBEAT_CONSUMER in absent else link_loss.heartbeat_consumer,
        abort_connection_option=None if abort is not None and abort.object in absent else abort,
        fault_reaction_option=None if reaction is not None and reaction.object in absent else reaction,
    )
    rated, actual = torque.rated, torque.actual
    torque = replace(
        torque,
        rated=None if rated is not None and rated.object in absent else rated,
        actual=None if actual is not None and actual.object in absent else actual,
    )
    return replace(profile, link_loss=link_loss, torque=torque), settings


def install_quirks(dictionary: Dictionary, profile: CanopenProfile, node: int) -> tuple[str, ...]:
    """Apply the quirks of the dictionary once the drive is built.

    Returns notes, in words, on the parts of a vendor's file that could not be taken over; empty without such a file.
    """
    quirks = profile.simulation
    notes = extend(dictionary, profile.eds, node) if isinstance(profile, EdsProfile) else ()
    for index in quirks.absent:
        dictionary.remove(index)
    install_described(dictionary, quirks.objects, node)
    for index, value in ((0x6072, quirks.max_torque), (0x6502, quirks.supported_modes)):
        if value is not None and index in dictionary:
            _start_with(dictionary.find(index), value)
    for entry in _cob_ids(dictionary):
        if quirks.cob_ids_missing:
            _start_with(entry, INVALID)
            # Without an identifier there is no node-ID in the value that a new node-ID could change.
            entry.numbered = False
        elif quirks.pdos_disabled:
            _start_with(entry, entry.default | INVALID)
    return notes


def _start_with(entry: Entry, value: int) -> None:
    entry.value = entry.default = value


def _cob_ids(dictionary: Dictionary) -> Iterable[Entry]:
    return [
        entry
        for entry in dictionary
        if entry.subindex == 1 and any(entry.index in records for records in _PDO_COMMUNICATION)
    ]


def _not_in_file(profile: CanopenProfile) -> frozenset[int]:
    """Return the objects of CiA 402-2 that a vendor's file does not have; empty for a profile without such a file."""
    if not isinstance(profile, EdsProfile):
        return frozenset()
    return frozenset(index for index in _APPLICATION if index not in profile.eds)


def _velocity_unit(profile: CanopenProfile) -> str | None:
    """Return the unit of 60A9h in a vendor's file; None if the file names no known unit."""
    if not isinstance(profile, EdsProfile) or number_of(profile.eds, 0x60A9) is None:
        return None
    return velocity_unit(profile.eds)


def _modes(profile: CanopenProfile) -> frozenset[int] | None:
    """Return the modes of operation of the profile, otherwise of a vendor's file; None without either.

    If the file gives no value of 6502h, a mode exists if its target object exists.
    """
    if profile.simulation.modes is not None:
        return frozenset(profile.simulation.modes)
    if not isinstance(profile, EdsProfile):
        return None
    value = number_of(profile.eds, 0x6502)
    if not value:
        return frozenset(mode for mode, target in _TARGETS.items() if target in profile.eds)
    return frozenset(bit + 1 for bit in range(_FIRST_MANUFACTURER_BIT) if value >> bit & 1)


class Slave:
    """A drive joined to its node; it is the `DriveLink` of the drive."""

    def __init__(
        self,
        number: int,
        profile: DriveProfile,
        axis: RigAxis,
        send: Callable[[Frame], None],
        hand: Hand | None = None,
        settings: DriveSettings | None = None,
        t_ns: int = 0,
    ) -> None:
        """Build the slave at `t_ns`, without voltage yet."""
        model, settings = with_quirks(canopen_profile(profile), settings or DriveSettings())
        self.silent_until_ns = 0
        """Until this time no frame is sent or received."""
        self._frames = send
        self.drive = Drive(model, axis, self, hand, settings, t_ns)
        dictionary = self.drive.dictionary
        self.node = Node(number, dictionary, self.drive, self._send, node_options(number, model, settings))
        self.not_taken_over = install_quirks(dictionary, model, number)
        self.drive.units.follow()
        """Notes on the parts of a vendor's file that this drive cannot take over."""

    def duplicate(self) -> None:
        """Let a second node with the same node-ID join: every frame is sent twice from now on."""
        send = self._frames

        def twice(frame: Frame) -> None:
            send(frame)
            send(frame)

        self._frames = twice

    # Called by `SimulatedDrives`.

    @property
    def due_ns(self) -> int:
        """Return the time of the next timer; NEVER_NS when there is none."""
        return min(self.node.alarms.due_ns, self.drive.due_ns)

    @property
    def concerns(self) -> frozenset[tuple[int, bool]]:
        """Identifiers of the frames that concern the node in any state, each with True for a remote frame.

        It follows from the parameters, and changes only when the handlers of the node are rebuilt.
        """
        node = self.node
        data = {0, REQUEST_ID, SDO_REQUEST_ID + node.number, *node.process.received, *node.consumers.route()}
        remote = {HEARTBEAT_ID + node.number, *node.process.requests()}
        time = set[int]() if node.time.can_id is None else {node.time.can_id}
        return frozenset([*((each, False) for each in data | time), *((each, True) for each in remote)])

    def power_on(self, t_ns: int, *, booted: bool = False) -> None:
        """Switch the voltage on; the boot-up message follows, or was sent long ago when `booted`."""
        self.node.power_on(t_ns, None if booted else self.drive.settings.start_delay_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Handle a frame of another node that has ended, unless the slave is silent."""
        if t_ns >= self.silent_until_ns:
            self.node.receive(frame, t_ns)
            # An NMT command begins or ends an exchange: the hand that leads begins anew, with a rest.
            if not frame.can_id and self.drive.plant.led:
                self.drive.servo.advance(t_ns)
                self.drive.plant.rest_hand()

    def timer(self, t_ns: int) -> None:
        """Serve the timers that are due."""
        # The drive first: the node may send values that the drive computes at the same instant.
        if self.drive.due_ns <= t_ns:
            self.drive.timer(t_ns)
        if self.node.alarms.due_ns <= t_ns:
            self.node.timer(t_ns)

    # Called by the drive.

    def error(self, code: int, t_ns: int) -> None:
        """Send an emergency message."""
        self.node.now_ns = t_ns
        self.node.emergencies.raise_error(code, DRIVE)

    def persists(self) -> bool:
        """Return whether the cause of an error of the drive is present."""
        return self.node.emergencies.persists(DRIVE)

    def clear_errors(self, t_ns: int) -> None:
        """Send *error reset* after a fault reset, unless another error remains."""
        self.node.now_ns = t_ns
        self.node.emergencies.clear_all(DRIVE)

    def _send(self, frame: Frame) -> None:
        if self.node.now_ns >= self.silent_until_ns:
            self._frames(frame)
