"""Files of faults for `run --faults`: TOML, one `[[fault]]` each."""

from pathlib import Path

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.errors import FaultFileError
from haptic_fieldbus.sim.faults import Fault, FaultFile


def load_faults(path: str | Path) -> tuple[Fault, ...]:
    """The faults of a file; raises FaultFileError with all that is wrong in it."""
    document = read_document(Path(path), FaultFileError)
    return document.checked(document.validate(FaultFile)).fault
