"""Life guarding: what is written, who is asked when, and what an answer is worth (CiA 301 7.2.8.3.2.1)."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import can
import pytest

from haptic_fieldbus.buses.canopen.guard import ProofsOfLife
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, ForeignMasterError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.image import AXIS_HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import cob_id_words
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import PROFILE, WALL, can_traffic, plan_of, rig_of, scene_of, unproved
from tests.buses.canopen.benches import NODE, TORQUE_FREE, Bench
from tests.buses.canopen.fake_can import REMOTE, FakeDrive

GUARDED: CanopenProfile = replace(
    PROFILE, link_loss=replace(PROFILE.link_loss, heartbeat_consumer=None, life_guarding=True)
)
REQUEST = REMOTE | 0x700 + NODE
MASTER_HEARTBEAT = 0x77F
THREE = scene_of(*[Wall(f"axis{number}", stiffness=100.0, name=f"wall{number}") for number in (1, 2, 3)])


def guarded(rate: float = 1000.0, scene: Scene = WALL) -> Bench:
    return Bench(plan_of(scene, rate=rate, profile=GUARDED))


def exchange(bench: Bench, periods: int) -> LinkFlag:
    """The flags of the first axis in all of these periods together."""
    flags = LinkFlag(0)
    for _ in range(periods):
        end_ns = bench.clock.now_ns() + bench.plan.period_ns
        image = bench.bus.read(end_ns - bench.plan.period_ns // 5)
        flags |= LinkFlag(AXIS_HEADER.unpack_from(image, 8)[1])
        bench.bus.write(bytes(bench.plan.image.output_size))
        bench.clock.sleep_until(end_ns)
    return flags


def requests(bench: Bench, since: int = 0) -> list[tuple[int, int]]:
    """Time [ns] and node of each request of node guarding after so many frames."""
    return [
        (t_ns, can_id & 0x7F)
        for t_ns, can_id, _ in bench.can.sent[since:]
        if can_id & REMOTE and can_id & 0x780 == 0x700
    ]


class TestConfiguration:
    def test_the_life_time_is_the_guard_and_begins_last(self) -> None:
        """No request may come between the factor and the loop: it would begin the life time too early."""
        bench = guarded().open()
        written = [(name, value) for name, value in bench.written() if name[:4] in ("100C", "100D", "1016", "1017")]
        assert written == [("100Dh:00", 0), ("100Ch:00", 10), ("100Dh:00", 5)]
        ids = [can_id for _, can_id, _ in bench.can.sent]
        factor = max(at for at, (_, _, data) in enumerate(bench.can.sent) if data[:4] == b"\x2f\x0d\x10\x00")
        assert REQUEST in ids[:factor], "the NMT states were confirmed by answers"
        assert REQUEST not in ids[factor:]
        assert bench.drive.state == 0x05

    @pytest.mark.parametrize(("rate", "guard"), [(1000.0, 50), (250.0, 50), (60.0, 85), (50.0, 100), (10.0, 500)])
    def test_it_is_a_multiple_of_the_factor_and_not_less_than_five_periods(self, rate: float, guard: int) -> None:
        bench = guarded(rate).open()
        assert bench.drive.value(0x100C) * bench.drive.value(0x100D) == guard
        assert can_traffic(bench.plan).guard("handle") == pytest.approx(guard * 1e-3)
        assert guard * 1e-3 >= max(0.05, 5 / rate)

    def test_a_heartbeat_that_is_on_is_switched_off(self) -> None:
        bench = guarded()
        bench.drive.objects[0x1017, 0] = (500).to_bytes(2, "little")
        bench.open()
        assert bench.drive.value(0x1017) == 0

    def test_a_drive_without_1017h_has_none_to_switch_off(self) -> None:
        bench = guarded()
        bench.drive.value = lambda index, subindex=0, held=bench.drive.value: (  # type: ignore[method-assign,misc]
            0 if index == 0x1017 else held(index, subindex)
        )
        del bench.drive.objects[0x1017, 0]
        bench.open()
        assert bench.drive.state == 0x05

    @pytest.mark.parametrize(
        "change",
        [
            lambda drive: drive.aborts.update({(0x1017, 0): 0x0601_0002}),
            lambda drive: drive.forgets.add((0x1017, 0)),
        ],
        ids=["read-only", "kept"],
    )
    def test_a_drive_that_keeps_its_heartbeat_is_refused_in_words(self, change: Callable[[FakeDrive], None]) -> None:
        bench = guarded()
        bench.drive.objects[0x1017, 0] = (100).to_bytes(2, "little")
        change(bench.drive)
        with pytest.raises(BusConfigurationError, match=r"heartbeat every 100 ms and refuses to stop it"):
            bench.open()

    @pytest.mark.parametrize("entry", [(0x100C, 0), (0x100D, 0)])
    def test_a_life_time_that_is_not_kept_is_refused(self, entry: tuple[int, int]) -> None:
        bench = guarded()
        bench.drive.forgets.add(entry)
        with pytest.raises(BusConfigurationError, match=f"did not keep {entry[0]:04X}h"):
            bench.open()

    def test_a_drive_that_answers_no_request_is_not_started(self) -> None:
        bench = guarded()
        bench.drive.lost_answers = 1_000_000
        with pytest.raises(BusTimeoutError, match=r"within 0\.3 s \(no answer to node guarding\): none came"):
            bench.open()
        assert set(bench.can.of(0x200 + NODE)) <= {TORQUE_FREE}

    def test_a_drive_that_never_toggles_is_not_started(self) -> None:
        bench = guarded()
        bench.drive.toggles = False
        with pytest.raises(
            BusTimeoutError, match=r"did not confirm operational within .*\(no answer to node guarding\)"
        ):
            bench.open()


class TestRequests:
    @pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0, 10.0])
    def test_the_first_period_asks_and_then_every_fifth_of_the_guard_or_every_period(self, rate: float) -> None:
        bench = guarded(rate).open()
        before = len(bench.can.sent)
        exchange(bench, 61)
        asked = [t_ns for t_ns, _ in requests(bench, before)]
        guard_ns = bench.drive.value(0x100C) * bench.drive.value(0x100D) * 1_000_000
        longest = max(later - earlier for earlier, later in pairwise(asked))
        assert longest <= max(guard_ns // 5, bench.plan.period_ns)
        assert asked[0] < bench.can.sent[before][0] + bench.plan.period_ns

    @pytest.mark.parametrize("guards", [True, False], ids=["requests", "heartbeats"])
    def test_periods_that_are_skipped_leave_no_guard_waiting(self, guards: bool) -> None:
        """A busy computer lets two periods of three pass, so that ten of them take thirty milliseconds."""
        bench = guarded().open() if guards else Bench().open()
        before, guard_ns = len(bench.can.sent), 50_000_000
        for _ in range(60):
            exchange(bench, 1)
            bench.clock.sleep_until(bench.clock.now_ns() + 2 * bench.plan.period_ns)
        ours = [t_ns for t_ns, can_id, _ in bench.can.sent[before:] if can_id in (REQUEST, MASTER_HEARTBEAT)]
        assert max(later - earlier for earlier, later in pairwise(ours)) <= guard_ns // 5 + 3 * bench.plan.period_ns
        assert len(ours) <= 1 + 180 // 10

    def test_a_period_that_is_cut_short_after_a_late_one_proves_our_life_too(self) -> None:
        plan = plan_of(rate=20.0)
        traffic = can_traffic(plan)
        assert traffic.heartbeat_every == 1
        proofs = ProofsOfLife(traffic, (), plan.period_ns)
        instants = [round(at * plan.period_ns) for at in (0.0, 1.0, 2.6, 3.0, 4.0)]
        assert [bool(proofs.due(t_ns)) for t_ns in instants] == [True] * 5

    def test_requests_to_several_drives_are_spread_over_the_periods(self) -> None:
        bench = guarded(scene=THREE).open()
        before = len(bench.can.sent)
        exchange(bench, 41)
        first, *later = [t_ns for t_ns, _ in requests(bench, before)]
        assert [node for t_ns, node in requests(bench, before) if t_ns == first] == [1, 2, 3]
        later = [t_ns for t_ns in later if t_ns > first]
        assert len(set(later)) == len(later) == 12

    def test_no_heartbeat_of_ours_is_sent_where_nobody_watches_it(self) -> None:
        bench = guarded().open()
        exchange(bench, 20)
        assert bench.can.of(MASTER_HEARTBEAT) == []

    def test_who_does_not_write_proves_no_life(self) -> None:
        bench = guarded().open()
        exchange(bench, 20)
        before = len(bench.can.sent)
        for _ in range(20):
            bench.bus.read(bench.clock.now_ns() + bench.plan.period_ns)
        assert requests(bench, before) == []

    def test_the_way_to_zero_asks_nothing_more_and_disarms_the_guard(self) -> None:
        bench = guarded().open()
        exchange(bench, 20)
        before = len(bench.can.sent)
        assert bench.bus.stop() is True
        assert requests(bench, before) == []
        assert bench.drive.value(0x100D) == 0
        assert bench.bus.warnings == []

    def test_a_guard_that_the_drive_keeps_is_told(self) -> None:
        """Written values are read back."""
        bench = guarded().open()
        exchange(bench, 5)
        bench.drive.forgets.add((0x100D, 0))
        assert bench.bus.stop() is True
        assert bench.bus.warnings == [
            "node 1 (axis handle) keeps 100Dh:00 life time factor, which could not be put back; with its watchdog "
            "armed it may report an error"
        ]

    def test_a_drive_that_stays_enabled_keeps_its_guard(self) -> None:
        bench = guarded().open()
        exchange(bench, 5)
        bench.drive.power_stays, bench.drive.objects[0x6041, 0] = 0x27, b"\x27\x00"
        exchange(bench, 1)
        before = len(bench.can.sent)
        assert bench.bus.stop() is False
        assert requests(bench, before) == []
        assert bench.drive.value(0x100D) == 5

    def test_the_bits_of_requests_and_answers_are_in_the_load(self) -> None:
        """55 bits without data, 65 with one octet, worst case (Davis et al. 2007), every 10 ms."""
        plain, other = can_traffic(plan_of()), can_traffic(plan_of(profile=GUARDED))
        heartbeats = (65 * 100 + 65 * 10) / 1e6
        assert other.load == pytest.approx(plain.load - heartbeats + (55 + 65) * 100 / 1e6)
        assert other.disturbance == pytest.approx((135 + 55 + 65) / 1e6)


class TestAnswers:
    def test_answers_are_the_sign_of_life_and_the_nmt_state(self) -> None:
        bench = guarded().open()
        assert exchange(bench, 200) is LinkFlag(0)
        bench.drive.state = 0x7F
        assert LinkFlag.NOT_OPERATIONAL in exchange(bench, 15)

    def test_a_drive_that_was_started_long_before_the_loop_is_not_missed_at_once(self) -> None:
        bench = guarded().open()
        bench.clock.sleep_until(bench.clock.now_ns() + 10_000_000_000)
        assert exchange(bench, 100) is LinkFlag(0)

    @pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
    def test_answers_that_stay_away_are_missed_after_the_life_time(self, rate: float) -> None:
        bench = guarded(rate).open()
        exchange(bench, 50)
        bench.drive.lost_answers = 1_000_000
        guard, period = can_traffic(bench.plan).guard("handle"), 1 / rate
        assert LinkFlag.NO_SIGN_OF_LIFE not in exchange(bench, int(0.75 * guard * rate))
        assert LinkFlag.NO_SIGN_OF_LIFE in exchange(bench, round((0.3 * guard + period) * rate) + 1)

    def test_an_answer_that_is_lost_costs_the_next_one_too_and_no_more(self) -> None:
        """The toggle bit after a lost answer is that of the last one received: as if it had not been received."""
        bench = guarded().open()
        for _ in range(5):
            exchange(bench, 40)
            bench.drive.lost_answers = 1
            assert exchange(bench, 40) is LinkFlag(0)
        bench.bus.stop()
        assert bench.bus.warnings == [
            "node 1 (axis handle) repeated the toggle bit in 5 node guarding answers; these do "
            "not count: answers were lost, or the node repeats itself"
        ]

    def test_a_toggle_bit_that_stands_still_is_no_sign_of_life(self) -> None:
        bench = guarded().open()
        exchange(bench, 50)
        bench.drive.toggles = False
        assert LinkFlag.NO_SIGN_OF_LIFE in exchange(bench, 70)
        text = bench.plan.axes[0].traffic.fault_text(LinkFlag.NO_SIGN_OF_LIFE, 0)
        assert text == "node 1 answered no request of node guarding within its life time, or repeated its toggle bit"

    @pytest.mark.parametrize("periods", [20, 30], ids=["after 1", "after 0"])
    def test_a_restarted_node_begins_with_toggle_bit_0_and_is_told_as_restarted(self, periods: int) -> None:
        bench = guarded().open()
        exchange(bench, periods)
        assert bench.drive._toggle == (0 if periods == 20 else 0x80), "the bit of its next answer"
        bench.drive.restart()
        assert LinkFlag.BOOT_UP in exchange(bench, 30)
        bench.bus.stop()
        assert not [warning for warning in bench.bus.warnings if "toggle bit" in warning]

    def test_an_empty_answer_is_none(self) -> None:
        bench = guarded().open()
        bench.can.reply(0x700 + NODE, b"", 0)
        assert exchange(bench, 20) is LinkFlag(0)


def request_of_somebody_else(bench: Bench, delay_ns: int = 0) -> None:
    bench.can.later(
        delay_ns, can.Message(arbitration_id=0x700 + NODE, is_remote_frame=True, dlc=1, is_extended_id=False)
    )


class TestSomebodyElse:
    """Requests to a drive under life guarding feed its guard, also when we are dead."""

    def test_a_request_in_the_loop_is_a_command(self) -> None:
        bench = guarded().open()
        exchange(bench, 5)
        request_of_somebody_else(bench)
        image = bench.bus.read(bench.clock.now_ns() + bench.plan.period_ns)
        _, flags, code = AXIS_HEADER.unpack_from(image, 8)
        assert LinkFlag.FOREIGN in LinkFlag(flags)
        assert cob_id_words(code) == "node guarding request to node 1 (701h)"
        words = bench.plan.axes[0].traffic.fault_text(LinkFlag.FOREIGN, code, "socketcan:can0")
        assert words.startswith("another master on socketcan:can0: received node guarding request to node 1 (701h)")

    @pytest.mark.parametrize("delay_ns", [500_000_000, 1_005_000_000], ids=["while we listen", "while we write"])
    def test_a_request_before_the_loop_is_refused(self, delay_ns: int) -> None:
        bench = guarded()
        request_of_somebody_else(bench, delay_ns)
        with pytest.raises(ForeignMasterError, match=r"node guarding request to node 1 \(701h\)"):
            bench.open()
        assert set(bench.can.of(0x200 + NODE)) <= {TORQUE_FREE}

    def test_a_drive_beside_it_that_watches_heartbeats_may_be_asked(self) -> None:
        """Two drives, two guards: each is asked, or not, by its own."""
        plan = _mixed()
        bench = Bench(plan).open()
        exchange(bench, 30)
        assert {node for _, node in requests(bench)} == {1}
        assert bench.can.of(MASTER_HEARTBEAT)
        assert [drive.value(0x1017) for drive in bench.drives] == [0, 100]
        bench.can.later(0, can.Message(arbitration_id=0x702, is_remote_frame=True, dlc=1, is_extended_id=False))
        assert LinkFlag.FOREIGN not in exchange(bench, 3)


def _mixed() -> Plan:
    scene = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))
    rig = rig_of(scene)
    rig = replace(rig, axis={**rig.axis, "left": replace(rig.axis["left"], profile="guarded")})
    return unproved(compile_plan(scene, rig, {PROFILE.name: PROFILE, "guarded": GUARDED}, 1000.0))
