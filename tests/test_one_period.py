"""The way of one encoder count to a torque goes through the files that docs/explanation/architecture.md names."""

from collections import Counter
from collections.abc import Callable

import pytest

import haptic_fieldbus
from haptic_fieldbus.cycle.cycle import Cycle
from tests.calls import Call, traced
from tests.docs.test_architecture_page import MENTION, section

pytestmark = pytest.mark.unwatched("looks at who calls whom, and a witness calls too")

MOST_FILES, MOST_MOVES = 8, {"wall": 6, "damped_wall": 10}
"""Files that one has to read from the input image to the output image, and calls from one of them into another."""
Step = Callable[[bytes | bytearray], bytearray]


def calls_of_a_steady_period(scene: str, monkeypatch: pytest.MonkeyPatch, *, full: bool) -> tuple[Call, ...]:
    """Functions called from the input image to the output image in most periods of a contact in which nothing happens.

    The wait, the buses, the simulated bench and the record stand around the step of the cycle. With `full` all periods
    go through the code that all plans share.
    """
    steady: Counter[tuple[Call, ...]] = Counter()
    bind = Cycle._bind_step

    def bind_traced(cycle: Cycle) -> Step:
        plain = cycle.full if full else bind(cycle)

        def step(image: bytes | bytearray) -> bytearray:
            with traced() as calls:
                output = plain(image)
            axis = cycle.axes["handle"]
            if axis.state.target and axis.state.steps == 1 and axis.permission.unchanged:
                steady[tuple(calls.made)] += 1
            return output

        return step

    monkeypatch.setattr(Cycle, "_bind_step", bind_traced)
    haptic_fieldbus.run(scene, duration=0.9)
    ((calls, count),) = steady.most_common(1)
    assert count > 0.5 * steady.total() > 50
    return calls


def files_on_the_page(left_out: str) -> list[str]:
    """The files of the rows from "decode" to "encode", without those that say `left_out`."""
    rows = section("encoder count").splitlines()
    first, last = (next(at for at, row in enumerate(rows) if row.startswith(f"| {step}")) for step in ("decode", "enc"))
    named = [MENTION.search(row) for row in rows[first : last + 1] if left_out not in row]
    return sorted({found[1] for found in named if found is not None})


@pytest.mark.parametrize(("scene", "left_out"), [("wall", "only "), ("damped_wall", "only when")])
def test_a_steady_period_goes_through_the_files_of_the_page(
    scene: str, left_out: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = calls_of_a_steady_period(scene, monkeypatch, full=True)
    files = sorted({str(call.called).partition(":")[0] for call in calls})
    assert files == files_on_the_page(left_out)
    assert len(files) <= MOST_FILES
    moves = [call for call in calls[1:] if call.caller is not None and call.caller.module != call.called.module]
    assert len(moves) <= MOST_MOVES[scene]


@pytest.mark.parametrize(
    ("scene", "called"),
    [("wall", {"scenes/wall.py"}), ("damped_wall", {"cycle/laws.py", "scenes/wall.py"})],
)
def test_an_ordinary_period_is_one_function_that_calls_the_estimator_and_the_elements(
    scene: str, called: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = calls_of_a_steady_period(scene, monkeypatch, full=False)
    files = {str(call.called).partition(":")[0] for call in calls}
    assert {file for file in files if "estimators" not in file} == {"cycle/ordinary.py", *called}
