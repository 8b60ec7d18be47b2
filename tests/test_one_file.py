"""Adding one thing is one file, tried: in a copy of this checkout, by the steps that a person takes.

After each step the tests must say what is missing; after the last one, and the generators, the contract of the kind
must hold, and no other file may have changed.
"""

from pathlib import Path

import pytest

from tests.checkouts import Checkout, copied
from tests.new_things import THINGS, NewThing

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
    hold(checkout, thing)


def hold(checkout: Checkout, thing: NewThing) -> None:
    """The thing is complete, tests of its kind chose it by its name, and it passes them."""
    asked = [thing.name, *(test.partition("::")[2] for test in thing.complete)]
    held = checkout.test(*thing.complete, *thing.contract, "-k", " or ".join(filter(None, asked)), "-rA")
    assert held.returncode == 0, held.stdout
    assert any(line.startswith("PASSED") and thing.name in line for line in held.stdout.splitlines())
