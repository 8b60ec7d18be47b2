"""pytest fixtures for tests of other people's masters: simulated drives on a bus.

pytest loads this file, by its entry point, in every project where the package is installed. So it imports nothing of
the package until a test asks for a fixture. How to use it: docs/how-to/test_your_master_with_pytest.md.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from haptic_fieldbus.testing import FaultPlan, SimulatedDrive, VirtualCanBus

_MARKERS = (
    "simulated_drive(profile, node, hand, workspace, profiles): a drive on the simulated bus of this test; "
    "several of these marks are several drives",
    "virtual_can_bus(time, bitrate, seed): the simulated bus of this test; time is 'real' or 'virtual'",
    "fault_plan(faults, within, kinds): what goes wrong in this test: a file, a list of faults, 'random@SEED', "
    "or 'random' for a new seed each time",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option by which a failure of a random plan is repeated."""
    group = parser.getgroup("haptic-fieldbus", "simulated drives of haptic-fieldbus")
    group.addoption("--fault-plan-seed", type=int, metavar="SEED", help="seed of the fault plans that say 'random'")


def pytest_configure(config: pytest.Config) -> None:
    """Make the markers known."""
    for marker in _MARKERS:
        config.addinivalue_line("markers", marker)


@pytest.fixture
def fault_plan(request: pytest.FixtureRequest) -> "FaultPlan":
    """What goes wrong on the simulated bus, by `@pytest.mark.fault_plan`; nothing without it.

    `indirect` parametrisation replaces the plan of the mark; a project may override this fixture by one that returns
    anything that the mark takes.
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

    mark = request.node.get_closest_marker("virtual_can_bus")
    with _refusing():
        drives = [DriveRequest(*each.args, **each.kwargs) for each in request.node.iter_markers("simulated_drive")]
        plan = _planner(request)(fault_plan)
        bus = VirtualCanBus(drives or [DriveRequest()], plan, **(mark.kwargs if mark is not None else {}))
    # pytest shows it with the report of a test that fails.
    request.node.add_report_section("setup", "simulated bench", str(bus))
    with bus:
        yield bus


@pytest.fixture
def simulated_drive(virtual_can_bus: "VirtualCanBus") -> "SimulatedDrive":
    """The simulated drive of this test; of several, the one with the lowest node-ID."""
    return virtual_can_bus.drives[min(virtual_can_bus.drives)]


def _planner(request: pytest.FixtureRequest) -> "Callable[..., FaultPlan]":
    """Return `plan_faults` with the seed for plans that name none, and the folder where names of files begin."""
    from haptic_fieldbus.testing import plan_faults

    return partial(plan_faults, seed=request.config.getoption("--fault-plan-seed"), folder=request.path.parent)


@contextmanager
def _refusing() -> Iterator[None]:
    """End the test with the sentence of a mark that cannot be fulfilled, without a traceback through this package."""
    try:
        yield
    except (TypeError, ValueError) as error:  # a wrong keyword of a mark; the package's own errors of usage
        pytest.fail(f"the marks of this test cannot be fulfilled: {error}", pytrace=False)
