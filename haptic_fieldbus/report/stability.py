"""Stability limits of a loop in words, as lines of a key and a text."""

import math
from collections.abc import Iterator

from haptic_fieldbus.api.judging import UNCERTAIN, Judgement
from haptic_fieldbus.margins import Plant, Stability, Verdict
from haptic_fieldbus.margins.bodies import HungBody
from haptic_fieldbus.numerals import exactly, in_unit, rounded, rounded_limit
from haptic_fieldbus.planning.explain import cautious_text, obstacle_text, place_texts
from haptic_fieldbus.report.words import Line, parameter_units
from haptic_fieldbus.signals import Workspace

# A passive hand is one that gives off no more energy than it took up.
MEANING = {
    Verdict.PASSIVE: "no hand that is passive itself can make it unstable",
    Verdict.STABLE: "a small motion dies wherever {held} can hold the handle; some hand could make it grow",
    Verdict.LIMIT_CYCLE: "it moves to and fro over the edge of an encoder count for ever",
    Verdict.UNSTABLE: "it grows until something saturates",
}


def stability_lines(judgement: Judgement) -> list[Line]:
    """Return lines on scene, device, delay, limits with full and reduced friction, and the verdict."""
    stability, unit = judgement.stability, parameter_units(judgement.workspace)["stiffness"]
    return [
        ("scene", f"{judgement.scene.name}: {_asked(stability, unit, judgement.workspace)}{_axis(judgement)}"),
        *_devices(judgement),
        *(("" if number else "ways", way.text()) for number, way in enumerate(judgement.ways)),
        *(("assumed", text) for text in judgement.assumed),
        *_keyed("limits", _limits(judgement, unit)),
        ("radius", f"{rounded(stability.spectral_radius, 9)}: what a motion is multiplied by in a period"),
        *_keyed("place", place_texts(stability, judgement.workspace)),
        ("verdict", f"{stability.verdict.value}: {_meaning(stability, judgement.workspace)}{_margin(stability)}"),
    ]


def _keyed(key: str, texts: Iterator[str]) -> Iterator[Line]:
    """Yield a line for each text, with the key on the first one only."""
    return ((key if number == 0 else "", text) for number, text in enumerate(texts))


def _devices(judgement: Judgement) -> Iterator[Line]:
    """Yield a line for the device of each axis judged, and one for the delays and the period."""
    spaces = {axis.name: axis.workspace for axis in judgement.scene.axes}
    members, delays = judgement.group.members, []
    for member in members:
        name = f"{member.name}: " if len(members) > 1 else ""
        yield "device", f"{name}{_device(member.plant, spaces[member.name])}"
        for body in member.bodies:
            yield "", f"{name}{_load(body, spaces[member.name])}"
        delays.append(f"{name.replace(':', '')}{rounded(1e3 * member.delay)} ms")
    period = rounded(1e3 * judgement.stability.period_s)
    yield "delay", f"{', '.join(delays)} from sampling to acting, period {period} ms"


def notes(judgement: Judgement) -> list[Line]:
    """Return the reasons for limits of 0, and the substitute of a nonlinear estimator; no lines when none applies."""
    plant, found = judgement.stability.plant, []
    if judgement.stability.stiffness_limit.quantisation == 0.0:
        step = in_unit(plant.resolution, judgement.workspace.length_unit)
        found.append(("note", f"quantisation 0: {_step(plant)} of {step} and no Coulomb friction to bridge it"))
    if plant.tachometer:
        found.append(("note", "passive 0: between two readings of velocity some hand can always gain energy"))
    if judgement.linear_estimator is not None:
        found.append(
            ("note", f"{judgement.estimator} is not linear; judged with {judgement.linear_estimator} in its place")
        )
    return found


def _asked(stability: Stability, unit: str, workspace: Workspace) -> str:
    """Return the stiffness and damping of the scene."""
    parts = [] if stability.stiffness is None else [f"stiffness {rounded_limit(stability.stiffness)} {unit}"]
    if stability.damping:
        parts.append(f"damping {exactly(stability.damping)} {parameter_units(workspace)['damping']}")
    return ", ".join(parts) or "no stiffness"


