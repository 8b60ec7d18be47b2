"""Write the tables of methods.md and estimators.md in docs/reference from the code: `python docs/make_tables.py`.

A table stands between two marks in a page that people write.
"""

import math
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from haptic_fieldbus.numerals import LIMIT_DIGITS, exactly, rounded
from haptic_fieldbus.numerics.estimators import ESTIMATORS, bind, chosen
from haptic_fieldbus.numerics.estimators.estimator import Parameter
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.integrators.method import Integrator

FOLDER = Path(__file__).resolve().parent / "reference"
MARKED = re.compile(r"(<!-- written by make docs -->\n).*?(<!-- end -->\n)", re.DOTALL)
PERIOD = 1e-3
SETTLED = 4000
"""Periods after which an impulse response is over."""


def pages() -> dict[Path, str]:
    """The text of each page by its file, its table as the code says."""
    return {
        FOLDER / "methods.md": _page("methods.md", _methods()),
        FOLDER / "estimators.md": _page("estimators.md", _estimators()),
    }


def _page(name: str, table: Iterable[Sequence[str]]) -> str:
    rows = "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in table)
    text = (FOLDER / name).read_text(encoding="utf-8")
    written, count = MARKED.subn(lambda marks: f"{marks[1]}{rows}{marks[2]}", text)
    if count != 1:
        raise ValueError(f"{name}: expected one table between <!-- written by make docs --> and <!-- end -->")
    return written


def _methods() -> Iterable[Sequence[str]]:
    yield ("method", "order", "free motion", "input samples", "a step", "oscillator stable to h", "decay stable to T·λ")
    yield ("---",) * 7
    yield from (_method(method) for method in METHODS.values())


def _method(method: Integrator) -> Sequence[str]:
    free = "exact" if math.isinf(method.free_order) else exactly(method.free_order)
    limits = (method.oscillator_limit, method.lag_limit)
    return (f"`{method.name}`", f"{method.order}", free, f"`{method.inputs}`", method.update, *map(_limit, limits))


def _limit(limit: float) -> str:
    return "never" if limit == 0.0 else "every" if math.isinf(limit) else rounded(limit, LIMIT_DIGITS)


def _estimators() -> Iterable[Sequence[str]]:
    yield ("name", "what it is", "parameters (default)", "noise gain · T", "delay / T")
    yield ("---",) * 5
    for name in ESTIMATORS:
        estimator = chosen(name).estimator
        parameters = ", ".join(map(_parameter, estimator.parameters))
        yield (f"`{name}`", estimator.summary, parameters or "–", _noise_gain(name), _delay(name))


def _parameter(parameter: Parameter) -> str:
    return f"`{parameter.key}` {parameter.meaning} ({_default(parameter)})"


def _default(parameter: Parameter) -> str:
    if parameter.default is None:
        return "one count"
    if isinstance(parameter.default, str):
        return f"`{parameter.default}`"
    return f"{exactly(parameter.default)} {parameter.unit}".rstrip()


def _noise_gain(name: str) -> str:
    """Of a linear one, the norm of its answer to an impulse."""
    if chosen(name).estimator.system is None:
        return "see below"
    step = bind(name, PERIOD)
    step(0.0)
    return rounded(PERIOD * math.hypot(*(step(float(sample == 0)) for sample in range(SETTLED))))


def _delay(name: str) -> str:
    choice = chosen(name)
    delay = choice.estimator.delay
    return "see below" if delay is None else rounded(delay(choice.setup(PERIOD)) / PERIOD)


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
        print(path, file=sys.stderr)
