"""Electronic data sheets of CANopen devices (EDS, DCF), read and written.

The reader is tolerant: it takes what is usable and lists the rest as faults. Reference: CiA 306-1 (EDS and DCF), CiA
301 4.2 (data types, object codes).
"""

from haptic_fieldbus.eds.model import DeviceInfo, Eds, EdsEntry, EdsObject, EdsValue, NodeOffset, ObjectCode
from haptic_fieldbus.eds.names import EdsType
from haptic_fieldbus.eds.reader import load_eds, read_eds
from haptic_fieldbus.eds.writer import eds_text

__all__ = [
    "DeviceInfo", "Eds", "EdsEntry", "EdsObject", "EdsType", "EdsValue", "NodeOffset", "ObjectCode", "eds_text",
    "load_eds", "read_eds",
]  # fmt: skip
