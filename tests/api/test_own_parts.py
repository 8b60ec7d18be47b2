"""Estimators, methods and hands that are not of this package: objects of Python, and those that packages add."""

import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus import (
    SafetyTripError,
    UsageError,
    load_scene,
    plan,
    read_recording,
    repeat,
    response,
    run,
    session,
    stability,
)
from haptic_fieldbus.documents.own_parts import OwnName
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import estimator_named
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.sim import hand as hands
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece
from tests.scenes.packages import install

NUMBERS = count()
ESTIMATOR = replace(estimator_named("backward-difference"), name="mine")
METHOD = replace(METHODS["verlet"], name="mine")
NUDGE = Hand("mine", (Piece(0.0, 3.0), Piece(0.1, 0.0)))
PUSH = HANDS["push"]
NEAR = {"wall.position": 0.001}
"""A wall that the handle reaches."""


def frames(path: Path, **arguments: Any) -> bytes:
    """The frames of a run that is long enough for the handle to move into contact."""
    run(arguments.pop("scene", "damped_wall"), duration=0.7, record=path, **arguments)
    return path.read_bytes()


def test_an_estimator_of_python_runs_as_the_shipped_one_of_the_same_definition(tmp_path: Path) -> None:
    own = frames(tmp_path / "a.log", settings=NEAR, estimator=ESTIMATOR)
    assert own == frames(tmp_path / "b.log", settings=NEAR, estimator="backward-difference")
    assert own != frames(tmp_path / "c.log", settings=NEAR, estimator="moving-average:window=9")


def test_a_method_of_python_runs_as_the_shipped_one_of_the_same_definition(tmp_path: Path) -> None:
    own = frames(tmp_path / "a.log", scene="sprung_mass", method=METHOD)
    assert own == frames(tmp_path / "b.log", scene="sprung_mass", method="verlet")
    assert own != frames(tmp_path / "c.log", scene="sprung_mass", method="forward-euler")


def test_a_hand_of_python_runs_as_the_shipped_one_of_the_same_definition(tmp_path: Path) -> None:
    assert PUSH is not None
    own = frames(tmp_path / "a.log", hand=replace(PUSH, name="mine"))
    assert own == frames(tmp_path / "b.log", hand="push")
    assert own != frames(tmp_path / "c.log", hand=NUDGE)


def test_every_function_takes_them() -> None:
    assert plan("damped_wall", estimator=ESTIMATOR).axes[0].estimator == OwnName("mine", ESTIMATOR)
    limits = [
        stability("damped_wall", estimator=each).to_json()["limit"] for each in (ESTIMATOR, "backward-difference")
    ]
    assert limits[0] == limits[1]
    forces = [response("sprung_mass", method=each, duration=0.1).force.tolist() for each in (METHOD, "verlet")]
    assert forces[0] == forces[1]
    with session("damped_wall", estimator=ESTIMATOR, hand=NUDGE) as live:
        for _, _ in zip(live, range(5), strict=False):
            pass
    assert live.result is not None
    assert live.result.plan is not None
    assert live.result.plan.axes[0].estimator == "mine" or str(live.result.plan.axes[0].estimator) == "mine"


