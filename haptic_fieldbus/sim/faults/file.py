"""Files of faults: read, checked, and written."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, ClassVar, get_args

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.drive.fields import STRICT
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import FaultFileError
from haptic_fieldbus.sim.faults.kinds import AnswerFault, DriveFaultKind, HandFault, HostFault, LastingFault, LineFault

TimedFault = DriveFaultKind | LineFault | AnswerFault | HostFault | HandFault
"""Kinds that happen at an instant."""
Fault = TimedFault | LastingFault


@dataclass(frozen=True)
class FaultFile:
    """A file of faults: `[[fault]] kind = "silence", at = 1.0`."""

    fault: tuple[Annotated[Fault, ByKind()], ...] = ()
    __pydantic_config__: ClassVar = STRICT


def load_faults(path: str | Path) -> tuple[Fault, ...]:
    """Return the faults of a file; raises FaultFileError that lists everything wrong in it."""
    document = read_document(Path(path), FaultFileError)
    return document.checked(document.validate(FaultFile)).fault


def toml_of(faults: Iterable[Fault]) -> str:
    """Return the text of a file of these faults; a value that is the default of its key is left out."""
    return "\n".join("[[fault]]\n" + "".join(_lines(fault)) for fault in faults)


def kinds_of(union: object) -> frozenset[str]:
    """Return the names of the kinds in a union of them."""
    return frozenset(kind.__annotations__["kind"].__args__[0] for kind in get_args(union))


def faults_of(faults: Iterable[Fault], node: int) -> tuple[Fault, ...]:
    """Return the faults that concern one drive of a bus."""
    return tuple(fault for fault in faults if fault.node in (None, node))


def faults_on(faults: Iterable[Fault], bus: str) -> tuple[Fault, ...]:
    """Return the faults that concern one bus of a rig."""
    return tuple(fault for fault in faults if fault.bus in (None, bus))


def _lines(fault: Fault) -> Iterable[str]:
    # `node` and `bus` are declared first, because they are inherited; `kind` stands first for the reader.
    names = sorted((field.name for field in fields(fault)), key=lambda name: name != "kind")
    defaults = {field.name: field.default for field in fields(fault)}
    for name in names:
        value = getattr(fault, name)
        if value != defaults[name] and value is not None:
            yield f"{name} = {_text(value)}\n"


def _text(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return str(list(value)) if isinstance(value, tuple) else repr(value)
