"""The CANopen half of a simulated drive: NMT, error control, emergencies, and who handles which frame.

Theory (CiA 301, 7.3.2): initialising → pre-operational (boot-up message) ⇄ operational ⇄ stopped. PDOs and SYNC work in
*operational* only, SDO and emergencies in *pre-operational* and *operational*, NMT and heartbeats in all three.
Which identifiers concern the node stands in `handlers`; it is made anew when a parameter or the state changes.
Pure: frames and times [ns] in, frames out through `send`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.dictionary import AbortCode, Access, Dictionary, Entry, SdoAbort, one_of
from haptic_fieldbus.sim.emergency import HEARTBEAT_LOST, Emergencies
from haptic_fieldbus.sim.frame import Frame
from haptic_fieldbus.sim.heartbeat import HEARTBEAT_ID, Consumer, Producer
from haptic_fieldbus.sim.pdo import PdoDefaults
from haptic_fieldbus.sim.process import Application, Handler, ProcessData
from haptic_fieldbus.sim.sdo import SdoServer
from haptic_fieldbus.sim.wire import NEVER_NS

SYNC_ID = 0x80
EMERGENCY_ID = 0x80
SDO_RESPONSE_ID = 0x580
SDO_REQUEST_ID = 0x600
_INVALID = 1 << 31
_STANDARD_ID = 0x7FF


class NmtState(Enum):
    """The value is the state octet of the heartbeat; that of *initialising* is the boot-up message's."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


# CiA 301, 7.2.8.3.1: NMT command specifiers.
_COMMANDED = {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED, 128: NmtState.PRE_OPERATIONAL}
_RESET_NODE, _RESET_COMMUNICATION = 129, 130

# CiA 301, 7.5.2.32 (1029h:01): state after a communication error.
_ERROR_BEHAVIOUR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}


@dataclass(frozen=True)
class NodeOptions:
    """What differs between models: PDOs, the object that watches the master, when RPDOs act, how long a reset takes."""

    rpdos: list[PdoDefaults]
    tpdos: list[PdoDefaults]
    consumer: int | None = 0x1016
    acts_at_sync: bool = False
    reset_ns: int = 0


