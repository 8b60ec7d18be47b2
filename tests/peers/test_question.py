"""The question before torque is enabled: nothing has been written by then, and nothing is when it is not confirmed."""

from dataclasses import dataclass

import can
import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.errors import UsageError
from tests.peers.hosts import in_another_process
from tests.peers.test_master_dies import NODE, RIG

pytestmark = [pytest.mark.xdist_group("peers"), pytest.mark.thorough("listens in real time")]

SDO_REQUESTS, SDO_RESPONSES, HEARTBEAT = 0x600 + NODE, 0x580 + NODE, 0x700 + NODE
SDO_UPLOAD = 0x40


@dataclass
class ServerRequest:
    question: str
    sent: list[can.Message]
    """All frames that were not the drive's."""


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> ServerRequest:
    """A run on a drive in another process, whose question is answered by no."""
    rig = tmp_path_factory.mktemp("bench") / "rig.toml"
    rig.write_text(RIG, encoding="utf-8")
    questions: list[str] = []

    def refuse(question: str) -> bool:
        questions.append(question)
        return False

    with in_another_process(NODE, [f"generic_cia402@{NODE}"]) as there, pytest.MonkeyPatch.context() as patch:
        patch.setenv("CAN_CONFIG", f'{{"port": {there.options["port"]}}}')
        with can.Bus(**there.options) as listener:
            with pytest.raises(UsageError, match="not enabled"):
                run("wall", rig=rig, settings={"wall.stiffness": 200.0}, confirm=refuse)
            heard = list(iter(lambda: listener.recv(0.1), None))
    drive = (SDO_RESPONSES, HEARTBEAT)
    return ServerRequest(questions[0], [frame for frame in heard if frame and frame.arbitration_id not in drive])


def test_a_question_that_is_not_confirmed_leaves_nothing_but_uploads_on_the_bus(asked: ServerRequest) -> None:
    assert len(asked.sent) > 5
    assert {frame.arbitration_id for frame in asked.sent} == {SDO_REQUESTS}
    assert {frame.data[0] for frame in asked.sent} == {SDO_UPLOAD}


def test_what_is_about_to_be_changed_in_the_drive_is_part_of_it(asked: ServerRequest) -> None:
    assert "about to enable torque on generic CiA 402, node 5" in asked.question
    assert "6072h:00 max torque is lowered from 300 % to 100 % of rated torque until the end." in asked.question
