"""Digests of objects of Python: equal where code and values are equal, and different where one of them differs."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from haptic_fieldbus.documents.own_parts import content_digest

UNIT = 3.0


def scaled(value: float, *, unit: float = 1.0) -> float:
    return UNIT * unit * value if value in {1.0, 2.0} else helper(value)


def helper(value: float) -> float:
    return value - 1.0 if value < 0.0 else helper(value - 1.0)


def held(unit: float) -> Callable[[float], float]:
    def law(value: float) -> float:
        return unit * value

    return law


class Scale:
    def __init__(self, unit: float) -> None:
        self.unit = unit

    def __call__(self, value: float) -> float:
        return scaled(value, unit=self.unit)


def from_text(text: str) -> Any:
    """A function of a module of its own."""
    space: dict[str, Any] = {"__name__": "a_module_of_its_own"}
    exec(text, space)
    return space["law"]


@pytest.mark.parametrize(
    "made",
    [
        held,
        Scale,
        lambda unit: partial(scaled, unit=unit),
        lambda unit: [unit, Scale(unit), scaled],
        lambda unit: from_text(f"UNIT = {unit}\ndef law(x):\n    return UNIT * x\n"),
        lambda unit: from_text(f"def scale(x):\n    return {unit} * x\ndef law(x):\n    return scale(x)\n"),
        lambda unit: from_text(f"def law(x, unit={unit}):\n    return unit * x\n"),
    ],
    ids=["closure", "attribute", "partial", "list", "constant", "function that is called", "default"],
)
def test_the_digest_of_an_object_is_that_of_its_code_and_its_values(made: Callable[[float], Any]) -> None:
    assert content_digest(made(1.5)) == content_digest(made(1.5))
    assert content_digest(made(1.5)) != content_digest(made(2.5))


def test_functions_of_one_text_and_other_names_in_it_differ() -> None:
    texts = (
        "def law(x):\n    return abs(x)\n",
        "def law(x):\n    return max(x)\n",
        "def law(x):\n    return x in {1, 2}\n",
    )
    digests = [content_digest(from_text(text)) for text in texts]
    assert len({*digests, content_digest(scaled), content_digest(helper), content_digest(Scale)}) == 6
    assert digests == [content_digest(from_text(text)) for text in texts]


def test_an_object_that_nobody_can_look_into_is_another_one_each_time() -> None:
    class Local(Scale):
        pass

    locked: Any = threading.Lock()
    of_no_text = from_text("class A: pass\ndef law(x):\n    return A\n")
    for each in (Local(1.0), partial(scaled, unit=locked), of_no_text):
        assert content_digest(each).startswith("unknown ")
        assert content_digest(each) != content_digest(each)
