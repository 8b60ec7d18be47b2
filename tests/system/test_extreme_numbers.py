"""Every number of scene, rig, profile and request, at the edge of its range and far beyond: a sentence, or a result.

The results hold no not-a-number, and no other exception than those of the package leaves it.
"""

import copy
import json
import math
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

import haptic_fieldbus
from haptic_fieldbus.documents.quantities import RANGES
from haptic_fieldbus.drive.fields import Ranged
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.explain import plan_json
from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.registry import quantities
from tests.builders import shipped

BEYOND = (1e308, -1e308, 1e-300, 5e-324, 0.0, -0.0, -1.0, 9e15, math.nan, math.inf)
EDGES = (1e-12, 1e-9, 1e-6, 1e6, 1e9)
WHOLE = (0, 1, -1, 2**8, 2**31 - 1, 2**31, 2**63, 10**300)
RIG = """\
[bus.can0]
interface = "haptic_sim"
channel = "sim"
bitrate = 1000000
listen = 0.0
[axis.handle]
bus = "can0"
node = 1
profile = "PROFILE"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
torque_constant = 0.05
rated_current = 8.0
peak_current = 20.0
raise_max_torque = true
inertia = 4e-5
viscous_damping = 1e-4
coulomb_friction = 2e-3
i_know = KNOWN
[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05
zero = 0
[axis.handle.limits]
effort = 8.0
speed = 10.0
position = [-0.1, 0.1]
drift = 0.01
acceleration = 1e4
power = 100.0
stall = 60.0
[axis.handle.simulation.coupling]
stiffness = 100.0
load_inertia = 1e-5
damping = 1e-3
backlash = 1e-3
[axis.handle.simulation.gravity]
torque = 0.01
[axis.handle.simulation.cogging]
torque = 0.001
periods_per_revolution = 12
[axis.handle.simulation.stribeck]
torque = 0.001
velocity = 1.0
""".replace("KNOWN", json.dumps(get_args(Ranged)))
"""Every value is known to be right, so that the range of a bench does not hide what comes after it."""
Key = tuple[str | int, ...]


def sentence(ask: Callable[[], object]) -> str:
    """The message with which something is refused; empty when it gives a result, which must hold numbers alone."""
    try:
        assert "NaN" not in json.dumps(ask(), default=str)
    except HapticFieldbusError as error:
        said = str(error)
    else:
        return ""
    assert said
    return said


def settings_of(name: str) -> Iterator[tuple[str, float]]:
    for element in load_scene(name).elements:
        for parameter, quantity in quantities(type(element)).items():
            edges = RANGES[quantity]
            for value in (edges.smallest, edges.largest, -edges.largest, *BEYOND):
                yield f"{element.name}.{parameter}", value


@pytest.mark.thorough("plans each scene a hundred times", quick=1)
@pytest.mark.parametrize("name", scene_names())
def test_every_parameter_of_every_scene_gives_a_sentence_or_a_plan(name: str) -> None:
    for setting, value in settings_of(name):
        changed = {setting: value}
        said = sentence(lambda changed=changed: plan_json(haptic_fieldbus.plan(name, settings=changed)))  # type: ignore[misc]
        if said and not math.isfinite(value):
            assert f"--set {setting}" in said
            assert "expected" in said
        sentence(lambda changed=changed: haptic_fieldbus.stability(name, settings=changed).to_json())  # type: ignore[misc]


