"""Foreign masters against simulated drives, over each way to reach them."""

from collections.abc import Callable, Iterator
from threading import Event

import canopen
import pytest

from tests.peers.hosts import Reach, in_another_process, in_this_process

LONG = 10.0
"""[s]: no answer takes so long, on any machine."""
RESET_NODE = 129

VCAN = "vcan0"

Connect = Callable[[canopen.RemoteNode], canopen.RemoteNode]


OTHER_DRIVE = pytest.param("haptic_sim-6", marks=pytest.mark.thorough("the other drive on the same bus"))
VCAN_MARKS = (pytest.mark.vcan, pytest.mark.thorough("in a guest kernel where the host has no vcan"))


@pytest.fixture(
    scope="module", params=["haptic_sim-5", OTHER_DRIVE, "simulate-5", pytest.param("vcan-5", marks=VCAN_MARKS)]
)
def reach(request: pytest.FixtureRequest) -> Iterator[Reach]:
    """Where the drives are, and which is talked to; those of another process live as long as the tests of a module."""
    where, _, node = request.param.partition("-")
    if where == "haptic_sim":
        yield in_this_process(int(node))
        return
    with in_another_process(int(node), vcan=VCAN if where == "vcan" else None) as there:
        yield there


@pytest.fixture
def network(reach: Reach) -> Iterator[canopen.Network]:
    """canopen with its receiving thread, as anybody uses it."""
    subject = canopen.Network()
    subject.NOTIFIER_CYCLE = 0.01
    subject.connect(**reach.options)
    yield subject
    subject.disconnect()  # ends SYNC too; on SocketCAN canopen's `sync.stop` raises when it is called twice


@pytest.fixture
def connect(network: canopen.Network) -> Connect:
    """Add a node to the network, and reset it: other tests may have used the drive before."""

    def add(node: canopen.RemoteNode) -> canopen.RemoteNode:
        node.sdo.RESPONSE_TIMEOUT = LONG
        network.add_node(node)
        booted = Event()
        node.nmt.add_heartbeat_callback(lambda state: booted.set() if state == 0 else None)
        node.nmt.send_command(RESET_NODE)
        assert booted.wait(LONG), "no boot-up message after a reset"
        return node

    return add
