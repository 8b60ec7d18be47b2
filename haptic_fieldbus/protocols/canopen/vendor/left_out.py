"""What a file offers and a profile does not use, although the loop would be safer or better with it."""

from collections.abc import Iterator

from haptic_fieldbus.drive.units import PERMILLE
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.pdos import carries
from haptic_fieldbus.protocols.canopen.vendor.values import READABLE, SENT, WRITABLE


def left_out(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield a fault for each key that the profile leaves out and that the file has an object for."""
    torque, link_loss, sync = profile.torque, profile.link_loss, profile.sync
    # A drive that takes a current shows the current actual value, if it does not show a torque.
    is_torque = torque.target.unit == PERMILLE or _offers(eds, 0x6077, 0, SENT)
    for key, given, index, subindex, access in (
        ("torque.actual", torque.actual, 0x6077 if is_torque else 0x6078, 0, SENT),
        ("torque.demand", torque.demand, 0x6074, 0, SENT),
        ("torque.rated", torque.rated or torque.rated_current, 0x6076, 0, READABLE),
        ("link_loss.heartbeat_consumer", link_loss.heartbeat_consumer, 0x1016, 1, WRITABLE),
        ("link_loss.abort_connection_option", link_loss.abort_connection_option, 0x6007, 0, WRITABLE),
        ("link_loss.fault_reaction_option", link_loss.fault_reaction_option, 0x605E, 0, WRITABLE),
        ("sync.interpolation_time", sync.interpolation_time, 0x60C2, 1, WRITABLE),
        ("sync.cycle_period", sync.cycle_period, 0x1006, 0, WRITABLE),
    ):
        if given is None and _offers(eds, index, subindex, access):
            yield _fault(key, index, subindex, eds)
    guards = _offers(eds, 0x100C, 0, WRITABLE) and _offers(eds, 0x100D, 0, WRITABLE)
    if guards and not link_loss.life_guarding and not _offers(eds, 0x1016, 1, WRITABLE):
        yield _fault("link_loss.life_guarding", 0x100C, 0, eds)
    if torque.echo == "none" and (torque.demand or torque.actual):
        yield Finding("torque.echo", "", fault="none, although a torque is named in which it comes back",
                      is_left_out=True)  # fmt: skip


def _offers(eds: Eds, index: int, subindex: int, access: tuple[str, ...]) -> bool:
    entry = eds.find(index, subindex)
    if entry is None:
        return False
    return carries(eds, Direction.TPDO, entry) if access is SENT else entry.access in access


def _fault(key: str, index: int, subindex: int, eds: Eds) -> Finding:
    fault = f"left out, although the file has {index:04X}h:{subindex:02X}; expected it, or its reason in [sources]"
    return Finding(key, "", eds.objects[index].line, fault, index, subindex, is_left_out=True)