def written(table: dict[str, Any], path: tuple[str, ...] = ()) -> str:
    """The TOML of a table."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict)}
    lines = [f"{json.dumps(key, ensure_ascii=False)} = {literal(value)}" for key, value in plain.items()]
    for key in table.keys() - plain.keys():
        inner = (*path, key)
        head = ".".join(json.dumps(each, ensure_ascii=False) for each in inner)
        lines += [f"[{head}]", written(table[key], inner)]
    return "\n".join(lines)


def literal(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(literal, value))}]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def numbers_of(table: Any, path: Key = ()) -> Iterator[tuple[Key, float]]:
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        if isinstance(value, dict | list):
            yield from numbers_of(value, (*path, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*path, key), value


def with_value(table: dict[str, Any], path: Key, value: float) -> dict[str, Any]:
    changed: Any = copy.deepcopy(table)
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return dict(changed)


def cases(table: dict[str, Any]) -> list[tuple[Key, float]]:
    return [
        (path, extreme)
        for path, value in numbers_of(table)
        for extreme in ((*BEYOND, *EDGES) if isinstance(value, float) else WHOLE)
    ]


def rig_with(profile: str) -> dict[str, Any]:
    return tomllib.loads(RIG.replace("PROFILE", profile))


def tried(rig: Path) -> None:
    sentence(lambda: plan_json(haptic_fieldbus.plan("damped_wall", rig=rig)))
    sentence(lambda: haptic_fieldbus.run("damper", rig=rig, duration=0.002, force=True).to_json())


TABLES = (("simulation", "objects"), ("commissioning", "shown"))
"""Tables of a hundred entries of one kind, of which the first is tried."""
RIG_KEYS = list(dict.fromkeys(path for path, _ in cases(rig_with("maxon_epos4"))))


@pytest.mark.thorough("plans and runs a dozen rigs for each key", quick=1)
@pytest.mark.parametrize("key", RIG_KEYS, ids=lambda key: ".".join(map(str, key)))
def test_every_number_of_a_rig_gives_a_sentence_or_a_run(key: Key, tmp_path: Path) -> None:
    table, path = rig_with("maxon_epos4"), tmp_path / "rig.toml"
    for where, value in cases(table):
        if where == key:
            path.write_text(written(with_value(table, key, value)), encoding="utf-8")
            tried(path)


@pytest.mark.thorough("plans and runs a dozen rigs for each key of a profile")
@pytest.mark.parametrize("name", shipped())
def test_every_number_of_a_profile_gives_a_sentence_or_a_run(name: str, tmp_path: Path) -> None:
    table = tomllib.loads((profile_folder() / f"{name}.toml").read_text(encoding="utf-8"))
    rig = tmp_path / "rig.toml"
    rig.write_text(written(rig_with("own.toml")), encoding="utf-8")
    for path, value in cases(table):
        first, second, *rest = (*path, "")
        if (first, second) in TABLES and rest[0] not in (0, next(iter(table[str(first)][str(second)]))):
            continue
        (tmp_path / "own.toml").write_text(written(with_value(table, path, value)), encoding="utf-8")
        tried(rig)


@pytest.mark.thorough("plans and runs with every profile")
def test_the_rig_and_the_profiles_of_these_tests_are_sound(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    for name in (each for each in shipped() if load_profile(each).drive.usable):
        rig.write_text(written(rig_with(name)), encoding="utf-8")
        assert sentence(lambda: plan_json(haptic_fieldbus.plan("damped_wall", rig=rig))) == ""
        assert not haptic_fieldbus.run("damper", rig=rig, duration=0.002, force=True).trips


@pytest.mark.thorough("5 cases of one rule", quick=2)
@pytest.mark.parametrize("option", ["mass", "damping", "coulomb", "resolution", "delay"])
def test_every_value_of_a_device_gives_a_sentence_or_limits(option: str) -> None:
    for value in (*BEYOND, *EDGES):
        device = {"mass": 0.1, option: value}
        sentence(lambda device=device: haptic_fieldbus.stability("damped_wall", **device).to_json())  # type: ignore[misc]


@pytest.mark.parametrize("value", [*BEYOND, *EDGES])
def test_every_rate_duration_and_amplitude_gives_a_sentence_or_a_response(value: float) -> None:
    sentence(lambda: plan_json(haptic_fieldbus.plan("wall", rate=value)))
    sentence(lambda: haptic_fieldbus.response("sprung_mass", rate=value, duration=0.01).to_json())
    sentence(lambda: haptic_fieldbus.response("sprung_mass", rate=10.0, duration=min(value, 1e9)).to_json())
    sentence(lambda: haptic_fieldbus.response("sprung_mass", amplitude=value, duration=0.01).to_json())
    sentence(lambda: haptic_fieldbus.response("sprung_mass", input=f"sine@{value}", duration=0.01).to_json())


@pytest.mark.parametrize("seed", [-1, 2**64, 10**1000])
def test_a_seed_out_of_range_is_refused(seed: int) -> None:
    assert "expected a whole number from 0" in sentence(lambda: haptic_fieldbus.run("wall", seed=seed))


def test_the_struct_error_of_a_rated_torque_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    huge = RIG.replace("PROFILE", "maxon_epos4").replace("rated_torque = 0.4", "rated_torque = 9e5")
    path.write_text(f'{huge}[axis.handle.seen]\nsign = "seen"\n')
    assert "expected at most" in sentence(lambda: haptic_fieldbus.run("wall", rig=path, duration=0.01, force=True))
