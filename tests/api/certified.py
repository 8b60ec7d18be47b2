"""Benches for certificates, drawn with their true onsets: `python -m tests.api.certified [COUNT [FIRST]]`."""

import random
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.api.certification import CertifyTask, certify
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.identification.certificate import Certificate
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from tests.api.test_identification import BUSES, rig_text
from tests.planning.test_known_bench import oracle_limit


@dataclass(frozen=True)
class CertifiedBench:
    """A simulated bench, and the text of a rig that describes it more or less well."""

    inertia: float
    damping: float
    coulomb: float
    text: str

    def onset(self, task: Task) -> float:
        """Return the true onset of the wall [N/m], without friction, by the exponential of a matrix of scipy."""
        plan = load(task).plan
        (axis,) = plan.axes
        square, delay = axis.rig.mechanism.ratio**2, axis.delay
        values = self.inertia / square, self.damping / square
        return oracle_limit(*values, delay.transport, delay.torque_loop, plan.period)


def drawn_bench(seed: int) -> CertifiedBench:
    """Draw a bench that its rig describes within a factor of two to three."""
    draw = random.Random(seed)
    inertia = 4e-5 * 3.0 ** draw.uniform(-1.0, 1.0)
    damping = 1e-4 * 4.0 ** draw.uniform(-1.0, 1.0)
    coulomb = 2e-3 * 10.0 ** draw.uniform(-1.0, 1.0)
    counts, bus = draw.choice([1024, 4096, 20_000, 65_536]), list(BUSES)[seed % 3]
    stated = {
        "viscous_damping = 3.0e-4": f"viscous_damping = {damping * 3.0 ** draw.uniform(-0.7, 1.0)!r}",
        "inertia = 4.0e-5": f"inertia = {inertia * 1.5 ** draw.uniform(-1.0, 1.0)!r}",
        "coulomb_friction = 2.0e-3": f"coulomb_friction = {coulomb * 2.0 ** draw.uniform(-1.0, 1.0)!r}",
    }
    text = rig_text(bus=bus, counts=counts)
    for old, new in stated.items():
        text = text.replace(old, new)
    truth = f"inertia = {inertia!r}\nviscous_damping = {damping!r}\ncoulomb_friction = {coulomb!r}\n"
    return CertifiedBench(inertia, damping, coulomb, f"{text}\n[axis.handle.simulation]\n{truth}")


def certified(seed: int, rig: Path, rate: float | None = None) -> tuple[Certificate, float]:
    """Return the certificate of a drawn bench and its true onset [N/m]; `rate` in Hz."""
    bench = drawn_bench(seed)
    rig.write_text(bench.text, encoding="utf-8")
    task = Task("wall", rig, rate=rate)
    return certify(CertifyTask(task)), bench.onset(task)


def survey(count: int, first: int = 0) -> None:
    """Print a line for each bench."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            try:
                found, onset = certified(seed, Path(folder) / "rig.toml")
            except HapticFieldbusError as error:
                print(f"{seed}: {type(error).__name__}: {error}", flush=True)
                continue
            told, tried = found.onset, max((each.stiffness for each in found.contacts), default=0.0)
            line = f"{seed}: true {onset:.0f} predicted {found.predicted:.0f} tried {tried:.0f} seen {found.seen}"
            if told is not None:
                covers = told.low <= onset <= told.high
                line += f" onset {told.value:.0f} ({told.low:.0f} to {told.high:.0f}) {told.value / onset - 1.0:+.1%}"
                line += f" {'covers' if covers else 'MISSES'} {told.reason}"
            print(line, "REACHED" if tried >= onset else "", found.ended, flush=True)


if __name__ == "__main__":
    survey(*map(int, sys.argv[1:] or ["40"]))
