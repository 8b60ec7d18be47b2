"""Ideal response of elements with virtual states; imported only for scenes that contain such an element."""

from collections.abc import Mapping

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.response import ExactResponse, sequence_response
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.signals import Signal


def exact_response(element: DynamicElement, times_ns: Times, motion: Mapping[Signal, Array]) -> ExactResponse:
    """Return the solution in continuous time on a motion known at `times_ns`, `(n_times,)`."""
    return ExactResponse(element.dynamics, times_ns, motion[Signal.POSITION], motion[Signal.VELOCITY])


def response_to_error(
    element: DynamicElement, real: Mapping[Signal, Array], true: Mapping[Signal, Array], period: float
) -> Array:
    """Return the force that a linear element adds for the difference of its inputs from the true ones, `(n_periods,)`.

    The difference is taken as straight lines between samples (first-order hold) and begins at rest; `period` in s.
    """
    error = np.stack([real[signal] - true[signal] for signal in (Signal.POSITION, Signal.VELOCITY)], axis=-1)
    space = element.dynamics
    return sequence_response(integrators.discrete(space, period, "exact-foh"), integrators.rest(space)[1], error)
