"""Quantities of the numbers in a scene or a rig, and the units that a file may use for them.

A bare number is SI, in the workspace of its axis: `stiffness = 600` is N/m on a linear axis, N·m/rad on a rotary one. A
text holds a number and a unit, `"0.6 N/mm"`; it is refused when the unit measures another quantity. The annotation of a
field states its quantity.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any, get_origin

from annotated_types import Interval

from haptic_fieldbus.documents.names import suggestion
from haptic_fieldbus.signals import Workspace


class Quantity(Enum):
    """A physical quantity; the value is its SI unit on a linear and on a rotary axis."""

    LENGTH = ("m", "rad")
    SPEED = ("m/s", "rad/s")
    ACCELERATION = ("m/s²", "rad/s²")
    EFFORT = ("N", "N·m")
    STIFFNESS = ("N/m", "N·m/rad")
    DAMPING = ("N·s/m", "N·m·s/rad")
    MASS = ("kg", "kg·m²")
    INVERSE_LENGTH = ("1/m", "1/rad")
    INVERSE_SPEED = ("s/m", "s/rad")
    EFFORT_RATE = ("N/s", "N·m/s")
    TIME = ("s", "s")
    FREQUENCY = ("Hz", "Hz")
    RATIO = ("", "")
    POWER = ("W", "W")
    CURRENT = ("A", "A")
    EFFORT_PER_CURRENT = ("N/A", "N·m/A")
    BIT_RATE = ("bit/s", "bit/s")

    def unit(self, workspace: Workspace) -> str:
        """Return the SI unit in this workspace; empty for a ratio."""
        return self.value[workspace is Workspace.ROTARY]


@dataclass(frozen=True)
class Range:
    """Magnitudes that a quantity may have, in SI units: 0, or from `smallest` to `largest`."""

    smallest: float
    largest: float

    @property
    def positive(self) -> Interval:
        """Bounds of a number above 0."""
        return Interval(gt=0.0, ge=self.smallest, le=self.largest)

    @property
    def from_zero(self) -> Interval:
        return Interval(ge=0.0, le=self.largest)

    @property
    def any(self) -> Interval:
        """Bounds of a number with either sign."""
        return Interval(ge=-self.largest, le=self.largest)


RANGES: Mapping[Quantity, Range] = {
    **{quantity: Range(1e-9, 1e9) for quantity in Quantity},
    Quantity.LENGTH: Range(1e-9, 1e6),
    Quantity.SPEED: Range(1e-9, 1e6),
    Quantity.STIFFNESS: Range(1e-12, 1e12),
    Quantity.DAMPING: Range(1e-12, 1e9),
    Quantity.MASS: Range(1e-12, 1e9),
    Quantity.EFFORT_RATE: Range(1e-9, 1e12),
}
"""Range of each quantity: far beyond any haptic device, but small enough that products and quotients stay finite."""

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180, "rev": 2 * math.pi}
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_TORQUES = {"N·m": 1.0, "mN·m": 1e-3, "µN·m": 1e-6, "kN·m": 1e3}
_CURRENTS = {"A": 1.0, "mA": 1e-3}
_TIMES = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "min": 60.0}


def _over(above: Mapping[str, float], below: Mapping[str, float]) -> dict[str, float]:
    return {f"{a}/{b}": x / y for a, x in above.items() for b, y in below.items()}


def _times_second(efforts: Mapping[str, float]) -> dict[str, float]:
    return {f"{effort}·s": factor for effort, factor in efforts.items()}


_FACTORS: dict[Quantity, tuple[dict[str, float], dict[str, float]]] = {
    Quantity.LENGTH: (_LENGTHS, _ANGLES),
    Quantity.SPEED: (_over(_LENGTHS, _TIMES), _over(_ANGLES, _TIMES) | {"rpm": 2 * math.pi / 60}),
    Quantity.ACCELERATION: ({"m/s²": 1.0, "mm/s²": 1e-3}, {"rad/s²": 1.0, "deg/s²": math.pi / 180}),
    Quantity.EFFORT: (_FORCES, _TORQUES),
    Quantity.STIFFNESS: (_over(_FORCES, _LENGTHS), _over(_TORQUES, _ANGLES)),
    Quantity.DAMPING: (_over(_times_second(_FORCES), _LENGTHS), _over(_times_second(_TORQUES), _ANGLES)),
    Quantity.MASS: ({"kg": 1.0, "g": 1e-3}, {"kg·m²": 1.0, "kg·cm²": 1e-4, "g·m²": 1e-3, "g·cm²": 1e-7}),
    Quantity.INVERSE_LENGTH: (_over({"1": 1.0}, _LENGTHS), _over({"1": 1.0}, _ANGLES)),
    Quantity.INVERSE_SPEED: (_over({"s": 1.0}, _LENGTHS), _over({"s": 1.0}, _ANGLES)),
    Quantity.EFFORT_RATE: (_over(_FORCES, _TIMES), _over(_TORQUES, _TIMES)),
    Quantity.TIME: (_TIMES, _TIMES),
    Quantity.FREQUENCY: ({"Hz": 1.0, "kHz": 1e3, "1/s": 1.0},) * 2,
    Quantity.RATIO: ({"": 1.0, "%": 1e-2},) * 2,
    Quantity.POWER: ({"W": 1.0, "mW": 1e-3, "kW": 1e3},) * 2,
    Quantity.CURRENT: (_CURRENTS,) * 2,
    Quantity.EFFORT_PER_CURRENT: (_over(_FORCES, _CURRENTS), _over(_TORQUES, _CURRENTS)),
    Quantity.BIT_RATE: ({"bit/s": 1.0, "kbit/s": 1e3, "Mbit/s": 1e6},) * 2,
}
"""SI value of one of each unit, on a linear and on a rotary axis."""
_WRITTEN = re.compile(r"\s*([-+]?(?:\d+(?:_\d+)*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_WITH_COMMA = re.compile(r"\s*([-+]?[\d.]*(?:,\d+)+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_ONE_SPELLING = str.maketrans({"*": "", "·": "", "⋅": "", "μ": "µ", "−": "-"})
"""Multiplication signs are dropped, so N·m, N*m and Nm are one unit; the two codes of µ and of − become one."""
# Spellings without superscripts and µ, as typed on a plain keyboard.
_PLAIN = (("^2", "²"), ("s2", "s²"), ("m2", "m²"), ("us", "µs"), ("um", "µm"), ("uN", "µN"))


def parse_quantity(text: str, quantity: Quantity, workspace: Workspace, reason: str | None = None) -> float:
    """Return the SI value of a text such as "0.6 N/mm".

    Raises ValueError with the expected form, such as "a stiffness in N·m/rad, as the axis is rotary", when the text is
    no number with a unit, or its unit measures another quantity. A `reason` replaces that of the axis.
    """
    refuse_comma(text)
    match = _WRITTEN.fullmatch(text.translate(_ONE_SPELLING))
    if match is None or not match.group(2):
        example = quantity.unit(workspace)
        also = f', or one with its unit such as "2 {example}"' if example else ""
        raise ValueError(f"a number without quotes{also}")
    number, unit = match.groups()
    for plain, proper in _PLAIN:
        unit = unit.replace(plain, proper)
    units = _spelt(quantity, workspace)
    if unit in units:
        return float(number) * units[unit][0]
    reason = f"because the axis is {workspace.value}" if reason is None else reason
    slip = next((written for typed, (_, written) in units.items() if typed.lower() == unit.lower()), None)
    told = _other(unit, quantity, workspace) if slip is None else f'; write "{number} {slip}"'
    raise ValueError(f"{_in_words(quantity, workspace, reason)}{told}")


def refuse_comma(text: str) -> None:
    """Raise ValueError with the correct spelling for a number with a comma, `100,5`; it never counts as a point."""
    if match := _WITH_COMMA.fullmatch(text):
        number, unit = match.groups()
        spellings = [_with_point(number)]
        # A comma before three digits may stand between thousands as well.
        spellings += [number.replace(",", "")] if re.fullmatch(r"[-+]?[1-9]\d{0,2},\d{3}", number) else []
        raise ValueError("a number without a comma: " + " or ".join(f"{each} {unit}".rstrip() for each in spellings))


def _with_point(number: str) -> str:
    """Return the correct spelling of a number with commas; the last separator is the decimal one, unless it repeats."""
    last = max(number.rfind(","), number.rfind("."))
    ends = number.replace(",", "").replace(".", "")
    if number.count(number[last]) > 1:
        return ends
    after = len(number) - last - 1
    return f"{ends[:-after] or '0'}.{ends[-after:]}"


@cache
def _spelt(quantity: Quantity, workspace: Workspace) -> dict[str, tuple[float, str]]:
    """Return factor and unit of a quantity by its units in the spelling of `_ONE_SPELLING`."""
    factors = _FACTORS[quantity][workspace is Workspace.ROTARY]
    return {unit.replace("·", ""): (factor, unit) for unit, factor in factors.items()}


def _in_words(quantity: Quantity, workspace: Workspace, reason: str) -> str:
    unit = quantity.unit(workspace)
    if not unit:
        return "a number without a unit"
    always = quantity.unit(Workspace.LINEAR) == quantity.unit(Workspace.ROTARY)
    return f"{_named(quantity, workspace)} in {unit}{'' if always else f', {reason}'}"


_WORDS = {
    Quantity.LENGTH: ("length", "angle"),
    Quantity.EFFORT: ("force", "torque"),
    Quantity.MASS: ("mass", "moment of inertia"),
    Quantity.EFFORT_RATE: ("force per time", "torque per time"),
    Quantity.EFFORT_PER_CURRENT: ("force per current", "torque per current"),
}
"""Names on a linear and on a rotary axis, for quantities whose enum name does not serve."""


def _named(quantity: Quantity, workspace: Workspace) -> str:
    words = _WORDS.get(quantity, (quantity.name.lower().replace("_", " "),) * 2)
    name = words[workspace is Workspace.ROTARY]
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _other(unit: str, quantity: Quantity, workspace: Workspace) -> str:
    """Return the end of a message: the quantity that the unit measures, or a note that the unit is unknown."""
    other = Workspace.LINEAR if workspace is Workspace.ROTARY else Workspace.ROTARY
    # The wanted quantity first: the likeliest mistake is its unit of the other workspace.
    for found in (quantity, *Quantity):
        for space in (workspace, other):
            if unit in _spelt(found, space):
                return f"; {unit} is a unit of {_named(found, space)} on a {space.value} axis"
    return f"; unknown unit{suggestion(unit, _FACTORS[quantity][workspace is Workspace.ROTARY])}"


def annotations(hint: Any) -> Iterator[object]:
    """Yield the annotations of a type, also those inside of unions."""
    yield from getattr(hint, "__metadata__", ())
    # Annotations inside of a list belong to its members, not to the list.
    if get_origin(hint) is not tuple:
        for member in getattr(hint, "__args__", ()):
            yield from annotations(member)


def with_units(schema: dict[str, Any], units: str) -> dict[str, Any]:
    """Return the JSON Schema of a number in SI that may also be a text of a number and its unit."""
    described = {"description": f"in {units}"} if units else {}
    text = {"type": "string", "pattern": r"^\s*[-+.0-9]"}
    # Default and title are of the value as a whole, whichever alternative it has.
    whole: dict[str, Any] = {key: schema.pop(key) for key in ("default", "title") if key in schema} | described
    return whole | {"anyOf": [*schema.get("anyOf", [schema]), text]}
