"""The live view's end inside a run: rows go out through a ring, commands come in through a local socket.

The loop pays one row a period and the test of one attribute. All else is done by two threads of its process, which
sleep until a command comes: one receives, so that STOP never waits, the other judges changes. A reader is another
process (`haptic_fieldbus.view`): it connects to a socket in a folder that only this user may enter, gets the descriptor
of the ring and the description of the run, and sends commands, one JSON object a line:

| command | effect |
|---|---|
| `{"stop": true}` | the run ends as by Ctrl-C |
| `{"change": {"wall.stiffness": 800.0}}` | judged as a change of `Changes.request`, then made or refused |
| `{"page": 0.2}` | again and again: age of the last answer of a page [s]; with `required` its loss ends the run |
| `{"pull": ["handle", 0.01]}` | simulation only: the hand pulls the handle to a place; null lets go |
| `{"hand": "push"}` | simulation only: another hand takes the handle |
| `{"scene": "detents"}` | simulation only: the run ends and one with that scene begins, if it can be run |
| `{"speed": 0.1}`, `{"paused": true}`, `{"steps": 1}` | simulation only: the pace of the simulated time |

No command enables a drive.
"""

import contextlib
import json
import math
import os
import re
import selectors
import shlex
import signal
import socket
import stat
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.leading import Leading, SimulatedTime
from haptic_fieldbus.running.rights import WorkAside, make_as_urgent
from haptic_fieldbus.running.ring import LONGEST_LINE, RingWriter
from haptic_fieldbus.signals import LinkFlag

if TYPE_CHECKING:
    from haptic_fieldbus.running.changes import Changes

Message = Mapping[str, Any]
RING_TIME = 30.0
"""Time that the ring holds [s]."""
LONGEST_RING = 120_000
_IN_FILE = re.compile(r"^.*?\.toml: --set ")
"""Beginning of a refusal that only a command line needs."""
_LONG_WORD = re.compile(r"(\S{100})\S+")
PAGE_LOST = 1.0
"""Time without a page after which a run that requires one ends [s]."""
FIRST_PAGE = 120.0
"""Time for which a run that requires a page waits for the first one [s]."""
POLL = 0.25
NEXT_SCENE = 0
"""Mark of an end after which another scene begins; a signal, and STOP, take its place."""
MOST_CHANGES = 8
"""Changes that wait to be judged or to begin, from which on a further one is refused: judging takes time."""
SEND_BUFFER = 1 << 20
"""Octets that wait for a reader before it is left, as far as the system permits them."""
NO_COMMAND = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
"""Errors of a line that is no JSON object, whose sender is left, and of a command whose value is refused."""
RUN_COLUMNS = ("t", "enabled", "missed", "lateness_us", "compute_us", "energy", "changes")
"""Columns of the run, which stand after those of the record; then comes the power state of each axis as a number."""
HANDS = ("push", "tap", "release", "none")
"""Hands of a simulation that a page may choose."""
EXPECTED = {
    "page": "expected a time in s", "pull": "expected an axis and a place, or null to let go",
    "hand": f"expected one of {', '.join(HANDS)}", "scene": "expected a scene that this simulation offers",
    "speed": "expected a finite number", "paused": "expected true or false", "steps": "expected a number of periods",
}  # fmt: skip
"""End of the sentence that refuses the value of a command."""
ASKED = ("parameters", "limits")
"""Parts of the description that are told of a change before it has begun."""
PACE: Mapping[str, Callable[[Any], Any]] = {"speed": float, "paused": bool, "steps": int}
"""Commands that are arguments of `SimulatedTime.set`, and their kinds."""


OTHER_FOLDER = "set XDG_RUNTIME_DIR to a folder of yours"
LONGEST_FOLDER = 92
"""Octets of the folder, with which the path of a socket fits into the 104 of macOS."""


def folder() -> Path:
    """Return the folder of the sockets, made if it is not there; raises UsageError where it cannot be used."""
    found = Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"haptic-fieldbus-{os.getuid()}"
    try:
        found.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{found}: {error.strerror}; {OTHER_FOLDER}") from error
    status = found.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
        raise UsageError(f"{found} is not a folder of this user alone; remove it, or {OTHER_FOLDER}")
    if len(os.fsencode(found)) > LONGEST_FOLDER:
        raise UsageError(f"{found} is too long for the path of a socket; {OTHER_FOLDER}")
    return found


