"""Calls between functions of the package while something runs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

PACKAGE = "haptic_fieldbus."


@dataclass(frozen=True)
class Function:
    """A function by its module, without the package's name, and its qualified name."""

    module: str
    name: str

    @property
    def room(self) -> str:
        return self.module.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.module.replace('.', '/')}.py: {self.name.rpartition('.')[2]}"


@dataclass(frozen=True)
class Call:
    """`caller` is the nearest function of the package above, whatever libraries stand between."""

    caller: Function | None
    called: Function


@dataclass
class Calls:
    """All calls of functions of the package, in order, and the stiffness of the wall in each call of its force."""

    made: list[Call] = field(default_factory=list)
    stiffnesses: set[float] = field(default_factory=set)


@contextmanager
def traced() -> Iterator[Calls]:
    """Take down the calls that are made inside; the profiler of before comes back."""
    calls, before = Calls(), sys.getprofile()

    def note(frame: FrameType, event: str, _: object) -> None:
        called = _function(frame) if event == "call" else None
        if called is None:
            return
        above = frame.f_back
        while above is not None and _function(above) is None:
            above = above.f_back
        calls.made.append(Call(None if above is None else _function(above), called))
        if called == Function("scenes.wall", "Wall.force"):
            calls.stiffnesses.add(frame.f_locals["self"].stiffness)

    sys.setprofile(note)
    try:
        yield calls
    finally:
        sys.setprofile(before)


def _function(frame: FrameType) -> Function | None:
    """The function of the package that a frame is; the file of a folder is its `__init__`."""
    name = str(frame.f_globals.get("__name__", ""))
    if not name.startswith(PACKAGE):
        return None
    package = frame.f_globals.get("__package__") == name
    return Function(name.removeprefix(PACKAGE) + (".__init__" if package else ""), frame.f_code.co_qualname)
