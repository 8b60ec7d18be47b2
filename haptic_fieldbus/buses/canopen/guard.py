"""The guard of a drive, by which it notices that its master is gone: armed, kept up and disarmed.

A drive has one of two guards, which `link_loss` of its profile names:

- The heartbeat consumer, 1016h: from our first heartbeat on the drive expects the next one. It sends heartbeats too.
- Life guarding, 100Ch and 100Dh: from our first request of node guarding on the drive expects the next one within its
  life time, their product. A node that produces heartbeats answers no request, therefore 1017h is 0.

`arm` comes while the node is pre-operational. `engage` comes last: before it we ask for the NMT state by the same
requests that begin life guarding, and nothing may begin before the loop keeps it up.

Reference: CiA 301 7.2.8.3.2 (error control protocols), 7.5.2.11 (100Ch), 7.5.2.12 (100Dh), 7.5.2.19 (1016h), 7.5.2.20
(1017h).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, cycle, islice

from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.wire import Received
from haptic_fieldbus.drive.profile import ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID
from haptic_fieldbus.protocols.canopen.profile import LinkLossSection
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.protocols.canopen.watch_traffic import (
    LIFE_TIME_FACTOR,
    PRODUCER_HEARTBEAT,
    consumer_heartbeat,
    guard_objects,
)


@dataclass(frozen=True)
class Guard:
    """The guard of one drive, which acts after `milliseconds` without a proof of our life."""

    node: Node
    section: LinkLossSection
    milliseconds: int
    master_node: int
    node_heartbeat_ms: int

    @property
    def objects(self) -> dict[ObjectEntry, int]:
        """Objects of the guard, with the values that are written."""
        return dict(guard_objects(self.section, self.milliseconds, self.master_node, self.node_heartbeat_ms))

    def hear(self) -> None:
        """Set how the drive shows that it is alive: by heartbeats or by answers; raises BusError."""
        if not self.section.life_guarding:
            self.node.write(PRODUCER_HEARTBEAT, self.objects[PRODUCER_HEARTBEAT])
            return
        # A master that was killed left the life time there; our first request would begin to count it.
        self.node.write(LIFE_TIME_FACTOR, 0)
        held = self.node.optional(PRODUCER_HEARTBEAT)
        if held:
            # A heartbeat of the node would keep it from answering.
            try:
                self.node.write(PRODUCER_HEARTBEAT, 0)
            except BusConfigurationError as error:
                raise BusConfigurationError(
                    f"{self.node.label} sends a heartbeat every {held} ms and refuses to stop it ({error}); such a "
                    "node answers no node guarding. Use another watchdog than link_loss.life_guarding in its profile"
                ) from error

    def arm(self) -> None:
        """Write what the guard needs while the node is pre-operational; raises BusError."""
        for entry, value in self.objects.items():
            if entry not in (PRODUCER_HEARTBEAT, LIFE_TIME_FACTOR):  # the one is written before, the other last
                self.node.write(entry, value)

    def engage(self) -> None:
        """Let life guarding begin with our next request; raises BusError."""
        if self.section.life_guarding:
            self.node.write(LIFE_TIME_FACTOR, self.objects[LIFE_TIME_FACTOR])

    @property
    def disarming(self) -> tuple[tuple[ObjectEntry, int], ...]:
        """Entries and values that switch the guard off, so that the end of the run is no fault."""
        if self.section.life_guarding:
            return ((LIFE_TIME_FACTOR, 0),)
        index = self.section.heartbeat_consumer
        return () if index is None else ((consumer_heartbeat(index), 0),)


class ProofsOfLife:
    """The proofs of our life: at first all, so that every guard is on, then in turn.

    Requests are spread over the periods; each comes as often as our heartbeat. Guards run on in periods that a late
    loop skips, so what was due in them comes with the next one.
    """

    def __init__(self, traffic: CanTraffic, nodes: Sequence[Node], period_ns: int) -> None:
        heartbeat = HEARTBEAT_COB_ID + traffic.master_node, bytes((NmtState.OPERATIONAL,))
        proofs: list[Received] = [heartbeat] if traffic.beats else []
        proofs += [node.guarding_request for node in nodes if node.guarded]
        self._every = every = traffic.heartbeat_every
        rounds = [tuple(proofs[place::every]) for place in range(every)]
        self._rounds = chain((tuple(proofs),), rounds[1:], cycle(rounds))
        self._period_ns, self._late_ns = period_ns, 1.5 * period_ns
        self._last_ns: int | None = None

    def due(self, t_ns: int) -> tuple[Received, ...]:
        """Return the frames that are due in the period that begins at this instant [ns]."""
        passed_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns = t_ns
        if passed_ns < self._late_ns:
            return next(self._rounds)
        skipped = min(round(passed_ns / self._period_ns), self._every)
        return tuple(chain.from_iterable(islice(self._rounds, skipped)))
