"""Random frames, valid and not: the node neither crashes nor hangs, and stays in its table.

A hundred thousand frames. Their proportions are chosen so that every service is reached with sense and with nonsense.
The NMT state machine that the node is compared with is written down here once more.
"""

from collections.abc import Callable
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.services.nmt import NmtState
from tests.lanes import examples
from tests.sim.bench import MS, NODE, DriveBench, profile

FRAMES = 1000
RUNS = 100
INDICES = (
    0x1000, 0x1001, 0x1003, 0x1005, 0x1006, 0x1007, 0x1008, 0x100C, 0x100D, 0x1010, 0x1011, 0x1012, 0x1014, 0x1015,
    0x1016, 0x1017, 0x1018, 0x1019, 0x1029, 0x1200, 0x1400, 0x1401, 0x1600, 0x1601, 0x1800, 0x1801, 0x1A00, 0x1A01,
    0x5FF0, 0x5FF1, 0x5FF2, 0x6040, 0x6041, 0x605A, 0x6060, 0x6064, 0x6071, 0x60C2,
)  # fmt: skip
VALUES = (0, 1, 2, 3, 5, 10, 100, 127 << 16 | 20, 0x6040_0010, 0x6041_0010, 0x6064_0020, 0x60C2_0108, 0x0005_0008,
          0x6576_6173, 0x6461_6F6C, 0x205, 0x185, 0x8000_0205, 0x8000_0185, 0xFFFF_FFFF)  # fmt: skip
COMMANDS = {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED, 128: NmtState.PRE_OPERATIONAL}
RESETS = (129, 130)


def _octets(random: Random, count: int | None = None) -> bytes:
    return random.randbytes(random.randrange(9) if count is None else count)


def _nmt(random: Random, node: int) -> Frame:
    command = random.choice((1, 1, 1, 1, 128, 2, 129, 130, random.randrange(256)))
    return Frame(0, bytes((command, random.choice((0, node, node + 1))))[: random.choice((2, 2, 2, 1))])


def _sdo(random: Random, node: int) -> Frame:
    command = random.choice((0x40, 0x40, 0x23, 0x2B, 0x2F, 0x21, 0x60, 0x70, 0x00, 0x10, 0xA4, 0xA3, 0xA2, 0xA1, 0xC6,
                             0xC5, 0x01, 0x82, 0x80, random.randrange(256)))  # fmt: skip
    where = random.choice(INDICES).to_bytes(2, "little") + bytes((random.choice((0, 0, 1, 1, 2, 3, 5, 6, 9)),))
    value = random.choice((random.choice(VALUES), random.getrandbits(32))).to_bytes(4, "little")
    return Frame(0x600 + node, (bytes((command,)) + where + value)[: random.choice((8, 8, 8, 8, 8, 7))])


def _block(random: Random, node: int) -> Frame:
    return Frame(
        0x600 + node, bytes((random.choice((1, 2, 3, 127, 0x81, 0x84, 0xC1, 0xA2, 0xA3)),)) + _octets(random, 7)
    )


def _lss(random: Random, _node: int) -> Frame:
    specifier = random.choice((*[0x04] * 6, 0x11, 0x13, 0x15, 0x17, *range(0x40, 0x52), *range(0x5A, 0x5F)))
    return Frame(0x7E5, bytes((specifier, random.choice((0, 1, 1, NODE, 255)))) + _octets(random, 6))


def _pdo(random: Random, node: int) -> Frame:
    return Frame(random.choice((0x200, 0x300, 0x180, 0x280)) + node, _octets(random))


def _sync(random: Random, _node: int) -> Frame:
    return Frame(0x80, _octets(random, random.choice((0, 0, 0, 1, 2))))


def _control(random: Random, node: int) -> Frame:
    remote = random.random() < 0.3
    can_id = random.choice((0x700 + node, 0x180 + node) if remote else (0x77F, 0x77E, 0x100, 0x700 + node))
    return Frame(can_id, _octets(random), remote=remote)


def _anything(random: Random, _node: int) -> Frame:
    extended = random.random() < 0.2
    can_id = random.getrandbits(29 if extended else 11)
    return Frame(can_id, _octets(random), extended=extended, remote=random.random() < 0.2)


MAKERS: tuple[Callable[[Random, int], Frame], ...] = (
    _sdo, _sdo, _sdo, _sdo, _block, _pdo, _pdo, _sync, _sync, _control, _lss, _nmt, _anything,
)  # fmt: skip


