import errno
import inspect
import json
import os

import pytest

from haptic_fieldbus import errors
from haptic_fieldbus.cli.failures import OUTCOMES, outcome_of, print_object, tell
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
from tests.cli.command import Command

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


@pytest.mark.parametrize(
    ("words", "error", "status", "faults"),
    [
        ("run wall --rate 1khz", "UsageError", 2, [(None, None, """Invalid value for '--rate': "1khz"; expected""")]),
        ("run wall --node x", "UsageError", 2, [(None, None, "Invalid value for '--node'")]),
        ("run wall --nope", "UsageError", 2, [(None, None, "No such option: --nope")]),
        ("run", "UsageError", 2, [(None, None, "no scene: expected SCENE or --from FILE")]),
        ("nope", "UsageError", 2, [(None, None, "No such command 'nope'")]),
        ("run wall --hand foot --seed 1", "UsageError", 2, [(None, None, 'no hand "foot"')]),
        ("plan wall --rig nowhere.toml", "RigError", 2, [("nowhere.toml", None, "no such file")]),
        (
            "plan damped_wall --set wall.stiffness=1n/m --set wall.damping=1,5",
            "SceneError",
            2,
            [
                ("damped_wall.toml", "--set wall.stiffness", '"1n/m"; expected a stiffness in N/m'),
                ("damped_wall.toml", "--set wall.damping", '"1,5"; expected a number without a comma: 1.5'),
            ],
        ),
        ("plan wall --drive faulhaber_mclm", "PlanError", 4, [(None, None, "Faulhaber MCLM")]),
        (
            "scan --bus modbus-rtu:/dev/null",
            "BusError",
            1,
            [(None, None, "cannot open modbus-rtu:/dev/null")],
        ),
    ],
)
def test_with_json_a_failure_is_an_object_on_standard_output_too(
    command: Command, words: str, error: str, status: int, faults: list[tuple[str | None, str | None, str]]
) -> None:
    done = command(*words.split(), "--json")
    told = json.loads(done.out)
    assert (done.status, told["error"], told["exit_status"]) == (status, error, status)
    assert len(told["errors"]) == len(faults)
    for found, (source, key, message) in zip(told["errors"], faults, strict=True):
        assert (found["source"] or "").endswith(source or "")
        assert (found["key"], found["line"]) == (key, None)
        assert found["message"].startswith(message)
    plain = command(*words.split())
    assert (plain.out, plain.status) == ("", status)
    assert done.err == plain.err, "the text on standard error stays"


def test_the_result_of_a_refused_run_stays_the_only_object(command: Command) -> None:
    done = command("run", "wall", "--set", "wall.stiffness=1e6", "--json")
    assert done.status == 4
    assert json.loads(done.out)["scene"] == "wall"


def test_the_json_of_another_command_is_not_ours(command: Command) -> None:
    assert command("plan", "nowhere", "--", "--json").out == ""


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO])
@pytest.mark.parametrize("as_object", [False, True])
def test_a_disk_that_fails_is_told_as_a_failure_whoever_names_its_path(
    code: int, capsys: pytest.CaptureFixture[str], *, as_object: bool
) -> None:
    error = UsageError("sweep/rows: cannot be written")
    error.__cause__ = OSError(code, os.strerror(code))
    if as_object:
        print_object(error)
        told = json.loads(capsys.readouterr().out)
        assert (told["error"], told["exit_status"]) == ("HapticFieldbusError", 1)
    else:
        assert tell(error) == 1
        assert capsys.readouterr().err == "failed     sweep/rows: cannot be written\n"


def test_a_path_that_cannot_be_right_stays_a_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    error = UsageError("sweep/rows: cannot be written")
    error.__cause__ = PermissionError(errno.EACCES, "Permission denied")
    assert tell(error) == 2
    assert capsys.readouterr().err == "sweep/rows: cannot be written\n"
