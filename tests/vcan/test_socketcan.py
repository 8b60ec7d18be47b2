"""Two programs on a SocketCAN bus."""

import subprocess
from contextlib import closing

import can
import pytest

from tests.vcan.links import Link

pytestmark = pytest.mark.vcan

FRAME = can.Message(arbitration_id=0x181, data=bytes.fromhex("37022a0000000000"), is_extended_id=False)


def test_two_programs_talk(vcan: Link) -> None:
    with (
        can.Bus(interface="socketcan", channel=vcan.name) as sender,
        can.Bus(interface="socketcan", channel=vcan.name) as receiver,
    ):
        sender.send(FRAME)
        received = receiver.recv(10.0)
        assert received is not None
        assert received.equals(FRAME, timestamp_delta=None, check_channel=False, check_direction=False)
        assert sender.recv(0.0) is None


@pytest.mark.thorough("starts another program")
def test_candump_reads_what_is_sent(vcan: Link) -> None:
    with subprocess.Popen(["candump", "-L", "-n", "1", vcan.name], stdout=subprocess.PIPE, text=True) as candump:
        with can.Bus(interface="socketcan", channel=vcan.name) as sender:
            while candump.poll() is None:
                sender.send(FRAME)
        assert candump.stdout is not None
        with closing(candump.stdout):
            assert candump.stdout.read().split()[1:3] == [vcan.name, "181#37022A0000000000"]


@pytest.mark.thorough("takes an interface away")
def test_an_interface_goes_down_and_comes_back(vcan: Link) -> None:
    with can.Bus(interface="socketcan", channel=vcan.name) as bus:
        vcan.down()
        assert not vcan.is_up
        with pytest.raises(can.CanError):
            bus.send(FRAME)
        vcan.up()
        bus.send(FRAME)
