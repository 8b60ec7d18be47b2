"""The slaves of a bench, their timers, and their faults.

Frames come from a wire, simulated or real, and leave through the ports. Everything random (serial number, position of
the encoder's zero within a count, boot time) is drawn from the seed.
"""

from collections.abc import Callable
from functools import partial
from typing import assert_never

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import Action, DriveBench, Plan, TimedFault, inject_drive, until, with_faulty_hand
from haptic_fieldbus.sim.canopen.link import Frame, Port
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive.dictionary import AccessRefused
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import AnswerFault, DriveFaultKind, Fault, HostFault, LineFault, kinds_of

# Application of each kind of fault to the simulated slave; those of its bus are applied by the bus.


def inject(fault: faults.DriveFaultKind, slave: Slave, plan: Plan, t_ns: int) -> None:
    """Apply a fault of a drive that happens at `t_ns`."""
    match fault:
        case faults.Emergency(code=code):
            slave.error(code, t_ns)
        case faults.DriveFault(code=code, duration=duration):
            errors = slave.node.emergencies
            slave.drive.fault(code, t_ns)
            if duration != 0.0:  # its cause lasts
                errors.raise_error(code, fault)
                plan(until(t_ns, duration), lambda _t_ns: errors.clear(code, fault))
        case faults.NodeReset(duration=duration):
            slave.node.reset(t_ns, round(duration * 1e9))
        case faults.Silence(duration=duration):
            slave.silent_until_ns = max(slave.silent_until_ns, until(t_ns, duration))
        case faults.MissingTpdos(count=count):
            slave.node.process.skip_tpdos += count
        case faults.MissingRpdos(count=count):
            slave.node.lose(slave.node.process.lost_rpdos, count)
        case faults.SyncIgnored(count=count):
            slave.node.lose(slave.node.process.lost_syncs, count)
        case faults.HeartbeatLost():
            slave.node.heartbeat_enabled = False
        case faults.DuplicateNode():
            slave.duplicate()
        case _:
            inject_drive(fault, slave.drive, plan, t_ns)


KINDS = kinds_of(Fault) - kinds_of(AnswerFault)
"""Kinds of faults that a bus and its drives may have."""


class SimulatedDrives(DriveBench):
    """The slaves by node-ID; all times are those of one clock [ns]."""

    of_line, kinds, protocol = LineFault | HostFault, KINDS, "CAN"
    inject_line: Callable[[LineFault | HostFault, int], None] | None = None
    """Applies a fault of the bus or of the host; None for a real bus, on which no faults can be simulated."""

    def __init__(self, seed: int | str = DEFAULT_SEED, longest: int | None = None) -> None:
        super().__init__(seed, longest)
        self.slaves: dict[int, Slave] = {}
        self.attached: list[tuple[Port, Slave]] = []
        self.due_ns = NEVER_NS
        """Time of the next timer or planned action; NEVER_NS when there is none."""
        self.plan = self.queue.plan

    def add(self, slot: DriveOnBus, port: Port, t_ns: int) -> Slave:
        """Power on a drive that sends through this port; raises UsageError (see `check`)."""
        self.check(slot)
        slave = Slave(with_faulty_hand(slot), port.send, self.drawn(slot), t_ns)
        self.slaves[slot.node] = slave
        self.follow(slave.drive, slot)
        self.attached.append((port, slave))
        self.timed += slave.drive.operation, slave.node.alarms
        slave.power_on(t_ns, booted=slot.booted)
        self.find_due()
        return slave

    def receive(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        """Pass a frame that has ended to every slave except its sender."""
        can_id, data, extended, remote = frame
        # A real bus has no port of ours: then `sender` is None and every slave receives the frame.
        if extended or remote or not can_id:
            for port, slave in self.attached:
                if port is not sender:
                    slave.receive(frame, t_ns)
        else:
            # As `Slave.receive`; a frame of the process data concerns one slave, and costs the others a look-up.
            for port, slave in self.attached:
                node = slave.node
                handler = node.handlers.get(can_id)
                if handler is not None and port is not sender and t_ns >= slave.silent_until_ns:
                    node.now_ns = t_ns
                    handler(data, t_ns)
        self.find_due()

    def timers(self, t_ns: int) -> None:
        """Run the planned actions and timers that are due."""
        self.queue.run(t_ns)
        for _port, slave in self.attached:
            if slave.due_ns <= t_ns:
                slave.timer(t_ns)
        self.find_due()

    def find_due(self) -> None:
        """Update `due_ns`; call it after anything that may have changed a slave's timers."""
        self.due_ns = self.next_due_ns

    def let_happen(self, fault: TimedFault, node: int, t_ns: int) -> None:
        super().let_happen(fault, node, t_ns)
        self.find_due()

    def install(self, fault: faults.LastingFault, node: int) -> None:
        slave = self.slaves[node]
        match fault:
            case faults.MissingNode():
                slave.silent_until_ns = NEVER_NS
            case faults.WrongIdentity(vendor_id=vendor_id, product_code=product_code):
                for subindex, value in ((1, vendor_id), (2, product_code)):
                    if value is not None:
                        # The default changes too, so that a reset of the node does not bring back the right identity.
                        try:
                            slave.drive.dictionary.find(0x1018, subindex).start_with(value)
                        except AccessRefused:
                            words = f"node {node} has no 1018h:{subindex:02X}, which this fault changes"
                            raise UsageError(f"{fault.kind}: {words}") from None
            case faults.SdoRefusal(object=index, subindex=subindex, code=code):
                slave.node.sdo.refuse[index, subindex] = code
            case faults.DeadGuard(factor=factor):
                slave.node.slow_guards(factor)
            case _:
                assert_never(fault)

    def action(self, node: int, fault: TimedFault) -> Action:
        if isinstance(fault, LineFault | HostFault) and self.inject_line is not None:
            return partial(self.inject_line, fault)
        if not isinstance(fault, DriveFaultKind):
            raise ValueError(f"drives on CAN do not support the fault {fault.kind}")
        return partial(inject, fault, self.slaves[node], self.plan)
