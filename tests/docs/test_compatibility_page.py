"""docs/reference/compatibility.md promises what there is: exit statuses, and every key of `--json`."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus import run
from haptic_fieldbus.assessing.result import Stopped, TripRecord
from haptic_fieldbus.cli import main
from haptic_fieldbus.cli.failures import OUTCOMES
from haptic_fieldbus.drive.rig import Identified
from haptic_fieldbus.drive.rig_units import rig_text as toml_of
from haptic_fieldbus.eds import eds_text
from tests.api.test_identification import rig_text
from tests.eds.sheets import generic
from tests.identification.twins import LASTING, hidden_bench, recorded
from tests.scenes.packages import install

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "compatibility.md").read_text(encoding="utf-8")
OBJECTS = {
    row[0]: set(re.findall(r"`(\w+)`", row[1])) for row in re.findall(r"^\| `([^`]+)` \| (.*) \|$", TEXT, re.MULTILINE)
}
STATUSES = dict(re.findall(r"^\| (\d+) \| [^|]* \|(.*)\|$", TEXT, re.MULTILINE))

COMMANDS = {
    "run": "run wall --duration 1.2 --change 0.6:wall.stiffness=700",
    "plan": "plan virtual_shaft",
    "stability": "stability wall",
    "response": "response sprung_mass",
    "response --model": "response sprung_mass --model",
    "estimate": "estimate signal.csv",
    "replay": "replay run.csv --compare",
    "sweep": "sweep wall --grid rate=500,1000",
    "scan": "scan",
    "doctor": "doctor",
    "watch": "watch --duration 0.5",
    "identify": "identify --rig rig.toml --bus sim",
    "twin": "twin motion.csv --rig twin.toml",
    "profiles list": "profiles list",
    "profiles check": "profiles check maxon_epos4",
    "profiles check --eds": "profiles check nanotec_c5_e --eds push1.eds",
    "profiles new": "profiles new --eds push1.eds",
    "scenes list": "scenes list",
    "scenes show": "scenes show wall",
    "scenes check": "scenes check wall no_such_scene",
    "a failed command": "plan no_such_scene",
}
BY_NAMES_OF_THEIR_OWN = ("by_source", "booked_j", "settings", "age_s", "states", "elements", "axes", "growth", "depth",
                          "versions", "drives", "columns", "values")  # fmt: skip
"""Objects whose keys are not ours, and those that a page of their own lists."""


def objects_of(value: Any, at: str) -> Iterator[tuple[str, set[str]]]:
    """Every object inside another one, by where it stands; of a list, the first."""
    if isinstance(value, list):
        value, at = value[0] if value else None, f"{at}[]"
    if isinstance(value, dict):
        yield at, set(value)
        for key, member in value.items():
            if key not in BY_NAMES_OF_THEIR_OWN:
                yield from objects_of(member, f"{at}.{key}" if ": " in at else f"{at}: {key}")


def test_the_page_tells_of_every_command_that_prints_an_object() -> None:
    assert {name.partition(":")[0] for name in OBJECTS} == set(COMMANDS)


@pytest.mark.thorough("every command that prints an object", quick=3)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_prints_the_keys_of_the_page(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a package adds an element."""
    install(tmp_path, "page_elements", "own = page_elements:Own")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    Path("push1.eds").write_text(eds_text(generic()), encoding="utf-8")
    Path("signal.csv").write_text("time,position\n0,0\n0.1,1\n", encoding="utf-8")
    Path("rig.toml").write_text(rig_text(), encoding="utf-8")
    if name == "replay":
        run("wall", duration=0.05, record="run.csv")
    if name == "twin":
        bench = hidden_bench(3)
        recorded(bench, LASTING[0], Path("motion.csv"), 6.0, 1)
        other = replace(
            bench.stated.axis["handle"], identified=Identified(inertia=1e-5, inertia_interval=(9e-6, 1.1e-5))
        )
        Path("twin.toml").write_text(
            toml_of(replace(bench.stated, axis={"handle": other}), "A twin."), encoding="utf-8"
        )
    with pytest.raises(SystemExit):
        main([*COMMANDS[name].split(), "--json"])
    told = dict(objects_of(json.loads(capsys.readouterr().out), name))
    same = {"run: stability": "stability", "plan: stability": "stability", "run: plan.left_out[]": "plan: left_out[]"}
    same |= {"run: deadlines[]": "plan: deadlines[]"}
    same |= {f"run: timing.{time}": "run: timing.period_us" for time in ("age_us", "compute_us", "lateness_us")}
    for at, keys in told.items():
        known = next((at.replace(start, there, 1) for start, there in same.items() if at.startswith(start)), at)
        known = known.replace("stability.", "stability: ", 1)
        known = "stability: limit" if known.endswith(": limit") else known
        # Run and plan tell what is assumed, and plan the ways of exchange, once, beside the rest of the plan.
        assert OBJECTS[known] - ({"assumed", "ways"} if at.endswith(": stability") else set()) == keys, at
    promised = {at for at in OBJECTS if at == name or at.startswith(f"{name}: ")}
    assert promised <= told.keys() | {
        "run: trips[]",
        "run: stopped",
        "stability: own_laws[]",
        "replay: first_difference",
    }


def test_a_trip_has_the_keys_of_the_page() -> None:
    shown = TripRecord("speed limit", 0.5, "").to_json()
    assert isinstance(shown, dict)
    assert set(shown) == OBJECTS["run: trips[]"]


def test_a_run_that_was_stopped_has_the_keys_of_the_page() -> None:
    shown = Stopped("SIGINT", 0.5, 1.0, "").to_json()
    assert isinstance(shown, dict)
    assert set(shown) == OBJECTS["run: stopped"]


def test_the_exit_statuses_are_those_of_the_errors() -> None:
    for error, outcome in OUTCOMES.items():
        assert f"`{error.__name__}`" in STATUSES[str(outcome.status)]
    assert set(STATUSES) == {"0", *(str(outcome.status) for outcome in OUTCOMES.values())}
