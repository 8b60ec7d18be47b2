"""What `plan` says of each library scene on each profile is what was read and found good."""

import pytest

from tests.golden.plans import FOLDER, cases, text_of


@pytest.mark.parametrize(("scene", "profile"), cases())
def test_the_plan_reads_as_before(scene: str, profile: str) -> None:
    path = FOLDER / f"plan_{scene}_{profile}.txt"
    assert path.exists(), f"new scene or profile: python -m tests.golden writes {path.name}; read it, then commit it"
    assert text_of(scene, profile) == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    assert {path.name for path in FOLDER.glob("plan_*.txt")} == {f"plan_{s}_{p}.txt" for s, p in cases()}
