"""The short way of an ordinary period gives what the full code gives: octets, rows and all values that are kept."""

import inspect
import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from random import Random
from types import CellType, FunctionType, MethodType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.api import plan as plan_from
from haptic_fieldbus.cycle import cycle as cycle_module
from haptic_fieldbus.cycle import energy_steps, ordinary
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.ordinary import Step, bind_ordinary
from haptic_fieldbus.planning.image import AXIS_HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import plan_of, scene_of
from tests.cycle.ordinary_cases import CASES, Case, plan_named, run_case
from tests.cycle.ordinary_drifts import ALONE_DRIFTS, DRIFTS
from tests.lanes import examples

ENABLED, READY, FAULT = 0x0637, 0x0631, 0x0638
PLANS: list[dict[str, Any]] = [
    {"scene": "wall"},
    {"scene": "damped_wall", "drive": "generic_cia402"},
    {"scene": "wall", "rate": 500.0},
    {"scene": "detents", "drive": "nanotec_c5_e"},
    {"scene": "wall", "drive": "generic_cia402_modbus", "bus": "sim-modbus-tcp"},
    {"scene": "hunt_crossley", "drive": "generic_cia402"},
    {"scene": "lugre"},
    {"scene": "sprung_mass"},
    {"scene": "free_puck", "drive": "generic_cia402"},
    {"scene": "wall", "drive": "nanotec_c5_e"},
]
"""Of the last three, the ledger judges by a step of its own: virtual masses, and a delay longer than a period."""
CONTROLLED = len(PLANS)
"""A plan with virtual masses and the passivity controller."""


@cache
def made(number: int) -> Plan:
    if number == CONTROLLED:
        return plan_of(replace(load_scene("sprung_mass"), passivity="controller"))
    return plan_from(**PLANS[number])


@cache
def with_mass(stiffness: float = 200.0, active: float = 0.0) -> Plan:
    """A plan of a virtual mass, alone or beside a force that is active by intention; force fades in soon."""
    mass, constant = SprungMass("handle", stiffness=stiffness, mass=0.5), Constant("handle", magnitude=active)
    plan = plan_of(scene_of(mass, constant) if active else scene_of(mass))
    (axis,) = plan.axes
    return replace(plan, axes=(replace(axis, limits=replace(axis.limits, fade_in=0.01)),))


def powerful(plan: Plan, power: float) -> Plan:
    """The plan with a limit of power [W]."""
    return replace(plan, axes=tuple(replace(axis, limits=replace(axis.limits, power=power)) for axis in plan.axes))


class Drive:
    """A drive as octets: it takes targets over with the lag of its torque loop, and moves as a hand moves it."""

    def __init__(self, plan: Plan, seed: int) -> None:
        self._plan, (self._axis,), self._random = plan, plan.axes, Random(seed)
        self._t_ns, self._counts, self._speed, self._wanted, self._shown = 10**9, 0.0, 0.0, 0.0, 0.0
        self._wild = self._random.choice((0.0, 0.001, 0.004, 0.02))
        """Probability of something unusual in a period."""

    def image(self, target: int) -> bytes:
        """Return the next image, after this target; sometimes something is unusual in it."""
        random, axis, period_ns = self._random, self._axis, self._plan.period_ns
        lag = axis.delay.torque_loop if axis.profile.echo is Signal.TORQUE_ACTUAL else 0.0
        self._shown += (target - self._shown) * (1.0 - math.exp(-1e-9 * period_ns / lag) if lag else 1.0)
        if random.random() < 0.02:
            self._wanted = random.choice((0.0, 0.0, 0.3, 3.0, 12.0, -0.3, -3.0, -12.0, 40.0, -40.0))
        if not -3000.0 < self._counts < 6000.0:
            self._wanted = math.copysign(self._wanted, -self._counts)
        self._speed += max(-2.0, min(2.0, self._wanted - self._speed))
        self._counts += self._speed
        self._t_ns, age_ns, flags, code, statusword, jump = self._t_ns + period_ns, 100_000, 0, 0, ENABLED, 0.0
        if random.random() < self._wild:
            match random.randrange(9):
                case 0 | 1 | 2:
                    flags = int(LinkFlag.STALE)
                case 3:
                    self._t_ns += period_ns * random.choice((1, 2, 5)) // random.choice((1, 3))
                case 4:
                    self._t_ns -= period_ns // 3
                case 5:
                    jump = random.choice((3.0, 300.0, 30_000.0, 2.0**32))
                case 6:
                    self._shown += random.choice((50.0, 500.0))
                case 7:
                    statusword = random.choice((READY, FAULT, ENABLED | 0x80))
                case _:
                    flags, code = int(random.choice(list(LinkFlag))), 0x8130
        values = {
            Signal.STATUSWORD: statusword,
            Signal.POSITION: round(self._counts + jump) & 0xFFFF_FFFF,
        }
        values[Signal.POSITION] -= (values[Signal.POSITION] & 0x8000_0000) * 2
        shown = axis.rig.mechanism.sign * round(self._shown)
        codec = self._plan.image.axes[0].input
        mapped = [values.get(each.signal, shown) for each in axis.incoming]
        return codec.pack(self._t_ns, age_ns, flags, code, *mapped)


