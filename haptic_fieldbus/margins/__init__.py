"""Limits of a sampled haptic loop before anything moves: numbers in, limits and a verdict out.

Coupled axes have a module of their own (`coupled`, `coupled_contact`), which a scene without any does not import.
"""

from haptic_fieldbus.margins.contact import judge_contact
from haptic_fieldbus.margins.linear import EnvironmentOf, stiffness_limit
from haptic_fieldbus.margins.passivity import passive_limit, passive_limit_of
from haptic_fieldbus.margins.plant import Plant, loop_matrix, sample, weakened
from haptic_fieldbus.margins.quantisation import quantisation_limit
from haptic_fieldbus.margins.suggestion import Suggestion, suggest
from haptic_fieldbus.margins.verdict import Stability, StiffnessLimit, Verdict, judge

__all__ = [
    "EnvironmentOf",
    "Plant",
    "Stability",
    "StiffnessLimit",
    "Suggestion",
    "Verdict",
    "judge",
    "judge_contact",
    "loop_matrix",
    "passive_limit",
    "passive_limit_of",
    "quantisation_limit",
    "sample",
    "stiffness_limit",
    "suggest",
    "weakened",
]
