"""The process data of a simulated node: which PDOs act on SYNC, which on an event, and when.

At a SYNC the measured entries are latched and the synchronous TPDOs made of them, then the synchronous RPDOs received
since the last one act (CiA 301, 7.2.5). Event-driven TPDOs are looked at once every `event_period_ns`.
"""

from collections.abc import Callable
from typing import Protocol

from haptic_fieldbus.sim.dictionary import Dictionary
from haptic_fieldbus.sim.emergency import PDO_TOO_SHORT, Emergencies
from haptic_fieldbus.sim.frame import Frame
from haptic_fieldbus.sim.pdo import PdoDefaults, Rpdo, Tpdo
from haptic_fieldbus.sim.wire import NEVER_NS

Handler = Callable[[bytes, int], None]


class Application(Protocol):
    """What the CANopen half needs of the drive behind it."""

    event_period_ns: int

    def sync(self, t_ns: int) -> None:
        """A SYNC ended: latch the measured entries."""
        ...

    def measure(self, t_ns: int) -> None:
        """Bring the measured entries up to date."""
        ...

    def act(self, t_ns: int) -> None:
        """Entries were received that may ask for something."""
        ...

    def link_lost(self, t_ns: int) -> None:
        """An event of 6007h: heartbeat lost, *stopped* entered, a reset."""
        ...

    def restart(self, t_ns: int) -> None:
        """Power-on state."""
        ...


class ProcessData:
    """All PDOs of a node; works between `start` and `stop`."""

    def __init__(
        self,
        dictionary: Dictionary,
        application: Application,
        emergencies: Emergencies,
        send: Callable[[Frame], None],
        changed: Callable[[], None],
        rpdos: list[PdoDefaults],
        tpdos: list[PdoDefaults],
        acts_at_sync: bool,
    ) -> None:
        """`acts_at_sync`: this drive holds even the content of event-driven RPDOs until the next SYNC."""
        self.due_ns = NEVER_NS
        self.skip_tpdos = 0
        """So many TPDOs are lost inside the node."""
        self._application = application
        self._emergencies = emergencies
        self._send = send
        self._acts_at_sync = acts_at_sync
        self._rpdos = [Rpdo(dictionary, defaults, changed) for defaults in rpdos]
        self._tpdos = [Tpdo(dictionary, defaults, changed) for defaults in tpdos]
        self._waiting: dict[Rpdo, bytes] = {}
        self._at_sync: list[Tpdo] = []
        self._at_event: list[Tpdo] = []

    def compile(self) -> None:
        """Take over the parameters of all PDOs, as after a reset."""
        for pdo in (*self._rpdos, *self._tpdos):
            pdo.compile()

    def start(self, t_ns: int) -> None:
        """Entering *operational*."""
        for tpdo in self._tpdos:
            tpdo.restart(t_ns)
        self._waiting.clear()
        self.due_ns = t_ns

    def stop(self) -> None:
        """Leaving *operational*."""
        self._waiting.clear()
        self.due_ns = NEVER_NS

    def route(self, t_ns: int) -> dict[int, Handler]:
        """What is received by which identifier, as the parameters now stand."""
        self._at_sync = [tpdo for tpdo in self._tpdos if tpdo.valid and tpdo.synchronous]
        self._at_event = [tpdo for tpdo in self._tpdos if tpdo.valid and not tpdo.synchronous]
        self.due_ns = min(self.due_ns, t_ns) if self._at_event else NEVER_NS
        return {rpdo.can_id: self._receiver(rpdo) for rpdo in self._rpdos if rpdo.valid}

    def sync(self, _data: bytes, t_ns: int) -> None:
        """A SYNC ended."""
        self._application.sync(t_ns)
        for tpdo in self._at_sync:
            octets = tpdo.at_sync()
            if octets is not None:
                self._send_pdo(tpdo, octets)
        if self._waiting:
            for rpdo, data in self._waiting.items():
                rpdo.apply(data)
            self._waiting.clear()
            self._application.act(t_ns)

    def poll(self, t_ns: int) -> None:
        """Look at the event-driven TPDOs."""
        self.due_ns = t_ns + self._application.event_period_ns
        self._application.measure(t_ns)
        for tpdo in self._at_event:
            octets = tpdo.at_event(t_ns)
            if octets is not None:
                self._send_pdo(tpdo, octets)

    def _receiver(self, rpdo: Rpdo) -> Handler:
        size = rpdo.size
        held = rpdo.synchronous or self._acts_at_sync

        def receive(data: bytes, t_ns: int) -> None:
            if len(data) < size:
                self._emergencies.raise_error(PDO_TOO_SHORT)
                return
            self._emergencies.clear(PDO_TOO_SHORT)
            if held:
                self._waiting[rpdo] = data
            else:
                rpdo.apply(data)
                self._application.act(t_ns)

        return receive

    def _send_pdo(self, tpdo: Tpdo, octets: bytes) -> None:
        if self.skip_tpdos:
            self.skip_tpdos -= 1
        else:
            self._send(Frame(tpdo.can_id, octets))
