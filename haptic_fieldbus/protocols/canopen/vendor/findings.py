"""One value of a profile beside what the file of its drive shows."""

from dataclasses import dataclass

from haptic_fieldbus.errors import Fault


@dataclass(frozen=True)
class Finding:
    """One value of a profile, and what the file has there; `fault` says what is wrong, empty when both agree."""

    key: str
    shows: str
    """What the file has, in words."""
    line: int | None = None
    """Line of the file."""
    fault: str = ""
    index: int | None = None
    """The object, by which a profile may explain a difference."""
    subindex: int = 0
    is_left_out: bool = False
    """True: the profile does not give the key, although the file has what it needs."""

    def as_fault(self) -> Fault:
        """Return the fault, with the line of the file."""
        return Fault(self.key, self.fault, self.line)
