"""Proof of a profile against the EDS of its drive: objects, types, access, mappability, limits, defaults, identity.

Each value of the profile that a file can show is looked up. What agrees is listed with its line, and what does not is a
fault with key, expected value and line. A profile may differ from its file on purpose: the source of a value begins
with "against the file" then, that of a key which is not there with "left out", and `simulation.differs` gives the
reason for an object of the simulated drive. Such differences are listed, and are no faults.

What no EDS shows is not looked at: units of torque, times, the best echo, values that are chosen.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import Fault
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.left_out import left_out
from haptic_fieldbus.protocols.canopen.vendor.modes import mode_findings
from haptic_fieldbus.protocols.canopen.vendor.named import named_objects
from haptic_fieldbus.protocols.canopen.vendor.numbers import identity_findings, pdo_findings
from haptic_fieldbus.protocols.canopen.vendor.shown import shown_findings
from haptic_fieldbus.protocols.canopen.vendor.sources import AGAINST, LEFT_OUT


@dataclass(frozen=True)
class Known:
    """A difference from the file that the profile explains."""

    fault: Fault
    reason: str


@dataclass(frozen=True)
class Comparison:
    """What a file shows of a profile."""

    source: str
    """The vendor's file, in which the lines of the faults are."""
    agreed: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    known: tuple[Known, ...]


def compare(profile: CanopenProfile, eds: Eds, more: tuple[Finding, ...] = ()) -> Comparison:
    """Return what the file shows of the profile; `more` are findings of other readers of both."""
    findings = [*_findings(profile, eds), *more]
    faults = [(finding, finding.as_fault(), _reason(profile, finding)) for finding in findings if finding.fault]
    return Comparison(
        Path(eds.source).name,
        tuple(finding for finding in findings if not finding.fault),
        tuple(fault for _, fault, reason in faults if not reason),
        tuple(Known(fault, reason) for _, fault, reason in faults if reason),
    )


def _findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    yield from identity_findings(profile, eds)
    if profile.drive.usable:
        yield from mode_findings(profile, eds)
        yield from named_objects(profile, eds)
        yield from shown_findings(profile, eds)
        yield from left_out(profile, eds)
    yield from pdo_findings(profile, eds)


def _reason(profile: CanopenProfile, finding: Finding) -> str:
    """Return the reason that the profile gives for a difference; empty when it gives none."""
    source = profile.sources.get(finding.key, "")
    if source.startswith(LEFT_OUT if finding.is_left_out else AGAINST):
        return source
    if not finding.key.startswith("simulation") or finding.index is None:
        return ""
    differs = profile.simulation.differs.items()
    return next((reason for place, reason in differs if _covers(place, finding.index, finding.subindex)), "")


def _covers(place: str, index: int, subindex: int) -> bool:
    """Return whether a key such as "6007", "1400-1403" or "1016:01-02" names the entry; all numbers are hexadecimal."""
    indices, _, subindices = place.partition(":")
    return index in _range(indices) and (not subindices or subindex in _range(subindices))


def _range(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first, 16), int(last or first, 16) + 1)
