"""The live view's end inside a run: rows go out through a ring, commands come in through a local socket.

The loop pays one row a period and the test of one attribute. All else is done by two threads of its process, which
sleep until a command comes: one receives, so that STOP never waits, the other judges changes. A reader is another
process (`haptic_fieldbus.view`): it connects to a socket in a folder that only this user may enter, gets the descriptor
of the ring and the description of the run, and sends commands, one JSON object a line:

| command | effect |
|---|---|
| `{"stop": true}` | the run ends as by Ctrl-C |
| `{"change": {"wall.stiffness": 800.0}}` | judged as a change of `Changes.request`, then made or refused |
| `{"pages": 1}` | says, again and again, that a page is shown; with `required` its loss ends the run |
| `{"pull": ["handle", 0.01]}` | simulation only: the hand pulls the handle to a place; null lets go |
| `{"hand": "push"}` | simulation only: another hand takes the handle |
| `{"scene": "detents"}` | simulation only: the run ends and one with that scene begins, if it can be run |
| `{"speed": 0.1}`, `{"paused": true}`, `{"step": 1}` | simulation only: the pace of the simulated time |

No command enables a drive.
"""

import contextlib
import json
import math
import os
import re
import selectors
import signal
import socket
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from time import monotonic, monotonic_ns
from typing import TYPE_CHECKING, Any, Protocol

from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.ring import RingWriter
from haptic_fieldbus.signals import LinkFlag

if TYPE_CHECKING:
    from haptic_fieldbus.running.changes import Changes

Message = Mapping[str, Any]
RING_TIME = 30.0
"""Time that the ring holds [s]."""
LONGEST_RING = 120_000
_IN_FILE = re.compile(r"^.*?\.toml: --set ")
"""Beginning of a refusal that only a command line needs."""
LONGEST_LINE = 65_536
"""Octets of a command after which its sender is left."""
PAGE_LOST = 1.0
"""Time without a page after which a run that requires one ends [s]."""
FIRST_PAGE = 120.0
"""Time for which a run that requires a page waits for the first one [s]."""
POLL = 0.25
SLACK_NS = 2_000_000
"""By how much simulated time may be ahead of real time, so that not every period sleeps."""
NEXT_SCENE = 0
"""Mark of an end after which another scene begins; a signal, and STOP, take its place."""
MOST_CHANGES = 8
"""Tasks that wait to be judged, from which on a further change is refused: judging takes time beside the loop."""
MOST_STEPS = 10_000
"""Largest number of periods that a paused simulation is still to go on."""
SEND_BUFFER = 1 << 20
"""Octets that wait for a reader before it is left, as far as the system permits them."""
BEHIND_NS = 100_000_000
"""By how much a slow computer may fall behind before the simulated time is no longer made up for."""
NO_COMMAND = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
"""Errors of a line that is no JSON object, whose sender is left, and of a command whose value is refused."""
RUN_COLUMNS = ("t", "enabled", "missed", "lateness_us", "compute_us", "energy", "changes")
"""Columns of the run, which stand after those of the record; then comes the power state of each axis as a number."""
HANDS = ("push", "tap", "release", "none")
"""Hands of a simulation that a page may choose."""
EXPECTED = {
    "pages": "expected a number of pages", "pull": "expected an axis and a place, or null to let go",
    "hand": f"expected one of {', '.join(HANDS)}", "scene": "expected a scene that this simulation offers",
    "speed": "expected a finite number", "paused": "expected true or false", "step": "expected a number of periods",
}  # fmt: skip
"""End of the sentence that refuses the value of a command."""
STATES = {state: state.value for state in PowerState}


def folder() -> Path:
    """Return the folder of the sockets, made if it is not there; raises UsageError where others may enter it."""
    found = Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"haptic-fieldbus-{os.getuid()}"
    found.mkdir(mode=0o700, exist_ok=True)
    status = found.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
        raise UsageError(f"{found} is not a folder of this user alone; remove it")
    return found


def sockets() -> list[Path]:
    """Return the sockets of the runs that can be viewed, the newest first; those of ended runs are removed."""
    alive = []
    for path in folder().glob("*.sock"):
        with socket.socket(socket.AF_UNIX) as probe:
            try:
                probe.connect(str(path))
            except OSError:
                path.unlink(missing_ok=True)
            else:
                alive.append(path)
    return sorted(alive, key=lambda path: path.stat().st_mtime, reverse=True)


