"""Where our sign of life stands among the frames of a period, and what it costs at the highest rate."""

import re
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import pytest

from haptic_fieldbus import run
from haptic_fieldbus.assessing.loop_report import LoopReport

HEARTBEAT, SYNC, RPDO = "77F", "080", "201"


def order(path: Path, rate: float) -> set[str]:
    """Return what precedes our heartbeats in a run at this rate [Hz]."""
    run("wall", drive="generic_cia402", rate=rate, duration=0.1, hand="none", record=path)
    sent = [can_id for can_id in re.findall(r" ([0-9A-F]{3})#", path.read_text()) if can_id in (HEARTBEAT, SYNC, RPDO)]
    enabled = sent[len(sent) // 2 : -20]  # before the way to zero torque
    return {before for before, can_id in pairwise(enabled) if can_id == HEARTBEAT}


@pytest.mark.parametrize(("rate", "before"), [(1000.0, RPDO), (3000.0, SYNC)])
def test_it_follows_the_set_points_or_sync_where_it_has_no_room_there(tmp_path: Path, rate: float, before: str) -> None:
    assert order(tmp_path / "run.log", rate) == {before}


def test_at_the_highest_rate_hardly_a_sample_is_late() -> None:
    """Behind the set-points each of the 100 heartbeats a second would make one late."""
    late, count = [0], LoopReport.count

    def counted(report: LoopReport, latch_ns: int, length_ns: int, age_ns: int, compute_ns: int, late_ns: int) -> int:
        late[0] += age_ns >= report.period_ns
        return count(report, latch_ns, length_ns, age_ns, compute_ns, late_ns)

    with patch.object(LoopReport, "count", counted):
        report = run("wall", drive="generic_cia402", rate=3000.0, duration=0.5, hand="none")
    assert report.cycles == 1500
    assert late[0] <= 5, "those of the drive's own heartbeats, 10 a second"
