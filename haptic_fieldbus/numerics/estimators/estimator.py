"""What a velocity estimator is: its parameters, its step, and the linear system that stability is judged by."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace

ParameterValue = float | str

Estimate = Callable[..., float]
"""Position of this period [m or rad] (and its time [ns], where `timed`) → velocity [m/s or rad/s]."""


@dataclass(frozen=True)
class Parameter:
    """A number or a word that is given as NAME:key=value; `default` None: one encoder count of the axis."""

    key: str
    default: ParameterValue | None
    meaning: str
    unit: str = ""
    lowest: float = 0.0
    highest: float = math.inf
    is_whole: bool = False
    choices: tuple[str, ...] = ()

    def parsed(self, text: str) -> ParameterValue:
        """The value written so; raises UsageError that says what is expected."""
        if self.choices:
            if text not in self.choices:
                raise UsageError(f"{self.key}={text}: expected {self.expected}")
            return text
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not self.lowest <= value <= self.highest or math.isinf(value) or (self.is_whole and value % 1.0):
            raise UsageError(f"{self.key}={text}: expected {self.expected}")
        return value

    @property
    def expected(self) -> str:
        """Kind and limits, for people."""
        unit = f" {self.unit}" if self.unit else ""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        kind = "a whole number" if self.is_whole else "a number"
        if math.isinf(self.highest):
            return f"{kind} from {exactly(self.lowest)}{unit} up"
        return f"{kind} from {exactly(self.lowest)} to {exactly(self.highest)}{unit}"


@dataclass(frozen=True)
class EstimatorSetup:
    """Where an estimator works: period [s], one encoder count [m or rad] (0: not known), and its parameters."""

    period: float
    resolution: float
    values: Mapping[str, ParameterValue]

    def number(self, key: str) -> float:
        return float(self.values[key])

    def whole(self, key: str) -> int:
        return round(self.number(key))

    def word(self, key: str) -> str:
        return str(self.values[key])


def _nothing(setup: EstimatorSetup) -> None:
    """Any values within their limits go together."""


def _backward_difference(setup: EstimatorSetup) -> str:
    """The least delay that there is."""
    return "backward-difference"


@dataclass(frozen=True)
class Estimator:
    """An estimator several times: as the step that the loop runs, as a linear system, and as closed-form figures."""

    name: str
    summary: str
    start: Callable[[EstimatorSetup], Estimate]
    """A fresh step; its first call returns 0, as if the handle had stood there for ever."""
    system: Callable[[EstimatorSetup], StateSpace] | None = None
    """s⁺ = A s + B x, v = C s + D x; None where no linear system is the estimator."""
    noise_gain: Callable[[EstimatorSetup], float] | None = None
    """Closed form of rms velocity over rms white position noise [1/s]; None where there is none."""
    delay: Callable[[EstimatorSetup], float] | None = None
    """Closed form of the delay of slow motions [s]."""
    parameters: tuple[Parameter, ...] = ()
    check: Callable[[EstimatorSetup], None] = _nothing
    """Raises UsageError for parameters that do not go together, or not with the period."""
    stand_in: Callable[[EstimatorSetup], str] = _backward_difference
    """Where there is no system: the linear estimator, as it is written, whose stability is judged instead."""
    timed: bool = False
    """Whether the step takes the time of the sample [ns] beside the position."""
