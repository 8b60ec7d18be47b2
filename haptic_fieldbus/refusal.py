"""No: a loop that would be unstable is refused before anything moves, with its limit and what would be stable."""

from haptic_fieldbus.axis_plan import AxisPlan, environment_of, stability_alone, stiffest_of
from haptic_fieldbus.errors import UnstableSceneError
from haptic_fieldbus.margins import Stability, Suggestion, Verdict, suggest
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.scenes.element import AnyElement, Graded
from haptic_fieldbus.scenes.files import parameters
from haptic_fieldbus.signals import Signal


def check_stable(plan: Plan, *, running: bool = False) -> None:
    """Raises UnstableSceneError for the first axis that is; one whose bench is unknown has no verdict.

    To a loop that is `running` no damping is proposed where it estimates no velocity.
    """
    for axis in plan.axes:
        if axis.stability is not None and axis.stability.verdict is Verdict.UNSTABLE:
            limit = axis.stability.stiffness_limit.stable
            raise UnstableSceneError(_refusal(plan, plan.told_by(axis), axis.stability, running), limit=limit)


def _refusal(compiled: Plan, axis: AxisPlan, stability: Stability, running: bool) -> str:
    """What is unstable, where the limit lies, and what would be stable."""
    per = f"{axis.workspace.effort_unit}/{axis.workspace.length_unit}"
    asked = "this scene" if stability.stiffness is None else f"{stability.stiffness:g} {per}"
    element = stiffest_of(axis) if axis.judged_with is None and len(axis.elements) > 1 else None
    asked += f" of {element.name}" if element is not None and stability.stiffness is not None else ""
    limit = stability.stiffness_limit.stable
    at = f"at {compiled.rate:g} Hz with {1e3 * axis.delay.total:.2f} ms of delay"
    limited = f"limit {limit:.4g} {per} {at}" if limit else f"no stiffness is stable {at}{_alone(compiled, axis)}"
    hints = _hints(axis, compiled.period, stability) if axis.judged_with is None else _coupled_hints(compiled, axis)
    if running and Signal.VELOCITY not in axis.needs:
        hints = [hint for hint in hints if ".damping=" not in hint]
    would = f"\nWould be stable: {' · or '.join(hints)}." if hints else ""
    return f"{asked} is unstable on this bench: {limited}.{would}"


def _alone(plan: Plan, axis: AxisPlan) -> str:
    """Which of the coupled axes are unstable by themselves, so that no coupling of theirs is stable."""
    parts = []
    for each in plan.axes if axis.judged_with is not None else ():
        found, element = stability_alone(each, plan.period), stiffest_of(each)
        if each.couplings and found is not None and element is not None and found.verdict is Verdict.UNSTABLE:
            per, limit = f"{each.workspace.effort_unit}/{each.workspace.length_unit}", found.stiffness_limit.stable
            parts.append(f"; {element.name} on {each.name} is unstable without a coupling too, limit {limit:.4g} {per}")
    return "".join(parts)


def _softer(element: AnyElement, stiffness: float) -> str:
    """The settings that give an element this stiffness; where it follows from other parameters, those."""
    if not isinstance(element, Graded):
        return f"--set {element.name}.stiffness={stiffness:g}"
    softer = element.with_stiffness(stiffness)
    changed = {name: getattr(softer, name) for name in parameters(type(element)) if name != "stiffness"}
    changed = {name: value for name, value in changed.items() if value != getattr(element, name)}
    if not all(isinstance(value, float) for value in changed.values()):
        return f"{element.name} with {stiffness / element.stiffness:.2g} times its stiffnesses"
    settings = [f"{name}={value:g}" for name, value in changed.items()]
    return " ".join(f"--set {element.name}.{setting}" for setting in settings)


def _hints(axis: AxisPlan, period: float, stability: Stability) -> list[str]:
    element = stiffest_of(axis)
    if element is None or stability.stiffness is None:
        return []
    has_damping = hasattr(element, "damping")

    def varied(stiffness: float, damping: float) -> StateSpace:
        changes = {"damping": damping} if has_damping else {}
        return environment_of(axis, period, stiffness=stiffness, **changes)

    damping = getattr(element, "damping", None)
    found = suggest(
        stability.plant, period, axis.delay.transport, varied, stiffness=stability.stiffness, damping=damping
    )
    return _told(element, found)


def _coupled_hints(plan: Plan, axis: AxisPlan) -> list[str]:
    """What would make the coupling stable, all axes that hang together as they are."""
    from haptic_fieldbus.coupled_plan import tied_with

    tied = tied_with(plan.axes, axis, plan.period)
    return [] if tied is None or tied.stiffest is None else _told(tied.stiffest, tied.suggested())


def _told(element: AnyElement, found: Suggestion) -> list[str]:
    hints = [] if found.stiffness is None else [_softer(element, found.stiffness)]
    if found.damping is not None and found.damping_limit is not None:
        hints.append(f"--set {element.name}.damping={found.damping:g} (limit {found.damping_limit:.4g})")
    return hints
