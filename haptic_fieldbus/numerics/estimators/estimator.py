"""Definition of a velocity estimator: its parameters, its step, and the linear system for stability."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace

ParameterValue = float | str

Estimate = Callable[..., float]
"""Step from the position of a period [m or rad] (and its time [ns], if `timed`) to the velocity [m/s or rad/s]."""


@dataclass(frozen=True)
class Parameter:
    """A number or word that is written NAME:key=value; `default` None means one encoder count of the axis."""

    key: str
    default: ParameterValue | None
    meaning: str
    unit: str = ""
    lowest: float = 0.0
    highest: float = math.inf
    is_whole: bool = False
    choices: tuple[str, ...] = ()

    def parsed(self, text: str) -> ParameterValue:
        """Return the value of a text; raises UsageError, with the expected values, for any other text."""
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
        """Kind and limits of the value, for people."""
        unit = f" {self.unit}" if self.unit else ""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        kind = "a whole number" if self.is_whole else "a number"
        if math.isinf(self.highest):
            return f"{kind} from {exactly(self.lowest)}{unit} up"
        return f"{kind} from {exactly(self.lowest)} to {exactly(self.highest)}{unit}"


@dataclass(frozen=True)
class EstimatorSetup:
    """Values for an estimator: period [s], one encoder count [m or rad] (0 when not known), and all parameters."""

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
    """Accept any values: they need no check beyond their own limits."""


@dataclass(frozen=True)
class Estimator:
    """An estimator in several forms: the step that the loop runs, the linear system, and closed-form figures."""

    name: str
    summary: str
    start: Callable[[EstimatorSetup], Estimate]
    """Function that returns a fresh step, whose first call returns 0, as if the handle had always stood there."""
    system: Callable[[EstimatorSetup], StateSpace] | None = None
    """Function that returns the system s⁺ = A s + B x, v = C s + D x; None when the estimator is not linear."""
    noise_gain: Callable[[EstimatorSetup], float] | None = None
    """Closed form of rms velocity over rms white position noise [1/s]; None when there is no closed form."""
    delay: Callable[[EstimatorSetup], float] | None = None
    """Closed form of the delay of slow motions [s]; None when there is no closed form."""
    parameters: tuple[Parameter, ...] = ()
    check: Callable[[EstimatorSetup], None] = _nothing
    """Function that raises UsageError for parameters that do not fit each other or the period."""
    stand_in: Callable[[EstimatorSetup], str] = lambda setup: "backward-difference"
    """Function that returns the text of the linear estimator with which stability is judged if `system` is None."""
    follows: Callable[[EstimatorSetup], float] = lambda setup: math.inf
    """Function that returns the largest acceleration that the velocity follows [m/s² or rad/s²]."""
    timed: bool = False
    """True when the step takes the time of the sample [ns] beside the position."""
