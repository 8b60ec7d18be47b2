"""Checks of a request before anything is opened; all faults are reported at once, in one `UsageError`.

The Python API and the command line both use these functions, so both refuse the same requests in the same words.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from haptic_fieldbus import defaults
from haptic_fieldbus.documents.quantities import Quantity, parse_quantity
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.limits import LONGEST_FADE_IN, SHORTEST_FADE_IN
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.protocols.registry import parse_bus, protocol_named
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Workspace


@dataclass(frozen=True)
class Task:
    """Request of a caller, unchanged: a scene on the shipped bench or on the bench of a rig.

    Nothing is loaded or checked yet. A rig replaces `drive` and `node`. A given `bus` replaces the buses of the rig.
    The open loop has no bench and uses only the scene, its method and its estimator.
    """

    scene: str | Path | Scene
    """A name of the library, a file, or a scene made in Python."""
    rig: str | Path | Rig | None = None
    """A file or a Rig; None is the shipped bench, with one drive for each axis of the scene."""
    _: KW_ONLY
    rate: float | None = None
    """Loop rate [Hz]; None: 1000 Hz, or the highest rate that a slower bus sustains."""
    settings: Mapping[str, Setting] | None = None
    """Parameters of the scene, such as {"wall.stiffness": 800.0}, "0.8 N/mm" or "max/2"."""
    method: str | None = None
    """Integrator of virtual states: a name, or an `Integrator` of your own."""
    estimator: str | None = None
    """Velocity estimator: a name, or an `Estimator` of your own."""
    drive: str | None = None
    """Profile of the shipped bench, by name or path; None: the default profile of the protocol."""
    bus: str | None = None
    """sim[@BITRATE] or INTERFACE:CHANNEL[@BITRATE]; None is the simulation, or the buses of the rig."""
    node: int = defaults.DEFAULT_NODE
    """Node-ID of the first axis of the shipped bench; the other axes follow in order."""
    axes: Mapping[str, str] | None = None
    """Rig axis for each scene axis, {"knob": "handle"}; an omitted axis uses the rig axis of the same name."""
    zero: str | None = None
    """"here": the position of the handle at enabling is zero, instead of the zero of the rig; or None."""
    profiles: str | Path | None = None
    """Folder of your own profiles, in addition to the shipped ones; None: the environment variable
    HAPTIC_FIELDBUS_PROFILES."""


MAXIMUM_RATE = 100_000.0
"""Highest rate accepted [Hz]: far above the rate of any bus, and low enough for the clock to resolve a period."""
MINIMUM_RATE = 0.1
"""Lowest rate accepted [Hz]: five of its periods are the longest guard time of a drive."""
LONGEST = 1e6
"""Longest duration accepted [s]."""
LARGEST_SEED = 2**64 - 1
A_CHANGE = "SECONDS:element.parameter=value, for example 2.5:wall.stiffness=400"

PLOT_SUFFIXES = (".png", ".svg", ".pdf")
RECORD_SUFFIXES = (".log", ".blf", ".csv", ".mcap")


def parse_settings(texts: Iterable[str]) -> dict[str, str]:
    """Return `element.parameter=value` texts as a mapping; raises one UsageError for all malformed or repeated ones."""
    return parse_pairs(texts, "--set", "element.parameter=value, for example wall.stiffness=400", dotted=True)


def parse_axes(texts: Iterable[str]) -> dict[str, str]:
    """Return `scene axis=rig axis` texts as a mapping; raises one UsageError for all malformed or repeated ones."""
    return parse_pairs(texts, "--axis", "SCENE_AXIS=RIG_AXIS, for example knob=handle")


def parse_pairs(texts: Iterable[str], option: str, expected: str, *, dotted: bool = False) -> dict[str, str]:
    """Return `key=value` texts as a mapping; the key is `dotted` if it has two parts. Raises UsageError."""
    pairs: dict[str, str] = {}
    faults = []
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        if not (value and (all(key.partition(".")) if dotted else key)):
            faults.append(f'{option} "{text}": expected {expected}')
        elif key in pairs:
            faults.append(f"{option} {key}: given twice, as {pairs[key]} and {value}")
        pairs[key] = value
    raise_all(faults)
    return pairs


def parse_changes(texts: Iterable[str]) -> list[tuple[float, dict[str, str]]]:
    """Return `SECONDS:element.parameter=value` texts as (time [s], settings), sorted by time, one entry for each time.

    Raises one UsageError for all malformed or repeated texts.
    """
    changes: dict[float, dict[str, str]] = {}
    faults = []
    for text in texts:
        when, _, setting = text.partition(":")
        try:
            time = _seconds(when)
            ((key, value),) = parse_settings([setting]).items()
        except ValueError:  # of the time, or a UsageError of `parse_settings`, which is one too
            faults.append(f'--change "{text}": expected {A_CHANGE}')
            continue
        same = changes.setdefault(time, {})
        if key in same:
            faults.append(f"--change {exactly(time)}:{key}: given twice, as {same[key]} and {value}")
        same[key] = value
    raise_all(faults)
    return sorted(changes.items())


def _seconds(text: str) -> float:
    """Return a time [s], a number or one with a unit, such as "500 ms"; raises ValueError."""
    with suppress(ValueError):
        return float(text)
    return parse_quantity(text.strip(), Quantity.TIME, Workspace.LINEAR)


def check_request(
    *,
    bus: str = defaults.DEFAULT_BUS,
    node: int = defaults.DEFAULT_NODE,
    rate: float | None = None,
    duration: float = defaults.DEFAULT_DURATION,
    seed: int = defaults.DEFAULT_SEED,
    record: Path | None = None,
) -> BusName:
    """Check a request and return its bus; `rate` in Hz, None for the rate of the bus, `duration` in s.

    Raises one UsageError that lists every fault.
    """
    faults = _number_faults(defaults.DEFAULT_RATE if rate is None else rate, duration, seed)
    faults += file_faults("record", record, RECORD_SUFFIXES)
    try:
        name = parse_bus(bus)
    except UsageError as error:
        # The bus is unknown, and so is its protocol; the node is checked by the default one.
        raise UsageError("\n".join([str(error), *_node_faults(defaults.DEFAULT_PROTOCOL, "", node), *faults])) from None
    raise_all([*_node_faults(name.section.protocol, name.section.interface, node), *faults])
    return name


def _node_faults(protocol: str, interface: str, node: int) -> list[str]:
    """Return the fault of a node-ID outside the range of `protocol`; empty without a fault."""
    wanted = protocol_named(protocol).wanted_node(node, interface)
    return [f"node {node}: a node-ID is {wanted}"] if wanted else []


def check_fade_in(fade_in: float) -> None:
    """Raise UsageError for a fade-in time [s] outside its range; the comparison also refuses NaN."""
    if not SHORTEST_FADE_IN <= fade_in <= LONGEST_FADE_IN:
        least, most = exactly(SHORTEST_FADE_IN), exactly(LONGEST_FADE_IN)
        raise UsageError(f"fade-in {exactly(fade_in)} s: expected {least} to {most} s, so that the person notices it")


def _number_faults(rate: float, duration: float, seed: int) -> list[str]:
    """Return the faults of rate [Hz], duration [s] and seed; the comparisons also refuse NaN."""
    good_rate, good_duration = MINIMUM_RATE <= rate <= MAXIMUM_RATE, 0.0 < duration <= LONGEST
    # Only if both values are valid: one fault must not be reported twice.
    good_product = not (good_rate and good_duration) or rate * duration >= 1.0
    rates = f"from {exactly(MINIMUM_RATE)} to {exactly(MAXIMUM_RATE)} Hz"
    checks = [
        (good_rate, f"rate {exactly(rate)}: expected a rate above 0, {rates}"),
        (good_duration, f"duration {exactly(duration)}: expected a time above 0 s, at most {exactly(LONGEST)} s"),
        (good_product, f"duration {exactly(duration)} s: less than one period at {exactly(rate)} Hz"),
        (0 <= seed <= LARGEST_SEED, f"seed {seed}: expected a whole number from 0 to {LARGEST_SEED}"),
    ]
    return [sentence for good, sentence in checks if not good]


def file_faults(option: str, path: Path | None, suffixes: Sequence[str]) -> list[str]:
    """Return the reason why a file cannot be written, known before the run; empty when it can be written."""
    if path is None:
        return []
    if path.suffix not in suffixes:
        return [f'{option} "{path}": the suffix must be one of {", ".join(suffixes)}']
    if not path.parent.is_dir():
        return [f'{option} "{path}": no folder {path.parent}']
    try:
        real = Path(os.path.realpath(path))  # a link stays; raises OSError in a working folder that was removed
        existed = real.exists()
        if real.is_fifo():  # opening it would wait for a reader
            return [f'{option} "{path}": it is a FIFO; expected a regular file']
        # Opening to append tests the permissions without changing an existing file.
        real.open("ab").close()
    except OSError as error:
        return [f'{option} "{path}": cannot be written: {error.strerror}']
    if not existed:
        real.unlink()
    return []
