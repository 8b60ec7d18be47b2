"""Proof of a profile against the EDS of its drive: the profile itself, and the simulated drive that it describes."""

from collections.abc import Iterator

from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SimulatedObject
from haptic_fieldbus.protocols.canopen.vendor.check import Comparison, compare
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.sim.canopen.model.compared import differences
from haptic_fieldbus.sim.canopen.sheet import dictionary_of

_NODE = 5
_STANDARD = (range(0x1000, 0x1F00), range(0x6000, 0x6800))
"""Objects of CiA 301, and of CiA 402-2 for one axis: those that programs for any drive read; not the programs of
CiA 302."""


def proof_of(profile: CanopenProfile, eds: Eds) -> Comparison:
    """Return what the file shows of the profile, and of its simulated drive where the profile describes that."""
    return compare(profile, eds, tuple(_simulated(profile, eds)) if profile.simulation.objects else ())


def _simulated(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield each object that the simulated drive has otherwise than the file."""
    named = {written.object for written in profile.setup.writes}
    named |= {shown.object for shown in profile.commissioning.shown} | {profile.torque.target.object}

    def concerns(index: int) -> bool:
        return index in named or any(index in standard for standard in _STANDARD)

    try:
        dictionary = dictionary_of(profile, _NODE)
    except UsageError as error:
        yield Finding("simulation", "", fault=f"cannot be simulated: {error}")
        return
    for place, shown in differences(dictionary, eds, _NODE, concerns).items():
        index, _, subindex = place.partition(":")
        number = int(index, 16)
        line = eds.objects[number].line if number in eds else None
        fault = f"{place}: the file has {_words(shown)}, the simulated drive has it otherwise"
        if shown.absent:
            fault = f"{place}: the file does not have it, the simulated drive does"
        yield Finding("simulation.objects", "", line, fault, number, int(subindex or "0", 16))


def _words(shown: SimulatedObject) -> str:
    given = {name: value for name, value in vars(shown).items() if value is not None and name != "absent"}
    return ", ".join(f"{name} {getattr(value, 'value', value)}" for name, value in given.items())
