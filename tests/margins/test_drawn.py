"""The drawn elements and the simulation's own formulas are the same laws."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.signals import Signal
from tests.cases import every
from tests.margins.drawn import NAMES, PERIOD, Drawn, element, law_of


def felt(each: Any) -> Callable[[float, float], float]:
    """Return the element's own law of position and velocity."""
    law = each.begin(PERIOD) if hasattr(each, "begin") else each.force
    if Signal.VELOCITY in each.needs:
        return lambda x, v: float(law(x, v))
    return lambda x, v: float(law(x))


@every("name", NAMES)
@every("seed", range(3))
def test_a_path_in_and_out_feels_the_same(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    each = element(name, 400.0, 10.0, random)
    law, own = law_of([Drawn(Plant(1.0, 1.0), 0.0, 10.0, (each,))]), felt(each)
    turns = np.linspace(0.0, 14.0, 400)
    path = getattr(each, "position", 0.0) - 0.04 * np.cos(turns) * (0.3 + random.random())
    path += np.cumsum(random.normal(0.0, 1e-4, len(path)))
    speed = np.diff(path, prepend=path[0]) / PERIOD
    law.relax(path[:1])
    forces = [(law.force(np.array([x]), np.array([v]))[0], own(x, v)) for x, v in zip(path, speed, strict=True)]
    mine, theirs = np.array(forces).T
    assert np.ptp(theirs) > 0.0
    assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9)
