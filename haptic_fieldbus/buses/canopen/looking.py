"""Looking at drives without touching them: their objects are uploaded, and nothing is downloaded or commanded.

The exchange of a run would show the same values, but to begin it a drive is configured: its PDOs are mapped, its mode
is changed, its guard is armed, and one that somebody left enabled would be switched off, with whatever hangs on it.
A drive in fault would be refused, when a look at it is needed most. SDO uploads do none of this, and a look that is
late or ends leaves nothing behind (decision 0032).

As soon as somebody else commands or asks on the bus, nothing more is sent: two SDO clients of one node mix up their
answers.

Reference: CiA 301 7.2.4 (SDO), 7.2.8 (heartbeat).
"""

from collections.abc import Mapping
from dataclasses import replace

from haptic_fieldbus.buses.canopen.foreign import ForeignMaster, OneMaster, frame_words
from haptic_fieldbus.buses.canopen.listening import listen
from haptic_fieldbus.buses.canopen.node import Node, nmt_state_name
from haptic_fieldbus.buses.canopen.setup import ERROR_CODE, NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.found import Glimpse
from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.values import PER_AXIS, axes_words
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal

SHOWN = (Signal.STATUSWORD, Signal.POSITION, Signal.VELOCITY, Signal.TORQUE_ACTUAL)
"""Signals that are read where the drive offers them."""
FAULTS = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
ANSWER_TIMEOUT = 0.1
"""Time for which an answer is waited for [s]: a drive that is gone must not hold up the look at another."""
LONGEST_DRAIN_NS = 10_000_000


class Looking:
    """A look at the drives of one bus; it listens for this time [s] before it sends anything. Raises BusError."""

    def __init__(
        self, wire: Wire, drives: Mapping[str, tuple[int, CanopenProfile]], listening: float, master_node: int
    ) -> None:
        self.masters = ""
        self._several: dict[tuple[int, int], bool] = {}
        self._wire = wire
        one = OneMaster([node for node, _ in drives.values()], master_node)
        self._drives = {
            axis: (Node(wire, node, f"node {node} (axis {axis})"), _shown(profile))
            for axis, (node, profile) in drives.items()
        }
        wire.drain(wire.clock.now_ns() + LONGEST_DRAIN_NS)  # what comes from now on is dated by this look, or later
        heard = listen(wire, listening, one, wire.name)
        heard.refuse_noise()
        self.listened = heard.sentence()
        if heard.masters:
            self._yield_to(self._commanded(*sorted(heard.masters)))
        self._foreign = ForeignMaster(wire, one, self._yield_to)

    def look(self) -> dict[str, Glimpse]:
        """Return what each drive says now; raises BusError when the bus is dead."""
        self._wire.drain(self._wire.clock.now_ns() + LONGEST_DRAIN_NS)
        if self._foreign.cob_id is not None:
            self._yield_to(self._commanded(self._foreign.cob_id))
        return {axis: self._look_at(node, entries) for axis, (node, entries) in self._drives.items()}

    def _commanded(self, *can_ids: int) -> str:
        return f"another master on {self._wire.name}: {', '.join(map(frame_words, can_ids))}"

    def _yield_to(self, words: str) -> None:
        self.masters = self.masters or f"{words}; nothing is asked any more, only heard"

    def _look_at(self, node: Node, entries: Mapping[Signal, ObjectEntry]) -> Glimpse:
        glimpse = self._heard(node) if self.masters else self._asked(node, entries)
        now_ns = self._wire.clock.now_ns()
        if node.state is None:
            return glimpse
        return replace(glimpse, nmt_state=nmt_state_name(node.state), life_age=(now_ns - node.heartbeat_ns) * 1e-9)

    def _heard(self, node: Node) -> Glimpse:
        code = node.emergency
        note = f"it sent emergency {code:04X}h ({emergency_meaning(code)})" if code else "not asked"
        return Glimpse(self._wire.clock.now_ns(), error_code=code or None, note=note)

    def _asked(self, node: Node, entries: Mapping[Signal, ObjectEntry]) -> Glimpse:
        """Upload all that is shown; without the first answer no other is waited for."""
        now_ns = self._wire.clock.now_ns
        began_ns = t_ns = now_ns()
        values: dict[Signal, int] = {}
        notes: list[str] = []
        for signal, entry in entries.items():
            try:
                values[signal] = node.read(entry, ANSWER_TIMEOUT)
            except BusTimeoutError as error:
                advice = "" if values else f"; {NO_ANSWER_ADVICE}"
                return Glimpse(t_ns, values, _seconds(began_ns, now_ns()) if values else None, note=f"{error}{advice}")
            except BusConfigurationError as error:
                notes.append(f"{error}{self._axes(node, entry)}")
            if signal is Signal.POSITION:
                t_ns = now_ns()
        code = self._error_code(node, values)
        return Glimpse(t_ns, values, _seconds(began_ns, now_ns()), error_code=code, note="; ".join(notes))

    def _axes(self, node: Node, entry: ObjectEntry) -> str:
        """Return what to do about an object that has a value of each of several axes in sub-indices, asked once."""
        key = node.id, entry.object
        if key not in self._several:
            self._several[key] = entry.object in PER_AXIS and entry.subindex == 0 and _has_axes(node, entry.object)
        return f"; {axes_words([entry.object])}" if self._several[key] else ""

    def _error_code(self, node: Node, values: Mapping[Signal, int]) -> int | None:
        """Return the code of the fault that a drive is in; an emergency tells it where there is no 603Fh."""
        if CIA402.state(values.get(Signal.STATUSWORD, 0)) not in FAULTS:
            return None
        try:
            return node.read(ERROR_CODE, ANSWER_TIMEOUT)
        except (BusConfigurationError, BusTimeoutError):
            return node.emergency or None


def _has_axes(node: Node, index: int) -> bool:
    try:
        return all(node.found(index, subindex) is not None for subindex in (1, 2))
    except (BusConfigurationError, BusTimeoutError):
        return False


def _shown(profile: CanopenProfile) -> dict[Signal, ObjectEntry]:
    entries = profile.entries()
    return {signal: entries[signal] for signal in SHOWN if signal in entries}


def _seconds(from_ns: int, to_ns: int) -> float:
    return (to_ns - from_ns) * 1e-9
