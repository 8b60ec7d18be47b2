"""The checker at work: every run on a simulated bus within `watched` gets a witness, and is judged at its end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from tests.invariants import outcome, proofs
from tests.invariants.places import Place, pdos_of, place_of
from tests.invariants.stated import Stated, stated
from tests.invariants.witness import Part, Shaft, Witness
from tests.invariants.words import State

MOST_FRAMES, KEPT_FRAMES = 200_000, 2_000
"""Frames after which a run is judged so far, and those that are kept of it: memory is bounded."""


@dataclass
class Findings:
    """Observations of the runs."""

    broken: list[tuple[str, str]] = field(default_factory=list)
    """(name of the law, sentence)."""
    runs: int = 0
    watching: bool = True
    """Whether runs that begin now get a witness."""
    keep: bool = False
    """Whether witnesses are kept after they were judged."""
    witnesses: list[Witness] = field(default_factory=list)
    settle: Callable[[], None] = lambda: None
    """Judges the runs whose master has not left."""


class Watch:
    """Puts witnesses at simulated buses, and judges them."""

    def __init__(self, findings: Findings) -> None:
        self.findings = findings
        self._open: dict[int, tuple[Witness, Place]] = {}
        self.judged: list[Witness] = []
        """Since the last run of the API began."""
        self._proving = self._asked = self._must_prove = False

    def begin(self, bus: Any, plan: Any) -> None:
        """A master is about to configure its drives, for the first time or anew."""
        if id(bus) in self._open:
            self._again(*self._open[id(bus)])
            return
        world = place_of(bus) if self.findings.watching else None
        if world is None:
            return
        shafts = {axis.node: _shaft(world, axis.node) for axis in plan.axes if axis.node in world.nodes}
        witness = Witness(_stated(plan), world.clock, shafts, world.now_ns, proves=self._proving)
        witness.may_prove, witness.must_prove = self._asked or not plan.simulated, self._must_prove
        frames = witness.frames

        def seen(t_ns: int, can_id: int, data: bytes, sender: int) -> None:
            frames.append((t_ns, can_id, data, sender))
            if len(frames) >= MOST_FRAMES:
                self._shorten(witness, t_ns)

        world.watch(seen)
        self._open[id(bus)] = witness, world

    def _again(self, witness: Witness, world: Place) -> None:
        """Another part begins."""
        begun_ns, now_ns = witness.earlier[-1].ended_ns if witness.earlier else witness.begun_ns, world.clock.now_ns()
        witness.earlier.append(Part(begun_ns, now_ns, witness.proves, witness.released_ns))
        witness.proves, witness.released_ns = self._proving, None

    def prove(self, inner: Callable[..., Any], *args: Any) -> Any:
        """The guards of the drives are proved meanwhile."""
        self._proving = True
        try:
            return inner(*args)
        finally:
            self._proving = False

    def _shorten(self, witness: Witness, t_ns: int) -> None:
        """Judge a long run so far, and forget all but the last part of it."""
        witness.seen_ns, witness.whole = t_ns, False
        self.findings.broken += proofs.broken(witness)
        del witness.frames[:-KEPT_FRAMES]
        for shaft in witness.shafts.values():
            del shaft.targets[:-KEPT_FRAMES]
            shaft.angles = {t_ns: shaft.angles[t_ns] for t_ns, _ in shaft.targets}

    def released(self, bus: Any) -> None:
        """A master was told to let go."""
        if id(bus) in self._open:
            witness, world = self._open[id(bus)]
            if witness.released_ns is None and witness.enabled_ns is not None:
                witness.released_ns = world.clock.now_ns()

    def end(self, bus: Any) -> None:
        """A master has left."""
        if id(bus) not in self._open:
            return
        witness, world = self._open.pop(id(bus))
        witness.closed_ns = world.clock.now_ns()
        self.judge(witness, world)

    def judge(self, witness: Witness, world: Place) -> None:
        """Bring the truth up to date, and judge it."""
        world.run()
        witness.seen_ns = world.now_ns
        for node, shaft in witness.shafts.items():
            drive = world.slave(node).drive
            drive.servo.advance(witness.seen_ns)
            shaft.now = State(drive.power.state.value)
            shaft.angles[witness.seen_ns] = float(drive.plant.state[0])
        self.findings.runs += 1
        self.findings.broken += proofs.broken(witness)
        self.judged.append(witness)
        if self.findings.keep:
            self.findings.witnesses.append(witness)

    def end_all(self) -> None:
        """Judge the runs whose master has never left."""
        for witness, world in [*self._open.values()]:
            self.judge(witness, world)
        self._open.clear()

    def render(self, inner: Callable[..., Any], request: Any, place: Any) -> Any:
        """A run of the API: its outcome is judged too."""
        if not self.findings.watching:
            return inner(request, place)
        plan = request.plan
        self.judged, self._must_prove = [], not plan.simulated
        self._asked = request.prove
        error: BaseException | None = None
        result: Any = None
        try:
            result = inner(request, place)
        except Exception as raised:
            error, result = raised, getattr(raised, "result", None)
            raise
        finally:
            self._asked = self._must_prove = False
            if plan.simulated and self.judged:
                name = None if error is None else type(error).__name__
                cycles = getattr(result, "cycles", 0) or 0
                told = outcome.Ended(name, str(error or ""), cycles, request.record)
                self.findings.broken += outcome.wrong(self.judged, told)
        return result


@contextmanager
def watched(*, keep: bool = False) -> Iterator[Findings]:
    """Judge every run on a simulated bus meanwhile; `keep` its witnesses too."""
    from haptic_fieldbus.buses.canopen.master import CanopenBus
    from haptic_fieldbus.buses.modbus.master import ModbusBus
    from haptic_fieldbus.running import proofs, session

    watch = Watch(Findings(keep=keep))
    watch.findings.settle = watch.end_all
    render, prove = session.Session.render, proofs.prove

    def rendered(request: Any, place: Any) -> Any:
        return watch.render(render, request, place)

    def proved(*args: Any) -> Any:
        return watch.prove(prove, *args)

    patched: Any = session.Session
    patched.render = rendered
    patched_proving: Any = proofs
    patched_proving.prove = proved
    with _told(CanopenBus, watch), _told(ModbusBus, watch):
        try:
            yield watch.findings
        finally:
            patched.render, patched_proving.prove = render, prove
            watch.end_all()


@contextmanager
def _told(master: Any, watch: Watch) -> Iterator[None]:
    """Tell of what masters of a kind are asked to do."""
    configure, release, close = master.configure, master.release, master.close

    def configured(self: Any, plan: Any) -> None:
        watch.begin(self, plan)
        configure(self, plan)

    def released(self: Any) -> None:
        watch.released(self)
        release(self)

    def closed(self: Any) -> None:
        close(self)
        watch.end(self)

    master.configure, master.release, master.close = configured, released, closed
    try:
        yield
    finally:
        master.configure, master.release, master.close = configure, release, close


def _shaft(world: Place, node: int) -> Shaft:
    """Write down from now on what the drive does."""
    drive = world.slave(node).drive
    power, recorder = drive.power, drive.plant.recorder
    shaft = Shaft(
        node,
        State(power.state.value),
        1e-3 * drive.objects.rated_torque,
        drive.objects.torque_unit,
        world.faults(node),
        targets=[(world.now_ns, drive.servo._target)],
        angles={world.now_ns: float(drive.plant.state[0])},
    )
    make, start, target = power._make, power.start, recorder.target

    def made(transition: Any) -> Any:
        shaft.transitions.append((world.now_ns, transition.number))
        return make(transition)

    def started() -> Any:
        shaft.transitions.append((world.now_ns, -1))
        return start()

    def targeted(t_ns: int, torque: float) -> None:
        shaft.targets.append((t_ns, torque))
        shaft.angles[t_ns] = float(drive.plant.state[0])
        target(t_ns, torque)

    power._make, power.start, recorder.target = made, started, targeted
    return shaft


def _stated(plan: Any) -> Stated:
    """The plain numbers of a part of a plan, as the whole has them in its JSON, of its rig and of its drives."""
    from haptic_fieldbus.planning.explain import _sign_json, limit_rows

    told = {
        "pdos": pdos_of(plan),
        "limits": [
            {"axis": axis.name, "limit": row.name, "value": row.value, "after_s": row.time}
            for axis in plan.axes
            for row in limit_rows(axis, plan.period)
        ],
        "couplings": [each.name for each in plan.scene.couplings],
        "deadlines": [each.to_json() for each in plan.deadlines],
        "sign": [_sign_json(axis, plan.period) for axis in plan.axes],
        "permissions": [
            {
                "axis": axis.name,
                "workspace": axis.workspace.value,
                "sign_pulse": axis.rig.permissions.sign_pulse,
                "sign_effort": axis.rig.permissions.sign_effort,
            }
            for axis in plan.axes
        ],
        "guards": [guard.to_json() for guard in plan.guards],
    }
    return stated(
        told,
        plan.period_ns * 1e-9,
        {axis.name: axis.rig.mechanism.ratio for axis in plan.axes},
        {axis.name: axis.rig.encoder_counts_per_revolution for axis in plan.axes},
        {axis.name: axis.delay.torque_loop for axis in plan.axes},
        {axis.name: None if axis.other_masters is None else axis.other_masters.blind for axis in plan.axes},
    )
