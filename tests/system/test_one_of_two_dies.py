"""One of two drives dies: the torque of both is zero in the stated time, whether or not a coupling ties them.

The checker of `tests/invariants` measures the torque at both motors against the times that the plan states.
"""

import re
from collections.abc import Callable
from functools import partial

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import BusError, HapticFieldbusError
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.modbus.bus import modbus_section
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.modbus.line import SimulatedLine
from haptic_fieldbus.sim.modbus.station import ServerRequest, exception_for
from tests.builders import endless_rig
from tests.invariants.attach import watched
from tests.whole_loop import run_loop

CAN, TCP, RTU = "sim", "sim-modbus-tcp", "sim-modbus-rtu@115200"
DRIVES = {CAN: "generic_cia402", TCP: "generic_cia402_modbus", RTU: "generic_cia402_modbus"}
LASTING = 100_000
KINDS: dict[str, Callable[[float, int], faults.Fault]] = {
    "silence": lambda at, node: faults.Silence("silence", at, node=node),
    "feedback lost": lambda at, node: faults.MissingTpdos("missing_tpdos", at, LASTING, node=node),
    "answers lost": lambda at, node: faults.AnswerLost("answer_lost", at, LASTING, node=node),
    "exceptions": lambda at, node: faults.AnswerException("answer_exception", at, 11, LASTING, node=node),
}
OF_BUS = {CAN: ("silence", "feedback lost"), TCP: ("silence", "answers lost", "exceptions")}
CASES = [(bus, kind) for bus in DRIVES for kind in OF_BUS.get(bus, OF_BUS[TCP])]


def two_walls(bus: str) -> Scene:
    """Two axes that nothing ties, each in a wall that a line as slow as this one can bear."""
    stiffness = {CAN: 600.0, TCP: 300.0, RTU: 20.0}[bus]
    axes = tuple(SceneAxis(name, Workspace.LINEAR) for name in ("left", "right"))
    walls = tuple(Wall(axis.name, stiffness=stiffness, position=0.001) for axis in axes)
    return Scene("two walls", "two handles, each at a wall of its own", axes, walls)


def told_of(node: int) -> str:
    """The pattern of an error that names the node; a dead drive confirms nothing."""
    return rf"(node|unit) {node}\b.*(torque is off|not confirmed)"


@pytest.mark.thorough("48 runs")
@pytest.mark.parametrize("phase", [0.0, 0.0047])
@pytest.mark.parametrize("node", [1, 2])
@pytest.mark.parametrize(("bus", "kind"), CASES)
@pytest.mark.parametrize("tied", [False, True], ids=["alone", "tied"])
def test_the_torque_of_both_is_zero_in_the_stated_time(
    tied: bool, bus: str, kind: str, node: int, phase: float
) -> None:
    scene = "virtual_shaft" if tied else two_walls(bus)
    fault = KINDS[kind](1.1 + phase, node)
    with watched(keep=True) as found, pytest.raises(BusError, match=told_of(node)):
        api.run(scene, endless_rig(scene, DRIVES[bus], bus), hand="push", duration=2.0, faults=[fault], force=True)
    assert found.broken == []


class Gateway(SimulatedLine):
    """Hands on one request after another, and waits in vain for the unit that died before it says so.

    Its exception is 11 (0Bh, gateway target device failed to respond).
    """

    waits_ns = 300_000_000
    dead, died_ns, _busy_ns = 0, 0, 0

    def _answer_ns(self, asked: ServerRequest) -> int:
        now_ns = self._clock.now_ns()
        in_vain = asked.unit == self.dead and now_ns >= self.died_ns
        took_ns = self.waits_ns if in_vain else super()._answer_ns(asked)
        self._busy_ns = max(now_ns, self._busy_ns) + took_ns
        return self._busy_ns - now_ns

    def _execute(self, asked: ServerRequest, t_ns: int) -> None:
        if asked.unit != self.dead or t_ns < self.died_ns:
            super()._execute(asked, t_ns)
            return
        octets = self._requests.frame(asked, exception_for(asked, 11))
        self._comes(t_ns + self._way_ns, octets)


def behind_a_gateway(plan: Plan, node: int, died_at: float) -> tuple[float, str, Gateway]:
    """Let this unit die so long after operation enabled [s]: how long the other one had torque [s], and the error."""
    (bus,), clock, hand = plan.buses, VirtualClock(), hand_named("push")
    assert isinstance(bus.traffic, ModbusTraffic)
    assert hand is not None
    section = modbus_section(plan.rig.bus[bus.name])
    line = Gateway(section.interface, bus.traffic.wire, clock, serial=False)
    for axis in plan.axes:
        line.add(DriveOnBus(axis.node, axis.profile, axis.rig, hand.after(axis.limits.fade_in)))

    drive = line.unit(node).drive
    before = drive.on_enabled

    def begin(t_ns: int) -> None:
        before(t_ns)
        line.dead, line.died_ns = node, t_ns + round(1e9 * died_at)
        line._drives.queue.plan(line.died_ns, partial(drive.fault, 0x2310))

    drive.on_enabled = begin
    master, error = ModbusBus(line, clock, section), ""
    try:
        master.open(plan)
        run_loop(plan, Cycle(plan), master, clock, cycles=round(3.0 * plan.rate))
    except HapticFieldbusError as raised:
        error = str(raised)
    finally:
        master.close()
    clock.sleep_until(clock.now_ns() + 1_000_000_000)
    times, torques = line.trajectory(3 - node).targets()
    ended_ns = times[torques != 0.0].max()
    following = times[times > ended_ns].min()
    return float(following - line.died_ns) * 1e-9, error, line


@pytest.mark.thorough("8 runs")
@pytest.mark.parametrize("died_at", [1.1004, 1.1007])
@pytest.mark.parametrize("node", [1, 2])
@pytest.mark.parametrize("tied", [False, True], ids=["alone", "tied"])
def test_a_gateway_that_waits_for_a_dead_unit_leaves_the_other_one_torque_free_in_time(
    tied: bool, node: int, died_at: float
) -> None:
    """It hands on nothing for 0.3 s, so that the guard of the other drive acts, and obeys late what was sent then."""
    scene = "virtual_shaft" if tied else two_walls(TCP)
    plan = api.plan(scene, endless_rig(scene, DRIVES[TCP], TCP))
    lasted, error, line = behind_a_gateway(plan, node, died_at)
    stated = {each.cause: each.seconds for each in plan.deadlines}[EndCause.FEEDBACK]
    lag = max(axis.delay.torque_loop for axis in plan.axes)
    assert lasted + 4.7 * lag <= stated, "a torque loop of first order is at 1 % after 4.6 of its time constants"
    assert re.search(told_of(node), error), error
    assert all(line.unit(unit).drive.power.state.name != "OPERATION_ENABLED" for unit in (1, 2))
