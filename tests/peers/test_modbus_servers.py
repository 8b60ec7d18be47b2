"""Our master on servers that nobody here wrote, with Nagle's algorithm and without, at two rates and by both ways.

What is judged is the function: of a few starts one renders a wall to its end, and none ends without the drive's
confirmation that its motor is off. A machine that is too busy for that rate ends runs by late feedback; then the server
without Nagle's algorithm is tried as well, and where that does not get to its end either the test is skipped.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.peers.foreign_servers import LINES, NAGLE, NODELAY, End, Line, run_on

STARTS, DURATION = 4, 1.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the C program is compiled once."""
    return tmp_path_factory.mktemp("servers")


def ends(line: Line, folder: Path) -> Iterator[End]:
    """Starts until one ran to its end; those before it ended torque-free, and for no other reason than time."""
    for _ in range(STARTS):
        end = run_on(line, folder, DURATION)
        yield end
        if end.rendered:
            return
        assert end.confirmed, end.said
        assert end.untimely, end.said


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("line", LINES, ids=str)
def test_a_wall_is_rendered_on_a_foreign_server_and_the_drive_confirms_its_end(line: Line, folder: Path) -> None:
    *_, last = ends(line, folder)
    if last.rendered:
        return
    if line.nagle == NAGLE:
        *_, other = ends(replace(line, nagle=NODELAY), folder)
        assert not other.rendered, f"without Nagle's algorithm it runs to its end: {last.said}"
    pytest.skip(f"this machine is too busy for {line.rate} Hz: {last.said}")
