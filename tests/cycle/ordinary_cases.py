"""Periods at the edge of an ordinary one: a plan, a state of the handle, a change of what is kept, and images.

Each case says which of its images the short way takes. A bound of a guard has a case at the bound and just beyond it,
on both sides. What is kept is changed alike for both ways, where images would need long to lead there.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

from haptic_fieldbus.api import plan as plan_from
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.energy_steps import PlainAccount
from haptic_fieldbus.cycle.plausibility import TorqueEcho
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import plan_of, rig_of, scene_of

ENABLED, READY, FAULT, WARNED = 0x0637, 0x0631, 0x0638, 0x06B7
STEPS = 200
"""Counts of the handle in contact; the wall begins at 41."""
SIGNS = (1.0, -1.0)
Change = Callable[[Cycle], None]


@cache
def plan_named(name: str) -> Plan:
    """A plan of one axis whose force fades in within 10 periods; the name says what is special in it."""
    if name == "other masters":
        plan = plan_from("wall", drive="generic_cia402_modbus", bus="sim-modbus-tcp")
    elif name == "by place":
        plan = plan_from("hunt_crossley", drive="generic_cia402")
    else:
        scene = scene_of(Wall("handle", stiffness=600.0, position=0.0005))
        if name == "velocity":
            scene = scene_of(Wall("handle", stiffness=600.0, position=0.0005), Damper("handle", damping=1.0))
        rig = rig_of(scene)
        if name == "turned":
            mechanism = replace(rig.axis["handle"].mechanism, sign=-1)
            rig = replace(rig, axis={"handle": replace(rig.axis["handle"], mechanism=mechanism)})
        plan = plan_of(scene, rig=rig)
    (axis,) = plan.axes
    limits = replace(axis.limits, fade_in=0.01, echo=0.035)
    unit = axis.position_unit
    if name == "range":
        limits = replace(limits, position=(-20 * unit, 20 * unit))
    if name == "narrow range":
        limits = replace(limits, position=(math.nextafter(-20 * unit, 0.0), math.nextafter(20 * unit, 0.0)))
    if name == "power":
        limits = replace(limits, power=1e-3)
    axis = replace(axis, limits=limits)
    if name == "unwatched":
        axis = replace(axis, plant=None)
    return replace(plan, axes=(axis,))


@dataclass(frozen=True)
class Image:
    """A sample; the counts go on by `way`, and time by `passed` or a period. `ordinary`: the short way takes it."""

    way: int = 0
    ordinary: bool | None = None
    passed: int | None = None
    flags: int = 0
    statusword: int = ENABLED
    shown: int = 0
    """Difference from the echo that is expected."""
    age: int = 100_000
    """[ns]"""


OLDEST_NS = 30_000_000
"""Largest permitted age of feedback: 0.6 times the watchdog time of 50 ms."""


@dataclass(frozen=True)
class Case:
    """`begin` periods lead to the state: in contact, or free; then `change`, then the images, then three usual ones."""

    name: str
    images: tuple[Image, ...]
    change: Change = lambda cycle: None
    plan: str = "usual"
    contact: bool = True
    begin: int = 80
    counts: int | None = None
    """Counts of the first image after the change; None: those before."""


class Handle:
    """Images for a cycle: a handle whose counts are given, and a drive whose echo is what the cycle expects."""

    def __init__(self, plan: Plan) -> None:
        self._plan, (self._axis,) = plan, plan.axes
        self._t_ns, self._counts = 10**9, 0

    def image(self, cycle: Cycle, given: Image) -> bytes:
        self._t_ns += self._plan.period_ns if given.passed is None else given.passed
        self._counts += given.way
        echo, state = cycle._first.echo, cycle._first.state
        assert echo is not None
        expected = echo.kept * echo.torque + echo.older * echo.before[0] + echo.own * state.target
        values = {Signal.STATUSWORD: given.statusword, Signal.POSITION: self._counts}
        shown = round(expected / echo.ratio) + given.shown
        mapped = [values.get(each.signal, shown) for each in self._axis.incoming]
        return self._plan.image.axes[0].input.pack(self._t_ns, given.age, given.flags, 0, *mapped)

    def place(self, counts: int) -> None:
        """Put the counts elsewhere, before the next image."""
        self._counts = counts


def leading(case: Case) -> Iterator[Image]:
    """Yield the images that lead to the state of a case: free at 0, or in the wall, coming and standing still."""
    for number in range(case.begin):
        moves = case.contact and 20 <= number < 20 + STEPS // 5
        yield Image((-5 if case.plan == "turned" else 5) if moves else 0)


def account(cycle: Cycle) -> PlainAccount:
    assert isinstance(cycle._account, PlainAccount)
    return cycle._account


def echo(cycle: Cycle) -> TorqueEcho:
    found = cycle._first.echo
    assert found is not None
    return found


def sent(cycle: Cycle, last: int, older: int, side: int, *, settles: bool = False) -> None:
    """Change the last targets and the side of the account."""
    cycle._first.state.target, account(cycle).older, echo(cycle).before[0] = last, older, older
    account(cycle).side, account(cycle).settles, account(cycle).energy = side, settles, -1e-3


def moved(cycle: Cycle, way: float) -> None:
    """Let the next sample at 0 be a motion by `way`, as the one before was."""
    cycle._first.state.position = account(cycle).last = -way
    cycle._first.state.way = way


def largest_way(cycle: Cycle, sign: float, *, beyond: bool) -> None:
    way = sign * cycle._first.bounds[3]
    moved(cycle, math.nextafter(way, sign * math.inf) if beyond else way)


def jump(cycle: Cycle, sign: float, *, beyond: bool) -> None:
    before = sign * cycle._first.bounds[4]
    cycle._first.state.way = math.nextafter(before, sign * math.inf) if beyond else before


def wraps(cycle: Cycle, sign: int) -> None:
    """Put the handle one count before the place where the counts wrap around."""
    state = cycle._first.state
    state.zero_counts = -sign * 2
    state.position = account(cycle).last = sign * (2**31 - 2) * cycle._first.axis.position_unit
    state.way = sign * cycle._first.axis.position_unit


def echo_off(cycle: Cycle, sign: int, *, beyond: bool) -> None:
    """Let an echo that is 30 steps beside no torque be just within its tolerance, or just beyond."""
    within = sign * (30 - echo(cycle).doubt.tolerance) / echo(cycle).kept
    while abs(sign * 30 - echo(cycle).kept * within) > echo(cycle).doubt.tolerance:
        within *= 1.1
    echo(cycle).torque = 0.0 if beyond else within


def energy(cycle: Cycle, way: int, *, beyond: bool) -> None:
    """Set the limit of the account to the energy after a motion by `way` counts, or just below it."""
    own, state = account(cycle), cycle._first.state
    own.active, own.leak, own.older, echo(cycle).before[0] = 0.3, 0.7, state.target - 3, state.target - 3
    here = (state.feedback[cycle._first.axis.place_of(Signal.POSITION)] + way - (state.zero_counts or 0)) * (
        cycle._first.axis.position_unit
    )
    moved = here - own.last
    given = moved * (own.early * own.older + own.late * state.target - own.leak * moved)
    after = own.energy + (given - (own.active * moved if moved > 0.0 else -own.active * moved))
    own.limit = math.nextafter(after, -math.inf) if beyond else after


def still(cycle: Cycle, *, beyond: bool, effort: str = "pressed") -> None:
    """Let counts have stood still for the time of a test, or just longer."""
    each = cycle._first
    each.state.moved_ns = each.state.feedback[0] + 1_000_000 - math.floor(each.still_ns) - int(beyond)
    target = abs(each.state.target)
    if each.standstill is not None:
        each.standstill._least = target + (0 if effort == "due" else 1)


def force(cycle: Cycle, value: float | Exception, before: float) -> None:
    """Let the law of the scene give this force, after this permitted one."""

    def field(position: float) -> float:
        if isinstance(value, Exception):
            raise value
        return value

    cycle._first.field, cycle._first.permission.before = field, before


def edge(cycle: Cycle, sign: float, kind: str, *, beyond: bool) -> None:
    limits = cycle._first.axis.limits
    change = limits.slew * cycle._first.period
    bound = sign * (limits.effort if kind == "effort" else change)
    bound = math.nextafter(bound, sign * math.inf) if beyond else bound
    force(cycle, bound, sign * limits.effort if kind == "effort" else 0.0)


def limited(cycle: Cycle) -> None:
    """Let an encoder pulse be at work: it needs no account of its own."""
    cycle._first.permission.pulses = lambda force, bound: 0.5 * force
    cycle._first.permission.unchanged = False


def followed(cycle: Cycle) -> None:
    """Let no contact be looked for."""
    account(cycle).settles = False


def beside(cycle: Cycle) -> None:
    cycle._first.permission.beside = True


def block(cycle: Cycle, left: int) -> None:
    watch = cycle._first.sign_watch
    assert watch is not None
    watch.left = left


def lean(cycle: Cycle, sign: int, steps: int) -> None:
    """Let the last force be this many steps above the holding force, after a long standstill without a test."""
    still(cycle, beyond=True)
    most = round(cycle._first.axis.limits.holding / cycle._first.axis.effort_unit)
    sent(cycle, sign * (most + steps), sign * (most + steps), sign)


def both_sides() -> Iterator[Case]:
    """Yield the bounds that have two sides, at the bound and beyond it."""
    for sign in SIGNS:
        for beyond in (False, True):
            which, on = "beyond" if beyond else "at", "up" if sign > 0.0 else "down"
            step = int(sign)
            yield from (
                Case(f"{name} {which} {on}", (Image(way, ordinary=not beyond),), change, plan, contact)
                for name, way, change, plan, contact in (
                    ("speed", 0, partial(largest_way, sign=sign, beyond=beyond), "usual", False),
                    ("jump", 0, partial(jump, sign=sign, beyond=beyond), "usual", False),
                    ("energy", step, partial(energy, way=step, beyond=beyond), "usual", True),
                    ("range", 20 * step, lambda cycle: None, "narrow range" if beyond else "range", False),
                )
            )
            yield Case(
                f"echo {which} {on}",
                (Image(shown=30 * step, ordinary=not beyond),),
                partial(echo_off, sign=step, beyond=beyond),
                contact=False,
            )
            for kind in ("effort", "slew"):
                change = partial(edge, sign=sign, kind=kind, beyond=beyond)
                yield Case(f"{kind} {which} {on}", (Image(ordinary=True),), change)


def one_side() -> Iterator[Case]:
    """Yield all other guards."""
    yes, no = Image(ordinary=True), Image(ordinary=False)
    yield Case("not enabled", (Image(statusword=READY, ordinary=False), Image(statusword=READY, ordinary=False)))
    yield Case("tripped", (Image(flags=int(LinkFlag.BUS_OFF), ordinary=False), no))
    yield Case("no zero yet", (Image(flags=int(LinkFlag.STALE), ordinary=False), no), followed, begin=0)
    for target, older, side, settles, ordinary in (
        (5, 5, 0, True, False),
        (5, 5, -5, False, True),
        (5, 3, -5, False, False),
        (-5, 3, 5, False, False),
        (5, 3, 0, False, False),
        (0, 3, 3, False, False),
        (5, 3, 1, False, True),
        (-5, -3, -1, False, True),
        (0, 0, 0, False, True),
        (0, 0, 0, True, False),
    ):
        name = f"account {target} {older} {side}{' settles' * settles}"
        change = partial(sent, last=target, older=older, side=side, settles=settles)
        yield Case(name, (Image(ordinary=ordinary), Image(3)), change)
    for flag in LinkFlag:
        yield Case(f"flag {flag.name}", (Image(flags=int(flag), ordinary=False),))
    yield Case("fault", (Image(statusword=FAULT, ordinary=False),))
    yield Case("warning", (Image(statusword=WARNED, ordinary=True),))
    yield Case("late answer", (Image(flags=int(LinkFlag.STALE), passed=0, ordinary=False), no, yes))
    yield Case("as old as it may be", (Image(age=OLDEST_NS, ordinary=True),))
    yield Case("too old", (Image(age=OLDEST_NS + 1, ordinary=False), no))
    yield Case("gap", (Image(passed=3_000_000, ordinary=False), yes))
    yield Case("law beside the handle", (no,), beside)
    yield Case("doubt", (Image(shown=60, ordinary=False), no, yes))
    for passed, ordinary in ((500_000, False), (500_001, True), (1_499_999, True), (1_500_000, False)):
        yield Case(f"after {passed} ns", (Image(2, passed=passed, ordinary=ordinary),))
    deep = Image(1, ordinary=False), Image(0), Image(-1, ordinary=False)
    yield Case("leak by place", deep, partial(sent, last=5, older=5, side=1), "by place")
    yield Case("stands still, no torque", (yes,), partial(still, beyond=True), contact=False)
    for beyond in (False, True):
        named = "beyond" if beyond else "at"
        due = partial(still, beyond=beyond, effort="due")
        yield Case(f"test of the encoder {named}", (Image(ordinary=not beyond),), due)
    yield Case("test of the encoder not due", (yes,), partial(still, beyond=True))
    for sign in (1, -1):
        for steps in (-1, 0, 1):
            name = f"leans with {sign * steps} beyond {sign} times the holding force"
            yield Case(name, (Image(ordinary=steps < 1),), partial(lean, sign=sign, steps=steps), "unwatched")
        name, change = f"change of the force against {sign}", partial(force, value=sign * 5.0, before=-sign * 20.0)
        yield Case(name, (yes,), change)
    yield Case("motor direction turned", (yes, Image(-1, ordinary=True)), plan="turned")
    yield Case("encoder pulse", (yes, Image(1, ordinary=True), yes), limited)
    for value in (math.nan, math.inf, -math.inf, ValueError("no")):
        yield Case(f"law gives {value!r}", (yes, Image(ordinary=False)), partial(force, value=value, before=1.0))
    for left in (0, 1, 2):
        yield Case(f"{left} to come of a block", (yes, Image(1, ordinary=True), yes), partial(block, left=left))
    for plan in ("usual", "velocity", "other masters", "by place", "power", "unwatched", "turned"):
        turn = -1 if plan == "turned" else 1
        ways = tuple(Image(turn * way) for way in (2, -2, 3, 0, 0, -1, 4, 1))
        pressed: Change = partial(sent, last=5, older=5, side=1)
        yield Case(f"motion, {plan}", ways, pressed if plan == "other masters" else Case.change, plan)
    for sign, counts in ((1, 2**31 - 2), (-1, -(2**31) + 1)):
        yield Case(f"counts wrap around {sign}", (no,), partial(wraps, sign=sign), contact=False, counts=counts)


CASES = {case.name: case for case in (*both_sides(), *one_side())}


def run_case(case: Case, short: Any, full: Any, begun: Callable[[], None]) -> Iterator[tuple[Image, bytes, bytes]]:
    """Lead both cycles through the full code, then give each image; yield it with both answers, copied."""
    handle = Handle(plan_named(case.plan))
    for given in leading(case):
        image = handle.image(full, given)
        for cycle in (short, full):
            cycle.full(image)
    for cycle in (short, full):
        case.change(cycle)
    if case.counts is not None:
        handle.place(case.counts)
    begun()
    for given in (*case.images, Image(1), Image(0), Image(-1)):
        image = handle.image(full, given)
        yield given, bytes(short.step(image)), bytes(full.full(image))
