"""A simulated drive on CAN: the drive together with its CANopen node.

The node has NMT, the services of each state, and the handlers of frames.

Theory (CiA 301, 7.3.2): initialising → pre-operational (boot-up message) ⇄ operational ⇄ stopped; `nmt` lists the
services that work in each state. A node without node-ID stays in *initialising*, with LSS alone (CiA 305). `handlers`
maps each identifier that concerns the node to its handler, `requests` does so for remote frames; both are rebuilt when
a parameter or the state changes.

Pure: it takes frames and times [ns] and sends frames through `send`.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from haptic_fieldbus.drive.cia402 import MappedObject, OptionCode
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.protocols.canopen.eds_values import number_of, velocity_unit
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.model import NodeOptions, extend, install_described, node_options
from haptic_fieldbus.sim.canopen.services import lss, nmt
from haptic_fieldbus.sim.canopen.services.basics import ID, INVALID, Alarms, Handler
from haptic_fieldbus.sim.canopen.services.communication import BitTiming, NodeObjects, Storage, TimeConsumer
from haptic_fieldbus.sim.canopen.services.lss import BIT_RATES, REQUEST_ID, UNCONFIGURED, LssSlave
from haptic_fieldbus.sim.canopen.services.nmt import DRIVE, HEARTBEAT_ID
from haptic_fieldbus.sim.canopen.services.process import Losses, ProcessData
from haptic_fieldbus.sim.canopen.services.sdo import TIMEOUT_NS, SdoServer
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry
from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus

SDO_RESPONSE_ID = 0x580
SDO_REQUEST_ID = 0x600
_EVERYTHING, _COMMUNICATION = (0x1000, 0xFFFF), (0x1000, 0x1FFF)


class Node:
    """One CANopen slave."""

    def __init__(self, number: int, drive: Drive, send: Callable[[Frame], None], options: NodeOptions) -> None:
        self.number = number
        self.state = nmt.NmtState.INITIALISING
        self.handlers: dict[int, Handler] = {}
        self.requests: dict[int, Callable[[int], None]] = {}
        self.now_ns = 0
        self.heartbeat_enabled = True
        """False: the node sends no heartbeats, regardless of 1017h, and answers no node guarding."""
        self.dictionary = dictionary = drive.dictionary
        self.sdo = SdoServer(dictionary)
        self._drive = drive
        self._send = send
        self._options = options
        self.alarms = alarms = Alarms()
        self._boot_alarm = alarms.new(self._boot)
        self._sdo_alarm = alarms.new(lambda _t_ns: self._respond(self.sdo.expire()))
        self._bit_timing = BitTiming(BIT_RATES[0], alarms, lambda: self.lss.bitrate, lambda: self.now_ns, self._route)
        self.emergencies = nmt.Emergencies(dictionary, self._send_emergency, alarms, lambda: self.now_ns)
        self._producer = nmt.Producer(
            dictionary, alarms, lambda: self.now_ns, lambda: self._tell_state(bytes((self.state.value,)))
        )
        watching = self._link_lost, self._link_back
        self.consumers = nmt.Consumers(dictionary, options.consumer, alarms, self._route, *watching)
        self._guarding = nmt.Guarding(dictionary, alarms, *watching)
        self.time = TimeConsumer(dictionary, lambda: self.now_ns, self._route)
        self._objects = NodeObjects(dictionary, number)
        self._storage = Storage(dictionary)
        self.lss = LssSlave(
            self._objects.identity, number, BIT_RATES[0], self._reset_communication, self._bit_timing.activate
        )
        self.process = ProcessData(
            drive, self.emergencies, self._emit, self._route, alarms,
            options.rpdos, options.tpdos, options.acts_at_sync,
        )  # fmt: skip

    def power_on(self, t_ns: int, delay_ns: int | None) -> None:
        """Switch the voltage on; the boot-up message follows after `delay_ns`.

        None: the message was sent long ago, and the node is *pre-operational* now.
        """
        self._initialise(t_ns, None if delay_ns is None else t_ns + delay_ns, power_on=True)
        if delay_ns is None:
            self._enter(nmt.NmtState.PRE_OPERATIONAL)

    def commission(self, bitrate: int) -> None:
        """Set the bit rate [bit/s] of the bus, and store it in the node as if it had been configured before."""
        self._bit_timing.bus_bitrate = bitrate
        self.lss.commission(bitrate)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Handle a frame of another node that has ended."""
        if frame.remote or frame.extended:
            requested = None if frame.extended else self.requests.get(frame.can_id)
            if requested is not None:
                self.now_ns = t_ns
                requested(t_ns)
            return
        if (handler := self.handlers.get(frame.can_id)) is not None:
            self.now_ns = t_ns
            handler(frame.data, t_ns)

    def timer(self, t_ns: int) -> None:
        """Serve the timers that are due."""
        self.now_ns = t_ns
        self.alarms.ring(t_ns)

    def reset(self, t_ns: int, boot_ns: int | None = None) -> None:
        """Reset the node as at power-on; the boot-up message follows after `boot_ns`, None: the model's reset time."""
        # 6007h makes no difference: the power-on state has no torque and no fault.
        self._initialise(t_ns, t_ns + (self._options.reset_ns if boot_ns is None else boot_ns), power_on=True)

    def lose(self, frames: Losses, count: int | None) -> None:
        """Lose the next `count` of these frames inside the node (a fault), None: all of them."""
        frames.left = math.inf if count is None else count
        self._route()

    def slow_guards(self, factor: float | None) -> None:
        """Let the watches on other nodes act after `factor` times their set time, None: never (a fault)."""
        for watch in (*self.consumers.watches, self._guarding):
            watch.factor = factor

    # States.

    def _reset_communication(self) -> None:
        self._drive.link_lost(nmt.DISCONNECTED, self.now_ns)
        self._initialise(self.now_ns, self.now_ns + self._options.reset_ns, power_on=False)

    def _initialise(self, t_ns: int, boot_ns: int | None, *, power_on: bool) -> None:
        """Enter *initialising* with the power-on values of all objects; without `power_on`, of communication alone."""
        self.now_ns = t_ns
        self.state = nmt.NmtState.INITIALISING
        self.process.stop()
        self._producer.stop()
        self.consumers.stop()
        self._guarding.reset()
        self._sdo_alarm.off()
        self.sdo.reset()
        self.lss.reset(power_on=power_on)
        self._bit_timing.switch()
        # The node-ID that LSS has set comes before the values, which may contain it; without one the last is kept.
        number = self.lss.active_node
        if number not in (self.number, UNCONFIGURED):
            self.dictionary.renumber(number - self.number)
            self.number = number
        self._storage.restore(*(_EVERYTHING if power_on else _COMMUNICATION))
        self.emergencies.restart(power_on=power_on)
        if power_on:
            self.time.forget()
            self._drive.restart(t_ns)
        self._boot_alarm.at(NEVER_NS if boot_ns is None else boot_ns)
        # Last, when all parameters have their power-on values.
        self.process.compile()
        self._route()

    def _boot(self, t_ns: int) -> None:
        self._route()
        if self.lss.active_node == UNCONFIGURED:
            return
        self._emit(Frame(nmt.HEARTBEAT_ID + self.number, bytes((nmt.NmtState.INITIALISING.value,))))
        self._producer.start(t_ns)
        self._enter(nmt.NmtState.PRE_OPERATIONAL)

    def _enter(self, state: nmt.NmtState) -> None:
        if state is self.state:
            return
        if state is nmt.NmtState.STOPPED:
            # Before the state is entered, in which no emergency is sent.
            self._drive.link_lost(nmt.DISCONNECTED, self.now_ns)
        self.state = state
        if state is nmt.NmtState.OPERATIONAL:
            self.process.start(self.now_ns)
        else:
            self.process.stop()
        if state is nmt.NmtState.STOPPED:
            self.sdo.reset()
            self._sdo_alarm.off()
        self._route()

    def _route(self) -> None:
        """Rebuild the handlers for the present state and parameters."""
        works = nmt.WORKING[self.state]
        waits = self.state is nmt.NmtState.INITIALISING and self._boot_alarm.due_ns == NEVER_NS
        if waits and self.lss.active_node == UNCONFIGURED:
            # No boot-up is pending: LSS alone can bring the node further.
            works = nmt.WITHOUT_NODE_ID
        handlers: dict[int, Handler] = {}
        requests: dict[int, Callable[[int], None]] = {}
        if nmt.Service.LSS in works:
            handlers[lss.REQUEST_ID] = self._lss
        if nmt.Service.SDO in works:
            if self.time.can_id is not None:
                handlers[self.time.can_id] = self.time.received
            handlers[SDO_REQUEST_ID + self.number] = self._sdo
        if nmt.Service.PDO in works:
            handlers |= self.process.route(self.now_ns)
            requests |= self.process.requests()
        if nmt.Service.NMT in works:
            handlers |= self.consumers.route()
            handlers[0] = self._nmt
            requests[nmt.HEARTBEAT_ID + self.number] = self._guard
        self.handlers, self.requests = (handlers, requests) if self._bit_timing.on_bus else ({}, {})

    # Services.

    def _nmt(self, data: bytes, t_ns: int) -> None:
        # The second octet is the node-ID that the command is for, 0 for all nodes.
        if len(data) != 2 or data[1] not in (0, self.number):
            return
        command = data[0]
        if command in nmt.COMMANDED:
            self._enter(nmt.COMMANDED[command])
        elif command == nmt.RESET_NODE:
            self.reset(t_ns)
        elif command == nmt.RESET_COMMUNICATION:
            self._reset_communication()

    def _sdo(self, data: bytes, t_ns: int) -> None:
        self._drive.measure(t_ns)
        self._respond(self.sdo.request(data))
        self._sdo_alarm.at(t_ns + TIMEOUT_NS if self.sdo.busy else NEVER_NS)

    def _respond(self, responses: list[bytes]) -> None:
        for response in responses:
            self._emit(Frame(SDO_RESPONSE_ID + self.number, response))

    def _guard(self, t_ns: int) -> None:
        # A node that produces heartbeats is not guarded: the heartbeat takes precedence.
        if self._producer.active:
            return
        self._tell_state(self._guarding.request(self.state.value, t_ns))

    def _tell_state(self, data: bytes) -> None:
        """Send a heartbeat, or the answer to node guarding."""
        if self.heartbeat_enabled:
            self._emit(Frame(nmt.HEARTBEAT_ID + self.number, data))

    def _link_lost(self, t_ns: int) -> None:
        """Handle the loss of a monitored node or of the guarding master: emergency, 6007h, and 1029h."""
        self.emergencies.raise_error(nmt.HEARTBEAT_LOST)
        self._drive.link_lost(nmt.HEARTBEAT_LOST, t_ns)
        self._enter(nmt.AFTER_ERROR.get((self._objects.behaviour.value, self.state), self.state))

    def _link_back(self) -> None:
        # Both share one error; it is over only when nobody is missing any more.
        if not self.consumers.lost and not self._guarding.lost:
            self.emergencies.clear(nmt.HEARTBEAT_LOST)

    def _send_emergency(self, data: bytes) -> None:
        cob_id = self._objects.emergency.value
        if nmt.Service.SDO in nmt.WORKING[self.state] and not cob_id & INVALID:
            self._emit(Frame(cob_id & ID, data))

    def _emit(self, frame: Frame) -> None:
        if self._bit_timing.on_bus:
            self._send(frame)

    # LSS.

    def _lss(self, data: bytes, _t_ns: int) -> None:
        if (response := self.lss.request(data)) is not None:
            self._emit(Frame(lss.RESPONSE_ID, response))


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
_PDO_COMMUNICATION = frozenset((*range(0x1400, 0x1600), *range(0x1800, 0x1A00)))
Named = TypeVar("Named", OptionCode, MappedObject)


