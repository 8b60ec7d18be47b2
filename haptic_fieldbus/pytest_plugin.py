"""pytest fixtures for tests of your own master: simulated drives on a bus.

pytest loads this file, by its entry point, in every project with this package installed. So it imports nothing of the
package until a test requests a fixture. How to use it: docs/how-to/test_your_master_with_pytest.md.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from haptic_fieldbus.testing import DriveRequest, FaultPlan, SimulatedDrive, VirtualCanBus
    from haptic_fieldbus.testing.modbus import SimulatedUnit, VirtualModbusLine

_MODBUS = "virtual_modbus_line"
"""Name of a fixture and of its mark."""
_MARKERS = (
    "simulated_drive(profile, node, hand, workspace, profiles, rig): a drive on the simulated bus of this test; "
    "several of these marks are several drives",
    "virtual_can_bus(time, bitrate, seed): the simulated bus of this test; time is 'real' or 'virtual'",
    "virtual_modbus_line(bus, seed): the simulated Modbus line of this test; bus is 'modbus-tcp:127.0.0.1:0', which is "
    "a free port, or 'modbus-rtu:pty'",
    "fault_plan(faults, within, kinds): faults of this test: a file, a list of faults, 'random@SEED', or 'random' for "
    "a new seed each time",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that repeats a failure of a random plan."""
    group = parser.getgroup("haptic-fieldbus", "simulated drives of haptic-fieldbus")
    group.addoption("--fault-plan-seed", type=int, metavar="SEED", help="seed of the fault plans that say 'random'")


def pytest_configure(config: pytest.Config) -> None:
    """Make the markers known."""
    for marker in _MARKERS:
        config.addinivalue_line("markers", marker)


@pytest.fixture
def fault_plan(request: pytest.FixtureRequest) -> "FaultPlan":
    """Fault plan of the simulated bus, from `@pytest.mark.fault_plan`; empty without it.

    `indirect` parametrisation replaces the plan of the mark; a project may override this fixture; it returns any value
    that the mark takes.
    """
    mark = request.node.get_closest_marker("fault_plan") or pytest.mark.fault_plan(()).mark
    arguments = (request.param,) if hasattr(request, "param") else mark.args
    with _refusing():
        return _planner(request)(*arguments, **mark.kwargs)


@pytest.fixture
def virtual_can_bus(request: pytest.FixtureRequest, fault_plan: Any) -> "Iterator[VirtualCanBus]":
    """The simulated CAN bus of this test with its drives, by `@pytest.mark.virtual_can_bus` and `simulated_drive`.

    Programs open it by its `options`.
    """
    from haptic_fieldbus.testing import DriveRequest, VirtualCanBus

    with _refusing():
        drives, plan = _drives(request), _planner(request)(fault_plan)
        named = _by_name(request, "virtual_can_bus", "time", "bitrate", "seed")
        bus = VirtualCanBus(drives or [DriveRequest()], plan, **named)
    # pytest shows it with the report of a test that fails.
    request.node.add_report_section("setup", "simulated bench", str(bus))
    with bus:
        yield bus


@pytest.fixture
def virtual_modbus_line(request: pytest.FixtureRequest, fault_plan: Any) -> "Iterator[VirtualModbusLine]":
    """The Modbus line of this test with its drives, by `@pytest.mark.virtual_modbus_line` and `simulated_drive`.

    Masters open it by its `address`, its `channel` or its `name`.
    """
    from haptic_fieldbus.testing.modbus import VirtualModbusLine

    with _refusing():
        named = _by_name(request, _MODBUS, "bus", "seed")
        line = VirtualModbusLine(_drives(request), _planner(request)(fault_plan), **named)
    request.node.add_report_section("setup", "simulated bench", str(line))
    with ExitStack() as stack:
        with _refusing():
            stack.enter_context(line)
        yield line


@pytest.fixture
def simulated_drive(request: pytest.FixtureRequest) -> "SimulatedDrive | SimulatedUnit":
    """The simulated drive of this test, on Modbus if it has such a line; the one with the lowest number of several."""
    drives: dict[int, SimulatedDrive | SimulatedUnit]
    drives = request.getfixturevalue(_MODBUS if _is_on_modbus(request) else "virtual_can_bus").drives
    return drives[min(drives)]


def _drives(request: pytest.FixtureRequest) -> "list[DriveRequest]":
    """Return the drives of the marks of a test; their files may stand beside it, wherever pytest was started."""
    from haptic_fieldbus.testing import DriveRequest

    marks = request.node.iter_markers("simulated_drive")
    return [DriveRequest(*each.args, **each.kwargs).beside(request.path.parent) for each in marks]


def _is_on_modbus(request: pytest.FixtureRequest) -> bool:
    """Return True when a test asks for a Modbus line, by its fixture or by its mark."""
    return _MODBUS in request.fixturenames or request.node.get_closest_marker(_MODBUS) is not None


def _by_name(request: pytest.FixtureRequest, kind: str, *names: str) -> dict[str, Any]:
    """Return the arguments of a mark by their names; raises TypeError for too many, or for one that is given twice."""
    mark = request.node.get_closest_marker(kind) or getattr(pytest.mark, kind).mark
    if len(mark.args) > len(names):
        raise TypeError(f"{mark.name} has {len(mark.args)} arguments; expected {', '.join(names)}")
    return dict(**dict(zip(names, mark.args, strict=False)), **mark.kwargs)


def _planner(request: pytest.FixtureRequest) -> "Callable[..., FaultPlan]":
    """Return `plan_faults` with the seed for plans without one, and the folder for relative file names."""
    from haptic_fieldbus.testing import plan_faults

    if _is_on_modbus(request):
        from haptic_fieldbus.sim.modbus.drives import KINDS

        plan_faults = partial(plan_faults, possible=KINDS)
    return partial(plan_faults, seed=request.config.getoption("--fault-plan-seed"), folder=request.path.parent)


@contextmanager
def _refusing() -> Iterator[None]:
    """End the test with a sentence on a mark that cannot be fulfilled, without a traceback through this package."""
    from haptic_fieldbus.errors import HapticFieldbusError

    try:
        yield
    except (TypeError, ValueError, HapticFieldbusError) as error:  # a wrong keyword of a mark; errors of the package
        pytest.fail(f"invalid marks of this test: {error}", pytrace=False)
