"""Changes to the interpreter while the loop runs, put back afterwards."""

import gc
import sys

import pytest

from haptic_fieldbus.running.loop import no_garbage_collection, threads_give_way


def test_no_garbage_is_collected_while_the_loop_runs_nor_before() -> None:
    """In a process with many objects a collection took longer than all else before a short run."""
    seen: list[str] = []

    def collected(phase: str, info: dict[str, int]) -> None:
        seen.append(phase)

    gc.callbacks.append(collected)
    try:
        with no_garbage_collection():
            assert not gc.isenabled()
            during: list[list[int]] = [[] for _ in range(2 * gc.get_threshold()[0])]
            assert seen == []
    finally:
        gc.callbacks.remove(collected)
    assert gc.isenabled()
    assert len(during) > gc.get_threshold()[0]


def test_threads_give_way_while_the_loop_runs_and_no_longer() -> None:
    before = sys.getswitchinterval()
    with threads_give_way():
        assert 1e-5 <= sys.getswitchinterval() <= 0.02 * 1e-3 + 1e-12, "2 % of a period at 1 kHz; less costs switches"
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
