"""CiA 301 and CiA 305, clause by clause: each is a conversation of hand-made frames with the simulated drive."""

from dataclasses import replace

import pytest

from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import DriveBench, profile
from tests.sim.canopen.clauses import lss, nmt, pdo, sdo
from tests.sim.canopen.clauses.script import Clause, matches, play, steps

CLAUSES = [*sdo.CLAUSES, *pdo.CLAUSES, *nmt.CLAUSES, *lss.CLAUSES]


def _bench() -> DriveBench:
    """A drive with everything that the standards ask for, and an address of its own."""
    generic = profile("generic_cia402")
    identity = replace(generic.identity, vendor_id=0xFB, product_codes=(0,))
    return DriveBench(replace(generic, identity=identity), settings=DriveSettings(serial=0x1234))


@pytest.mark.parametrize("clause", CLAUSES, ids=str)
def test_the_drive_does_what_the_clause_says(clause: Clause) -> None:
    play(clause, _bench())


def test_a_conversation_that_goes_another_way_is_noticed() -> None:
    for script in (
        "> 605 40 00 10 00 00 00 00 00",
        "wait 5\n< 705 00",
        "r 1000:00 = u32 5",
        "w 1017:00 u16 1 = 06090030",
    ):
        with pytest.raises(AssertionError):
            play(Clause("", "", script), _bench())
    with pytest.raises(ValueError, match="sing"):
        play(Clause("", "", "sing"), _bench())


def test_a_script_is_steps_with_the_frames_that_follow() -> None:
    assert list(steps("> 1 # x\n< 2\n\n< 3\nwait 4")) == [("> 1", ["2", "3"]), ("wait 4", [])]
    assert matches("705 7f", "705 ??")
    assert not matches("705 7f", "705 7")
