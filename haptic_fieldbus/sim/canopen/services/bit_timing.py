"""The bit timing of a simulated node: whether it matches that of the bus.

Reference: CiA 305, activate bit timing. The node is silent for the switch delay before the bit timing is switched, and
for the same time after it. The bit rate of a simulated bus does not change. A node set to another one is therefore
silent and deaf until a power-on restores the stored one.
"""

from collections.abc import Callable

from haptic_fieldbus.sim.canopen.services.alarms import Alarms

_MS = 1_000_000


class BitTiming:
    """The presence of a node on the bus, by its bit rate.

    `wanted` returns the bit rate [bit/s] to use; `changed` is called when the node leaves the bus or returns.
    """

    def __init__(
        self,
        bitrate: int,
        alarms: Alarms,
        wanted: Callable[[], int],
        now: Callable[[], int],
        changed: Callable[[], None],
    ) -> None:
        self.on_bus = True
        """False: the node neither sends nor receives."""
        self.bus_bitrate = bitrate
        self._wanted = wanted
        self._now = now
        self._changed = changed
        self._alarm = alarms.new(lambda _t_ns: self.switch())

    def activate(self, delay_ms: int) -> None:
        """Leave the bus, and return with the wanted bit rate after two switch delays [ms]."""
        self.on_bus = False
        self._alarm.at(self._now() + 2 * delay_ms * _MS)
        self._changed()

    def switch(self) -> None:
        """Use the wanted bit rate now."""
        self._alarm.off()
        self.on_bus = self._wanted() == self.bus_bitrate
        self._changed()
