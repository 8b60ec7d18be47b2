"""What is changed about the interpreter while the loop runs, and put back after."""

import sys

import pytest

from haptic_fieldbus.running.realtime import GIVE_WAY, threads_give_way


def test_threads_give_way_while_the_loop_runs_and_no_longer() -> None:
    before = sys.getswitchinterval()
    with threads_give_way():
        assert sys.getswitchinterval() == pytest.approx(GIVE_WAY)
    assert sys.getswitchinterval() == before


def test_an_interruption_puts_back_what_was() -> None:
    before = sys.getswitchinterval()
    with pytest.raises(KeyboardInterrupt), threads_give_way():
        raise KeyboardInterrupt
    assert sys.getswitchinterval() == before


def test_an_interpreter_that_switches_faster_is_left_alone() -> None:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with threads_give_way():
            assert sys.getswitchinterval() == pytest.approx(1e-6)
    finally:
        sys.setswitchinterval(before)
