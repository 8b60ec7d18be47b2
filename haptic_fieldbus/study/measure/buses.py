"""Felt error of one scene on buses of both protocols: bus × velocity estimator × rate.

The scene is a wall that damps, tapped by a hand, so that all contact moves. A point is one run in virtual time. Its
error is what the hand feels of it; its cost is the time that a period takes on the bus and in this computer.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.study.measure.bench import Tools
from haptic_fieldbus.study.measure.optional_parts import Playback
from haptic_fieldbus.study.measure.timing import Timed, in_turn

BUSES = {
    "CANopen, 1 Mbit/s": ("sim", "generic_cia402"),
    "Modbus TCP": ("sim-modbus-tcp", "generic_cia402_modbus"),
    "Modbus RTU, 1 Mbit/s": ("sim-modbus-rtu@1000000", "generic_cia402_modbus"),
    "Modbus RTU, 115200 bit/s": ("sim-modbus-rtu@115200", "generic_cia402_modbus"),
}
"""Name → bus and profile; both profiles are of the same drive."""
SCENE, HAND, DURATION, FADE_IN = "damped_wall", "tap", 0.9, 0.1
"""Scene, hand, and times of a run [s]; the first tap is over the wall's surface soon after the fade-in."""
SETTINGS = {"wall.stiffness": 60.0, "wall.damping": 1.0, "wall.position": 0.005}
"""A wall that is soft enough for all of the buses [N/m], [N·s/m], [m]."""
FEW_ESTIMATORS = (DEFAULT_ESTIMATOR,)
ESTIMATORS = tuple(
    dict.fromkeys((DEFAULT_ESTIMATOR, "backward-difference", "least-squares", "kalman-velocity", "foaw-best-fit"))
)
"""One of each family, and the default."""
FEW_RATES, RATES = (1, 4), (1, 2, 4)
"""Divisors of the rate that a bus has by itself."""
REPEATS = 10
"""Timed repeats; each is a swing of the handle."""


@dataclass(frozen=True)
class BusPoint:
    """One run of the scene; errors are shares of the force, None when the run was refused or had no contact."""

    bus: str
    estimator: str
    exchange: str
    """Messages of a period in words."""
    rate_hz: float
    bus_s: float
    """Time on the bus in a period [s]."""
    computing_s: float
    """Time in this computer in a period [s]."""
    felt_error: float | None
    reason: str = ""
    """Why there is no error; empty when there is one."""

    @property
    def period_cost(self) -> float:
        """Time of a period on the bus and in this computer [s]."""
        return self.bus_s + self.computing_s

    @property
    def computing_share(self) -> float:
        """Time in this computer for a second of contact [s]."""
        return self.computing_s * self.rate_hz


def bus_points(tools: Tools, name: str, *, quick: bool) -> Iterator[BusPoint]:
    """Yield the points of one bus of `BUSES`: each estimator, the highest rate first."""
    bus, drive = BUSES[name]
    for estimator in FEW_ESTIMATORS if quick else ESTIMATORS:
        chosen: dict[str, object] = {"bus": bus, "drive": drive, "estimator": estimator, "settings": SETTINGS}
        fastest = tools.plan(SCENE, **chosen)
        computing = computing_time(fastest)
        for divisor in FEW_RATES if quick else RATES:
            rate = fastest.rate / divisor
            traffic = tools.plan(SCENE, rate=rate, **chosen).buses[0].traffic
            way, on_bus = traffic.exchange or "SYNC, TPDO, RPDO", traffic.load / rate
            yield BusPoint(name, estimator, way, rate, on_bus, computing, *_felt(tools, rate=rate, **chosen))


def computing_time(plan: Plan) -> float:
    """Return the median time of a period's computing on this machine [s]."""
    playback = Playback(plan)
    return 1e-9 * in_turn({SCENE: Timed(playback.running_cycle(), playback.swing)}, REPEATS)[SCENE].ns


def _felt(tools: Tools, **chosen: object) -> tuple[float | None, str]:
    """Return the error in moving contact as a share of the force, or None and the reason."""
    try:
        result = tools.run(SCENE, hand=HAND, duration=DURATION, fade_in=FADE_IN, **chosen)
    except HapticFieldbusError as error:
        return None, str(error).splitlines()[0]
    found = None if result.torque_error is None else result.torque_error.contact
    return found, "" if found is not None else "the hand did not reach the wall"
