"""A force that is late is told apart from one of another shape, on pulses in closed form."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus import run
from haptic_fieldbus.assessing.torque_error import ErrorFigures, ErrorSums, Lateness
from haptic_fieldbus.scenes.braking_pulse import BrakingPulse
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.scenes.wall import Wall

Array = NDArray[np.float64]
PERIOD, TRANSPORT, LAG = 1e-3, 4e-4, 1.6e-4
BEGIN, WIDTH, HEIGHT = 0.0305, 0.003, 4.0
NODES_NS = np.arange(62_500, 100_000_000, 62_500, dtype=np.int64)
TIMES = NODES_NS * 1e-9


def pulse(delay: float, lag: float) -> Array:
    """A pulse after a delay and a first-order lag: (1 − e^(−t/τ)) on, and the same off again."""

    def edge(begin: float) -> Array:
        since = np.maximum(TIMES - begin - delay, 0.0)
        return 1.0 - np.exp(-since / lag) if lag else (begin + delay <= TIMES).astype(float)

    return HEIGHT * (edge(BEGIN) - edge(BEGIN + WIDTH))


def figures(force: Array) -> ErrorFigures:
    ideal, lateness, sums = pulse(0.0, 0.0), Lateness(PERIOD, TRANSPORT, LAG), ErrorSums()
    shapes = [force - each for each in lateness.ideals(NODES_NS, NODES_NS, ideal)]
    sums.add(force - ideal, ideal, {}, np.ones_like(ideal), shapes)
    return sums.figures("N", lateness.delays)


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_pulse_that_is_late_is_nothing_but_late(part: float) -> None:
    """By the delay of the loop, its lag, and any part of a period, as the sample before the edge was early or late."""
    found = figures(pulse(TRANSPORT + part * PERIOD, LAG))
    share = math.sqrt((TRANSPORT + part * PERIOD + 0.5 * LAG) / WIDTH)
    assert found.error_rms_contact / found.ideal_rms_contact == pytest.approx(share, rel=0.1)
    assert found.shape_rms_contact < 0.07 * found.ideal_rms_contact
    assert found.late == pytest.approx(TRANSPORT + part * PERIOD, abs=2 * PERIOD / 16)


@pytest.mark.parametrize("factor", [0.8, 1.3])
def test_a_force_of_another_size_is_no_late_one(factor: float) -> None:
    found = figures(factor * pulse(TRANSPORT, LAG))
    assert found.shape_rms_contact > 0.9 * abs(factor - 1.0) * found.ideal_rms_contact * math.sqrt(0.8)


def test_a_delay_that_the_loop_cannot_have_is_an_error_of_shape() -> None:
    found = figures(pulse(TRANSPORT + 2.0 * PERIOD, LAG))
    assert found.shape_rms_contact > 0.4 * found.ideal_rms_contact


LONG_PULSES = {"braking_pulse.duration": 0.1, "braking_pulse.damping": 10.0}


def test_pulses_may_come_a_little_late() -> None:
    verdict = run("braking_pulse", hand="shake", settings=LONG_PULSES, duration=1.5).verdict
    assert verdict is not None
    told = re.match(r"Feels right, ([\d.]+) ms late: .* \(people notice from 5\.5 ms and 8 %\)", verdict)
    assert told is not None
    assert 0.4 < float(told[1]) < 1.6


@pytest.mark.thorough("another run")
def test_pulses_beside_a_wall_may_not() -> None:
    """Where an element acts for as long as it is touched, all of the error counts."""
    scene = load_scene("braking_pulse")
    beside = replace(scene, elements=(*scene.elements, Wall("handle", 20.0, position=0.09)))
    verdict = run(beside, hand="shake", settings=LONG_PULSES, duration=2.0).verdict
    assert verdict is not None
    assert re.match(r"Feels different: .* without the delay of", verdict)


def test_of_the_library_only_pulses_come_from_events_alone() -> None:
    elements = (each for name in scene_names() for each in load_scene(name).elements)
    eventful = [each for each in elements if abilities(each).by_event]
    assert eventful
    assert all(isinstance(each, BrakingPulse) for each in eventful)
