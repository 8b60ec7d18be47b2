"""What `plan` says of a scene on a drive that offers velocity only is what was read and found good."""

from pathlib import Path

from tests.golden.plans import VELOCITY_ONLY, velocity_only_text


def test_the_plan_reads_as_before(tmp_path: Path) -> None:
    assert velocity_only_text(tmp_path) == VELOCITY_ONLY.read_text(encoding="utf-8")