class SimulatedTime(VirtualClock):
    """Virtual time that follows real time, faster or slower, or stands still; nothing in it depends on the pace."""

    def __init__(self) -> None:
        super().__init__()
        self.speed, self.paused = 1.0, False
        self.period_ns = 1_000_000
        """Period of the loop, which is what one step lets pass."""
        self._until_ns = 0
        """Time up to which a paused simulation may go on."""
        self.leaving: Callable[[], bool] = lambda: False
        """Whether the run is to end, which waits for no pace."""
        self.changed = threading.Event()
        self._anchor = (self.now_ns(), monotonic_ns())

    def sleep_until(self, deadline_ns: int) -> int:
        while not self.leaving() and (wait_ns := self._ahead_ns(deadline_ns)) > 0:
            self.changed.clear()
            self.changed.wait(min(wait_ns * 1e-9, POLL))
        return super().sleep_until(deadline_ns)

    def set(self, *, speed: float | None = None, paused: bool | None = None, steps: int = 0) -> None:
        """Change the pace; any thread may call it. A simulation that is paused goes on by `steps` periods."""
        now_ns = self.now_ns()
        self.speed = self.speed if speed is None else min(max(speed, 0.001), 10.0)
        if paused is not None and paused is not self.paused:
            self._until_ns, self.paused = now_ns, paused
        further = max(self._until_ns, now_ns) + max(0, steps) * self.period_ns
        self._until_ns = min(further, now_ns + MOST_STEPS * self.period_ns)
        self._anchor = (now_ns, monotonic_ns())
        self.changed.set()

    def _ahead_ns(self, deadline_ns: int) -> float:
        """Return how long a deadline has to be waited for [ns]."""
        if self.paused:
            self._anchor = (self.now_ns(), monotonic_ns())
            # Not each wait is a period: the world behind a simulated bus waits for each of its events.
            return 0 if deadline_ns <= self._until_ns else math.inf
        virtual_ns, real_ns = self._anchor
        ahead_ns = (deadline_ns - virtual_ns) / self.speed - (monotonic_ns() - real_ns)
        if ahead_ns < -BEHIND_NS:
            self._anchor = (deadline_ns, monotonic_ns())
        return ahead_ns if ahead_ns > SLACK_NS else 0


class Handle(Protocol):
    """The handle of a simulated axis, as a hand takes it; efforts and places are in the workspace."""

    def pull(self, position: float, target: float, period: float) -> None:
        """Pull towards a place with a spring."""

    def let_go(self) -> None:
        """Let go."""

    def take(self, hand: str) -> None:
        """Let the hand of this name take the handle."""


class LiveRecord(Record):
    """A record whose rows also go to the ring; `after` is called once a period, after them."""

    def __init__(self, columns: Sequence[str], capacity: int, ring: RingWriter) -> None:
        super().__init__(columns, capacity)
        self.ring, self._show = ring, ring.push
        self.of_run: Callable[[], tuple[float, ...]] = lambda: (math.nan,) * len(RUN_COLUMNS)
        self.after: Callable[[], None] | None = None

    def push(self, row: Sequence[float]) -> None:
        super().push(row)
        self._show(row, self.of_run())
        if self.after is not None:
            self.after()


@dataclass(eq=False)
class _Reader:
    """A process that is connected."""

    socket: socket.socket
    received: bytes = b""

    def send(self, message: Message, *, fd: int | None = None) -> bool:
        """Send a line; False when the reader does not take it."""
        line = json.dumps(message).encode() + b"\n"
        try:
            if fd is None:
                self.socket.sendall(line)
            else:
                sent = socket.send_fds(self.socket, [line], [fd])
                self.socket.sendall(line[sent:])
        except OSError:
            return False
        return True


