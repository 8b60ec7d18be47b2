"""The slaves of a bench, their timers, and their faults.

Frames come from a wire, simulated or real, and leave through the ports. Everything random (serial number, position of
the encoder's zero within a count, boot time) is drawn from the seed.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.agenda import Agenda
from haptic_fieldbus.sim.canopen.injection import Line, inject, inject_line, install_fault
from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.link.wire import Port
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive.broken import faulty_hand
from haptic_fieldbus.sim.drive.settings import drawn_settings
from haptic_fieldbus.sim.faults import (
    AnswerFault,
    Fault,
    HandFault,
    HostFault,
    LastingFault,
    LineFault,
    faults_of,
    kinds_of,
)
from haptic_fieldbus.sim.schedule import FaultSchedule, TimedFault
from haptic_fieldbus.sim.slot import Slot

KINDS = kinds_of(Fault) - kinds_of(AnswerFault)
"""Kinds of faults that a bus and its drives may have."""


class Rack:
    """The slaves by node-ID; all times are those of one clock [ns].

    At least the `longest` latest segments of the true motion are kept, None: all.
    """

    def __init__(self, line: Line, seed: int | str = DEFAULT_SEED, longest: int | None = None) -> None:
        self._seed = seed
        self.slaves: dict[int, Slave] = {}
        self.attached: list[tuple[Port, Slave]] = []
        self.due_ns = NEVER_NS
        """Time of the next timer or planned action; NEVER_NS when there is none."""
        self._line = line
        self._longest = longest
        self._agenda = Agenda()
        self.plan = self._agenda.plan
        self._schedule = FaultSchedule(self.plan)

    def add(self, slot: Slot, port: Port, t_ns: int) -> Slave:
        """Power on a drive that sends through this port; raises ValueError when its node-ID is taken."""
        self.check_free(slot.node)
        drawn = drawn_settings(self._seed, slot.node)
        settings = replace(drawn, position=slot.position, velocity=slot.velocity, led=slot.led)
        hand = faulty_hand(slot.hand, faults_of(slot.faults, slot.node))
        slave = Slave(slot.node, slot.profile, slot.axis, port.send, hand, settings, t_ns=t_ns)
        slave.drive.plant.recorder.longest = self._longest
        timed: list[TimedFault] = []
        for fault in slot.faults:
            if isinstance(fault, LineFault | HostFault):
                timed.append(fault)
            elif fault.node not in (None, slot.node):
                continue
            elif isinstance(fault, LastingFault):
                install_fault(fault, slave)
            elif not isinstance(fault, HandFault):
                timed.append(fault)
        # The time of a fault counts from *operation enabled*, which is not known yet.
        slave.drive.on_enabled = partial(self._schedule.begin, timed, slot.node, partial(self._action, slave))
        slave.drive.on_freed = lambda _t_ns: self._schedule.freed(slot.node)
        self.slaves[slot.node] = slave
        self.attached.append((port, slave))
        slave.power_on(t_ns, booted=slot.booted)
        self.find_due()
        return slave

    def check_free(self, node: int) -> None:
        """Raise ValueError when the node-ID is taken."""
        if node in self.slaves:
            raise ValueError(f"node {node} is on this bus already")

    def receive(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        """Pass a frame that has ended to every slave except its sender."""
        for port, slave in self.attached:
            # A real bus has no port of ours: then `sender` is None and every slave receives the frame.
            if port is not sender:
                slave.receive(frame, t_ns)
        self.find_due()

    def timers(self, t_ns: int) -> None:
        """Run the planned actions and timers that are due."""
        self._agenda.run(t_ns)
        for _port, slave in self.attached:
            if slave.due_ns <= t_ns:
                slave.timer(t_ns)
        self.find_due()

    def find_due(self) -> None:
        """Update `due_ns`; call it after anything that may have changed a slave's timers."""
        due_ns = self._agenda.due_ns
        for _port, slave in self.attached:
            due_ns = min(due_ns, slave.due_ns)
        self.due_ns = due_ns

    def let_happen(self, fault: TimedFault, node: int, t_ns: int) -> None:
        """Plan a fault of a drive or of the bus, whose `at` counts from `t_ns`."""
        self.plan(t_ns + round(fault.at * 1e9), self._action(self.slaves[node], fault))
        self.find_due()

    def _action(self, slave: Slave, fault: TimedFault) -> Callable[[int], None]:
        """Return what a fault does, to its drive or to the line."""
        if isinstance(fault, LineFault | HostFault):
            return partial(inject_line, fault, self._line, self.plan)
        if isinstance(fault, AnswerFault):
            raise ValueError(f"{fault.kind} is no fault of a drive on CAN")
        return partial(inject, fault, slave, self.plan)
