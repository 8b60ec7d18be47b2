"""What a plan rests on without a source: the values of the profiles that are marked ASSUMED, in words.

A limit that is computed from an assumption is no better than it. The word therefore stands beside each result.
"""

from collections.abc import Callable, Iterable, Iterator

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan

_WORDS: dict[str, Callable[[DriveProfile], str]] = {
    "timing.torque_bandwidth": lambda profile: f"torque loop {exactly(profile.timing.torque_bandwidth)} Hz",
    "timing.control_period": lambda profile: f"control period {exactly(1e3 * profile.timing.control_period)} ms",
    "line.answer_time": lambda profile: "answer time",
    "timing.enabling_timeout": lambda profile: "time to enable",
    "torque.mode_of_operation": lambda profile: "mode of operation",
    "torque.target": lambda profile: "unit of target torque",
    "torque.rated": lambda profile: "unit of rated torque",
    "torque.rated_current": lambda profile: "unit of rated current",
    "torque.full_scale": lambda profile: f"full scale of torque {exactly(profile.full_scale or 0.0)} N·m",
    "torque.limit": lambda profile: "unit of the torque limit",
    "torque.slope": lambda profile: "unit of the torque slope",
    "torque.echo": lambda profile: "echo of the set-points",
    "position.actual": lambda profile: "unit of position",
    "velocity.actual": lambda profile: "unit of velocity",
    "pdo.rpdo_acts": lambda profile: "set-points act on reception",
    "link_loss.reacts": lambda profile: "reaction to a lost link",
    "sync.powers": lambda profile: "periods that it takes",
}
"""Key of a profile → its words; others do not bear on torque, or follow from these."""
_ORDER = list(_WORDS)


def assumed_words(profile: DriveProfile) -> tuple[str, ...]:
    """Return what is assumed of a drive, the times first."""
    keys = {member for key in profile.assumed for member in _members(key)}
    return tuple(_WORDS[key](profile) for key in sorted(keys, key=_ORDER.index))


def _members(key: str) -> Iterator[str]:
    """Yield the keys with words that a source covers: its own, or those of its table."""
    yield from (name for name in _WORDS if name == key or name.startswith(f"{key}."))


def assumed_lines(axes: Iterable[AxisPlan]) -> tuple[str, ...]:
    """Return a line for each drive of which something is assumed; drives of one profile share theirs."""
    profiles = {axis.profile.title: axis.profile for axis in axes}
    told = {title: ", ".join(assumed_words(profile)) for title, profile in profiles.items()}
    several = len(profiles) > 1
    return tuple(f"{title}: {words}" if several else words for title, words in told.items() if words)
