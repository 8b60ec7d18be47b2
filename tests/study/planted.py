"""Bugs in the computation of limits, each with the cases of the report and the tests that must notice it.

Seven of them once stood in the package together, and all cases of the report passed; two survived as mutants. A bug
that no case or no test misses shows that something is computed and not judged.
"""

from dataclasses import dataclass
from pathlib import Path

MARGINS, NUMERICS = "haptic_fieldbus/margins", "haptic_fieldbus/numerics"


@dataclass(frozen=True)
class Planted:
    """`text` of `file`, which stands there once, becomes `instead`; each of `cases` and of `tests` must fail."""

    file: str
    text: str
    instead: str
    cases: tuple[str, ...]
    tests: tuple[str, ...]

    def changed(self, text: str) -> str:
        """The text of the file with the bug; raises ValueError when its place is not there once."""
        if text.count(self.text) != 1:
            raise ValueError(f"{self.file} has its place {text.count(self.text)} times")
        return text.replace(self.text, self.instead)

    def apply(self, folder: Path) -> str:
        """Plant the bug in a checkout; return the file's text without it."""
        path = folder / self.file
        whole = path.read_text(encoding="utf-8")
        path.write_text(self.changed(whole), encoding="utf-8")
        return whole


PLANTED = {
    "torque lag gone from stability": Planted(
        f"{MARGINS}/plant.py",
        "sampled.sample(*through_torque_loop(*dynamics(plant), plant.torque_lag), period, delay)",
        "sampled.sample(*dynamics(plant), period, delay)",
        ("torque-lag",),
        (),
    ),
    "torque lag gone from passivity": Planted(
        f"{MARGINS}/passivity.py",
        "centre = 0.5 * period + delay + plant.torque_lag",
        "centre = 0.5 * period + delay",
        ("torque-lag",),
        (),
    ),
    "torque lag gone from the largest gain": Planted(
        f"{MARGINS}/passivity.py",
        "largest_gain(base, added, plant.damping, period, delay, plant.torque_lag)",
        "largest_gain(base, added, plant.damping, period, delay)",
        ("torque-lag",),
        (),
    ),
    "a sign in the passivity spread": Planted(
        f"{NUMERICS}/passivity.py",
        "- 2.0 * first.real * gone / rate",
        "+ 2.0 * first.real * gone / rate",
        ("torque-lag",),
        (),
    ),
    "coupling reaction without its ratio": Planted(
        f"{NUMERICS}/coupled.py",
        "gain([first.tolist(), (-ratio * first).tolist()])",
        "gain([first.tolist(), (-first).tolist()])",
        ("coupled-axes",),
        (),
    ),
    "coupled spread doubled": Planted(
        f"{NUMERICS}/coupled_passivity.py",
        "spread = 0.5 * np.sqrt(",
        "spread = 1.0 * np.sqrt(",
        ("coupled-axes",),
        (),
    ),
    "edge chatter halved": Planted(
        f"{MARGINS}/cycles.py",
        "return 2.0 * plant.resolution / (math.pi * gain)",
        "return 1.0 * plant.resolution / (math.pi * gain)",
        ("one-count-wall",),
        (),
    ),
    "damping asked without torque lag": Planted(
        f"{MARGINS}/closed_loop.py",
        "times = (self.period, axis.delay, axis.plant.torque_lag)",
        "times = (self.period, axis.delay, 0.0)",
        ("torque-lag", "varying-slope"),
        (),
    ),
    "bisection of passivity without torque lag": Planted(
        f"{MARGINS}/passivity.py",
        "damping_needed(environment, period, delay, plant.torque_lag)",
        "damping_needed(environment, period, delay)",
        ("torque-lag",),
        (),
    ),
    "torque lag gone from coupled energies": Planted(
        f"{MARGINS}/coupled.py",
        "axis.plant.damping, axis.delay, axis.plant.torque_lag)",
        "axis.plant.damping, axis.delay, 0.0)",
        ("coupled-axes",),
        (),
    ),
    "coupling law without its ratio": Planted(
        "haptic_fieldbus/scenes/coupling.py",
        "force = shaft(first - ratio * second)\n            return force, -ratio * force",
        "force = shaft(first - ratio * second)\n            return force, -force",
        ("coupled-axes",),
        (),
    ),
    "torque lag gone from a load": Planted(
        f"{MARGINS}/bodies.py",
        "through_torque_loop(*dynamics(plant, bodies), plant.torque_lag)",
        "dynamics(plant, bodies)",
        ("compliant-transmission",),
        (),
    ),
    "torque lag gone from ticks": Planted(
        f"{MARGINS}/schedules.py",
        "through_torque_loop(*dynamics(plant), plant.torque_lag)",
        "dynamics(plant)",
        ("tick-phase",),
        (),
    ),
    "a lost sample moves the estimator": Planted(
        f"{NUMERICS}/sampled.py",
        "environment = StateSpace(np.eye(inner), np.zeros((inner, inputs)), environment.c, environment.d)",
        "pass",
        ("missed-frames-pattern",),
        (),
    ),
    "force returns in full after a gap": Planted(
        "haptic_fieldbus/cycle/safety.py",
        "permission.cap_after_gap(min(permission.cap, holding if pulses else abs(held)), side)",
        "pass",
        ("fade-return",),
        (),
    ),
    "stiffest place alone is judged": Planted(
        f"{MARGINS}/places.py",
        "at, growth = int(self._tried[growths.argmax()]), float(growths.max())",
        "at, growth = int(self._tried[self.stiffness[self._tried].argmax()]), "
        "float(growths[self.stiffness[self._tried].argmax()])",
        ("varying-slope",),
        (),
    ),
}
