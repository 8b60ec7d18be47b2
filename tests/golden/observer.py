"""Run a scene in this interpreter, and print what that took as JSON: `python -m tests.golden.observer SCENE`.

Nothing here asks the plan for modules: imported ones are those in `sys.modules`, called ones those whose functions the
interpreter's profiler sees from one input image to its output image, after force has faded in.
"""

import json
import sys
from collections.abc import Sequence
from types import FrameType

from haptic_fieldbus.api import plan
from haptic_fieldbus.cycle.cycle import Cycle, decoded_columns
from haptic_fieldbus.planning.plan import Plan

PACKAGE = "haptic_fieldbus."
FADED_IN, WATCHED = 2000, 20
"""Periods before the profiler watches, and those that it watches."""
OPERATION_ENABLED = 0x0637


def image(compiled: Plan, number: int, targets: Sequence[int]) -> bytes:
    """The input image of a period: every drive in operation enabled, its handle one count further than before.

    What was sent comes back: `targets` has the target torque of each axis.
    """
    known = {"t_ns": number * compiled.period_ns}
    for axis, target in zip(compiled.axes, targets, strict=True):
        known |= {f"{axis.name}.statusword": OPERATION_ENABLED, f"{axis.name}.position counts": number}
        if axis.profile.echo is not None:
            known[f"{axis.name}.{axis.profile.echo.value}"] = target
    return compiled.image.input.pack(*(known.get(name, 0) for name in decoded_columns(compiled)))


def calls(cycle: Cycle, period: bytes) -> list[str]:
    """Modules of this package whose functions run in one period, once for each call."""
    called: list[str] = []

    def watch(frame: FrameType, event: str, argument: object) -> None:
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith(PACKAGE):
            called.append(module.removeprefix(PACKAGE))

    sys.setprofile(watch)
    cycle(period)
    sys.setprofile(None)
    return called


def observe(scene: str) -> dict[str, object]:
    """Return the fields of `tests.golden.left_out.Observed`; RuntimeError when the cycle trips."""
    compiled = plan(scene)
    cycle, periods = Cycle(compiled), []
    targets = [0 for _ in compiled.axes]
    for number in range(FADED_IN + WATCHED):
        period = image(compiled, number, targets)
        if number < FADED_IN:
            cycle(period)
        else:
            periods.append(calls(cycle, period))
        targets = [int(cycle.row[cycle.columns.index(f"{axis.name}.target torque")]) for axis in compiled.axes]
    if cycle.trip is not None:
        raise RuntimeError(f"{scene} tripped: {cycle.trip}")
    return {
        "imported": sorted(name.removeprefix(PACKAGE) for name in sys.modules if name.startswith(PACKAGE)),
        "mapped": compiled.mapped,
        "steps": compiled.steps,
        "called": sorted({module for period in periods for module in period}),
        "most_calls": max(len(period) for period in periods),
    }


if __name__ == "__main__":
    print(json.dumps(observe(sys.argv[1])))
