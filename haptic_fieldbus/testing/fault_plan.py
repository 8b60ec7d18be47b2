"""The faults of a test's bench: of a file, of a list, or drawn from a seed."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from random import SystemRandom

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.sim.faults import Fault, HostFault, load_faults, toml_of
from haptic_fieldbus.sim.faults.drawing import ANSWER_RECIPES, RANDOM, RECIPES, drawn, seed_of

NEW_SEED = "random"
"""A plan whose seed is drawn anew for each test."""
_LARGEST_NEW_SEED = 999_999
"""Short enough to be typed; any seed may be given."""
HOST_KINDS = frozenset({"host_late", "host_paused", "clock_step", "slow_compute"})
"""Faults of the computer of a master that runs in virtual time; nobody else's computer is simulated."""


@dataclass(frozen=True)
class FaultPlan:
    """Faults of a bench; `seed` is that of drawn faults, None for others."""

    faults: tuple[Fault, ...] = ()
    seed: int | None = None

    @property
    def text(self) -> str:
        """The faults as a file; for drawn ones, a first line that tells how to draw them again."""
        if self.seed is None:
            return toml_of(self.faults)
        return f"# again by: --fault-plan-seed {self.seed}, or the plan {RANDOM}{self.seed}\n{toml_of(self.faults)}"


def plan_faults(
    source: "FaultPlan | str | Path | Iterable[Fault]",
    *,
    within: float = 1.0,
    kinds: Iterable[str] | None = None,
    seed: int | None = None,
    folder: Path | None = None,
    possible: Collection[str] = RECIPES,
) -> FaultPlan:
    """Return the plan of a file, of a list of faults, of `random@SEED`, or of `random` and a new seed.

    Drawn faults happen `within` s of *operation enabled*, and are of these `kinds` (None: all that are `possible` on
    the bus of the bench); `seed` replaces that of `random`. The name of a file counts from `folder`. Raises UsageError
    for faults that this bench cannot have, and FaultFileError for a faulty file.
    """
    if isinstance(source, FaultPlan):
        return source
    if not isinstance(source, str | Path):
        return _checked(FaultPlan(tuple(source)))
    if source == NEW_SEED:
        source = f"{RANDOM}{SystemRandom().randint(0, _LARGEST_NEW_SEED) if seed is None else seed}"
    number = seed_of(str(source))
    if number is not None:
        return FaultPlan(drawn(number, within, _kinds(kinds, possible)), number)
    return _checked(FaultPlan(load_faults((folder or Path()) / source)))


def _kinds(wanted: Iterable[str] | None, possible: Collection[str]) -> tuple[str, ...]:
    """Return the kinds to draw from; raises UsageError for one that cannot be drawn here."""
    here = [kind for kind in (*RECIPES, *ANSWER_RECIPES) if kind in possible and kind not in HOST_KINDS]
    kinds = tuple(here if wanted is None else wanted)
    unknown = [kind for kind in kinds if kind not in here]
    if unknown or not kinds:
        raise UsageError(f"kinds of faults {', '.join(unknown)}: expected some of {', '.join(here)}")
    return kinds


def _checked(plan: FaultPlan) -> FaultPlan:
    for fault in plan.faults:
        if isinstance(fault, HostFault):
            raise UsageError(f'fault "{fault.kind}" is one of the master\'s computer, which is real here; leave it out')
        if fault.bus is not None:
            raise UsageError(
                f'fault "{fault.kind}" names the bus "{fault.bus}" of a rig; here is one bus, leave it out'
            )
    return plan
