"""Signals that end a run: the first one, further ones, and handlers that are not ours to take."""

import signal
import threading
import weakref
from collections.abc import Iterator
from contextlib import suppress

import pytest

from haptic_fieldbus.running.ending import SIGNALS, EndSignals, ended_by_signals

EACH = pytest.mark.parametrize("number", SIGNALS, ids=[each.name for each in SIGNALS])


@pytest.fixture(autouse=True)
def usual_handlers() -> Iterator[None]:
    """As a process has them when it begins."""
    before = {each: signal.getsignal(each) for each in SIGNALS}
    for each in SIGNALS:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)
    yield
    for each, handler in before.items():
        signal.signal(each, handler)


@EACH
def test_before_the_loop_a_signal_interrupts(number: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt), ended_by_signals() as ending:
        signal.raise_signal(number)
    assert ending.signal == number


@EACH
def test_in_the_loop_it_is_only_noted_however_often_it_comes(number: signal.Signals) -> None:
    with ended_by_signals() as ending:
        ending.hold()
        for _ in range(3):
            signal.raise_signal(number)
            signal.raise_signal(signal.SIGINT)
    assert ending.signal == number


class Clock:
    """A clock that stands still unless it is moved [s]."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


def test_after_the_first_signal_no_other_one_interrupts_the_way_to_zero() -> None:
    with ended_by_signals(clock := Clock()) as ending:
        before = ending.leaving
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert (before, ending.leaving) == (False, True)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        clock.time += 1000.0
        ending.hold()
        signal.raise_signal(signal.SIGTERM)
    assert ending.signal == signal.SIGINT


def test_a_command_that_holds_nothing_can_be_interrupted_again() -> None:
    with ended_by_signals(clock := Clock()):
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            clock.time += 1.0


def test_a_result_that_hangs_is_given_up_once_the_drives_are_off() -> None:
    with ended_by_signals(clock := Clock()) as ending:
        ending.hold()
        signal.raise_signal(signal.SIGINT)
        ending.freed()
        clock.time += 9.9
        signal.raise_signal(signal.SIGINT)
        clock.time += 0.2
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    assert ending.signal == signal.SIGINT


def test_a_run_inside_a_command_shares_its_signals() -> None:
    with ended_by_signals() as command:
        with ended_by_signals() as run:
            assert run is command
            run.hold()
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            run.resume()
    assert command.sentence == "stopped by SIGTERM"


def test_a_process_that_ends_with_the_block_takes_no_late_signal() -> None:
    with ended_by_signals() as ending:
        ending.last = True
        ending.hold()
    signal.raise_signal(signal.SIGTERM)
    assert ending.signal is None
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN  # which Python leaves when it ends


def test_handlers_are_put_back_and_those_of_others_left_alone() -> None:
    def own(number: int, frame: object) -> None:
        raise AssertionError

    signal.signal(signal.SIGTERM, own)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as under nohup
    with ended_by_signals() as ending:
        assert signal.getsignal(signal.SIGTERM) is own
        signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    assert ending.signal is None
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_outside_the_main_thread_nothing_is_taken() -> None:
    taken: list[bool] = []

    def work() -> None:
        with ended_by_signals():
            taken.append(signal.getsignal(signal.SIGINT) is not signal.default_int_handler)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert taken == [False]


def ended_by_another_thread() -> EndSignals:
    """Signals of a block whose end another thread runs, as that of a generator which it collects."""
    (block := ended_by_signals()).__enter__()
    ending: EndSignals = getattr(signal.getsignal(signal.SIGINT), "__self__")  # noqa: B009  no attribute of a handler
    thread = threading.Thread(target=block.__exit__, args=(None, None, None))
    thread.start()
    thread.join()
    return ending


def test_what_another_thread_could_not_put_back_the_next_signal_does() -> None:
    ending = ended_by_another_thread()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert ending.signal is None
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_what_another_thread_could_not_put_back_the_next_block_does() -> None:
    earlier = ended_by_another_thread()
    with ended_by_signals() as ending:
        assert ending is not earlier
        ending.hold()
        signal.raise_signal(signal.SIGTERM)
    assert (earlier.signal, ending.signal) == (None, signal.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_function_that_no_signal_interrupts() -> None:
    def inside() -> None:
        signal.raise_signal(signal.SIGTERM)

    def whole() -> None:
        inside()
        done.append(True)

    done: list[bool] = []
    with ended_by_signals() as ending:
        ending.unbroken = whole.__code__
        with suppress(KeyboardInterrupt):
            whole()
        assert done
        assert ending.signal == signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            inside()


class Noted:
    """Something that is deleted by its last reference."""


def test_a_callback_in_which_an_exception_would_be_lost_only_notes_the_signal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Struck(set[object]):
        def discard(self, element: object) -> None:
            signal.raise_signal(signal.SIGINT)

    kept, whole = weakref.WeakSet[Noted](), Noted()
    kept.add(whole)
    kept.data = Struck(kept.data)  # type: ignore[attr-defined]
    with ended_by_signals() as ending:
        del whole
        assert ending.signal == signal.SIGINT
        with pytest.raises(KeyboardInterrupt):
            ending.resume()
