"""Adding one thing is one file, tried: in a copy of this checkout, by the steps that a person takes.

After each step the tests must say what is missing. With one thing of each kind in one copy, written by its guide, every
test of the quick lane must pass, and no other file may have changed.
"""

from pathlib import Path

import pytest

from tests.checkouts import Checkout, copied
from tests.new_things import THINGS

BY_HAND = {"profile": 1, "scene": 1, "element": 3, "integrator": 3, "estimator": 2}
"""Files that a person touches; of an element and an integrator, one is the sheet that they are held to."""
CHANGED = {"profile": 3}
"""The most files that may differ at the end, where few are promised."""


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    copy = copied(tmp_path / "copy")
    for words in (("init", "-q"), ("add", "-A"), ("-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", "t")):
        done = copy.call("git", *words)
        assert done.returncode == 0, done.stderr
    return copy


@pytest.mark.thorough("runs the tests of a kind and its generators in a copy")
@pytest.mark.parametrize("kind", THINGS)
def test_one_thing_is_added_by_what_the_tests_say(kind: str, checkout: Checkout) -> None:
    thing = THINGS[kind]
    for step in thing.steps:
        checkout.take(step)
        failed = checkout.test(*thing.complete)
        assert failed.returncode == 1, failed.stdout + failed.stderr
        assert step.says in failed.stdout
    by_hand = checkout.changed()
    assert by_hand == {step.path for step in thing.steps}
    assert len(by_hand) <= BY_HAND[kind]
    for generator in thing.generators:
        checkout.generate(generator)
    assert checkout.changed() - by_hand == set(thing.generated)
    assert len(checkout.changed()) <= CHANGED.get(kind, len(checkout.changed()))
    held = checkout.test(*thing.complete)
    assert held.returncode == 0, held.stdout


def add_all(checkout: Checkout) -> None:
    """One thing of each kind, by hand."""
    for thing in THINGS.values():
        for step in thing.steps:
            checkout.take(step)


@pytest.mark.thorough("runs the whole quick lane in a copy")
def test_with_one_more_of_each_kind_every_quick_test_passes(checkout: Checkout) -> None:
    add_all(checkout)
    for generator in dict.fromkeys(each for thing in THINGS.values() for each in thing.generators):
        checkout.generate(generator)
    named = {path for thing in THINGS.values() for path in (*thing.generated, *(step.path for step in thing.steps))}
    assert checkout.changed() == named
    held = checkout.test("-n", "2", "--dist", "loadgroup")
    assert held.returncode == 0, held.stdout


@pytest.mark.thorough("copies the package")
def test_with_one_more_of_each_kind_the_cheap_tests_over_the_kinds_pass(tmp_path: Path) -> None:
    """These need no generated file; a run of the thorough lane has all others too."""
    checkout = copied(tmp_path / "copy")
    add_all(checkout)
    held = checkout.test(*(test for thing in THINGS.values() for test in thing.cheap), "-rA")
    assert held.returncode == 0, held.stdout
    assert "mostly-implicit" in held.stdout
