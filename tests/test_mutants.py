"""Which changes a mutation run makes (`python -m tests.mutation`)."""

import ast
from collections import Counter

import pytest

from tests.mutation.__main__ import PROJECT, ROOMS, diff
from tests.mutation.mutants import chosen, mutants

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


@pytest.mark.thorough("finds all mutants of three rooms")
def test_the_same_seed_chooses_the_same_and_every_room_has_its_share() -> None:
    made = chosen(PROJECT, ROOMS, 100, 1)
    assert made == chosen(PROJECT, ROOMS, 100, 1) != chosen(PROJECT, ROOMS, 100, 2)
    assert len(made) == len({(mutant.file, mutant.line) for mutant in made}) == 100
    assert min(Counter(mutant.room for mutant in made)[room] for room in ROOMS) > 5


def test_every_mutant_is_a_program_that_differs() -> None:
    for mutant in chosen(PROJECT, ROOMS, 50, 1):
        source = (PROJECT / mutant.file).read_bytes()
        ast.parse(mutant.apply(source))
        assert diff(mutant, source)
