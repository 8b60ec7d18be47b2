"""Errors in the code of elements of other packages, reported with the element, its file and its line.

Such code may raise anything, anywhere. The traceback has a frame of that code, which shows the element and the line
(`blamed`). An error without such a frame is one of this package, and passes as it is.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import getattr_static
from traceback import walk_tb
from types import FrameType

from haptic_fieldbus.documents.own_parts import told
from haptic_fieldbus.errors import Fault, HapticFieldbusError, SceneError, raise_all
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

_SIGNALS = (Signal.POSITION, Signal.VELOCITY, Signal.TORQUE_ACTUAL, Signal.ELAPSED_NS)
"""Signals that an element may need."""


@contextmanager
def own_faults(*elements: AnyElement) -> Iterator[None]:
    """Raise SceneError with element, file and line, from the error itself, where the code of an own element fails."""
    try:
        yield
    except HapticFieldbusError:
        raise
    except Exception as error:
        found = blamed(error, elements)
        if found is None:
            raise
        raise SceneError(found[0], [found[1]]) from error


def blamed(error: BaseException, elements: tuple[AnyElement, ...] = ()) -> tuple[str, Fault] | None:
    """Return the file of an own element whose code raised an error, and the fault with its name and its line.

    None where no frame of the error belongs to such an element. `elements` are those whose laws may have been called: a
    law that is a closure does not know its element.
    """
    frames = list(walk_tb(error.__traceback__))
    found = [(frame, owner) for frame, _ in frames if (owner := _owner(frame, elements)) is not None]
    if not found:
        return _unplaced(error, elements)
    source, owner = found[-1][0].f_code.co_filename, found[-1][1]
    # Functions beside the class belong to it too: the innermost frame of that file is reported.
    inside, line = [(frame.f_code, line) for frame, line in frames if frame.f_code.co_filename == source][-1]
    return source, Fault(f"element {_name(owner)}", f"{inside.co_qualname} raised {told(error)}", line)


def _unplaced(error: BaseException, elements: tuple[AnyElement, ...]) -> tuple[str, Fault] | None:
    """Return the fault of an error in our code that a single own element causes by a wrong call or a wrong answer."""
    own = [each for each in elements if _is_own(type(each).__module__)]
    if len(own) != 1:
        return None
    kind = type(own[0])
    source = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
    return source, Fault(f"element {_name(own[0])}", f"a call of {kind.__qualname__} raised {told(error)}")


def _name(owner: object) -> str:
    """Return the name of an element that may be incomplete; without a name that of its class."""
    name = getattr_static(owner, "name", None)
    return name if isinstance(name, str) else type(owner).__name__


def _is_own(module: str) -> bool:
    return module.partition(".")[0] != "haptic_fieldbus"


def _owner(frame: FrameType, elements: tuple[AnyElement, ...]) -> object:
    """Return the own element to which a frame belongs; None where it belongs to none."""
    code, module = frame.f_code, str(frame.f_globals.get("__name__"))
    if not _is_own(module) or code.co_filename.startswith("<"):
        return None
    me = frame.f_locals.get("self")
    if hasattr(type(me), "needs"):
        return me
    theirs = [each for each in elements if type(each).__module__ == module]
    return next((each for each in theirs if code.co_qualname.startswith(_classes(each))), None)


def _classes(element: AnyElement) -> tuple[str, ...]:
    """Return the name prefixes of all functions of an element's class and its bases."""
    return tuple(f"{kind.__qualname__}." for kind in type(element).__mro__)


def check_shapes(scene: Scene) -> None:
    """Raise UsageError for own elements whose needs or linear models have a wrong form."""
    own = [each for each in scene.elements if _is_own(type(each).__module__)]
    raise_all([f"scene: element {each.name}: {fault}" for each in own if (fault := shape_fault(each))])


def shape_fault(element: AnyElement) -> str:
    """Return the fault of the needs or the linearised form of an element; empty without a fault."""
    axes = 2 if isinstance(element, CouplingElement) else 1
    unknown = [each for each in element.needs if each not in _SIGNALS]
    space: object = element.linearised()
    if unknown:
        return f"needs {unknown[0]!r}; expected {', '.join(map(str, _SIGNALS))}"
    if not isinstance(space, StateSpace) or space.d.shape != (axes, 2 * axes):
        return f"linearised() must return a StateSpace with {2 * axes} inputs and {axes} output{'s' * (axes > 1)}"
    return ""
