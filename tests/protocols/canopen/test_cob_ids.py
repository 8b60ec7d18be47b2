"""COB-IDs in words, against the predefined connection set of CiA 301, 7.3.5."""

import pytest

from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.canopen.bus import CanSection, cob_id_words
from tests.builders import WALL, can_traffic, plan_of, rig_of


@pytest.mark.parametrize(
    ("cob_id", "words"),
    [
        (0x000, "NMT command (000h)"),
        (0x080, "SYNC (080h)"),
        (0x085, "emergency of node 5 (085h)"),
        (0x201, "set-point (RPDO1) for node 1 (201h)"),
        (0x5FF, "SDO answer of node 127 (5FFh)"),
        (0x77F, "heartbeat of node 127 (77Fh)"),
        (0x700, "frame (700h)"),
        (0x7FF, "frame (7FFh)"),
    ],
)
def test_a_cob_id_is_told_with_its_meaning(cob_id: int, words: str) -> None:
    assert cob_id_words(cob_id) == words


def rig_with_master(node: int | None) -> Rig:
    rig = rig_of(WALL)
    return Rig({"bus": CanSection("haptic_sim", "sim", master_node=node)}, rig.axis)


def test_the_master_has_the_node_id_that_the_rig_gives_it_else_the_highest() -> None:
    assert can_traffic(plan_of(rig=rig_with_master(100))).master_node == 100
    assert can_traffic(plan_of(rig=rig_with_master(None))).master_node == 127


def test_the_master_cannot_have_the_node_id_of_a_drive() -> None:
    with pytest.raises(PlanError, match="master_node 1 of the bus is the node-ID of one of its drives"):
        plan_of(rig=rig_with_master(1))
