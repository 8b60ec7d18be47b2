"""Every exception that canopen and python-can define becomes one of ours."""

import errno
import importlib
import inspect
import pkgutil
import queue

import can
import canopen
import pytest

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError
from tests.cases import every


def _defined_in_canopen() -> list[type[Exception]]:
    found: dict[str, type[Exception]] = {}
    for info in pkgutil.walk_packages(canopen.__path__, "canopen."):
        if info.name.endswith("__main__"):
            continue
        module = importlib.import_module(info.name)
        for member in vars(module).values():
            # `type`, because canopen's placeholder network raises when it is looked at
            if issubclass(type(member), type) and issubclass(member, Exception):
                found[f"{member.__module__}.{member.__name__}"] = member
    return [error for name, error in found.items() if name.startswith("canopen")]


def _defined_in_can() -> list[type[Exception]]:
    return [
        member for _, member in inspect.getmembers(can.exceptions, inspect.isclass) if issubclass(member, Exception)
    ]


@pytest.mark.parametrize("foreign", _defined_in_canopen() + _defined_in_can() + [OSError, TimeoutError])
def test_every_foreign_exception_has_a_row(foreign: type[Exception]) -> None:
    assert issubclass(foreign, FOREIGN)


def test_there_are_foreign_exceptions_to_check() -> None:
    assert canopen.SdoAbortedError in _defined_in_canopen()
    assert can.CanError in _defined_in_can()


def test_special_rows_stand_above_general_ones() -> None:
    for at, foreign in enumerate(FOREIGN):
        assert not issubclass(foreign, FOREIGN[:at]), foreign


@every("code", canopen.SdoAbortedError.CODES)
def test_every_abort_code_of_the_standard_is_put_in_words(code: int) -> None:
    error = translate(canopen.SdoAbortedError(code), "node 5")
    assert isinstance(error, BusConfigurationError)
    assert str(error) == f"node 5: refused: {canopen.SdoAbortedError.CODES[code]} (SDO abort code {code:08X}h)"


def test_silence_is_a_timeout_and_nonsense_is_not() -> None:
    silent = canopen.SdoCommunicationError("No SDO response received")
    silent.__context__ = queue.Empty()
    assert isinstance(translate(silent, "node 5"), BusTimeoutError)
    assert isinstance(translate(canopen.SdoCommunicationError("Unexpected response"), "node 5"), BusConfigurationError)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (can.CanOperationError("Failed to transmit", errno.ENOBUFS), "txqueuelen"),
        (OSError(errno.ENOBUFS, "No buffer space available"), "txqueuelen"),
        (can.CanOperationError("Transmit buffer full"), "txqueuelen"),
        (can.CanOperationError("Failed to transmit", errno.ENETDOWN), "down or gone"),
        (OSError(errno.ENODEV, "No such device"), "down or gone"),
        (can.CanError(), "CanError"),
    ],
)
def test_what_the_operating_system_says_becomes_advice(error: Exception, words: str) -> None:
    ours = translate(error, "can0")
    assert type(ours) is BusError
    assert words in str(ours)


def test_only_a_full_queue_is_a_full_queue() -> None:
    assert not is_queue_full(can.CanOperationError("Failed to transmit", errno.ENETDOWN))
    assert not is_queue_full(OSError(errno.ENETDOWN, "down"))


def test_a_mistake_of_ours_is_not_dressed_up() -> None:
    with pytest.raises(ZeroDivisionError):
        translate(ZeroDivisionError(), "node 5")
