"""The first start of a rig at a terminal: a person answers, the guard is proved, the handle is moved, the sign is seen.

The drive is in another process and the terminal is a pseudo-terminal, on which the person's `y` is typed.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.protocols.catalogue import load_rig
from tests.peers.hosts import PROJECT, free_port, line_of, require_multicast, typed
from tests.peers.test_master_dies import BUS, NODE, RIG

pytestmark = [pytest.mark.xdist_group("peers"), pytest.mark.thorough("two processes, and waits in real time")]

ATTEMPTS = 10
"""On a machine so busy that feedback comes too late, or too seldom for the direction to be seen in 2 s."""
RUN = ("run", "wall", "--rate", "50", "--duration", "2", "--set", "wall.stiffness=max/2", "--rig")


def environment(port: int) -> dict[str, str]:
    return {**os.environ, "CAN_CONFIG": f'{{"port": {port}}}'}


def first_start(rig: Path, speed: float) -> tuple[int, str]:
    """Start a new rig file while the handle of its drive rolls [m/s]."""
    port = free_port()
    require_multicast(port)
    for _ in range(ATTEMPTS):
        rig.write_text(RIG, encoding="utf-8")
        words = ("tests.peers.rolling", BUS, str(NODE), str(speed))
        drive = subprocess.Popen(
            [sys.executable, "-m", *words],
            cwd=PROJECT,
            env=environment(port),
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        try:
            assert line_of(drive) == "ready\n"
            status, seen = typed(
                (sys.executable, "-m", "haptic_fieldbus", *RUN, str(rig)), environment(port), PROJECT, "y"
            )
        finally:
            drive.kill()
            drive.communicate()
        if "feedback lost" not in seen and "the run was too short" not in seen:
            break
    return status, seen


def test_a_person_who_answers_and_moves_the_handle_gets_a_wall_and_a_rig_that_knows(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    status, seen = first_start(rig, 0.02)
    assert status == 0, seen
    told = [
        "about to test the drive watchdog of axis handle",
        "about to enable torque on generic CiA 402",
        "axis handle is off: move the handle 10 mm to the positive side",
        "axis handle: drive watchdog fired after ",
    ]
    places = [seen.find(text) for text in told]
    assert -1 not in places, seen
    assert places == sorted(places), seen
    axis = load_rig(rig).axis["handle"]
    assert axis.proved is not None
    assert (axis.proved.guard, axis.seen.direction) == ("proved", "confirmed")
    assert "not confirmed" not in seen


def test_a_handle_that_goes_the_other_way_is_refused_with_the_key(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    status, seen = first_start(rig, -0.02)
    assert status == 2, seen
    assert "axis.handle.mechanism.sign" in seen
    assert "write sign = -1" in seen
    assert load_rig(rig).axis["handle"].seen.direction is None
