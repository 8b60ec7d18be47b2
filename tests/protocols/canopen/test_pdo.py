"""PDO layout and the worst-case length of a frame."""

import pytest

from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.protocols.canopen.pdo import Direction, Pdo, lay_out, worst_case_bits
from haptic_fieldbus.signals import Signal
from tests.builders import PROFILE

IN = (Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_ACTUAL)


def layout(*signals: Signal, pdos: int = 4, entries: int = 8) -> tuple[Pdo, ...]:
    return laid_out(dict.fromkeys(range(1, pdos + 1), entries), *signals)


def laid_out(room: dict[int, int], *signals: Signal) -> tuple[Pdo, ...]:
    return lay_out(Direction.TPDO, PROFILE.entries(), signals, node=5, transmission_type=1, room=room)


def test_signals_that_fit_into_eight_octets_share_one_pdo() -> None:
    (pdo,) = layout(*IN)
    assert pdo.size == 8
    assert pdo.signals == IN
    assert pdo.name == "TPDO1"


def test_a_signal_that_does_not_fit_opens_the_next_pdo() -> None:
    first, second = layout(*IN, Signal.STATUSWORD)
    assert first.signals == IN
    assert (second.cob_id, second.mapping_index) == (0x285, 0x1A01)


def test_the_number_of_mapping_entries_bounds_a_pdo() -> None:
    assert [pdo.signals for pdo in layout(*IN, entries=2)] == [IN[:2], IN[2:]]


def test_each_pdo_has_its_own_room_and_one_without_any_is_passed_over() -> None:
    first, second = laid_out({1: 2, 2: 0, 3: 1}, *IN)
    assert (first.number, second.number) == (1, 3)
    assert (first.signals, second.signals) == (IN[:2], IN[2:])
    assert (second.cob_id, second.mapping_index) == (0x385, 0x1A02)


def test_without_any_room_the_number_of_pdos_is_none() -> None:
    with pytest.raises(ImageTooLargeError, match="1 TPDOs of node 5, which has 0: statusword"):
        laid_out({1: 0, 5: 8}, Signal.STATUSWORD)


@pytest.mark.parametrize(("pdos", "wanted"), [(1, IN + IN), (9, IN * 5)])
def test_too_few_pdos_are_an_error_that_names_the_signals(pdos: int, wanted: tuple[Signal, ...]) -> None:
    with pytest.raises(ImageTooLargeError, match=r"TPDOs of node 5.*position"):
        layout(*wanted, pdos=pdos)


def test_cob_ids_and_indices_are_those_of_the_predefined_connection_set() -> None:
    """CiA 301 7.3.5, table 35: TPDO1 180h, RPDO1 200h, TPDO2 280h … plus the node-ID."""
    signals = (Signal.STATUSWORD,)
    entries = (PROFILE.entries()[Signal.STATUSWORD],)
    for number, (tpdo, rpdo) in enumerate([(0x185, 0x205), (0x285, 0x305), (0x385, 0x405), (0x485, 0x505)], start=1):
        assert Pdo(Direction.TPDO, number, 5, 1, signals, entries).cob_id == tpdo
        assert Pdo(Direction.RPDO, number, 5, 255, signals, entries).cob_id == rpdo
    rpdo_two = Pdo(Direction.RPDO, 2, 5, 255, signals, entries)
    assert rpdo_two.mapping_index == 0x1601


@pytest.mark.parametrize(("kind", "synchronous"), [(0, True), (1, True), (240, True), (254, False), (255, False)])
def test_types_to_240_are_synchronous(kind: int, synchronous: bool) -> None:
    pdo = Pdo(Direction.RPDO, 1, 5, kind, (Signal.STATUSWORD,), (PROFILE.entries()[Signal.STATUSWORD],))
    assert pdo.synchronous is synchronous


@pytest.mark.parametrize(("octets", "bits"), [(0, 55), (1, 65), (4, 95), (6, 115), (8, 135)])
def test_worst_case_lengths_are_the_published_ones(octets: int, bits: int) -> None:
    """Davis et al. 2007: 55 + 10 s bits for 11-bit identifiers."""
    assert worst_case_bits(octets) == bits == 55 + 10 * octets


@pytest.mark.parametrize(("octets", "bits"), [(0, 80), (8, 160)])
def test_worst_case_lengths_of_extended_frames_are_the_published_ones(octets: int, bits: int) -> None:
    """Davis et al. 2007: 80 + 10 s bits for 29-bit identifiers."""
    assert worst_case_bits(octets, extended=True) == bits == 80 + 10 * octets
