"""A simulated drive reached without any bus: its dictionary is written, its errors are told to the link."""

from haptic_fieldbus.sim.drive.core import FOLLOWING_ERROR, Drive
from haptic_fieldbus.sim.drive.power import STATUS_BITS, State
from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.sim.bench import MS, axis, profile

TORQUE_MODE, SHUTDOWN, SWITCH_ON, ENABLE, RESET = 10, 0x06, 0x07, 0x0F, 0x80
STATE_BITS = 0x6F


class Told:
    """A link that remembers: errors with their times, None for a fault reset."""

    def __init__(self) -> None:
        self.errors: list[tuple[int | None, int]] = []
        self.persisting = False
        self.drive = Drive(profile(), DriveOnBus(1, profile(), axis()), self, DriveSettings(), 0)
        self.drive.restart(0)

    def error(self, code: int, t_ns: int) -> None:
        self.errors.append((code, t_ns))

    def persists(self) -> bool:
        return self.persisting

    def clear_errors(self, t_ns: int) -> None:
        self.errors.append((None, t_ns))

    def write(self, index: int, value: int, t_ns: int) -> None:
        self.drive.measure(t_ns)
        entry = self.drive.dictionary.find(index)
        assert entry.type is not None
        entry.write(entry.type.pack(value))

    def enabled(self) -> "Told":
        self.write(0x6060, TORQUE_MODE, MS)
        for controlword in (SHUTDOWN, SWITCH_ON, ENABLE):
            self.write(0x6040, controlword, MS)
        assert self.state is State.OPERATION_ENABLED
        return self

    @property
    def state(self) -> State:
        status = self.drive.dictionary.value(0x6041) & STATE_BITS
        return next(state for state, bits in STATUS_BITS.items() if bits == status)


def test_a_written_target_turns_the_shaft() -> None:
    told = Told().enabled()
    told.write(0x6071, 100, 2 * MS)
    told.drive.measure(20 * MS)
    assert told.drive.dictionary.value(0x6064) > 0
    assert told.errors == []


def test_a_fault_and_its_reset_are_told_with_their_times() -> None:
    told = Told().enabled()
    told.drive.fault(FOLLOWING_ERROR, 3 * MS)
    while told.drive.operation.due_ns < 2000 * MS:
        told.drive.operation.timer(told.drive.operation.due_ns)
    assert told.state is State.FAULT
    told.write(0x6040, RESET, 2000 * MS)
    assert told.errors == [(FOLLOWING_ERROR, 3 * MS), (None, 2000 * MS)]


def test_a_lost_link_is_a_fault_of_this_code_where_torque_could_be_made() -> None:
    told = Told()
    told.drive.link_lost(0x8130, 3 * MS)
    assert told.errors == []
    assert told.state is State.SWITCH_ON_DISABLED
    told.enabled().drive.link_lost(0x8130, 4 * MS)
    assert told.drive.dictionary.value(0x603F) == 0x8130
    assert told.errors == [(0x8130, 4 * MS)]


def test_a_fault_stays_while_its_cause_does_and_then_asks_for_a_new_edge() -> None:
    told = Told().enabled()
    told.drive.objects.fault_reaction_option.value = 0
    told.drive.fault(0x4310, 3 * MS)
    told.persisting = True
    states = []
    for number, (controlword, persisting) in enumerate([(RESET, True), (RESET, False), (0, False), (RESET, False)]):
        told.persisting = persisting
        told.write(0x6040, controlword, (4 + number) * MS)
        states.append(told.state)
    assert states == [*[State.FAULT] * 3, State.SWITCH_ON_DISABLED]
    assert told.errors == [(0x4310, 3 * MS), (None, 7 * MS)]