class Watched:
    """A drive under random frames, and what must hold after each."""

    def __init__(self) -> None:
        self.bench = DriveBench(profile("generic_cia402"))
        self.node = self.bench.node
        self.heard: set[int] = set()
        """Kinds of what was sent: the function code of CiA 301, 7.3.5."""

    def take(self, frame: Frame, pause_ns: int) -> None:
        before, number = self.node.state, self.node.number
        self.bench.sent.clear()
        self.bench.slave.receive(frame, self.bench.t_ns)
        self._check_state(frame, before, number)
        self._check_sent(before)
        self.bench.sent.clear()
        self.bench.run(pause_ns)
        self._check_sent(None)
        assert len(self.bench.sent) <= 20 + pause_ns // 100_000

    def _check_state(self, frame: Frame, before: NmtState, number: int) -> None:
        commanded = (
            frame.can_id == 0 and not frame.extended and not frame.remote and len(frame.data) == 2
            and frame.data[1] in (0, number) and before is not NmtState.INITIALISING
        )  # fmt: skip
        state = self.node.state
        if state is NmtState.INITIALISING and before is not state:
            assert commanded
            assert frame.data[0] in RESETS
        elif commanded and frame.data[0] in COMMANDS and self.node.handlers:
            assert state is COMMANDS[frame.data[0]]
        elif state is not before:
            raise AssertionError(f"{frame} led from {before} to {state}")

    def _check_sent(self, before: NmtState | None) -> None:
        """Frames that may be sent in a state; before: the state at the time, None: it may have changed."""
        number, state = self.node.number, self.node.state
        for _, frame in self.bench.sent:
            self.heard.add(frame.can_id & 0x780)
            assert len(frame.data) <= 8
            assert not frame.extended
            assert not frame.remote
            if frame.can_id == 0x580 + number:
                assert len(frame.data) == 8
                assert before is None or before in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)
            elif frame.can_id == 0x7E4:
                assert len(frame.data) == 8
                assert before is not NmtState.OPERATIONAL
            elif frame.can_id == 0x700 + number:
                assert frame.data[0] & 0x7F in {state.value for state in NmtState}
            elif frame.can_id not in (0x80 + number, self.bench.drive.dictionary.value(0x1014) & 0x7FF):
                # a PDO: sent in *operational* only
                assert state is NmtState.OPERATIONAL or before in (None, NmtState.OPERATIONAL)

    def check_alive(self) -> None:
        """After a reset of the node by its watchdog all is well again, on the node-ID that it then has."""
        self.bench.node.reset(self.bench.t_ns)
        self.bench.sent.clear()
        self.bench.run(30 * MS)
        number = self.node.number
        if not self.node.handlers or self.node.lss.active_node == 0xFF:
            assert self.node.lss.active_node == 0xFF or self.node.lss.bitrate != 1_000_000
            return
        boots = [frame.data for _, frame in self.bench.sent if frame.can_id == 0x700 + number]
        assert boots[0] == b"\0"
        assert self.node.state is NmtState.PRE_OPERATIONAL
        self.bench.sent.clear()
        self.bench.give(0x600 + number, bytes.fromhex("40 00 10 00 00 00 00 00"))
        assert self.bench.take(0x580 + number) == [bytes.fromhex("43 00 10 00 92 01 02 00")]


def _storm(seed: int, count: int) -> Watched:
    random = Random(seed)
    watched = Watched()
    for _ in range(count):
        frame = random.choice(MAKERS)(random, watched.node.number)
        watched.take(frame, random.choice((0, 0, 0, 100_000, MS, 30 * MS)) if random.random() < 0.3 else 0)
    watched.check_alive()
    return watched


@given(st.integers(0, 2**63))
@settings(max_examples=examples(RUNS))
def test_a_storm_of_frames_leaves_a_node_that_works(seed: int) -> None:
    _storm(seed, FRAMES)


FRAME = st.builds(
    Frame,
    st.sampled_from((0, 0x80, 0x100, 0x205, 0x305, 0x605, 0x605, 0x605, 0x705, 0x77F, 0x7E5)),
    st.binary(max_size=8),
    st.just(False),
    st.booleans(),
)


@given(st.lists(FRAME, max_size=40))
@settings(max_examples=examples(100))
def test_any_short_sequence_of_octets_does_no_harm(frames: list[Frame]) -> None:
    watched = Watched()
    for frame in frames:
        watched.take(frame, 0)
    watched.check_alive()


def test_the_storm_reaches_every_state_and_service() -> None:
    reached, answered = set[NmtState](), set[int]()
    for seed in range(20):
        random, watched = Random(seed), Watched()
        for _ in range(300):
            watched.take(random.choice(MAKERS)(random, watched.node.number), MS if random.random() < 0.1 else 0)
            reached.add(watched.node.state)
        answered |= watched.heard
    assert reached == set(NmtState)
    assert {0x580, 0x080, 0x180, 0x700, 0x780} <= answered


def test_a_state_that_nobody_commanded_is_noticed() -> None:
    watched = Watched()
    watched.node.state = NmtState.OPERATIONAL
    with pytest.raises(AssertionError, match="led from"):
        watched._check_state(Frame(0x80, b""), NmtState.PRE_OPERATIONAL, NODE)