def with_quirks(profile: CanopenProfile, settings: DriveSettings) -> tuple[CanopenProfile, DriveSettings]:
    """Return the profile and the settings with the quirks of the profile applied, to build the drive from."""
    quirks, link_loss, torque = profile.simulation, profile.link_loss, profile.torque
    eds = profile.eds if isinstance(profile, EdsProfile) else None
    not_in_file = (index for index in _APPLICATION if eds is not None and index not in eds)
    absent = frozenset(quirks.absent)
    boot_ns = round(quirks.boot_time * _NS)
    settings = replace(
        settings,
        without=settings.without | absent | frozenset(not_in_file),
        modes=_modes(profile, eds) if settings.modes is None else settings.modes,
        velocity_unit=velocity_unit(eds) if eds is not None and number_of(eds, 0x60A9) is not None else None,
        mode_change_ns=max(settings.mode_change_ns, round(quirks.mode_change_time * _NS)),
        start_delay_ns=settings.start_delay_ns + boot_ns,
        reset_ns=settings.reset_ns + boot_ns,
    )
    # The drive is built without an absent object, so that its effects are missing too, not only the entry.
    link_loss = replace(
        link_loss,
        heartbeat_consumer=None if _HEARTBEAT_CONSUMER in absent else link_loss.heartbeat_consumer,
        abort_connection_option=_present(link_loss.abort_connection_option, absent),
        fault_reaction_option=_present(link_loss.fault_reaction_option, absent),
    )
    torque = replace(torque, rated=_present(torque.rated, absent), actual=_present(torque.actual, absent))
    return replace(profile, link_loss=link_loss, torque=torque), settings


