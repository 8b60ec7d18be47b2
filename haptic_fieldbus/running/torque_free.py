"""What is done on a bus before the loop runs: drives are configured, looked at without torque, and stopped again."""

from collections.abc import Iterator
from contextlib import contextmanager

from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.cycle.safety import LINK_TRIPS
from haptic_fieldbus.cycle.trips import TRIP_ERRORS
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.loop import UNCONFIRMED


@contextmanager
def started(plan: Plan, bus: Bus, ending: EndSignals) -> Iterator[None]:
    """Configure and start an inspected bus, and stop it at the end of the block, whatever happens in it.

    Raises KeyboardInterrupt after a signal, and BusError when a drive does not confirm that it is off; a note says so
    where the block raised something else.
    """
    bus.configure(plan)
    try:
        bus.start()
        yield
    except BaseException as error:
        ending.hold()
        if not bus.stop():
            error.add_note(UNCONFIRMED)
        raise
    if not bus.stop():
        raise BusError(f"{UNCONFIRMED} {' '.join(f'{warning}.' for warning in bus.warnings)}".rstrip())
    if ending.signal is not None:
        raise KeyboardInterrupt


def check_link(axis: AxisPlan, found: int, code: int, moment: str) -> None:
    """Raise the error of the first link fault among these flags; `moment` ends the sentence."""
    for flag, kind in LINK_TRIPS.items():
        if found & flag:
            raise TRIP_ERRORS[kind](f"axis {axis.name}: {axis.traffic.fault_text(flag, code, axis.bus_name)}, {moment}")
