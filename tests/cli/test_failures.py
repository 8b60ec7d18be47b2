import inspect

import pytest

from haptic_fieldbus import errors
from haptic_fieldbus.cli.failures import OUTCOMES, outcome_of, tell
from haptic_fieldbus.errors import (
    BusTimeoutError,
    Fault,
    HapticFieldbusError,
    PlanError,
    ProfileError,
    SafetyTripError,
    UsageError,
)
from tests.cases import every

ERRORS = [
    member
    for _, member in inspect.getmembers(errors, inspect.isclass)
    if issubclass(member, HapticFieldbusError) and member is not HapticFieldbusError
]
STATUS = {
    "BusError": 1,
    "BusTimeoutError": 1,
    "BusConfigurationError": 1,
    "DriveFaultError": 1,
    "UsageError": 2,
    "DocumentError": 2,
    "ProfileError": 2,
    "SceneError": 2,
    "RigError": 2,
    "FaultFileError": 2,
    "EdsError": 2,
    "SafetyTripError": 3,
    "PlanError": 4,
    "SignalUnavailableError": 4,
    "ImageTooLargeError": 4,
    "BusOverloadError": 4,
    "UnstableSceneError": 4,
    "ForeignMasterError": 4,
    "UnprovedGuardError": 4,
    "VcanError": 125,
}


@every("error", ERRORS, ids=lambda error: error.__name__)
def test_every_error_has_the_exit_status_of_the_contract(error: type[HapticFieldbusError]) -> None:
    assert outcome_of(error).status == STATUS[error.__name__]


@every("error", ERRORS, ids=lambda error: error.__name__)
def test_every_error_is_in_the_table_or_has_a_base_there(error: type[HapticFieldbusError]) -> None:
    assert any(kind in OUTCOMES for kind in error.__mro__)


def test_an_error_without_an_entry_counts_as_a_failure() -> None:
    assert outcome_of(HapticFieldbusError).status == 1


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (PlanError("too fast\nwould fit: 100"), "refused    too fast\n           would fit: 100\n"),
        (SafetyTripError("speed"), "tripped    speed\n"),
        (BusTimeoutError("silence"), "failed     silence\n"),
        (UsageError("no bus"), "no bus\n"),
        (
            ProfileError("a.toml", [Fault("x", "wrong", 3), Fault("y", "bad", 4)]),
            "a.toml: line 3: x: wrong\na.toml: line 4: y: bad\n",
        ),
    ],
)
def test_an_error_is_told_on_standard_error(
    error: HapticFieldbusError, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tell(error) == outcome_of(type(error)).status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == text


def test_notes_of_an_error_follow_its_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    error = PlanError("unstable")
    error.add_note("would be stable: less")
    tell(error)
    assert capsys.readouterr().err == "refused    unstable\n           would be stable: less\n"
