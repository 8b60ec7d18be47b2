"""Fitting of a profile of no particular drive to the node that answers; nothing is written."""

from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.errors import BusConfigurationError, EdsError
from haptic_fieldbus.protocols.canopen.fitting import fitted
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.upload import uploaded


def fit_to_drive(profile: CanopenProfile, node: Node) -> CanopenProfile:
    """Return the profile with what the drive has; raises BusError, BusConfigurationError for no CiA 402 drive."""
    try:
        return fitted(profile, uploaded(profile, node.found))
    except EdsError as error:
        told = "; ".join(fault.message for fault in error.faults)
        raise BusConfigurationError(f"{node.label}: {told}. Nothing was written") from error
