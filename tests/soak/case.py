"""One seeded run: what is drawn from its seed, how it is run, and what is found broken in it."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from haptic_fieldbus import api
from haptic_fieldbus.api.site import kinds_on
from haptic_fieldbus.errors import HapticFieldbusError, PlanError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.faults.drawing import drawn
from tests.builders import endless_rig, shipped
from tests.invariants import laws
from tests.invariants.attach import Findings, watched
from tests.invariants.witness import Witness
from tests.softened import softened, unstable

DURATION = 1.0
FADE_IN = 0.1
CAN, TCP, RTU = "sim", "sim-modbus-tcp", "sim-modbus-rtu@115200"
EVERY = 5
"""Of so many seeds one is on Modbus: on RTU, or on TCP where the drive has it."""
ON_MODBUS = 2
"""The remainder of these seeds; the planted bugs were found with others, and keep them."""
RATES: Mapping[str, tuple[float | None, ...]] = {
    CAN: (1000.0, 1000.0, 500.0, 250.0),
    TCP: (None, 1000.0, 500.0, 250.0),
    RTU: (None, None, 30.0),
}
"""Rates that are drawn [Hz]; None: that of the bus itself."""
FALLBACK: Mapping[str, float | None] = {CAN: 1000.0, TCP: None, RTU: None}
"""Rates at which a scene is softened that is not stable at the one that was drawn [Hz]."""
HANDS = ("push", "tap", "sine", "guide", "release", "none")
CONTACT = {"wall.position": 0.001}
"""Settings of scenes whose wall is a few centimetres away: a short run is to be in contact."""
STAND_IN = "wall"
"""Scene in the place of one that a drive cannot render on its bus: a slow line bears no detents."""
REPEATED = 10
"""Of so many runs one is run twice, octet for octet; another one is recorded."""


@dataclass(frozen=True)
class Case:
    """Parts of one run."""

    seed: int
    scene: str
    drive: str
    bus: str
    rate: float | None
    hand: str
    duration: float
    faults: tuple[Fault, ...]


@dataclass(frozen=True)
class Verdict:
    """Findings of one run."""

    seed: int
    broken: tuple[tuple[str, str], ...]
    error: str | None
    zero: dict[str, float]
    """Times from a fault that must end a run to zero torque [s], by kind and rate; of runs with this fault alone."""
    seconds: float
    """Virtual time."""
    digest: str = field(default="", compare=False)

    def line(self) -> str:
        return json.dumps({name: value for name, value in asdict(self).items() if name != "digest"})


@cache
def scenes() -> tuple[str, ...]:
    return tuple(scene_names())


@cache
def profiles(protocol: str = "canopen") -> tuple[str, ...]:
    return tuple(name for name in shipped(protocol) if load_profile(name).drive.usable)


@cache
def buses_of(drive: str) -> tuple[str, ...]:
    """The simulated buses that a drive can be on."""
    profile = load_profile(drive)
    if not isinstance(profile, ModbusProfile):
        return (CAN,)
    return tuple(bus for bus, transport in ((TCP, "tcp"), (RTU, "rtu")) if transport in profile.line.transports)


def case_of(seed: int, duration: float = DURATION) -> Case:
    """Draw the run of a seed; its faults happen while there is torque."""
    random, modbus = Random(f"case/{seed}"), seed % EVERY == ON_MODBUS
    scene, drive = random.choice(scenes()), random.choice(profiles("modbus" if modbus else "canopen"))
    bus = random.choice(buses_of(drive)) if modbus else CAN
    rate, hand = random.choice(RATES[bus]), random.choice(HANDS)
    faults = drawn(seed, duration, kinds()) if modbus else drawn(seed, duration)
    return Case(seed, scene, drive, bus, rate, hand, duration, faults)


@cache
def kinds() -> tuple[str, ...]:
    """Kinds of faults that can be drawn on Modbus."""
    return kinds_on(api.plan("wall", bus=TCP))


@cache
def settings_of(scene: str, drive: str, bus: str) -> tuple[tuple[str, float], ...]:
    """The settings with which a scene is in contact early."""
    chosen = {}
    for key, value in CONTACT.items():
        try:
            api.plan(scene, drive=drive, bus=bus, settings={key: value})
            chosen[key] = value
        except HapticFieldbusError:
            continue
    return tuple(chosen.items())


@cache
def possible(scene: str, drive: str, bus: str, rate: float | None) -> tuple[str | Scene, float | None]:
    """The scene and the rate, or the fallback where the scene would not be stable with it.

    A scene that is unstable on a drive even there is refused before there is torque; it is softened, so that it runs.
    One that cannot be, or that this drive cannot render, is replaced by a wall.
    """
    settings = dict(settings_of(scene, drive, bus))
    try:
        if unstable(api.plan(scene, drive=drive, bus=bus, rate=rate, settings=settings)) is None:
            return scene, rate
    except PlanError:
        pass  # a bus that is too slow for the rate
    try:
        return softened(scene, drive, FALLBACK[bus], settings, bus=bus), FALLBACK[bus]
    except (HapticFieldbusError, ValueError):
        if scene == STAND_IN:
            raise
        return possible(STAND_IN, drive, bus, rate)


def run_case(case: Case) -> Verdict:
    """Run a case and judge it; every tenth is run twice, or recorded."""
    # On either protocol: its seeds are every so many, and each has all remainders of what is left.
    number = case.seed // EVERY if case.bus != CAN else case.seed
    with TemporaryDirectory() as folder:
        record = Path(folder) / ("run.csv" if case.bus != CAN or case.seed % 20 < REPEATED else "run.log")
        verdict = _once(case, record if number % REPEATED == 1 else None)
    if number % REPEATED == 0 and _once(case, None).digest != verdict.digest:
        verdict = replace(verdict, broken=(*verdict.broken, ("same seed, same octets", "another run wrote others")))
    return verdict


def _once(case: Case, record: Path | None) -> Verdict:
    error: str | None = None
    scene, rate = possible(case.scene, case.drive, case.bus, case.rate)
    with watched(keep=True) as found:
        try:
            api.run(
                scene,
                # Any hand is drawn for any scene; where it leaves the bench, the fault is not what ends the run.
                endless_rig(scene, case.drive, case.bus),
                rate=rate,
                hand=case.hand,
                duration=case.duration,
                fade_in=FADE_IN,
                seed=case.seed,
                faults=case.faults,
                settings=dict(settings_of(scene, case.drive, case.bus)) if isinstance(scene, str) else None,
                record=record,
            )
        except HapticFieldbusError as refused:
            error = type(refused).__name__
        except Exception as crash:  # the findings tell of it, with its message
            error = type(crash).__name__
    return Verdict(
        case.seed,
        tuple(found.broken) or _unseen(found, error),
        error,
        dict(_times(found.witnesses)),
        sum((witness.seen_ns - witness.begun_ns) * 1e-9 for witness in found.witnesses),
        _digest(found.witnesses),
    )


def _unseen(found: Findings, error: str | None) -> tuple[tuple[str, str], ...]:
    """A run that nobody has witnessed says nothing."""
    return () if found.runs else (("a run is witnessed", f"it ended with {error}"),)


def _times(witnesses: Iterable[Witness]) -> Iterable[tuple[str, float]]:
    for witness in witnesses:
        if len(witness.faults) != 1:
            continue
        for fault, cause, event_ns in laws.ending(witness):
            took = max((laws.lasted(witness, axis.node, event_ns) for axis in witness.stated.axes), default=0.0)
            yield f"{fault.kind}|{cause}|{1.0 / witness.stated.period:.0f}", took


def _digest(witnesses: Iterable[Witness]) -> str:
    seen = hashlib.sha256()
    for witness in witnesses:
        for t_ns, can_id, data, _ in witness.frames:
            seen.update(t_ns.to_bytes(8, "little", signed=True) + can_id.to_bytes(4, "little") + data)
    return seen.hexdigest()
