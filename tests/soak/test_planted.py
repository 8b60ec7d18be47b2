"""Ten bugs that the soak has found once: their shrunk faults still show them, and show nothing without them."""

import json
from pathlib import Path

import pytest

from tests.soak.planted import MOST_FAULTS, MOST_RUNS, PLANTED, PROJECT, Planted, called, copy_of, kept

FOUND = {each["bug"]: each for each in kept()}
BUGS = pytest.mark.parametrize("bug", PLANTED, ids=lambda bug: bug.name)


@BUGS
def test_a_bug_has_its_place_and_was_found_soon(bug: Planted) -> None:
    assert (PROJECT / bug.file).read_text(encoding="utf-8").count(bug.old) == 1
    found = FOUND[bug.name]
    assert found["runs"] <= MOST_RUNS
    assert found["faults"].count("[[fault]]") <= MOST_FAULTS


@pytest.mark.thorough("two processes for each of ten bugs")
@BUGS
def test_a_bug_is_shown_by_its_seed_and_by_nothing_else(bug: Planted, tmp_path: Path) -> None:
    found, file = FOUND[bug.name], tmp_path / "faults.toml"
    file.write_text(found["faults"], encoding="utf-8")
    assert json.loads(called(PROJECT, "replay", str(found["seed"]), str(file))) == []
    tree = copy_of(PROJECT, tmp_path / "tree")
    bug.apply(tree)
    assert found["law"] in json.loads(called(tree, "replay", str(found["seed"]), str(file)))


def test_there_are_ten() -> None:
    assert len({bug.name for bug in PLANTED}) == 10
