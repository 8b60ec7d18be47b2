"""A failing run with the fewest and plainest faults that still fails in the same way."""

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

from haptic_fieldbus.sim.faults import Fault

Faults = tuple[Fault, ...]


def shrunk(faults: Faults, fails: Callable[[Faults], bool]) -> Faults:
    """Remove faults one by one while `fails` holds, then take plainer values for those that are left.

    Raises ValueError when the faults do not fail to begin with.
    """
    if not fails(faults):
        raise ValueError("these faults do not fail")
    again = True
    while again:
        again = False
        for smaller in (*_fewer(faults), *_plainer(faults)):
            if fails(smaller):
                faults, again = smaller, True
                break
    return faults


def _fewer(faults: Faults) -> Iterator[Faults]:
    """All faults but one; first halves, so that many are gone soon."""
    half = len(faults) // 2
    if half > 1:
        yield from (faults[:half], faults[half:])
    for place in range(len(faults)):
        yield faults[:place] + faults[place + 1 :]


def _plainer(faults: Faults) -> Iterator[Faults]:
    """One fault with one value that is plainer than its own: its default, one instead of many, a rounded time."""
    for place, fault in enumerate(faults):
        for plainer in _plainer_one(fault):
            if plainer != fault:
                yield (*faults[:place], plainer, *faults[place + 1 :])


def _plainer_one(fault: Fault) -> Iterator[Fault]:
    given = {each.name: getattr(fault, each.name) for each in fields(fault)}
    changes: list[dict[str, Any]] = [{"at": round(given["at"], digits)} for digits in (1, 2) if "at" in given]
    if isinstance(given.get("count"), int) and given["count"] > 1:
        changes = [{"count": 1}, {"count": given["count"] // 2}, *changes]
    if "interval" in given:
        changes.append({"interval": 0.001})
    for change in changes:
        yield replace(fault, **change)
