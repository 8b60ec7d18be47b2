"""Ready-made values for tests of Modbus: the generic profile, plans on simulated lines, characters by hand."""

from dataclasses import replace
from typing import Any

import haptic_fieldbus
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic

TCP, RTU = "sim-modbus-tcp", "sim-modbus-rtu@115200"
GENERIC = modbus_profile(load_profile("generic_cia402_modbus"))
ANSWER_TIME, COMPUTE, SILENCE, ROUND_TRIP = 0.2e-3, 50e-6, 1.75e-3, 0.25e-3
CHARACTER = 11 / 115200
"""Start, eight data bits, parity and stop."""


def on(bus: str, rate: float | None = None, **task: Any) -> Plan:
    """The wall on a simulated line."""
    return haptic_fieldbus.plan("wall", bus=bus, rate=rate, **task)


def traffic_of(plan: Plan, place: int = 0) -> ModbusTraffic:
    """Requests that one line of a plan carries."""
    traffic = plan.buses[place].traffic
    assert isinstance(traffic, ModbusTraffic)
    return traffic


def with_line(profile: ModbusProfile = GENERIC, **changes: Any) -> ModbusProfile:
    """The profile with other facts of its line."""
    return replace(profile, line=replace(profile.line, **changes))
