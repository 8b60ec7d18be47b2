"""What the report takes for granted: the bench, what its drive's data leave open, the hand, and the machine."""

from collections.abc import Mapping
from html import escape

from haptic_fieldbus.margins.bodies import HAND
from haptic_fieldbus.numerals import exactly, in_unit, percent, rounded
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.report.drawing import FELT
from haptic_fieldbus.study.measure.bench import Bench


def assumed(plan: Plan, bench: Bench, machine: Mapping[str, str]) -> str:
    """Return the assumptions as a sentence each, as HTML."""
    plant = bench.plant
    known = (
        f"{rounded(plant.mass)} kg, {rounded(plant.damping)} N·s/m, {rounded(plant.coulomb)} N of dry friction, counts "
        f"of {in_unit(plant.resolution, 'm')}"
    )
    open_ = "; ".join(plan.assumed) or "nothing"
    drive = escape(plan.axes[0].profile.title)
    return (
        f"<strong>Assumed.</strong> No hardware: {drive}, simulated at {exactly(plan.rate)} Hz in virtual time; its "
        f"handle has {known}; torque acts {rounded(1e3 * bench.delay)} ms after its sample, and "
        f"lags by {rounded(1e3 * plant.torque_lag)} ms. Without a source in the drive's data: {escape(open_)}. The "
        f"hand is {exactly(HAND.mass)} kg on {exactly(HAND.damping)} N·s/m and {exactly(HAND.stiffness)} N/m, and "
        f"feels a change of force from {percent(FELT)} on (Pang, Tan and Durlach 1991). Costs are those of "
        f"{escape(machine['python'])} on this machine ({escape(machine['processor'])}); errors and stability are the "
        "same on any."
    )
