"""How much an element answers acceleration, as a mass would."""

from collections.abc import Iterable

import numpy as np

from haptic_fieldbus.scenes.element import Element

FASTEST_HAND, BLOCK = 30.0, 600.0
"""[rad/s]; between them lie changes of torque that a hand does not follow, and that are seen within blocks of 5 ms."""
FREQUENCIES = np.geomspace(FASTEST_HAND, BLOCK, 16)


def virtual_mass(elements: Iterable[Element]) -> float:
    """Return the largest mass [kg or kg·m²] that the elements add to the handle between these frequencies.

    A force H(jω)·x on a motion x with the frequency ω acts like a mass Re H/ω², since a mass answers with m·ω²·x.
    """
    total = np.zeros(FREQUENCIES.size)
    for element in elements:
        space = element.linearised()
        answers = []
        for frequency in FREQUENCIES:
            motion = np.array([1.0, 1j * frequency])
            states = np.linalg.solve(1j * frequency * np.eye(space.order) - space.a, space.b @ motion)
            answers.append(np.real((space.c @ states + space.d @ motion)[0]) / frequency**2)
        total += np.maximum(0.0, answers)
    return float(total.max())
