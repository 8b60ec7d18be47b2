"""Stability limits of a loop in words, as lines of a key and a text."""

import math
from collections.abc import Iterator

from haptic_fieldbus.api.judging import UNCERTAIN, Judged
from haptic_fieldbus.margins import Plant, Stability, Verdict
from haptic_fieldbus.report.words import Line, count, parameter_units, quantity
from haptic_fieldbus.signals import Workspace

# A passive hand is one that gives off no more energy than it took up.
MEANING = {
    Verdict.PASSIVE: "no hand that is passive itself can make it unstable",
    Verdict.STABLE: "the handle comes to rest; some hand could make it unstable",
    Verdict.LIMIT_CYCLE: "it moves to and fro over the edge of an encoder count for ever",
    Verdict.UNSTABLE: "it grows until something saturates",
}


def limits(judged: Judged) -> list[Line]:
    """Return lines on scene, device, delay, limits with full and reduced friction, and the verdict."""
    told, unit = judged.stability, parameter_units(judged.workspace)["stiffness"]
    return [
        ("scene", f"{judged.scene.name}: {_asked(told, unit, judged.workspace)}{_axis(judged)}"),
        *_devices(judged),
        *(("limits" if number == 0 else "", text) for number, text in enumerate(_limits(judged, unit))),
        ("radius", f"{told.spectral_radius:.9g}: what a motion is multiplied by in a period"),
        ("verdict", f"{told.verdict.value}: {MEANING[told.verdict]}{_margin(told)}"),
    ]


def _devices(judged: Judged) -> Iterator[Line]:
    """Yield a line for the device of each axis judged, and one for the delays and the period."""
    spaces = {axis.name: axis.workspace for axis in judged.scene.axes}
    members, delays = judged.group.members, []
    for member in members:
        name = f"{member.name}: " if len(members) > 1 else ""
        yield "device", f"{name}{_device(member.plant, spaces[member.name])}"
        delays.append(f"{name.replace(':', '')}{1e3 * member.delay:.3g} ms")
    yield "delay", f"{', '.join(delays)} from sampling to acting, period {1e3 * judged.stability.period_s:.3g} ms"


def notes(judged: Judged) -> list[Line]:
    """Return the reasons for limits of 0, and the substitute of a nonlinear estimator; no lines when none applies."""
    plant, found = judged.stability.plant, []
    if judged.stability.stiffness_limit.quantisation == 0.0:
        step = quantity(plant.resolution, judged.workspace.length_unit)
        found.append(("note", f"quantisation 0: {_step(plant)} of {step} and no Coulomb friction to bridge it"))
    if plant.tachometer:
        found.append(("note", "passive 0: between two readings of velocity some hand can always gain energy"))
    if judged.linear_estimator is not None:
        found.append(("note", f"{judged.estimator} is not linear; judged with {judged.linear_estimator} in its place"))
    return found


def _asked(told: Stability, unit: str, workspace: Workspace) -> str:
    """Return the stiffness and damping of the scene."""
    parts = [] if told.stiffness is None else [f"stiffness {told.stiffness:g} {unit}"]
    if told.damping:
        parts.append(f"damping {told.damping:g} {parameter_units(workspace)['damping']}")
    return ", ".join(parts) or "no stiffness"


def _axis(judged: Judged) -> str:
    """Return which axes were judged; empty when the scene has only one."""
    if judged.group.couplings:
        return f" · coupling {', '.join(member.name for member in judged.group.members)}"
    return f" · axis {judged.axis} has the smallest margin" if len(judged.scene.axes) > 1 else ""


def _device(plant: Plant, workspace: Workspace) -> str:
    """Return the parameters of a device that are not 0."""
    units = parameter_units(workspace)
    parts = [
        f"mass {plant.mass:.4g} {units['mass']}",
        f"damping {plant.damping:.4g} {units['damping']}",
        f"Coulomb friction {plant.coulomb:.4g} {workspace.effort_unit}",
        f"{_step(plant).partition(' ')[2]} {plant.resolution:.4g} {workspace.length_unit}",  # without the article
        f"torque loop {1e3 * plant.torque_lag:.3g} ms",
    ]
    values = (plant.mass, plant.damping, plant.coulomb, plant.resolution, plant.torque_lag)
    return ", ".join(part for part, value in zip(parts, values, strict=True) if value)


def _step(plant: Plant) -> str:
    """Return the name of one step of the measured position."""
    return "a step by the tachometer" if plant.tachometer else "an encoder step"


def _limits(judged: Judged, unit: str) -> Iterator[str]:
    """Yield the stiffness limits, last with the share `UNCERTAIN` of the friction."""
    told = judged.stability.stiffness_limit
    if told.stable is None:
        yield "none: no element has a stiffness to vary"
        return
    yield f"stable {_up_to(told.stable, unit)}"
    yield f"passive {_up_to(told.passive, unit)}, whatever hand holds it"
    if told.quantisation is not None:
        between = "steps" if judged.stability.plant.tachometer else "counts"
        yield f"at rest between two {between} {_up_to(told.quantisation, unit)} (2·fc/D)"
    # Friction raises the limits, and is the least certain figure of a device: the line shows how much depends on it.
    less = judged.group.weakened(UNCERTAIN).told.stiffness_limit
    limits = f"stable {_up_to(less.stable, unit)}, passive {_up_to(less.passive, unit)}"
    yield f"with {UNCERTAIN:g} of the friction: {limits}"


def _up_to(value: float | None, unit: str) -> str:
    if value is None:
        return "to an unknown stiffness"
    return "with no limit" if math.isinf(value) else f"to {count(value)} {unit}"


def _margin(told: Stability) -> str:
    """Return the margin; empty when there is none to tell."""
    if told.margin is None or math.isinf(told.margin):
        return ""
    return f" · margin {told.margin:.3g}"
