"""Limits of stability and passivity of a sampled loop, before anything moves.

Code for coupled axes alone is in `coupled`, which a scene without couplings does not import. `bodies` (loads behind a
compliant transmission, hands) is imported when one of its names is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from haptic_fieldbus.margins.closed_loop import alone, stiffness_limit
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.limit import Limit, Suggestion, suggest
from haptic_fieldbus.margins.linear import (
    ROUNDING,
    EnvironmentOf,
    gaps,
    limit_of,
    pattern_bound,
    pattern_growth,
    pattern_limit,
)
from haptic_fieldbus.margins.passivity import Increments, passive_limit, passive_limit_of
from haptic_fieldbus.margins.plant import (
    Basis,
    Plant,
    Ranges,
    check_times,
    dynamics,
    quantisation_limit,
    sample,
    through_torque_loop,
    weakened,
)
from haptic_fieldbus.margins.stiffness_map import EVERYWHERE, Places
from haptic_fieldbus.margins.verdict import Stability, StiffnessLimit, Verdict, judge, verdict_at_places
from haptic_fieldbus.numerics.passivity import damping_needed, frequency_response

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HAND, HungBody, limit_with, sample_with
    from haptic_fieldbus.margins.bodies import dynamics as dynamics_with

_OF_BODIES = {"dynamics_with": "dynamics", **{name: name for name in ("HAND", "HungBody", "limit_with", "sample_with")}}

__all__ = [
    "EVERYWHERE", "HAND", "ROUNDING", "Basis", "EnvironmentOf", "Group", "HungBody", "Increments", "Limit",
    "Member", "Places", "Plant", "Ranges", "Stability", "StiffnessLimit", "Suggestion", "Verdict", "alone",
    "check_times", "damping_needed", "dynamics", "dynamics_with", "frequency_response", "gaps", "judge", "limit_of",
    "limit_with", "passive_limit", "passive_limit_of", "pattern_bound", "pattern_growth", "pattern_limit",
    "quantisation_limit", "sample", "sample_with", "stiffness_limit", "suggest", "through_torque_loop",
    "verdict_at_places", "weakened",
]  # fmt: skip


def __getattr__(name: str) -> object:
    """Import a name of `bodies` when it is first used (PEP 562)."""
    if name not in _OF_BODIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.bodies"), _OF_BODIES[name])
