"""Arguments that nobody means: each is refused with its name, what was expected and what was given, by no traceback."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
import pytest

import haptic_fieldbus as package
from haptic_fieldbus import Changes, Rig, Scene, SceneAxis, Signal, Workspace, plan, response, run, stability
from haptic_fieldbus.api.estimation import SignalRequest, estimate_from
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.wall import Wall
from tests.cases import every
from tests.cli.command import Command

AXES = (SceneAxis("handle", Workspace.LINEAR),)
BENCH = load(Task("wall")).rig


@dataclass(frozen=True)
class NoModel:
    """An element without `linearised`."""

    axis: str = "handle"
    name: str = "no_model"
    needs: ClassVar = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return 0.0


class Shy:
    """An object that does not even show itself."""

    def __repr__(self) -> str:
        raise RuntimeError


def made(*elements: object, **changes: object) -> Scene:
    given: dict[str, Any] = {"axes": AXES, "elements": elements, "name": "mine"} | changes
    return Scene(description="", **given)


def estimate(**given: Any) -> object:
    return estimate_from(SignalRequest(**given))


WRONG_KINDS: list[tuple[Callable[..., object], Mapping[str, Any], str]] = [
    (run, {"scene": 42}, r"run\(\) scene: expected a name of the library, a path or a Scene, not 42 \(int\)"),
    (plan, {"scene": None}, r"plan\(\) scene: expected .* not None \(NoneType\)"),
    (response, {"scene": Wall("handle", 100.0)}, r"response\(\) scene: expected .* \(Wall\)"),
    (stability, {"scene": ["wall"]}, r"stability\(\) scene: expected .* not \['wall'\] \(list\)"),
    (run, {"scene": Shy()}, r"run\(\) scene: expected .* not \(Shy\)"),
    (run, {"duration": "1 s"}, r"run\(\) duration: expected a number in s, not '1 s' \(str\)"),
    (run, {"duration": None}, r"run\(\) duration: expected a number in s, not None \(NoneType\)"),
    (run, {"duration": True}, r"run\(\) duration: expected a number in s, not True \(bool\)"),
    (run, {"duration": 10**400}, r"run\(\) duration: expected a number in s, not 10{59}… \(int\)"),
    (run, {"rate": "1kHz"}, r"run\(\) rate: expected a number in Hz, not '1kHz' \(str\)"),
    (plan, {"rate": Fraction(1000)}, r"plan\(\) rate: expected a number in Hz, not Fraction\(1000, 1\)"),
    (plan, {"rate": np.array([1e3])}, r"plan\(\) rate: expected a number in Hz, not array"),
    (run, {"estimator": lambda position: position}, r"run\(\) estimator: expected a name or an Estimator, not <f"),
    (run, {"method": 3}, r"run\(\) method: expected a name or an Integrator, not 3 \(int\)"),
    (run, {"drive": 3, "bus": 5}, r"run\(\) drive: .* not 3 \(int\)\nrun\(\) bus: .* not 5 \(int\)"),
    (run, {"bus": ""}, r"run\(\) bus: expected a name, not '' \(str\)"),
    (run, {"node": "1"}, r"run\(\) node: expected a whole number, not '1' \(str\)"),
    (run, {"node": 1.0}, r"run\(\) node: expected a whole number, not 1\.0 \(float\)"),
    (run, {"seed": 1.5}, r"run\(\) seed: expected a whole number, not 1\.5 \(float\)"),
    (run, {"hand": ["push"]}, r"run\(\) hand: expected a name or a Hand, not \['push'\] \(list\)"),
    (run, {"settings": ["wall.stiffness=3"]}, r"run\(\) settings: expected a mapping such as"),
    (run, {"settings": {3: 4}}, r"run\(\) settings: expected a mapping such as .* not \{3: 4\} \(dict\)"),
    (run, {"settings": {"wall.stiffness": None}}, r"settings: wall\.stiffness: expected a number, .* not None"),
    (run, {"axes": {"handle": 3}}, r"run\(\) axes: expected a mapping of names"),
    (run, {"zero": 0}, r"run\(\) zero: expected a name, not 0 \(int\)"),
    (run, {"profiles": 3}, r"run\(\) profiles: expected a path, not 3 \(int\)"),
    (run, {"rig": 3}, r"run\(\) rig: expected the path of a rig file, or a Rig of buses and axes, not 3 \(int\)"),
    (run, {"rig": Rig({}, {})}, r"run\(\) rig: expected .* not Rig\("),
    (run, {"rig": replace(BENCH, axis=cast(Any, {"handle": 3}))}, r"run\(\) rig: expected .* not Rig\("),
    (run, {"fade_in": "1"}, r"run\(\) fade_in: expected a number in s, not '1' \(str\)"),
    (run, {"faults": ["node_reset"]}, r"run\(\) faults: expected a path, random@SEED or a list of faults"),
    (run, {"record": 3}, r"run\(\) record: expected a path, not 3 \(int\)"),
    (run, {"force": "no"}, r"run\(\) force: expected True or False, not 'no' \(str\)"),
    (run, {"changes": 3}, r"run\(\) changes: expected a Changes, or a list such as .* not 3 \(int\)"),
    (run, {"changes": [3]}, r"changes: expected pairs of a time in s and settings, such as .* not 3 \(int\)"),
    (run, {"changes": [("1", {})]}, r"changes: expected pairs of a time in s and settings, .* not \('1', \{\}\)"),
    (run, {"confirm": True}, r"run\(\) confirm: expected a function, not True \(bool\)"),
    (Changes, {"scheduled": 3}, r"changes: expected pairs of a time in s and settings, .* not 3 \(int\)"),
    (Changes, {"ramp": "x"}, r"ramp: expected a number in s, not 'x' \(str\)"),
    (stability, {"mass": "1 kg"}, r"stability\(\) mass: expected a number, not '1 kg' \(str\)"),
    (response, {"input": 3}, r"response\(\) input: expected a path, not 3 \(int\)"),
    (response, {"amplitude": "5mm"}, r"response\(\) amplitude: expected a number, not '5mm' \(str\)"),
    (estimate, {"file": 3}, r"estimate_from\(\) file: expected a path, not 3 \(int\)"),
    (package.load_scene, {"name_or_path": 3}, r"name: expected a name or a path, not 3 \(int\)"),
    (package.load_scene, {"name_or_path": "wall", "settings": [1]}, r"settings: expected a mapping such as"),
    (package.load_profile, {"name_or_path": 3}, r"name: expected a name or a path, not 3 \(int\)"),
    (package.load_rig, {"path": 3}, r"path: expected that of a rig file, not 3 \(int\)"),
    (run, {"scene": made(NoModel())}, r"scene: elements: expected an element with linearised, not NoModel\("),
    (run, {"scene": made("wall")}, r"scene: elements: expected an element with name, needs, .* not 'wall' \(str\)"),
    (run, {"scene": made(elements=Wall("handle", 1.0))}, r"scene: elements: expected a tuple of elements, not Wall"),
    (run, {"scene": made(axes=())}, r"scene: axes: expected a tuple of at least one SceneAxis, not \(\) \(tuple\)"),
    (run, {"scene": made(axes=("handle",))}, r"scene: axes: expected a SceneAxis of .* not 'handle' \(str\)"),
    (run, {"scene": made(axes=(SceneAxis("handle", "linear"),))}, r"scene: axes: expected a SceneAxis of"),  # type: ignore[arg-type]
    (run, {"scene": made(name=3)}, r"scene: name: expected a text, not 3 \(int\)"),
    (run, {"scene": made(passivity="x")}, r"scene: passivity: expected observer or controller, not 'x' \(str\)"),
]  # fmt: skip


@every(("call", "given", "told"), WRONG_KINDS, ids=[told for *_, told in WRONG_KINDS])
def test_an_argument_of_the_wrong_kind_is_told_by_name_with_what_was_expected_and_given(
    call: Callable[..., object], given: Mapping[str, Any], told: str
) -> None:
    of_a_scene = call in (run, plan, stability, response) and "scene" not in given
    with pytest.raises(TypeError, match=f"^{told}"):
        call(**({"scene": "wall"} | dict(given) if of_a_scene else given))


WRONG_VALUES: list[tuple[Mapping[str, Any], str]] = [
    ({"duration": math.nan}, "duration"), ({"duration": -1}, "duration"), ({"rate": math.inf}, "rate"),
    ({"estimator": "nope"}, "estimator"), ({"method": "rk5"}, "method"), ({"drive": "nope"}, "profile"),
    ({"bus": "sim@1m"}, "bus"), ({"bus": "sim@" + "9" * 5000}, "bus"), ({"node": 10**30}, "node"),
    ({"seed": -1}, "seed"), ({"hand": "foot"}, "hand"), ({"settings": {"wall.stiffness": [1]}}, "wall.stiffness"),
    ({"settings": {"wall.stiffness": math.nan}}, "wall.stiffness"), ({"settings": {"wall": 3}}, "--set wall"),
    ({"settings": {"wall.stiffness": 10**400}}, "wall.stiffness"), ({"settings": {"wall.name": "x"}}, "wall.name"),
    ({"settings": {"wall.position": 20}}, "wall.position"), ({"axes": {"nope": "handle"}}, "--axis"),
    ({"rig": ""}, "folder"), ({"rig": "/nope.toml"}, "/nope.toml"), ({"zero": "there"}, "--zero"),
    ({"fade_in": 0}, "fade-in"), ({"faults": "random@x"}, "faults"), ({"record": "x.txt"}, "record"),
    ({"profiles": "/nope"}, "profiles"), ({"changes": [(99.0, {"wall.stiffness": 3.0})]}, "change at 99 s"),
    ({"changes": [(1.0, {})]}, "change"), ({"scene": ""}, "scene"),
    ({"scene": made(Wall("handle", -1.0))}, "wall.stiffness"),
    ({"rig": replace(BENCH, axis={"handle": replace(BENCH.axis["handle"], node=-1)})}, "axis.handle.node"),
]  # fmt: skip


@every(("given", "name"), WRONG_VALUES, ids=[f"{name}, {number}" for number, (_, name) in enumerate(WRONG_VALUES)])
def test_an_argument_of_a_wrong_value_is_told_by_name(given: Mapping[str, Any], name: str) -> None:
    with pytest.raises(HapticFieldbusError) as refused:
        run(**({"scene": "wall"} | dict(given)))
    assert name in str(refused.value)
    assert isinstance(refused.value, ValueError), "usage, and no failure of bus or drive"


COMMANDS = [
    ("run wall --rate 1khz", "--rate"), ("run wall --rate 0", "rate"), ("run wall --duration 1,5", "--duration"),
    ("run wall --duration -1", "duration"), ("run wall --fade-in x", "--fade-in"), ("run wall --node x", "--node"),
    ("run wall --node 500", "node"), ("run wall --seed -1", "seed"), ("run wall --hand foot", "hand"),
    ("run wall --set", "--set"), ("run wall --set x", "--set"), ("run wall --set wall.stiffness=1n/mm", "--set"),
    ("run wall --set wall.stiffness=100,5", "--set"), ("run wall --set wall.position=20", "wall.position"),
    ("run wall --change 0.5", "--change"), ("run wall --change x:wall.stiffness=3", "--change"),
    ("run wall --bus sim@1m", "bus"), ("run wall --bus can0", "bus"), ("run wall --drive nope", "profile"),
    ("run wall --rig /tmp", "/tmp"), ("run wall --rig x.toml --node 3", "--node"), ("run wall --axis x", "--axis"),
    ("run wall --zero there", "--zero"), ("run wall --faults random@x", "faults"),
    ("run wall --record x.txt", "record"),
    ("run wall --plot x.txt", "plot"), ("run wall --method rk5", "method"), ("run wall --estimator x", "estimator"),
    ("run wall --estimator low-pass:x=1", "low-pass"), ("run nope", "nope"), ("run", "SCENE"),
    ("plan wall --nope", "--nope"),
    ("stability wall --mass 0,5", "--mass"), ("stability wall --damping 1", "mass"),
    ("response wall --input hop", "input"), ("response wall --amplitude 5mm", "--amplitude"),
    ("response wall --input sine@1,5", "input"), ("estimate /nope.csv", "/nope.csv"),
    ("scan --bus nope", "nope"), ("doctor --rate 1khz", "--rate"), ("watch --duration x", "--duration"),
    ("profiles show nope", "nope"), ("scenes show nope", "nope"), ("nope", "nope"),
]  # fmt: skip
"""Words of a command line, and what its message names."""


@every(("words", "name"), COMMANDS)
def test_a_command_line_that_nobody_means_ends_with_2_and_the_name_of_the_argument(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: str, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(*words.split())
    assert (done.status, done.out) == (2, "")
    assert name in done.err
    assert "Traceback" not in done.err


def test_an_element_may_be_of_ones_own_and_numbers_of_numpy() -> None:
    element: AnyElement = Wall("handle", 500.0)
    settings = {"wall.stiffness": np.float64(400.0)}
    numbers: dict[str, Any] = {"rate": np.float32(500.0), "node": np.int64(3)}
    planned = plan(made(element), settings=settings, **numbers)
    assert (planned.rate, planned.axes[0].node) == (500.0, 3)


def test_an_empty_name_is_refused_where_a_default_would_hide_it() -> None:
    with pytest.raises(UsageError, match='no scene ""'):
        run("")