def kept(value: object, seen: set[int] | None = None) -> object:
    """Return all values of an object of the cycle, with those of its parts and of the variables of its functions."""
    if isinstance(value, int | float | str | bytes | bytearray | None):
        return repr(value)
    if isinstance(value, MethodType):
        return kept(value.__self__, seen)
    seen = set() if seen is None else seen
    if id(value) in seen:
        return None
    seen.add(id(value))
    if isinstance(value, dict):
        return {str(key): kept(each, seen) for key, each in value.items()}
    if isinstance(value, list | tuple | deque):
        return [kept(each, seen) for each in value]
    if isinstance(value, ordinary.ElsewhereJudged):  # its step keeps nothing that the ledger does not reach
        return [value.older, kept(value._ledger, seen)]
    if isinstance(value, FunctionType):
        # Both ways bind other functions there, and the ledger reaches all that its step keeps.
        other = value.__module__ in (ordinary.__name__, energy_steps.__name__)
        return [] if other else [kept(_content(cell), seen) for cell in _cells(value)]
    if type(value).__module__.startswith(("haptic_fieldbus.cycle", "haptic_fieldbus.numerics")):
        names = [*getattr(value, "__dict__", {}), *getattr(type(value), "__slots__", ())]
        return {name: kept(getattr(value, name), seen) for name in names}
    return None


def _cells(function: FunctionType) -> tuple[CellType, ...]:
    return function.__closure__ or ()


def _content(cell: CellType) -> object:
    try:
        return cell.cell_contents
    except ValueError:  # not bound yet
        return None