def _axis(judgement: Judgement) -> str:
    """Return which axes were judged; empty when the scene has only one."""
    if judgement.group.couplings:
        return f" · coupling {', '.join(member.name for member in judgement.group.members)}"
    return f" · axis {judgement.axis} has the smallest margin" if len(judgement.scene.axes) > 1 else ""


def _device(plant: Plant, workspace: Workspace) -> str:
    """Return the parameters of a device that are not 0."""
    units = parameter_units(workspace)
    parts = [
        f"mass {rounded(plant.mass)} {units['mass']}",
        f"damping {rounded(plant.damping)} {units['damping']}",
        f"Coulomb friction {in_unit(plant.coulomb, workspace.effort_unit)}",
        f"{_step(plant).partition(' ')[2]} {in_unit(plant.resolution, workspace.length_unit)}",  # without the article
        f"torque loop {rounded(1e3 * plant.torque_lag)} ms",
    ]
    values = (plant.mass, plant.damping, plant.coulomb, plant.resolution, plant.torque_lag)
    return ", ".join(part for part, value in zip(parts, values, strict=True) if value)


def _load(body: HungBody, workspace: Workspace) -> str:
    """Return a load behind a compliant transmission."""
    units = parameter_units(workspace)
    link = f"{rounded(body.stiffness)} {units['stiffness']} and {rounded(body.damping)} {units['damping']}"
    return f"behind it, by {link}: mass {rounded(body.mass)} {units['mass']}"


def _step(plant: Plant) -> str:
    """Return the name of one step of the measured position."""
    return "a step by the tachometer" if plant.tachometer else "an encoder step"


def _limits(judgement: Judgement, unit: str) -> Iterator[str]:
    """Yield the stiffness limits, last with the share `UNCERTAIN` of the friction."""
    limit = judgement.stability.stiffness_limit
    if limit.stable is None:
        yield "none: no element has a stiffness to vary"
        return
    yield f"stable {_up_to(limit.stable, unit)}"
    hand = "whatever hand holds it" if limit.passive else "as nothing proves it for every hand"
    yield f"passive {_up_to(limit.passive, unit)}, {hand}"
    if limit.quantisation is not None:
        between = "steps" if judgement.stability.plant.tachometer else "counts"
        yield f"at rest between two {between} {_up_to(limit.quantisation, unit)} (2·fc/D)"
    least = judgement.stability.cautious
    if least is not None:
        yield f"cautious {_up_to(least.stable, unit)}: {cautious_text(least, judgement.workspace)}"
        if least.obstacle is not None:
            yield obstacle_text(least.obstacle, judgement.workspace)
    # Friction raises the limits, and is the least certain figure of a device: the line shows how much depends on it.
    less = judgement.group.weakened(UNCERTAIN).stability.stiffness_limit
    limits = f"stable {_up_to(less.stable, unit)}, passive {_up_to(less.passive, unit)}"
    yield f"with {exactly(UNCERTAIN)} of the friction: {limits}"


def _meaning(stability: Stability, workspace: Workspace) -> str:
    """Return what the verdict says, with the force up to which places were judged."""
    is_limited = math.isfinite(stability.effort)
    held = f"up to {in_unit(stability.effort, workspace.effort_unit)}" if is_limited else "a hand"
    return MEANING[stability.verdict].format(held=held)


def _up_to(value: float | None, unit: str) -> str:
    if value is None:
        return "to an unknown stiffness"
    if value <= 0.0:
        return "at no stiffness"
    return "with no limit" if math.isinf(value) else f"to {rounded_limit(value)} {unit}"


def _margin(stability: Stability) -> str:
    """Return the margin; empty when there is none to tell."""
    if stability.margin is None or math.isinf(stability.margin):
        return ""
    return f" · margin {rounded(stability.margin)}"
