"""Simulated drives for the tests of other people's masters.

`haptic_fieldbus.pytest_plugin` makes fixtures of them. Those on Modbus are in `testing.modbus`, so that tests on CAN do
without pymodbus.
"""

from haptic_fieldbus.testing.bench import DriveRequest as DriveRequest
from haptic_fieldbus.testing.bench import FaultPlan as FaultPlan
from haptic_fieldbus.testing.bench import SimulatedDrive as SimulatedDrive
from haptic_fieldbus.testing.bench import Time as Time
from haptic_fieldbus.testing.bench import VirtualCanBus as VirtualCanBus
from haptic_fieldbus.testing.bench import plan_faults as plan_faults