class Node:
    """One CANopen slave."""

    def __init__(
        self,
        number: int,
        dictionary: Dictionary,
        application: Application,
        send: Callable[[Frame], None],
        options: NodeOptions,
    ) -> None:
        self.number = number
        self.state = NmtState.INITIALISING
        self.handlers: dict[int, Handler] = {}
        self.now_ns = 0
        self.heartbeat_enabled = True
        """False: our own heartbeats are no longer sent."""
        self.dictionary = dictionary
        self.sdo = SdoServer(dictionary)
        self.emergencies = Emergencies(dictionary, self._send_emergency)
        self._application = application
        self._send = send
        self._reset_ns = options.reset_ns
        self._boot_ns = NEVER_NS
        self._producer = Producer(dictionary, lambda: self.now_ns)
        consumer = options.consumer
        self._consumer = Consumer(dictionary, consumer, self._route) if consumer is not None else None
        self._add_objects()
        self.process = ProcessData(
            dictionary, application, self.emergencies, send, self._route,
            options.rpdos, options.tpdos, options.acts_at_sync,
        )  # fmt: skip

    @property
    def due_ns(self) -> int:
        """When something is to be done without a frame."""
        consumer_ns = self._consumer.due_ns if self._consumer is not None else NEVER_NS
        return min(self._boot_ns, self._producer.due_ns, consumer_ns, self.process.due_ns)

    def power_on(self, t_ns: int, delay_ns: int | None) -> None:
        """Voltage comes; the boot-up message follows after the delay. None: it came long ago, nobody was listening."""
        self._initialise(t_ns, 0x1000, 0xFFFF, NEVER_NS if delay_ns is None else t_ns + delay_ns)
        if delay_ns is None:
            self._enter(NmtState.PRE_OPERATIONAL)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """A frame of another node ended."""
        handler = self.handlers.get(frame.can_id)
        if handler is not None and not frame.extended and not frame.remote:
            self.now_ns = t_ns
            handler(frame.data, t_ns)

    def timer(self, t_ns: int) -> None:
        """Do what is due."""
        self.now_ns = t_ns
        if self._boot_ns <= t_ns:
            self._boot()
        if self._producer.due_ns <= t_ns:
            self._producer.next(t_ns)
            if self.heartbeat_enabled:
                self._send(Frame(HEARTBEAT_ID + self.number, bytes((self.state.value,))))
        if self._consumer is not None and self._consumer.due_ns <= t_ns:
            self._consumer.expire()
            self._heartbeat_lost(t_ns)
        if self.process.due_ns <= t_ns:
            self.process.poll(t_ns)

    def reset(self, t_ns: int, boot_ns: int | None = None) -> None:
        """As after power-on; the boot-up message comes after `boot_ns`, None: after the model's reset time."""
        self._application.link_lost(t_ns)
        self._initialise(t_ns, 0x1000, 0xFFFF, t_ns + (self._reset_ns if boot_ns is None else boot_ns))

    # States.

    def _initialise(self, t_ns: int, first: int, last: int, boot_ns: int) -> None:
        """Enter *initialising* with power-on values of a range of objects."""
        self.now_ns = t_ns
        self.state = NmtState.INITIALISING
        self.process.stop()
        self._producer.stop()
        if self._consumer is not None:
            self._consumer.stop()
        self.sdo.reset()
        self.emergencies.restart()
        self.dictionary.restore(first, last)
        if last == 0xFFFF:
            self._application.restart(t_ns)
        self.process.compile()
        self._route()
        self._boot_ns = boot_ns

    def _boot(self) -> None:
        self._boot_ns = NEVER_NS
        self._send(Frame(HEARTBEAT_ID + self.number, bytes((NmtState.INITIALISING.value,))))
        self._producer.next(self.now_ns)
        self._enter(NmtState.PRE_OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        before, self.state = self.state, state
        if state is before:
            return
        if state is NmtState.OPERATIONAL:
            self.process.start(self.now_ns)
        else:
            self.process.stop()
        self._route()
        if state is NmtState.STOPPED:
            self._application.link_lost(self.now_ns)

    def _route(self) -> None:
        """Who handles which identifier in the present state; CiA 301, table 38."""
        handlers: dict[int, Handler] = {}
        if self.state is not NmtState.INITIALISING:
            handlers[0] = self._nmt
            if self._consumer is not None and self._consumer.can_id is not None:
                handlers[self._consumer.can_id] = self._heartbeat
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            handlers[SDO_REQUEST_ID + self.number] = self._sdo
        if self.state is NmtState.OPERATIONAL:
            handlers |= self.process.route(self.now_ns)
            handlers[self.dictionary.value(0x1005) & _STANDARD_ID] = self.process.sync
        self.handlers = handlers

    # Services.

    def _nmt(self, data: bytes, t_ns: int) -> None:
        if len(data) < 2 or data[1] not in (0, self.number):
            return
        command = data[0]
        if command in _COMMANDED:
            self._enter(_COMMANDED[command])
        elif command == _RESET_NODE:
            self.reset(t_ns)
        elif command == _RESET_COMMUNICATION:
            self._application.link_lost(t_ns)
            self._initialise(t_ns, 0x1000, 0x1FFF, t_ns + self._reset_ns)

    def _sdo(self, data: bytes, t_ns: int) -> None:
        self._application.measure(t_ns)
        response = self.sdo.request(data)
        if response is not None:
            self._send(Frame(SDO_RESPONSE_ID + self.number, response))

    def _heartbeat(self, data: bytes, t_ns: int) -> None:
        if self._consumer is not None and self._consumer.received(data, t_ns):
            self.emergencies.clear(HEARTBEAT_LOST)

    def _heartbeat_lost(self, t_ns: int) -> None:
        self.emergencies.raise_error(HEARTBEAT_LOST)
        self._application.link_lost(t_ns)
        state = _ERROR_BEHAVIOUR.get(self.dictionary.value(0x1029, 1))
        if state is NmtState.STOPPED or (state is not None and self.state is NmtState.OPERATIONAL):
            self._enter(state)

    def _send_emergency(self, data: bytes) -> None:
        cob_id = self.dictionary.value(0x1014)
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL) and not cob_id & _INVALID:
            self._send(Frame(cob_id & _STANDARD_ID, data))

    def _add_objects(self) -> None:
        """The communication objects that are this class's own."""
        add = self.dictionary.add
        sync = add(Entry(0x1005, 0, DataType.UINT32, SYNC_ID, Access.RW, accept=_accept_sync))
        sync.changed = self._route
        emergency_id = EMERGENCY_ID + self.number
        add(Entry(0x1014, 0, DataType.UINT32, emergency_id, Access.RW,
                  accept=one_of((emergency_id, emergency_id | _INVALID))))  # fmt: skip
        behaviour = Entry(0x1029, 1, DataType.UINT8, 0, Access.RW, accept=one_of((0, 1, 2)))
        self.dictionary.add_record([behaviour])
        self.dictionary.add_record(
            Entry(0x1200, subindex, DataType.UINT32, base + self.number)
            for subindex, base in ((1, SDO_REQUEST_ID), (2, SDO_RESPONSE_ID))
        )


def _accept_sync(value: int) -> None:
    """This node consumes SYNC: it does not produce it (bit 30) and knows 11-bit identifiers only."""
    if value & ~_STANDARD_ID or not value:
        raise SdoAbort(AbortCode.INVALID_VALUE)