def _present(named: Named | None, absent: frozenset[int]) -> Named | None:
    """Return what names an object, None when the drive lacks this object."""
    return None if named is None or named.object in absent else named


def install_quirks(dictionary: Dictionary, profile: CanopenProfile, node: int) -> tuple[str, ...]:
    """Apply the quirks of the dictionary once the drive is built.

    Returns notes, in words, on the parts of a vendor's file that could not be taken over; empty without such a file.
    """
    quirks = profile.simulation
    notes = extend(dictionary, profile.eds, node) if isinstance(profile, EdsProfile) else ()
    for index in quirks.absent:
        dictionary.remove(index)
    install_described(dictionary, quirks.objects, node)
    # A drive has the objects that its profile sets up; where nothing describes them they only store their values.
    for each in profile.setup.writes:
        if each.object not in dictionary and each.object not in quirks.absent and not isinstance(profile, EdsProfile):
            dictionary.add(Entry(each.object, each.subindex, each.type, access=Access.RW))
    for index, value in ((0x6072, quirks.max_torque), (0x6502, quirks.supported_modes)):
        if value is not None and index in dictionary:
            dictionary.find(index).start_with(value)
    for entry in (each for each in dictionary if each.subindex == 1 and each.index in _PDO_COMMUNICATION):
        if quirks.cob_ids_missing:
            entry.start_with(INVALID)
            # Without an identifier there is no node-ID in the value that a new node-ID could change.
            entry.numbered = False
        elif quirks.pdos_disabled:
            entry.start_with(entry.default | INVALID)
    return notes


