"""Ideal response of elements with virtual states; imported only for scenes that contain such an element."""

from collections.abc import Mapping

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.response import ExactResponse, SequenceResponse
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.signals import Signal


def exact_response(
    element: DynamicElement, times_ns: Times, motion: Mapping[Signal, Array], start: Array | None
) -> ExactResponse:
    """Return the solution in continuous time on a motion known at `times_ns`, `(n_times,)`, from rest or from `start`.

    `start` are the states at the first time, `(order,)`.
    """
    return ExactResponse(element.dynamics, times_ns, motion[Signal.POSITION], motion[Signal.VELOCITY], start)


class ResponseToError:
    """Force that a linear element adds for the error of its inputs, part by part.

    The error is a straight line between samples (first-order hold) and begins at rest; `period` in s.
    """

    def __init__(self, element: DynamicElement, period: float) -> None:
        space = element.dynamics
        discrete = integrators.discrete(space, period, "exact-foh")
        self._response = SequenceResponse(discrete, integrators.rest(space)[1])

    def __call__(self, real: Mapping[Signal, Array], true: Mapping[Signal, Array]) -> Array:
        """Return the forces in the next periods, `(n_periods,)`, from their real and true inputs."""
        error = np.stack([real[signal] - true[signal] for signal in (Signal.POSITION, Signal.VELOCITY)], axis=-1)
        return self._response(error)