@contextmanager
def long_step() -> Iterator[None]:
    """Let ledgers that begin inside of the block have no shorter step for virtual masses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(energy_steps._Account, "bind_alone", lambda account, side, step: step)
        yield


def both(
    plan: Plan, seed: int, periods: int, changed: Plan | None = None, of: type[Drive] = Drive, *, strict: bool = False
) -> Iterator[Cycle]:
    """Run a plan in both ways on the same images, and compare each period.

    A live change begins in the middle. `strict`: from a third on, an account is judged that is within what is granted.
    """
    short, full, drive, target = Cycle(plan), Cycle(plan), of(plan, seed), 0
    changes = [] if changed is None else [each.prepare(plan, changed, 100) for each in (short, full)]
    for number in range(periods):
        image = drive.image(target)
        if 2 * number > periods and changes:
            begun = {change() for change in changes}
            assert len(begun) == 1
            changes = [] if begun == {True} else changes
        for each in (short, full) if strict and 3 * number == periods - 1 else ():
            each.ledgers[0].tally.largest = -1e-2
        with long_step():
            ours = bytes(full.full(image))
        assert short.step(image) == ours, number
        assert short.row == full.row or not short.axes, number
        assert (short.trip, short.enabled, repr(short.failure)) == (full.trip, full.enabled, repr(full.failure)), number
        if number % 64 == 0 or short.trip is not None:
            assert kept(short) == kept(full), number
        if short.trip is not None:
            break
        target = next(iter(short.axes.values())).state.target
        yield short


@settings(max_examples=examples(60))
@given(number=st.integers(0, CONTROLLED), seed=st.integers(0, 10**6), power=st.sampled_from((math.inf, 5.0)))
def test_both_ways_keep_the_same_values_whatever_comes(number: int, seed: int, power: float) -> None:
    for _ in both(powerful(made(number), power), seed, 1500):
        pass


def planted_alone(text: str, instead: str) -> Any:
    """Return `bind_alone` of the ledger with a changed text."""
    whole = inspect.getsource(energy_steps)
    own = inspect.getsource(energy_steps._Account.bind_alone)
    assert own.count(text) == 1, f"{text!r} is there {own.count(text)} times"
    names: dict[str, Any] = {"__name__": energy_steps.__name__}
    exec(compile(whole.replace(own, own.replace(text, instead)), "drift", "exec"), names)
    return names["_Account"].bind_alone


class Unsteady(Drive):
    """A drive that loses three samples in a row at times."""

    def image(self, target: int) -> bytes:
        octets, header = super().image(target), self._plan.image.axes[0].header
        if (self._t_ns // self._plan.period_ns) % 40 < 3:
            age_ns, flags, code = AXIS_HEADER.unpack_from(octets, header)
            return (
                octets[:header]
                + AXIS_HEADER.pack(age_ns, flags | LinkFlag.STALE, code)
                + octets[header + AXIS_HEADER.size :]
            )
        return octets


def steps_compared() -> None:
    """Compare the short step for virtual masses with the long one, on all that it must leave to the long one."""
    for seed in range(16):
        drive, active = (Drive, Unsteady)[seed % 2], 0.3 * (seed % 4 > 1)
        for _ in both(with_mass(200.0, active), seed, 400, with_mass(220.0, active), drive, strict=seed % 8 > 3):
            pass


@pytest.mark.parametrize(("text", "instead"), ALONE_DRIFTS)
def test_a_change_of_the_short_step_for_virtual_masses_shows(
    text: str, instead: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(energy_steps._Account, "bind_alone", planted_alone(text, instead))
    with pytest.raises(AssertionError):
        steps_compared()


def test_the_short_step_for_virtual_masses_is_the_same_as_the_long_one() -> None:
    steps_compared()


def difference(case: Case, bind: Any = bind_ordinary) -> str | None:
    """Return what differs between both ways in a case, with this short way; None if all is the same."""
    calls: list[int] = []

    def bound(*parts: Any) -> Step:
        full: Step = parts[-1]

        def count(image: bytes | bytearray) -> bytearray:
            calls.append(1)
            return full(image)

        step: Step = bind(*parts[:-1], count)
        return step

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cycle_module, "bind_ordinary", bound)
        short, full = Cycle(plan_named(case.plan)), Cycle(plan_named(case.plan))
    try:
        for given, ours, theirs in run_case(case, short, full, calls.clear):
            if ours != theirs:
                return f"{given}: octets {ours.hex()} and {theirs.hex()}"
            if given.ordinary is not None and given.ordinary == bool(calls):
                return f"{given}: {'full' if calls else 'short'} way"
            if kept(short) != kept(full):
                return f"{given}: kept values"
            calls.clear()
    except Exception as error:  # the short way lets no exception out
        return f"{type(error).__name__}: {error}"
    return None


ALONE = (
    "feedback = unpack(image)",
    "t_ns = feedback[T_NS]",
    "return full(image)",
    "if (",
    "or (",
    ")",
    "):",
)
"""Lines without which the function does not run, or that only hold others together."""


@pytest.mark.parametrize("name", CASES)
def test_a_period_at_the_edge_of_an_ordinary_one_is_the_same_in_both_ways(name: str) -> None:
    assert difference(CASES[name]) is None


def planted(text: str, instead: str) -> Any:
    """Return `bind_ordinary` of the module with a changed text."""
    source = inspect.getsource(ordinary)
    assert source.count(text) == 1, f"{text!r} is there {source.count(text)} times"
    names: dict[str, Any] = {"__name__": ordinary.__name__, "WIDER": math.nextafter(1.0, 2.0)}
    exec(compile(source.replace(text, instead), "drift", "exec"), names)
    return names["bind_ordinary"]


@pytest.mark.parametrize(("text", "instead", "name"), DRIFTS, ids=[f"{place}" for place in range(len(DRIFTS))])
def test_a_change_of_the_short_way_shows_in_its_case(text: str, instead: str, name: str) -> None:
    assert difference(CASES[name], planted(text, instead)) is not None


def test_each_comparison_and_each_value_that_is_kept_has_a_change() -> None:
    """Whoever adds a line to the short way plants its change too."""
    source = inspect.getsource(ordinary.bind_ordinary)
    texts = [text for text, _, _ in DRIFTS]
    written = [line.strip() for line in source[source.index("def period") :].splitlines()]
    for line in written:
        compares = line.startswith(("if ", "or ", "and ", "else ", "feedback[", "permission.un", "elif "))
        sets = " = " in line or " += " in line or " -= " in line or line.endswith(")")
        if (compares or sets) and not line.startswith(("#", "def ")) and line not in ALONE:
            assert any(part.strip() in line or line in text for text in texts for part in text.splitlines()), line


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets an item for each period that goes through the full code."""
    calls: list[int] = []

    def bound(*parts: Any) -> Step:
        full: Step = parts[-1]
        bind: Any = bind_ordinary

        def count(image: bytes | bytearray) -> bytearray:
            calls.append(1)
            return full(image)

        step: Step = bind(*parts[:-1], count)
        return step

    monkeypatch.setattr(cycle_module, "bind_ordinary", bound)
    return calls


