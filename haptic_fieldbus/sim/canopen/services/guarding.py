"""Node guarding and life guarding of a simulated node: 100Ch, 100Dh.

Reference: CiA 301 4.2, 7.2.8.3.2.1, 7.5.2.11, 7.5.2.12. The master requests by a remote frame. The answer is the NMT
state with a toggle bit, which is 0 in the first answer after a reset of communication. The node life time is guard time
× life time factor. It is monitored from the first request on; when it passes without another request, the master is
lost until its next one.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.alarms import Alarms
from haptic_fieldbus.sim.canopen.services.heartbeat import Watch
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry

_MS = 1_000_000
_TOGGLE = 0x80


class Guarding(Watch):
    """The monitoring of the master."""

    def __init__(
        self, dictionary: Dictionary, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]
    ) -> None:
        super().__init__(alarms, lost, back)
        self._toggle = 0
        self._guard_time = dictionary.add(Entry(0x100C, 0, DataType.UINT16, 0, Access.RW))
        self._factor = dictionary.add(Entry(0x100D, 0, DataType.UINT8, 0, Access.RW))
        self._guard_time.changed = self._factor.changed = self.renew

    def request(self, state: int, t_ns: int) -> bytes:
        """Return the answer to the master's remote frame: NMT state and toggle bit."""
        answer = bytes((self._toggle | state,))
        self._toggle ^= _TOGGLE
        life_ns = self._guard_time.value * self._factor.value * _MS
        if life_ns:
            self.heard(t_ns, life_ns)
        return answer

    def reset(self) -> None:
        """Start anew, as after a reset of communication."""
        self._toggle = 0
        self.stop()