def _modes(profile: CanopenProfile, eds: Eds | None) -> frozenset[int] | None:
    """Return the modes of operation of the profile, otherwise of a vendor's file; None without either.

    If the file gives no value of 6502h, a mode exists if its target object exists.
    """
    if profile.simulation.modes is not None:
        return frozenset(profile.simulation.modes)
    if eds is None:
        return None
    if not (value := number_of(eds, 0x6502)):
        return frozenset(mode for mode, target in _TARGETS.items() if target in eds)
    return frozenset(bit + 1 for bit in range(_FIRST_MANUFACTURER_BIT) if value >> bit & 1)


class Slave:
    """A drive joined to its node; it is the `DriveLink` of the drive."""

    def __init__(
        self, slot: DriveOnBus, send: Callable[[Frame], None], settings: DriveSettings | None = None, t_ns: int = 0
    ) -> None:
        """Build the slave at `t_ns`, without voltage yet."""
        model, settings = with_quirks(canopen_profile(slot.profile), settings or DriveSettings())
        self.silent_until_ns = 0
        """Until this time no frame is sent or received."""
        self._frames = send
        self.drive = Drive(model, slot, self, settings, t_ns)
        self.node = Node(slot.node, self.drive, self._send, node_options(slot.node, model, settings))
        self.not_taken_over = install_quirks(self.drive.dictionary, model, slot.node)
        """Notes on the parts of a vendor's file that this drive cannot take over."""
        self.drive.units.follow()

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
        return min(self.node.alarms.due_ns, self.drive.operation.due_ns)

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
        if self.drive.operation.due_ns <= t_ns:
            self.drive.operation.timer(t_ns)
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