@pytest.mark.thorough("draws 18,000 periods")
def test_three_fifths_of_the_drawn_periods_go_the_short_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a comparison of both ways would compare the full code with itself."""
    calls = counted(monkeypatch)
    passed = sum(1 for number in (0, 1, 2, 4) for seed in (1, 2, 3) for _ in both(made(number), seed, 1500))
    assert passed > 10_000
    assert len(calls) < 0.4 * passed


@pytest.mark.parametrize("number", range(5), ids=[each["scene"] for each in PLANS[:5]])
def test_most_periods_of_a_plan_with_one_axis_are_ordinary(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, drive = counted(monkeypatch), Drive(made(number), 1)
    drive._wild = 0.0
    cycle, target = Cycle(made(number)), 0
    for _ in range(3000):
        cycle(drive.image(target))
        assert cycle.trip is None
        target = cycle._first.state.target
    assert len(calls) < 1200, "force fades in for half a second"


@pytest.mark.parametrize("force", [math.nan, "raised"])
def test_a_law_that_fails_in_an_ordinary_period_takes_the_torque_away(force: object) -> None:
    @dataclass(frozen=True)
    class Failing(Wall):
        def force(self, position: float, velocity: float = 0.0) -> float:
            if position < 0.01:
                return super().force(position, velocity)
            if force == "raised":
                raise ValueError("no")
            return math.nan

    plan = plan_of(scene_of(Failing("handle", stiffness=100.0, position=0.002)))
    cycles = Cycle(plan), Cycle(plan)
    codec, zero = plan.image.axes[0].input, b"\x00\x00\x00\x00"
    for number in range(2000):
        image = codec.pack(10**9 + number * 10**6, 0, 0, 0, ENABLED, number, -cycles[0]._first.state.target)
        first, second = cycles[0].step(image), cycles[1].full(image)
        assert first == second
        assert repr(cycles[0].trip) == repr(cycles[1].trip), "as text, because a value that is nan equals no other"
        if cycles[0].trip is not None:
            break
    assert first == zero
    assert kept(cycles[0]) == kept(cycles[1])


def test_an_axis_whose_energy_nothing_bounds_has_no_ledger_and_is_rendered() -> None:
    plan = plan_from("wall", settings={"wall.position": 0.002})
    cycle = Cycle(replace(plan, axes=tuple(replace(a, limits=replace(a.limits, energy=math.inf)) for a in plan.axes)))
    assert cycle.ledgers == ()
    for number in range(700):
        target = cycle._first.state.target
        cycle.step(plan.image.axes[0].input.pack(10**9 + number * 10**6, 0, 0, 0, ENABLED, number, target))
    assert cycle.trip is None
    assert cycle._first.state.target < 0
