"""Elements of somebody else's package: a shaft between two axes and a mass on a spring, each as simple as it can be."""

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Mass, PairLaw, Stiffness, TwoAxes
from haptic_fieldbus.signals import Signal


class Workspace(Enum):
    """Where it is meant for; a definition of scene files has the same name."""

    SOFT = "soft"


@dataclass(frozen=True)
class SoftShaft:
    """A spring of `stiffness` [N/m] between two axes."""

    axes: TwoAxes
    stiffness: Stiffness
    feel: Workspace = Workspace.SOFT
    name: str = "soft_shaft"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> PairLaw:
        def law(first: float, second: float) -> tuple[float, float]:
            force = -self.stiffness * (first - second)
            return force, -force

        return law

    def linearised(self) -> StateSpace:
        k = self.stiffness
        return gain([[-k, 0.0, k, 0.0], [k, 0.0, -k, 0.0]])


@dataclass(frozen=True)
class HeavyPuck:
    """A `mass` [kg] on a spring of `stiffness` [N/m]."""

    axis: str
    stiffness: Stiffness
    mass: Mass
    name: str = "heavy_puck"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    @property
    def dynamics(self) -> StateSpace:
        square = self.stiffness / self.mass
        return StateSpace(
            a=np.array([[0.0, 1.0], [-square, 0.0]]),
            b=np.array([[0.0, 0.0], [square, 0.0]]),
            c=np.array([[self.stiffness, 0.0]]),
            d=np.array([[-self.stiffness, 0.0]]),
        )

    def linearised(self) -> StateSpace:
        return self.dynamics
