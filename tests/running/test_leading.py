"""The hand of a simulation that is led: commands act once, in their periods, and are kept as far as there is room."""

from collections.abc import Callable, Mapping
from time import monotonic
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_fieldbus.running import leading
from haptic_fieldbus.running.leading import Leading, Led, SimulatedTime

PERIOD = 1e-3


class Handle:
    """Notes what is done to it."""

    def __init__(self) -> None:
        self.done: list[Any] = []

    def pull(self, position: float, target: float, period: float) -> None:
        self.done.append(("pull", position, target, period))

    def let_go(self) -> None:
        self.done.append(("let go",))

    def take(self, hand: str) -> None:
        self.done.append(("take", hand))


def axes(*, begun: bool = True) -> Any:
    return {name: SimpleNamespace(state=SimpleNamespace(begun=begun, position=0.5)) for name in ("a", "b")}


def led(commands: Mapping[int, Callable[[Leading], None]], recorded: tuple[Led, ...] = ()) -> tuple[Leading, list[Any]]:
    """Go through ten periods with commands before some; return what was kept, and what was done to the axis a."""
    handle = Handle()
    found = Leading({"a": handle, "b": Handle()}, recorded, "none")
    for period in range(10):
        if period in commands:
            commands[period](found)
        found.act(axes(), PERIOD)
        handle.done.append(period)
    return found, handle.done


def test_each_command_acts_in_its_period_and_the_record_does_the_same_again() -> None:
    def dragged(hands: Leading) -> None:
        hands.pull("a", 0.1)
        hands.pull("a", 0.2)  # in one period the last place counts

    commands = {
        1: dragged,
        3: lambda hands: hands.pull("a", 0.2),
        4: lambda hands: hands.take("push"),
        6: lambda hands: hands.pull("a", 0.3),
        8: Leading.let_go,
    }
    first, done = led(commands)
    assert first.acted == [(1, "a", 0.2), (4, "", "push"), (6, "a", 0.3), (8, "a", None)]
    pull = ("pull", 0.5, 0.2, PERIOD), ("pull", 0.5, 0.3, PERIOD)
    dragging = [0, pull[0], 1, pull[0], 2, pull[0], 3]
    assert done == [*dragging, ("take", "push"), 4, 5, pull[1], 6, pull[1], 7, ("let go",), 8, 9]
    again, repeated = led({}, tuple(first.acted or ()))
    assert (again.acted, repeated) == (first.acted, done)


def test_the_hand_of_the_simulation_stays_at_a_handle_that_nobody_has_pulled() -> None:
    found, done = led({1: lambda hands: hands.pull("a", None), 2: Leading.let_go})
    assert (found.acted, done) == ([], [*range(10)])


def test_a_handle_whose_place_is_not_known_is_not_pulled_yet() -> None:
    handle = Handle()
    found = Leading({"a": handle}, [], "none")
    found.pull("a", 0.1)
    found.act(axes(begun=False), PERIOD)
    assert handle.done == []
    found.act(axes(), PERIOD)
    assert handle.done == [("pull", 0.5, 0.1, PERIOD)]


def test_a_hand_that_takes_the_handles_while_the_loop_obeys_ends_no_run() -> None:
    """As the thread of a page may at any moment."""

    class Taken(Handle):
        def let_go(self) -> None:
            found.take("push")

    other = Handle()
    found = Leading({"a": Taken(), "b": other}, [], "none")
    found.pull("a", 0.1)
    found.act(axes(), PERIOD)
    found.pull("a", None)
    found.pull("b", 0.1)
    found.act(axes(), PERIOD)
    assert other.done == []
    found.act(axes(), PERIOD)
    assert other.done == [("take", "push")]


@pytest.mark.parametrize(("seconds", "kept"), [(60, True), (300, False)])
def test_a_minute_of_dragging_is_kept_and_five_are_not(seconds: int, kept: bool) -> None:
    """One place per period of 1 ms."""
    found, handles = Leading({"a": Handle()}, [], "none"), axes()
    for period in range(1000 * seconds):
        found.pull("a", 0.001 * (period % 2))
        found.act(handles, PERIOD)
    assert (found.acted is not None) is kept


def test_a_hand_that_is_led_without_end_acts_on_and_is_kept_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leading, "MOST_LED", 3)

    def further(period: int) -> Callable[[Leading], None]:
        return lambda hands: hands.pull("a", 0.01 * period)

    found, done = led({period: further(period) for period in range(10)})
    assert found.acted is None
    assert done[-2] == ("pull", 0.5, 0.09, PERIOD)


def test_a_simulation_that_is_watched_begins_at_the_pace_of_real_time() -> None:
    """A machine that is slow makes it later, and never sooner. It may be ahead by 2 ms."""
    clock, began = SimulatedTime(), monotonic()
    clock.sleep_until(clock.now_ns() + 60_000_000)
    assert monotonic() - began > 0.057
