"""A run in real time is as punctual, and as strong, whatever its page or the server of the page does."""

from pathlib import Path

import numpy as np
import pytest

from tests.peers.hosts import free_port, require_multicast
from tests.view.lateness import KILLED, QUIET, RELOADS, SEGMENT, STATES, measured
from tests.view.served import CHROMIUM, DRIVER, chromium

pytestmark = [
    pytest.mark.thorough("two processes in real time and a browser"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs: apt-get install chromium chromium-driver"),
    pytest.mark.xdist_group("browser"),
]
RATIO, SLACK = 2.0, 1e-3
"""Bound of a lateness beside that without a page, or of a bare timer where that is larger: multiple, and time [s]."""
ALIKE = 0.2
"""Largest relative difference of the force on a handle that a hand pushes."""


def test_no_page_makes_the_loop_late_or_takes_its_force(tmp_path: Path) -> None:
    require_multicast(free_port())
    with chromium() as browser:
        seen = measured(browser, 2, tmp_path)
    quiet = seen[QUIET]
    for name in (*STATES, KILLED):
        found = seen[name]
        assert len(found.lateness) > 500 * SEGMENT, name  # the loop went on
        for share in (0.5, 0.999):
            usual = max(quiet.late(share), found.computer(share))
            assert found.late(share) <= RATIO * usual + SLACK, (name, share, found.late(share), usual)
        pushed, without = (float(np.median(each.force)) for each in (found, quiet))
        assert pushed == pytest.approx(without, rel=ALIKE), name
    assert without > 1.0
    assert len(seen["page reloaded"].spans) * -(-RELOADS // 2) >= RELOADS
