"""Simulated drives for tests of masters, and contracts of own parts.

`haptic_fieldbus.pytest_plugin` makes fixtures of the drives. Those on Modbus are in `testing.modbus`, so that tests on
CAN do without pymodbus. `check_element`, `check_estimator`, `check_integrator` and `check_hand` hold a part to its
contract; nothing here needs pytest.
"""

from haptic_fieldbus.testing.bench import DriveRequest as DriveRequest
from haptic_fieldbus.testing.bench import FaultPlan as FaultPlan
from haptic_fieldbus.testing.bench import SimulatedDrive as SimulatedDrive
from haptic_fieldbus.testing.bench import Time as Time
from haptic_fieldbus.testing.bench import VirtualCanBus as VirtualCanBus
from haptic_fieldbus.testing.bench import plan_faults as plan_faults
from haptic_fieldbus.testing.contracts import check_element as check_element
from haptic_fieldbus.testing.contracts import check_estimator as check_estimator
from haptic_fieldbus.testing.contracts import check_hand as check_hand
from haptic_fieldbus.testing.contracts import check_integrator as check_integrator
