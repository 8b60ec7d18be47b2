"""Limits of stability and passivity of a sampled loop, before anything moves.

Code for coupled axes alone is in `coupled`, which a scene without couplings does not import.
"""

from haptic_fieldbus.margins.cautious import Suggestion, suggest
from haptic_fieldbus.margins.closed_loop import alone, stiffness_limit
from haptic_fieldbus.margins.linear import EnvironmentOf
from haptic_fieldbus.margins.passivity import passive_limit, passive_limit_of
from haptic_fieldbus.margins.plant import Plant, quantisation_limit, sample, weakened
from haptic_fieldbus.margins.verdict import Stability, StiffnessLimit, Verdict, judge

__all__ = [
    "EnvironmentOf",
    "Plant",
    "Stability",
    "StiffnessLimit",
    "Suggestion",
    "Verdict",
    "alone",
    "judge",
    "passive_limit",
    "passive_limit_of",
    "quantisation_limit",
    "sample",
    "stiffness_limit",
    "suggest",
    "weakened",
]