class Live:
    """The live view of one run; `describe` makes the description of a plan that a page needs.

    Give it to `run` as `live`, and use it as a context manager around it.
    """

    def __init__(
        self,
        describe: Callable[[Plan], Message],
        *,
        required: bool = False,
        handles: Callable[[Plan, Mapping[str, Any]], Mapping[str, Handle]] | None = None,
    ) -> None:
        if not hasattr(socket, "send_fds"):
            raise UsageError("the live view needs Linux or macOS")
        self._describe, self._required, self._handles_of = describe, required, handles
        self.command: list[str] = []
        """Command line of the run, for a page to copy."""
        self.ready: Callable[[], None] = lambda: None
        """Called before a bus is opened: waits for the server."""
        self.scenes: Sequence[str] = ()
        """Scenes that a page may begin in place of this one, in simulation."""
        self.check_scene: Callable[[str], object] = lambda name: None
        """Raises the error of a run with a scene; called while the present run goes on."""
        self.next_scene: str | None = None
        """Scene for which the run was ended."""
        self._run = 0
        """Number of the run; a page draws itself anew for another one."""
        self.time = SimulatedTime()
        self.changes: Changes | None = None
        self.led = False
        """True when a pointer led a handle or a page chose another hand."""
        self.lost = False
        """True when the run was ended because its page was lost."""
        self.path = folder() / f"{os.getpid()}.sock"
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._readers: list[_Reader] = []
        self._lock = threading.Lock()
        """Held while readers are added, removed or written to."""
        self._hello: dict[str, Any] | None = None
        self._record: LiveRecord | None = None
        self._handles: Mapping[str, Handle] = {}
        self._pulled: dict[str, float | None] = {}
        self._taken: str | None = None
        """Hand that is to take the handles."""
        self._ending: EndSignals | None = None
        self._shown, self._pacing = threading.Event(), threading.Event()
        self._page_seen = math.inf
        self._ended = False

    def __enter__(self) -> "Live":
        self.path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.path))
        self._listener.listen(8)
        self._wake, self._woken = socket.socketpair()
        self._threads = [
            threading.Thread(target=work, name=f"live view: {work.__name__}", daemon=True)
            for work in (self._receive, self._judge)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._tasks.put(None)
        self._wake.close()
        for thread in self._threads:
            thread.join()
        for each in (self._listener, self._woken, *(reader.socket for reader in self._readers)):
            each.close()
        self.path.unlink(missing_ok=True)
        if self._record is not None:
            self._record.ring.close()

    @property
    def goes_on(self) -> bool:
        """Whether the run has ended for another scene alone; Ctrl-C and STOP take its place."""
        return self._ending is not None and self._ending.signal == NEXT_SCENE

    def renew(self) -> str | None:
        """Prepare the next run and return its scene; None when no other one is to begin."""
        scene, ending, record = self.next_scene, self._ending, self._record
        if not self.goes_on or ending is None or record is None:
            return None
        with self._lock:  # a reader that connects now waits for the description of the next run
            self._hello, self._handles, self._record, self._ending = None, {}, None, None
        record.ring.close()
        speed, self.time = self.time.speed, SimulatedTime()
        self.time.set(speed=speed)
        self._pulled.clear()
        self._shown.clear()
        self._page_seen, self._taken, self.led, self.next_scene = math.inf, None, False, None
        self._run, self.ready = self._run + 1, lambda: None
        ending.signal = None
        ending.resume()
        return scene

    # What the run calls.

    def record(self, plan: Plan, columns: Sequence[str], capacity: int) -> Record:
        """Return the record of the run, whose rows are shown too."""
        self.ready()
        width = len(columns) + len(RUN_COLUMNS) + len(plan.axes)
        ring = RingWriter(width, min(LONGEST_RING, math.ceil(RING_TIME * plan.rate)))
        self._record = LiveRecord(columns, capacity, ring)
        return self._record

    def begin(
        self, plan: Plan, cycle: Cycle, report: LoopReport, worlds: Mapping[str, Any], ending: EndSignals
    ) -> None:
        """Show the run from now on; with `required`, wait for a page. Raises UsageError when none comes."""
        record = self._record
        if record is None:
            raise UsageError("this view has no record; call `record` first")
        self.time.period_ns = plan.period_ns
        self._ending, self.time.leaving = ending, lambda: ending.signal is not None
        if plan.simulated and self._handles_of is not None:
            self._handles = self._handles_of(plan, worlds)
        record.of_run, record.after = self._of_run(cycle, report), self._after(plan, cycle, report)
        columns = [*record.columns, *RUN_COLUMNS, *(f"{axis.name}.state" for axis in plan.axes)]
        words = {"states": [*STATES.values()], "flags": [str(flag.name).lower().replace("_", " ") for flag in LinkFlag]}
        told = {"columns": columns, **words, "run": self._run, "required": self._required, "command": self.command}
        told |= {"scenes": [*self.scenes] if self._handles else [], **self._describe(plan)}
        with self._lock:
            self._hello = {**told, **self._pace()}
            for reader in self._readers:
                reader.send({"hello": self._hello}, fd=record.ring.fd)
        if self._required:
            if not self._shown.wait(FIRST_PAGE):
                raise UsageError(f"no page was opened within {FIRST_PAGE:.0f} s, and --view-required needs one")
            self._page_seen = monotonic()

    def end(self, told: Message) -> None:
        """Say how the run ended; pages keep it. Only the first word counts."""
        self._page_seen = math.inf
        if not self._ended:
            self._ended = True
            self._tell({"ended": told})

    def _of_run(self, cycle: Cycle, report: LoopReport) -> Callable[[], tuple[float, ...]]:
        """Return the function that gives the values of `RUN_COLUMNS`; lateness and computing time are one old."""
        # Written for speed: this and the row are what the loop pays for a view.
        tallies = [ledger.tally for ledger in cycle.ledgers]
        first, *others = [axis.state for axis in cycle.axes.values()]
        alone = tallies[0] if len(tallies) == 1 else None
        begun = () if self.changes is None else self.changes.applied
        number_of = {id(state): place for place, state in enumerate(STATES)}  # an Enum is slow to look up

        def values() -> tuple[float, ...]:
            began_ns, (_, _, compute_ns, late_ns) = report.enabled_at_ns, report.samples.last
            return (
                math.nan if began_ns is None else (cycle.t_ns - began_ns) * 1e-9,
                cycle.enabled,
                report.missed,
                late_ns * 1e-3,
                compute_ns * 1e-3,
                alone.largest if alone is not None else max([tally.largest for tally in tallies], default=0.0),
                len(begun),
                number_of[id(first.power)],
                *([number_of[id(axis.power)] for axis in others] if others else ()),
            )

        return values

    def _after(self, plan: Plan, cycle: Cycle, report: LoopReport) -> Callable[[], None]:
        """Return what is done once a period: the hand of a simulation pulls, and a trip is told."""
        axes, handles, pulled, period = cycle.axes, self._handles, self._pulled, plan.period

        def after() -> None:
            if cycle.trip is not None and cycle.trip is not told[0]:
                told[0] = trip = cycle.trip
                self._tasks.put(lambda: self._tell({"trip": str(trip_error(trip, plan, report.enabled_at_ns))}))
            if self._taken is not None:
                name, self._taken = self._taken, None
                for handle in handles.values():
                    handle.take(name)
            if pulled:
                for name, target in [*pulled.items()]:
                    if target is None:
                        handles[name].let_go()
                        pulled.pop(name, None)
                    elif axes[name].state.begun:
                        handles[name].pull(axes[name].state.position, target, period)

        told: list[Any] = [None]
        return after

    def _pace(self) -> dict[str, Any]:
        return {"speed": self.time.speed, "paused": self.time.paused}

    def _tell(self, message: Message, only: _Reader | None = None) -> None:
        """Send a message to all readers or to one; a reader that does not take it is left."""
        with self._lock:
            for reader in [*self._readers] if only is None else [only]:
                if not reader.send(message) and reader in self._readers:
                    self._readers.remove(reader)
                    with contextlib.suppress(OSError):
                        reader.socket.shutdown(socket.SHUT_RDWR)

    # The thread that judges changes.

    def _judge(self) -> None:
        while (task := self._tasks.get()) is not None:
            task()

    def _change(self, reader: _Reader, settings: Any) -> None:
        try:
            if self.changes is None:
                raise UsageError("this run takes no changes")
            change = self.changes.request(settings)
        except (HapticFieldbusError, *NO_COMMAND) as error:
            self._tell({"refused": _IN_FILE.sub("", " ".join(str(error).splitlines()))}, reader)
            return
        told = self._describe(change.plan)
        with self._lock:
            self._hello = {**(self._hello or {}), **told}
        # Counted in this order, so that a change which begins meanwhile is not counted twice.
        begun = len(self.changes.applied) + len(self.changes.waiting)
        above = [*above_limit(change.plan)]
        self._tell({"scene": told, "changed": dict(change.settings), "begun": begun, "above": above})

    def _tell_pace(self) -> None:
        self._pacing.clear()
        self._tell({"pace": self._pace()})

    def _begin_scene(self, reader: _Reader, name: str) -> None:
        try:
            self.check_scene(name)
        except HapticFieldbusError as error:
            self._tell({"refused": f"{name} cannot be run here: {' '.join(str(error).splitlines())}"}, reader)
            return
        if self._ending is not None and self._ending.signal is None:
            self.next_scene, self._ending.signal = name, NEXT_SCENE
            self.time.changed.set()

    # The thread that receives commands.

    def _receive(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select(POLL if self._required else None):
                    if key.fileobj is self._woken:
                        return
                    if key.fileobj is self._listener:
                        self._accept(selector)
                    elif not self._read(key.data):
                        selector.unregister(key.fileobj)
                        self._leave(key.data)
                self._check_page()

    def _accept(self, selector: selectors.BaseSelector) -> None:
        connected, _ = self._listener.accept()
        connected.setblocking(False)  # a reader that stands still is left, and STOP of another one does not wait for it
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        reader = _Reader(connected)
        selector.register(connected, selectors.EVENT_READ, reader)
        with self._lock:
            self._readers.append(reader)
            if self._hello is not None and self._record is not None:
                reader.send({"hello": self._hello}, fd=self._record.ring.fd)

    def _leave(self, reader: _Reader) -> None:
        with self._lock:
            if reader in self._readers:
                self._readers.remove(reader)
            reader.socket.close()
        self._pulled.update(dict.fromkeys(self._pulled))

    def _read(self, reader: _Reader) -> bool:
        """Take the commands that have come; False when the reader is gone or sends what is no command."""
        try:
            octets = reader.socket.recv(LONGEST_LINE)
        except BlockingIOError:
            return True
        except OSError:
            return False
        *lines, reader.received = (reader.received + octets).split(b"\n")
        if not octets or len(reader.received) > LONGEST_LINE:
            return False
        for line in lines:
            try:
                commands = json.loads(line).items()
            except NO_COMMAND:
                return False
            for name, value in commands:
                try:
                    self._obey(reader, name, value)
                except NO_COMMAND:
                    # Behind one reader there may be several pages, which are not to suffer from one of them.
                    self._tell({"refused": f"{name} {json.dumps(value)[:60]}: {EXPECTED[name]}"}, reader)
        return True

    def _obey(self, reader: _Reader, name: str, value: Any) -> None:
        """Carry out one command; raises one of NO_COMMAND for a wrong value."""
        if name == "stop" and self._ending is not None:
            self._ending.signal = self._ending.signal or signal.SIGINT
            self.time.changed.set()
        elif name == "pages" and int(value) > 0:
            self._shown.set()
            if self._page_seen < math.inf:
                self._page_seen = monotonic()
        elif name == "change" and self._tasks.qsize() >= MOST_CHANGES:
            self._tell({"refused": "too many changes wait to be checked; try again"}, reader)
        elif name == "change":
            self._tasks.put(lambda: self._change(reader, value))
        elif self._handles:
            self._simulate(reader, name, value)
        elif name == "scene":
            raise ValueError

    def _simulate(self, reader: _Reader, name: str, value: Any) -> None:
        """Carry out a command that exists in a simulation alone."""
        if name == "scene":
            if value not in self.scenes:
                raise ValueError
            self._tasks.put(lambda: self._begin_scene(reader, value))
        elif name == "pull":
            axis, target = value
            if axis not in self._handles or not (target is None or math.isfinite(target)):
                raise ValueError
            self._pulled[axis], self.led = target, True
        elif name == "hand":
            if value not in HANDS:
                raise ValueError
            self._pulled.clear()
            self._taken, self.led = value, True
        elif name in ("speed", "paused", "step"):
            numbers: dict[str, Any] = {"speed": float, "paused": bool, "step": int}
            number = numbers[name](value)
            if not math.isfinite(number):
                raise ValueError
            self.time.set(**{"steps" if name == "step" else name: number})
            with self._lock:
                self._hello = {**(self._hello or {}), **self._pace()}
            if not self._pacing.is_set():  # however many commands come, one message waits
                self._pacing.set()
                self._tasks.put(self._tell_pace)

    def _check_page(self) -> None:
        """End a run that requires a page and has lost it."""
        if monotonic() - self._page_seen > PAGE_LOST and self._ending is not None and not self.lost:
            self.lost = True
            self._ending.signal = self._ending.signal or getattr(signal, "SIGHUP", signal.SIGINT)
            self.time.changed.set()


class LiveReader:
    """The other end, in the process that shows pages: the ring, and the messages of the run."""

    def __init__(self, path: Path) -> None:
        """Connect to a run; raises OSError."""
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(path))
        self._received = b""

    def send(self, command: Message) -> None:
        """Send a command; raises OSError when the run is gone."""
        self.socket.sendall(json.dumps(command).encode() + b"\n")

    def close(self) -> None:
        """Leave the run."""
        self.socket.close()

    def messages(self) -> Iterator[tuple[dict[str, Any], int | None]]:
        """Yield each message of the run, with the descriptor of the ring that came with it; ends with the run."""
        fds: list[int] = []
        while True:
            try:
                octets, found, _, _ = socket.recv_fds(self.socket, LONGEST_LINE, 4)
            except OSError:
                return
            if not octets:
                return
            fds += found
            *lines, self._received = (self._received + octets).split(b"\n")
            for line in lines:
                message = json.loads(line)
                yield message, fds.pop(0) if "hello" in message and fds else None
