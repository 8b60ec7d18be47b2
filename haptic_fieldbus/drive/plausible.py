"""Ranges of the values that benches for a hand have, and the slips of unit that lie beyond them.

A value out of its range is refused, with the range and with the unit in which it would be in range: a motor of 400 N·m
moves no handle, one of 400 mN·m does. `i_know` in the rig excuses a bench that really has such a value.

Each range is a good deal wider than what motors for CANopen and Modbus drives have, so that a factor of 1000 is found
and every bench passes. The smallest motor that was looked at is a brushless one of 10 mm (Orbray BMS10: 0.11 mN·m, 0.2
A, 0.92 mN·m/A, rotor 0.03 g·cm²), the largest an AC servo motor of 5 kW (Yaskawa SGMSH-50: 15.8 N·m, 28.6 A, 84 A peak,
0.6 N·m/A, rotor 1.23e-3 kg·m²). Handles, gears and encoders have no such catalogue: the reason for their ranges stands
beside each.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeGuard, get_args

from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.fields import Ranged
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.signals import Workspace

TORQUES = ((1e-3, "mN·m"), (1e-2, "N·cm"), (1e-6, "µN·m"))
AMPERES = ((1e-3, "mA"),)
LARGEST_RATIO = 10.0
"""By which rated torque and rated current times torque constant may differ: constants are told of amplitudes and of
effective values, and rated values at standstill or at speed, which is a factor of 3."""

MEASURED = ((0.4, 0.0), (2.0, 50.0))
"""(factor, [ms]) of the shortest and of the longest time that any proof of a guard accepts. The factor is that of the
time for which the guard is set, which covers five periods at least. A proof accepts a fifth and two periods less, and
it accepts two periods more, the delay of a set-point (two periods at most), and the time of a question to the drive."""


@dataclass(frozen=True)
class Typical:
    """Smallest and largest value of a key, their unit, and why; a list has all its members within it."""

    low: float
    high: float
    unit: str
    why: str
    slips: tuple[tuple[float, str], ...] = ()
    """(size of a unit that somebody may have written, its name)."""

    def has(self, value: float) -> bool:
        """Return whether the value is in range."""
        return self.low <= value <= self.high

    @property
    def text(self) -> str:
        """The range in words."""
        return f"from {exactly(self.low)} to {exactly(self.high)} {self.unit}".rstrip()


RANGES: dict[Ranged, Typical] = {
    "rated_torque": Typical(
        1e-5, 50.0, "N·m", "motors of 0.11 mN·m to 15.8 N·m, steering wheels up to 30 N·m", TORQUES),
    "torque_constant": Typical(
        1e-4, 10.0, "N·m/A", "motors of 0.92 mN·m/A to 0.6 N·m/A, direct drives up to a few N·m/A", (
        (1e-3, "mN·m/A"), (1e-6, "µN·m/A"))),
    "rated_current": Typical(0.01, 300.0, "A", "motors of 0.2 A to 28.6 A", AMPERES),
    "peak_current": Typical(0.05, 1000.0, "A", "three to five times the rated current", AMPERES),
    "inertia": Typical(1e-9, 1.0, "kg·m²", "rotors of 3e-9 kg·m² to 1.23e-3 kg·m², steering wheels up to 0.1 kg·m²", (
        (1e-7, "g·cm²"), (1e-4, "kg·cm²"), (1e-6, "kg·mm²"))),
    "viscous_damping": Typical(0.0, 5.0, "N·m·s/rad", "rated torque of the largest motor at 3 rad/s", (
        (1e-3, "mN·m·s/rad"), (1e-6, "µN·m·s/rad"))),
    "coulomb_friction": Typical(0.0, 10.0, "N·m", "two thirds of the rated torque of the largest motor", TORQUES),
    "encoder_counts_per_revolution": Typical(6, 2**28, "", "Hall sensors of one pole pair to encoders of 28 bits", (
        (4.0, "lines of four counts each"),)),
    "mechanism.metres_per_revolution": Typical(1e-4, 3.0, "m", "a screw of 0.1 mm to a drum of 1 m", (
        (1e-3, "mm"), (1e-2, "cm"))),
    "mechanism.gear_ratio": Typical(0.01, 1000.0, "", "a hand cannot turn the motor through a larger gear"),
}  # fmt: skip
"""Range of each key of the motor and its mechanism."""
OF_HANDLE: dict[Workspace, dict[Ranged, Typical]] = {
    Workspace.LINEAR: {
        "limits.effort": Typical(1e-3, 2000.0, "N", "four times what a hand pushes in a blow", ((1e-3, "mN"),)),
        "limits.speed": Typical(1e-3, 200.0, "m/s", "several times the speed of a throw", ((1e-3, "mm/s"),)),
        "limits.position": Typical(-5.0, 5.0, "m", "beyond the reach of an arm", ((1e-3, "mm"), (1e-2, "cm"))),
        "limits.acceleration": Typical(0.1, 1e6, "m/s²", "a blow on the lightest handle", ((1e-3, "mm/s²"),)),
        "limits.power": Typical(1e-3, 5000.0, "W", "the largest motor", ((1e-3, "mW"),)),
    },
    Workspace.ROTARY: {
        "limits.effort": Typical(1e-5, 200.0, "N·m", "eight times what a hand turns in a blow", TORQUES),
        "limits.speed": Typical(0.01, 2e4, "rad/s", "the fastest motors", ()),
        "limits.position": Typical(
            -70.0, 70.0, "rad", "eleven turns to each side", ((0.017453292519943295, "degrees"),)),
        "limits.acceleration": Typical(1.0, 1e9, "rad/s²", "rated torque on the lightest rotor", ()),
        "limits.power": Typical(1e-3, 5000.0, "W", "the largest motor", ((1e-3, "mW"),)),
    },
}  # fmt: skip
"""Range of each limit, by the workspace of the handle."""


def implausible(known: dict[str, Any], workspace: Workspace | None) -> Iterator[tuple[str, str]]:
    """Yield (key, what is expected) for each value out of its range; `known` maps the keys of an axis to their values.

    Without a workspace, as when the mechanism has a fault, the limits of the handle are not judged. Values of a wrong
    type are left to the schema.
    """
    i_know = known.get("i_know") or ()
    ranges = RANGES | (OF_HANDLE[workspace] if workspace else {})
    credible = dict(known)
    for key, each in ranges.items():
        held = known.get(key)
        values = [value for value in (held if isinstance(held, list | tuple) else [held]) if _is_number(value)]
        beyond = [value for value in values if not each.has(value)]
        if beyond and key not in i_know:
            credible[key] = None
            # The unit in which the value would be plausible, where there is one.
            meant = next(((size * beyond[0], unit) for size, unit in each.slips if each.has(size * beyond[0])), None)
            hint = f"; is this in {meant[1]}? It would be {rounded(meant[0])} {each.unit}" if meant else ""
            yield key, f"{each.text} ({each.why}){hint}; {_excused(key)}"
    yield from _contradictions(credible, i_know)


def _contradictions(known: dict[str, Any], i_know: Any) -> Iterator[tuple[str, str]]:
    """Yield what two values that are in range each say against each other."""
    rated, friction = known.get("rated_torque"), known.get("coulomb_friction")
    if _is_number(rated) and _is_number(friction) and friction >= rated > 0.0:
        hint = "; is this in mN·m?" if 1e-3 * friction < rated else ""
        yield "coulomb_friction", f"less than rated_torque, {exactly(rated)} N·m; otherwise nothing moves{hint}"
    current, constant = known.get("rated_current"), known.get("torque_constant")
    if not (_is_number(rated) and _is_number(current) and _is_number(constant)) or "torque_constant" in i_know:
        return
    torque = current * constant
    if rated > 0.0 and torque > 0.0 and not 1.0 / LARGEST_RATIO <= torque / rated <= LARGEST_RATIO:
        hint = "; is this in mN·m/A?" if 1.0 / LARGEST_RATIO <= 1e-3 * (torque / rated) <= LARGEST_RATIO else ""
        ratio = f"rated_torque / rated_current, {exactly(rated)} N·m / {exactly(current)} A"
        yield "torque_constant", f"within a factor of {LARGEST_RATIO:g} of {ratio}{hint}; {_excused('torque_constant')}"


def _excused(key: str) -> str:
    return f'if your bench really has this value, write i_know = ["{key}"]'


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


IN_INTERVALS = ("inertia", "viscous_damping", "coulomb_friction", "delay_and_lag", "torque_lag")
"""Keys of `[axis.NAME.identified]` that have an interval."""


def check_plausible(document: Document, axis: str) -> None:
    """Note each value of an axis that no bench for a hand has; faults of types and of keys are those of the schema."""
    path = ("axis", axis)
    kind = document.value(*path, "mechanism", "kind")
    workspace = next((each for each in Workspace if each.value == kind), None)
    known = {key: document.value(*path, *key.split(".")) for key in (*get_args(Ranged), "i_know")}
    for key, expected in implausible(known, workspace):
        document.refuse((*path, *key.split(".")), expected)
    _check_measured(document, axis)
    _check_intervals(document, axis)


def _check_intervals(document: Document, axis: str) -> None:
    """Note a measured value without an interval around it."""
    path, otherwise = ("axis", axis, "identified"), f"without [axis.{axis}.identified] the values of the axis count"
    for key in IN_INTERVALS:
        value, interval = document.value(*path, key), document.value(*path, f"{key}_interval")
        if not _is_number(value):
            continue
        low, high = interval if isinstance(interval, list | tuple) and len(interval) == 2 else (None, None)
        if not (_is_number(low) and _is_number(high) and low <= value <= high):
            expected = f"[lowest, highest] around {key} = {exactly(value)}"
            document.refuse((*path, f"{key}_interval"), f"{expected}; {otherwise}")


def _check_measured(document: Document, axis: str) -> None:
    """Note a proof of a guard with a measured time that no proof accepts, or without one."""
    path = ("axis", axis, "proved")
    asked, measured = document.value(*path, "asked_ms"), document.value(*path, "guard_ms")
    if document.value(*path, "guard") != "proved" or not _is_number(asked):
        return
    low, high = (factor * asked + more for factor, more in MEASURED)
    if measured is None or (_is_number(measured) and not low <= measured <= high):
        expected = f"from {rounded(low)} to {rounded(high)} ms for asked_ms = {exactly(asked)}"
        document.refuse(
            (*path, "guard_ms"), f"{expected}; without [axis.{axis}.proved] the next run tests the watchdog"
        )
