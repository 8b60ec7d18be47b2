"""CiA 305: fastscan finds whatever address a node has, and of several the one with the lowest bits first."""

from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.sim.canopen.services.lss import LssSlave, LssState
from tests.lanes import examples

WORD = st.integers(0, 2**32 - 1)
ADDRESS = st.lists(WORD, min_size=4, max_size=4)


def _slave(address: list[int], node: int = 0xFF) -> LssSlave:
    return LssSlave(lambda: address, node, 1_000_000, lambda: None, lambda _ms: None)


def _anybody(slaves: list[LssSlave], number: int, bit: int, part: int, following: int) -> bool:
    request = bytes((0x51,)) + number.to_bytes(4, "little") + bytes((bit, part, following))
    answers = [slave.request(request) for slave in slaves]  # all of them hear it
    return b"\x4f" + bytes(7) in answers


def _fastscan(slaves: list[LssSlave]) -> list[int]:
    """The master's side: a bit is 1 when nobody confirms that it is 0."""
    assert _anybody(slaves, 0, 0x80, 0, 0)
    found = []
    for part in range(4):
        number = 0
        for bit in reversed(range(32)):
            if not _anybody(slaves, number, bit, part, part):
                number |= 1 << bit
        assert _anybody(slaves, number, 0, part, (part + 1) % 4)
        found.append(number)
    return found


@given(ADDRESS)
@settings(max_examples=examples(30))
def test_one_node_is_found(address: list[int]) -> None:
    slave = _slave(address)
    assert _fastscan([slave]) == address
    assert slave.state is LssState.CONFIGURATION


@given(st.lists(ADDRESS, min_size=2, max_size=5, unique_by=tuple))
@settings(max_examples=examples(30))
def test_of_several_nodes_each_is_found_in_turn(addresses: list[list[int]]) -> None:
    slaves = [_slave(address) for address in addresses]
    for wanted in sorted(addresses):
        assert _fastscan(slaves) == wanted
        (selected,) = [slave for slave in slaves if slave.state is LssState.CONFIGURATION]
        selected.request(bytes((0x11, 5)) + bytes(6))
        selected.request(bytes((0x04, 0)) + bytes(6))


@given(ADDRESS, ADDRESS)
def test_only_the_whole_address_selects(address: list[int], other: list[int]) -> None:
    slave = _slave(address, 5)
    answers = [
        slave.request(bytes((0x40 + k,)) + part.to_bytes(4, "little") + bytes(3)) for k, part in enumerate(other)
    ]
    assert answers[:3] == [None] * 3
    assert (answers[3] is not None) is (slave.state is LssState.CONFIGURATION) is (address == other)


def test_parts_of_an_address_out_of_order_select_nobody() -> None:
    slave = _slave([1, 1, 1, 1], 5)
    for specifier in (0x41, 0x40, 0x42, 0x43, 0x41, 0x43):
        assert slave.request(bytes((specifier, 1)) + bytes(6)) is None
