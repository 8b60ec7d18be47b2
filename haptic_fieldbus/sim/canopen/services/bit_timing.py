"""The bit timing of a simulated node: whether it and the bus understand each other.

Reference: CiA 305, activate bit timing: silent for the switch delay before the bit timing is switched and as long after
it. The bit rate of a simulated bus does not change, so a node that is set to another one is silent and deaf until a
power-on finds the old one stored.
"""

from collections.abc import Callable

from haptic_fieldbus.sim.canopen.services.alarms import Alarms

_MS = 1_000_000


class BitTiming:
    """`wanted` tells the bit rate [bit/s] to be used, `changed` is called when the node comes or goes."""

    def __init__(
        self,
        bitrate: int,
        alarms: Alarms,
        wanted: Callable[[], int],
        now: Callable[[], int],
        changed: Callable[[], None],
    ) -> None:
        self.on_bus = True
        """False: silent and deaf."""
        self.bus_bitrate = bitrate
        self._wanted = wanted
        self._now = now
        self._changed = changed
        self._alarm = alarms.new(lambda _t_ns: self.switch())

    def activate(self, delay_ms: int) -> None:
        """Leave the bus, and come back with the wanted bit rate after two switch delays."""
        self.on_bus = False
        self._alarm.at(self._now() + 2 * delay_ms * _MS)
        self._changed()

    def switch(self) -> None:
        """Use the wanted bit rate now."""
        self._alarm.off()
        self.on_bus = self._wanted() == self.bus_bitrate
        self._changed()
