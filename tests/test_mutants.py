"""Which changes a mutation run makes (`python -m tests.mutation`)."""

import ast
from collections import Counter

import pytest
from coverage import CoverageData

from tests.mutation.__main__ import ROOMS, ROOMS_OF_CONSTANTS, diff
from tests.mutation.mutants import STATED, chosen, chosen_constants, mutants, scaled
from tests.mutation.reach import PROJECT, Reach, uses

CHANGES = {
    "x = a < b": {"x = (a <= b)"},
    "x = a + b": {"x = (a - b)"},
    "x = a and b": {"x = (a or b)"},
    "x = not a": {"x = (a)"},
    "x = 2": {"x = 3"},
    "x = True": {"x = False"},
    "x = [a for a in b if c]": {"x = [a for a in b if (not (c))]"},
    "x = a if b else c": {"x = a if (not (b)) else c"},
    "while a:\n    break": {"while (not (a)):\n    break", "while a:\n    pass"},
    "f(x)": {"pass"},
    "raise Wrong(f'{2 + 2} is wrong')": {"pass"},
    "x.y += z": {"pass"},
    "x.y = z": {"pass"},
    "def f() -> bool:\n    return x": {"def f() -> bool:\n    return not (x)"},
    "def f() -> int | None:\n    return x": {"def f() -> int | None:\n    return None"},
    "def f(a: Literal[2] = b) -> int:\n    '''Take 2.'''\n    return x": set(),
    "x = f'{a + b:3}', 'text'": set(),
    "Number = int | None": set(),
    "x = 'ä' < y": {"x = ('ä' <= y)"},
}


@pytest.mark.parametrize("before", CHANGES)
def test_each_kind_of_change_is_made_and_texts_and_types_are_left_alone(before: str) -> None:
    made = mutants("haptic_fieldbus/drive/x.py", before.encode())
    assert {mutant.apply(before.encode()).decode() for mutant in made} == CHANGES[before]


def test_a_mutant_stands_in_the_lines_of_its_statement() -> None:
    source = b"x = [\n    1,\n]\ndef f():\n    if (a or\n            b):\n        g()\n"
    found = {mutant.text: mutant for mutant in mutants("haptic_fieldbus/drive/x.py", source)}
    assert {text: (each.line, each.first, each.last, each.at_import) for text, each in found.items()} == {
        "2": (2, 1, 3, True),
        "(a and b)": (5, 5, 6, False),
        "(not (a or b))": (5, 5, 6, False),
        "pass": (7, 7, 7, False),
    }


SCALED = {
    "LIMIT = 0.005": {"LIMIT = (4 * (0.005))", "LIMIT = (type(0.005)((0.005) / 4))"},
    "class A:\n    MOST = 4": {"class A:\n    MOST = (4 * (4))", "class A:\n    MOST = (type(4)((4) / 4))"},
    "MASK, INDEX, BITS, NAME, IS = 0x10, 1, 2, 3, 4": set(),
    "INDEX = 0x6071": set(),
    "SIZE = 1 << 16": set(),
    "NAME = 'handle'": set(),
    "IS_ON = True": set(),
    "step = 0.5": set(),
    "def f():\n    return 3 * x[1] + 0.0": set(),
    "def f():\n    return 0.5 * x": {
        "def f():\n    return (4 * (0.5)) * x",
        "def f():\n    return (type(0.5)((0.5) / 4)) * x",
    },
}


@pytest.mark.parametrize("before", SCALED)
def test_quantities_are_changed_by_a_factor_and_names_of_bits_are_left_alone(before: str) -> None:
    made = scaled("haptic_fieldbus/cycle/x.py", before.encode())
    assert {mutant.apply(before.encode()).decode() for mutant in made} == SCALED[before]


def test_each_constant_that_a_decision_states_is_there_and_changed_by_a_fifth() -> None:
    for file, names in STATED.items():
        made = scaled(file, (PROJECT / file).read_bytes())
        assert {each.constant for each in made if each.kind == "constant × 1.2"} == set(names), file


@pytest.mark.thorough("reads the whole package")
def test_a_constant_is_reached_where_a_function_reads_it_also_in_another_module() -> None:
    made = chosen_constants(PROJECT, ROOMS_OF_CONSTANTS, 10_000, 1)
    assert len(made) > 300
    (gap,) = [each for each in made if each.constant == "LARGEST_MISSING_SHARE" and each.kind == "constant × 4"]
    read = uses(gap)
    assert read.keys() == {
        "haptic_fieldbus/cycle/gaps.py",
        "haptic_fieldbus/cycle/axis.py",
        "haptic_fieldbus/planning/axis_plan.py",
        "haptic_fieldbus/planning/energy.py",
        "haptic_fieldbus/planning/explain.py",
    }
    for file, lines in read.items():
        source = (PROJECT / file).read_text().splitlines()
        assert all("LARGEST_MISSING_SHARE" in source[line - 1] for line in lines)
        assert not any(source[line - 1].startswith("LARGEST_MISSING_SHARE") for line in lines)


@pytest.mark.thorough("reads the whole package")
def test_a_constant_that_an_untraced_room_reads_is_reached_by_all_tests_of_that_room() -> None:
    """The largest torque above the limit stands in `planning`, and `api` alone reads it."""
    made = chosen_constants(PROJECT, ROOMS_OF_CONSTANTS, 10_000, 1)
    (share,) = [each for each in made if each.constant == "BEYOND_SHARE" and each.kind == "constant × 4"]
    names = ("tests/api/test_certification.py::test_a", "tests/planning/test_limits.py::test_b")
    reach = Reach("quick", CoverageData(no_disk=True), {name: (1.0, True, []) for name in names})
    assert reach.of(share) == {names[0]}


@pytest.mark.thorough("finds all mutants of three rooms")
def test_the_same_seed_chooses_the_same_and_every_room_has_its_share() -> None:
    made = chosen(PROJECT, ROOMS, 100, 1)
    assert made == chosen(PROJECT, ROOMS, 100, 1) != chosen(PROJECT, ROOMS, 100, 2)
    assert len(made) == len({(mutant.file, mutant.line) for mutant in made}) == 100
    assert min(Counter(mutant.room for mutant in made)[room] for room in ROOMS) > 5


@pytest.mark.thorough("compiles every mutant")
def test_every_mutant_is_a_program_that_differs() -> None:
    for mutant in chosen(PROJECT, ROOMS, 50, 1):
        source = (PROJECT / mutant.file).read_bytes()
        ast.parse(mutant.apply(source))
        assert diff(mutant, source)
