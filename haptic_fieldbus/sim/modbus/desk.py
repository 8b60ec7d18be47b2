"""Requests carried out and answered, with the faults of the answers: what a line in virtual time and a server share."""

from collections.abc import Iterator
from dataclasses import replace

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.modbus.disturbance import AnswerDisturbances
from haptic_fieldbus.sim.modbus.rack import FaultyLine, UnitRack
from haptic_fieldbus.sim.modbus.station import Asked, Station, exception_for


class Desk:
    """The drives of a line behind octets; all times are those of one clock [ns]."""

    def __init__(
        self, line: FaultyLine, seed: int | str = DEFAULT_SEED, *, serial: bool, longest: int | None = None
    ) -> None:
        self.rack = UnitRack(line, seed, longest)
        self.station = Station(self.rack.units, serial=serial)
        self.disturbances = AnswerDisturbances(seed, serial=serial)

    def answer(self, asked: Asked, t_ns: int) -> Iterator[tuple[int, bytes]]:
        """Carry a request out; yield what arrives as its answer: by how much later [ns], and the octets."""
        unit = self.rack.units.get(asked.unit)
        fault = self.disturbances.take(asked.unit) if unit is not None and unit.hears(t_ns) else None
        if isinstance(fault, faults.AnswerException):
            answer = exception_for(asked, fault.code)
        else:
            found = self.station.carry_out(asked, t_ns)
            if found is None:
                return
            answer = found
        if isinstance(fault, faults.AnswerWrongUnit):
            asked = replace(asked, unit=fault.to)
        yield from self.disturbances.arriving(fault, self.station.frame(asked, answer))
