"""A simulated drive as a test sees it: from inside, beside the wire."""

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive.dictionary import Refused
from haptic_fieldbus.sim.faults import DriveFault, DriveFaultKind, LineFault


class SimulatedDrive:
    """One drive of a `VirtualCanBus`; what is read of it is the truth at this moment, not what it says on the bus."""

    def __init__(self, world: World, slave: Slave, profile: DriveProfile) -> None:
        self._world = world
        self._slave = slave
        self.profile = profile

    def __repr__(self) -> str:
        return f"<simulated {self.profile.title}, node {self.node}: {self.state}>"

    @property
    def node(self) -> int:
        """Return the node-ID."""
        return self._slave.node.number

    @property
    def state(self) -> str:
        """Return the state of CiA 402 by its name in the standard, such as "operation enabled"."""
        with self._world.pace.held():
            return self._slave.drive.power.state.value

    @property
    def nmt_state(self) -> str:
        """Return the NMT state: "initialising", "pre-operational", "operational" or "stopped"."""
        with self._world.pace.held():
            return self._slave.node.state.name.lower().replace("_", "-")

    @property
    def torque(self) -> float:
        """Return the torque of the motor [N·m]."""
        return self._shaft()[2]

    @property
    def position(self) -> float:
        """Return the angle of the shaft [rad]."""
        return self._shaft()[0]

    @property
    def velocity(self) -> float:
        """Return the speed of the shaft [rad/s]."""
        return self._shaft()[1]

    @property
    def rated_torque(self) -> float:
        """Return the rated torque of the motor [N·m], to which 6071h and 6077h refer."""
        return self._slave.drive.objects.rated_torque

    @property
    def error_code(self) -> int:
        """Return the code of the fault that stands, as in 603Fh; 0 when there is none."""
        with self._world.pace.held():
            return self._slave.drive.objects.error_code.value

    def value(self, index: int, subindex: int = 0) -> int:
        """Return a number of the object dictionary, as an upload would; raises LookupError when there is none."""
        with self._world.pace.held():
            self._slave.drive.measure(self._world.clock.now_ns())
            try:
                entry = self._slave.drive.dictionary.find(index, subindex)
            except Refused:
                raise LookupError(f"the simulated {self.profile.title} has no {index:04X}h:{subindex:02X}") from None
            return entry.fetch() if entry.fetch is not None else entry.value

    def fail(self, code: int = 0x2310) -> None:
        """Let the drive detect a fault now; `code` is that of its emergency message, 2310h is an over-current."""
        self.happen(DriveFault("drive_fault", 0.0, code))

    def happen(self, fault: DriveFaultKind | LineFault) -> None:
        """Let a fault of this drive or of its bus happen; its `at` counts from now."""
        if not isinstance(fault, DriveFaultKind | LineFault):
            raise ValueError(f'fault "{fault.kind}" cannot begin while the bench runs')
        with self._world.pace.held():
            self._world.let_happen(self.node, fault)

    def _shaft(self) -> tuple[float, float, float]:
        with self._world.pace.held():
            drive = self._slave.drive
            drive.servo.advance(self._world.clock.now_ns())
            return drive.plant.position, drive.plant.velocity, drive.plant.torque