def test_a_run_with_them_is_repeated_where_the_objects_are_known(tmp_path: Path) -> None:
    result = run("damped_wall", estimator=ESTIMATOR, hand=NUDGE, duration=0.1, record=tmp_path / "a.csv")
    assert result.provenance is not None
    repeat(result.provenance, record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert read_recording(tmp_path / "a.csv").provenance is not None
    told = 'the {0} "mine" of the recorded run was an object of a program, .*no {0} "mine".*{0}=...'
    with pytest.raises(UsageError, match=told.format("hand")):
        repeat(tmp_path / "a.csv")
    with pytest.raises(UsageError, match=told.format("estimator")):
        repeat(tmp_path / "a.csv", hand=NUDGE)
    repeat(tmp_path / "a.csv", record=tmp_path / "c.csv", hand=NUDGE, estimator=ESTIMATOR)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()


def test_a_result_with_them_is_copied_without_what_cannot_be_sent() -> None:
    result = run("damped_wall", estimator=ESTIMATOR, hand=NUDGE, duration=0.05)
    sent = pickle.loads(pickle.dumps(result))
    assert sent.to_json() == result.to_json()
    assert type(sent.plan.axes[0].estimator) is str, "its functions are lambdas"
    assert sent.provenance.conditions.hand == OwnName("mine", NUDGE)
    assert deepcopy(result).plan == result.plan or deepcopy(result).to_json() == result.to_json()


def test_a_name_of_an_object_is_that_of_an_equal_object_alone() -> None:
    own = OwnName("mine", NUDGE)
    assert own == OwnName("mine", replace(NUDGE))
    assert own != OwnName("mine", replace(NUDGE, mass=1.0))
    assert own != "mine"
    assert "mine" != own  # noqa: SIM300 - the other operand is asked first
    assert {own: 1, "mine": 2} == {"mine": 2, own: 1}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"estimator": replace(ESTIMATOR, name="levant")}, 'estimator "levant": a shipped one has this name'),
        ({"method": replace(METHOD, name="rk4")}, 'method "rk4": a shipped one has this name'),
        ({"hand": replace(NUDGE, name="none")}, 'hand "none": a shipped one has this name'),
        ({"hand": replace(NUDGE, mass=0.0, release=-1.0)}, 'hand "mine": mass is 0.0; .*; release is -1.0 s'),
    ],
)
def test_what_cannot_be_used_is_refused_before_anything_moves(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        run("damped_wall", duration=0.05, **arguments)


@pytest.mark.parametrize("function", [plan, stability, run])
def test_an_object_of_another_class_is_named_with_what_was_expected_and_given(function: Callable[..., Any]) -> None:
    with pytest.raises(TypeError) as caught:
        function("damped_wall", estimator=METHOD, method=NUDGE)
    method, estimator = sorted(str(caught.value).splitlines(), reverse=True)
    assert method.startswith(f"{function.__name__}() method: expected a name or an Integrator, not Hand(")
    assert estimator.startswith(f"{function.__name__}() estimator: expected a name or an Estimator, not Integrator(")


def test_an_error_in_an_estimator_ends_the_run_torque_free(tmp_path: Path) -> None:
    calls = count()

    def start(setup: Any) -> Any:
        def step(position: float) -> float:
            return 1.0 / (next(calls) < 30)

        return lambda position: 0.0 * step(position)

    broken = replace(ESTIMATOR, start=start)
    with pytest.raises(SafetyTripError, match="ZeroDivisionError"):
        run("damped_wall", estimator=broken, duration=0.3, record=tmp_path / "a.csv")
    assert read_recording(tmp_path / "a.csv")["handle.command"][-1] == 0.0


MODULE = """
from dataclasses import replace
from haptic_fieldbus.numerics.estimators import estimator_named
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.sim.hand import Hand, Piece
estimator = replace(estimator_named("backward-difference"), name="added")
method = replace(METHODS["verlet"], name="added")
hand = Hand("added", (Piece(0.0, 3.0),))
light = Hand("added", mass=0.0)
"""
SORTS = {
    "estimator": (estimators.GROUP, estimators.estimator_named, 'no estimator "aded"; nearest: added'),
    "method": (integrators.GROUP, integrators.method_named, 'no method "aded"; nearest: added'),
    "hand": (hands.GROUP, hands.hand_named, 'no hand "aded"; hands are: .*, added'),
}


class Packages:
    """A folder on the path, for packages that last as long as a test."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, sort: str, at: str, module: str = MODULE, name: str = "added") -> str:
        package = f"added_{next(NUMBERS)}"
        install(self.folder, package, f"{name} = {package}:{at}", module, SORTS[sort][0])
        return package


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Packages:
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    return Packages(tmp_path / "site")


@pytest.mark.parametrize("sort", SORTS)
def test_a_package_adds_one_by_its_name(sort: str, packages: Packages) -> None:
    packages.add(sort, sort)
    named: dict[str, Any] = {sort: "added"}
    result = run("damped_sprung_mass", duration=0.05, **named)
    assert result.provenance is not None
    assert getattr(result.provenance.conditions, sort) == "added"
    with pytest.raises(UsageError, match=SORTS[sort][2]):
        SORTS[sort][1]("aded")


@pytest.mark.parametrize("sort", SORTS)
@pytest.mark.parametrize(
    ("at", "module", "told"),
    [
        ("nothing", MODULE, "it cannot be imported: AttributeError"),
        ("estimator", "raise OSError('no disk')", "it cannot be imported: OSError: no disk"),
        ("__name__", MODULE, "expected an object of .*, not str"),
    ],
)
def test_one_that_is_broken_is_told_with_package_and_entry_point(
    sort: str, at: str, module: str, told: str, packages: Packages
) -> None:
    package = packages.add(sort, at, module)
    place = rf'{sort} "added" of {package} 1\.0 \(entry point {package}:{at}\): '
    with pytest.raises(UsageError, match=f"^{place}{told}"):
        SORTS[sort][1]("added")
    run("wall", duration=0.02)


def test_one_of_another_name_and_one_that_cannot_be_simulated_are_told(packages: Packages) -> None:
    packages.add("hand", "hand", name="other")
    packages.add("hand", "light")
    with pytest.raises(UsageError, match='its name is "added"; expected that of the entry point'):
        hands.hand_named("other")
    with pytest.raises(UsageError, match=r"mass is 0\.0; expected a finite number above 0"):
        hands.hand_named("added")


def test_two_of_one_name_are_told(packages: Packages) -> None:
    packages.add("hand", "hand")
    packages.add("hand", "light")
    with pytest.raises(UsageError, match="several packages provide it; uninstall all but one"):
        hands.hand_named("added")


def test_one_that_has_the_name_of_a_shipped_one_is_not_used(packages: Packages) -> None:
    packages.add("hand", "hand", name="push")
    assert hands.hand_named("push") is HANDS["push"]
    assert load_scene("wall").name == "wall"