def sockets() -> list[Path]:
    """Return the sockets of the runs that can be viewed, the newest first; those of ended runs are removed."""
    alive = []
    for path in folder().glob("*.sock"):
        with socket.socket(socket.AF_UNIX) as probe:
            if probe.connect_ex(str(path)):
                path.unlink(missing_ok=True)
            else:
                alive.append(path)
    return sorted(alive, key=lambda path: path.stat().st_mtime, reverse=True)


@dataclass(eq=False)
class _Reader:
    """A process that is connected."""

    socket: socket.socket
    received: bytes = b""
    pulls: bool = False
    """Whether it has pulled a handle."""

    def send(self, message: Message, *, fd: int | None = None) -> None:
        """Send a line; a reader that does not take it is left, when the thread that receives sees its end."""
        line = json.dumps(message).encode() + b"\n"
        try:
            sent = 0 if fd is None else socket.send_fds(self.socket, [line], [fd])
            self.socket.sendall(line[sent:])
        except OSError:
            with contextlib.suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)


class Live:
    """The live view of one run; `describe` makes the description of a plan that a page needs.

    Give it to `run` as `live`, and use it as a context manager around it.
    """

    def __init__(self, describe: Callable[[Plan, Plan], Message], *, required: bool = False) -> None:
        if not hasattr(socket, "send_fds"):
            raise UsageError("the live view needs Linux or macOS")
        self._describe, self._required = describe, required
        self.command: list[str] = []
        """Command line of the run, for a page to copy."""
        self.of_file: Mapping[str, float] = {}
        """Values of the parameters in the file of the scene, where the run begins with others."""
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
        self._process = f"{os.getpid()} {monotonic()}"
        """Name of this process, unlike that of any other one since the computer began."""
        self.time = SimulatedTime()
        self.changes: Changes | None = None
        self.lost = False
        """True when the run was ended because its page was lost."""
        self.path = folder() / f"{os.getpid()}.sock"
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._readers: list[_Reader] = []
        self._lock = threading.Lock()
        """Held while readers are added, removed or written to."""
        self._hello: dict[str, Any] = {}
        """First message to a reader; empty while no run goes on."""
        self.ring: RingWriter | None = None
        self._record: Record | None = None
        self._leading: Leading | None = None
        self._plan: Plan | None = None
        self._ending: EndSignals | None = None
        self._shown = threading.Event()
        self._page_seen = math.inf
        self._ended = False

    def __enter__(self) -> "Live":
        self.path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.path))
        self._listener.listen(8)
        self._wake, self._woken = socket.socketpair()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._receive, self._judge)]
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
        if self.ring is not None:
            self.ring.close()

    @property
    def goes_on(self) -> bool:
        """Whether the run has ended for another scene alone; Ctrl-C and STOP take its place."""
        return self._ending is not None and self._ending.signal == NEXT_SCENE

    def renew(self) -> str | None:
        """Prepare the next run and return its scene; None when no other one is to begin."""
        with self._lock:
            scene, ending, ring = self.next_scene, self._ending, self.ring
            if not self.goes_on or ending is None or ring is None:
                return None
            ending.signal = None  # without a call after the look at it, in which a signal could come and be lost
            # A reader that connects now waits for the description of the next run. STOP ends that one.
            self._hello, self._leading, self.ring, self.next_scene = {}, None, None, None
        ring.close()
        speed, self.time = self.time.speed, SimulatedTime()
        self.time.set(speed=speed)
        self._shown.clear()
        self._page_seen, self.of_file = math.inf, {}
        self._run, self.ready = self._run + 1, lambda: None
        ending.resume()
        return scene

    # What the run calls.

    def follow(self, plan: Plan, record: Record) -> None:
        """Prepare to show the rows of the record of a run, before a bus is opened."""
        self.ready()
        width = len(record.columns) + len(RUN_COLUMNS) + len(plan.axes)
        self.ring = RingWriter(width, min(LONGEST_RING, math.ceil(RING_TIME * plan.rate)))
        self._record = record

    def begin(self, plan: Plan, cycle: Cycle, report: LoopReport, leading: Leading | None, ending: EndSignals) -> None:
        """Show the run from now on; with `required`, wait for a page. Raises UsageError when none comes."""
        record, ring = self._record, self.ring
        if record is None or ring is None:
            raise UsageError("this view has no record; call `follow` first")
        self.time.period_ns = plan.period_ns
        self._ending, self.time.leaving = ending, lambda: ending.signal is not None
        self._leading, self._plan = leading, plan
        if not plan.simulated:
            make_as_urgent(self._threads)
        values = self._of_run(plan, cycle, report)
        record.followers.append(lambda row: ring.push(row, values()))
        columns = [*record.columns, *RUN_COLUMNS, *(f"{axis.name}.state" for axis in plan.axes)]
        flags = [str(flag.name).lower().replace("_", " ") for flag in LinkFlag]
        told = {"columns": columns, "flags": flags, "states": [state.value for state in PowerState], "run": self._run}
        told |= {"required": self._required, "first": self.of_file, "command": shlex.join(self.command)}
        told["process"] = self._process
        told["scenes"] = [*self.scenes] if self._leading else []
        with self._lock:
            self._hello = {**told, **self._describe(plan, plan), **self._pace()}
            for reader in self._readers:
                reader.send({"hello": self._hello}, fd=ring.fd)
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

    def _of_run(self, plan: Plan, cycle: Cycle, report: LoopReport) -> Callable[[], tuple[float, ...]]:
        """Return the function that gives the values of `RUN_COLUMNS`, and tells a trip at once.

        Lateness and computing time are one period old.
        """
        # Written for speed: this and the row are what the loop pays for a view.
        tallies = [ledger.tally for ledger in cycle.ledgers]
        first, *others = [axis.state for axis in cycle.axes.values()]
        alone = tallies[0] if len(tallies) == 1 else None
        begun = () if self.changes is None else self.changes.applied
        told: list[Any] = []
        number_of = {id(state): place for place, state in enumerate(PowerState)}  # an Enum is slow to look up

        def values() -> tuple[float, ...]:
            trip = cycle.trip
            if trip is not None and not told:
                told.append(trip)
                # The drives have not been asked yet; `end` brings the words of the whole run.
                error = trip_error(trip, plan, report.enabled_at_ns, released=False)
                self._tasks.put(lambda: self._tell({"trip": str(error)}))
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

    def _pace(self) -> dict[str, Any]:
        hand = None if self._leading is None else self._leading.hand
        return {"speed": self.time.speed, "paused": self.time.paused, "hand": hand}

    def _tell(self, message: Message, only: _Reader | None = None, *, known: Message | None = None) -> None:
        """Send a message to all readers or to one.

        What is `known` from it is told to later readers too.
        """
        with self._lock:
            self._hello |= known or {}
            for reader in self._readers if only is None else [only]:
                reader.send(message)

    # The thread that judges changes.

    def _judge(self) -> None:
        aside = WorkAside()
        while (task := self._tasks.get()) is not None:
            try:
                if self._plan is None or self._plan.simulated:
                    task()
                else:
                    aside.do(task)
            except Exception as error:  # the page must go on to answer, and to tell trips
                self._tell({"refused": f"this cannot be shown: {type(error).__name__}: {error}"})

    def _change(self, reader: _Reader, settings: Any) -> None:
        try:
            if self.changes is None:
                raise UsageError("this run takes no changes")
            change = self.changes.request(settings)
        except (HapticFieldbusError, *NO_COMMAND) as error:
            text = _IN_FILE.sub("", " ".join(str(error).splitlines()))
            self._tell({"refused": _LONG_WORD.sub(r"\1…", text)}, reader)
            return
        told = self._describe(change.plan, self._plan or change.plan)
        # Counted in this order, so that a change which begins meanwhile is not counted twice.
        begun = len(self.changes.applied) + len(self.changes.waiting)
        above = [*above_limit(change.plan)]
        message = {"scene": told, "changed": dict(change.settings), "begun": begun, "above": above}
        later = self._for_later_pages(message, len(self.changes.applied))
        self._tell({**message, "later": later}, known=later)

    def _for_later_pages(self, message: Message, begun: int) -> dict[str, Any]:
        """Return what a page that is opened from now on is told: the scene in force, and the values that are asked."""
        earlier = self._hello.get("waiting", ())
        in_force = {name: told for each in earlier if each["begun"] <= begun for name, told in each["scene"].items()}
        asked = {name: told for name, told in message["scene"].items() if name in ASKED}
        return {**in_force, **asked, "waiting": [each for each in earlier if each["begun"] > begun] + [message]}

    def _waiting(self) -> int:
        """Return the number of changes that are accepted and have not begun."""
        return 0 if self.changes is None else len(self.changes.waiting)

    def _begin_scene(self, reader: _Reader, name: str) -> None:
        try:
            self.check_scene(name)
        except HapticFieldbusError as error:
            self._tell({"refused": f"{name} cannot be run here: {' '.join(str(error).splitlines())}"}, reader)
            return
        self._end_by(NEXT_SCENE, name)

    # The thread that receives commands.

    def _receive(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select(self._patience()):
                    if key.fileobj is self._woken:
                        return
                    if key.fileobj is self._listener:
                        self._accept(selector)
                    elif not self._read(key.data):
                        selector.unregister(key.fileobj)
                        self._leave(key.data)
                if monotonic() - self._page_seen >= PAGE_LOST and self._ending is not None and not self.lost:
                    self.lost = True  # a run that requires a page has lost it
                    self._end_by(getattr(signal, "SIGHUP", signal.SIGINT))

    def _accept(self, selector: selectors.BaseSelector) -> None:
        connected, _ = self._listener.accept()
        connected.setblocking(False)  # a reader that stands still is left, and STOP of another one does not wait for it
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        reader = _Reader(connected)
        selector.register(connected, selectors.EVENT_READ, reader)
        with self._lock:
            self._readers.append(reader)
            if self._hello and self.ring is not None:
                reader.send({"hello": self._hello}, fd=self.ring.fd)

    def _leave(self, reader: _Reader) -> None:
        with self._lock:
            self._readers.remove(reader)
            reader.socket.close()
        if self._leading is not None and reader.pulls:
            self._leading.let_go()

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
        if name == "stop":
            self._end_by(signal.SIGINT)
        elif name == "page":
            age = float(value)
            _expect(0.0 <= age < math.inf)
            if self._page_seen < math.inf:
                self._page_seen = max(self._page_seen, monotonic() - age)
            elif age < PAGE_LOST:
                self._shown.set()
        elif name == "change" and self._tasks.qsize() + self._waiting() >= MOST_CHANGES:
            self._tell({"refused": f"{MOST_CHANGES} changes wait; try again when one of them has begun"}, reader)
        elif name == "change":
            self._tasks.put(lambda: self._change(reader, value))
        elif self._leading is not None:
            self._simulate(reader, self._leading, name, value)
        elif name == "scene":
            raise ValueError

    def _simulate(self, reader: _Reader, leading: Leading, name: str, value: Any) -> None:
        """Carry out a command that exists in a simulation alone."""
        if name == "scene":
            _expect(value in self.scenes)
            self._tasks.put(lambda: self._begin_scene(reader, value))
        elif name == "pull":
            axis, target = value
            _expect(axis in leading.handles and (target is None or math.isfinite(target)))
            reader.pulls = True
            leading.pull(axis, target)
        elif name == "hand":
            _expect(value in HANDS)
            leading.take(value)
            self._tell({"pace": self._pace(), "hand": value}, known=self._pace())
        elif name in PACE:
            number = PACE[name](value)
            _expect(math.isfinite(number))
            self.time.set(**{name: number})
            self._tell({"pace": self._pace()}, known=self._pace())

    def _end_by(self, number: int, scene: str | None = None) -> None:
        """End the run as by a signal, if none has come; between two runs, the next one."""
        with self._lock:
            if self._ending is not None:
                self._ending.signal, self.next_scene = self._ending.signal or number, scene or self.next_scene
                self.time.changed.set()

    def _patience(self) -> float | None:
        """Return how long to wait for a command [s]: where a page is required, no longer than until it is lost."""
        return min(POLL, max(0.0, self._page_seen + PAGE_LOST - monotonic())) if self._required else None


def _expect(holds: bool) -> None:
    """Raise ValueError where a value is not what a command expects."""
    if not holds:
        raise ValueError
