"""What elements with virtual states would have done: imported only for scenes that have one."""

from collections.abc import Mapping

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.response import ExactResponse, sequence_response
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.signals import Signal


def exact_response(element: DynamicElement, times_ns: Times, motion: Mapping[Signal, Array]) -> ExactResponse:
    """The continuous solution on a trajectory that is known at these times."""
    return ExactResponse(element.dynamics, times_ns, motion[Signal.POSITION], motion[Signal.VELOCITY])


def response_to_error(
    element: DynamicElement, real: Mapping[Signal, Array], true: Mapping[Signal, Array], period: float
) -> Array:
    """What an element adds, being linear, for the difference of its inputs from the truth: straight between samples."""
    error = np.stack([real[signal] - true[signal] for signal in (Signal.POSITION, Signal.VELOCITY)], axis=-1)
    space = element.dynamics
    return sequence_response(integrators.discrete(space, period, "exact-foh"), integrators.rest(space)[1], error)
