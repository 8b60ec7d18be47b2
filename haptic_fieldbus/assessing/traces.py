"""Traces of a run, gathered part by part; those of a long run are thinned as they come.

Of each bin, the points with the least and the greatest value of every line are kept, so that no spike is lost. Points
around the first considerable force are all kept, for a closer look.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import POINTS_PER_PERIOD
from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.assessing.result import Trace
from haptic_fieldbus.assessing.torque_error import ErrorPoints
from haptic_fieldbus.planning.axis_plan import AxisPlan

WHOLE = 30_000
"""Largest number of periods of a run whose traces are kept as they are."""
BINS = 10_000
"""Bins to which the traces of a longer run are thinned."""
CONSIDERABLE = 0.05
"""Share of the greatest force from which a force is considerable."""
VIRTUAL = "virtual "
BEFORE, AFTER = 20, 400
"""Periods around the first considerable force in which all points are kept."""


class Traces:
    """The traces of one axis of a run of about `periods`."""

    def __init__(self, periods: int, period_ns: int) -> None:
        self._bin = 0 if periods <= WHOLE else -(-periods // BINS)
        """Periods of a bin; 0: keep all."""
        self._period_ns = period_ns
        self._lines: list[dict[str, NDArray[Any]]] = []
        self._samples: list[tuple[Times, Array]] = []
        self._greatest = 0.0
        self._began = 0.0
        """Force at which the closer look begins; 0 while there is none."""

    def add(self, points: ErrorPoints, times_ns: Times, samples: Array) -> None:
        """Add a part of the run: its points, and the decoded positions at the instants `times_ns`."""
        lines = {"position": points.position, "force": points.force, "ideal": points.ideal}
        lines |= {f"{VIRTUAL}{name}": states[:, 0] for name, states in points.virtual.items()}
        kept, seen = np.arange(len(points.times_ns)), np.arange(len(times_ns))
        if self._bin:
            near_ns = self._near(points)
            kept = extremes(
                [*lines.values(), points.error], points.times_ns, round(self._bin * POINTS_PER_PERIOD), near_ns
            )
            seen = extremes([samples], times_ns, self._bin, near_ns)
        self._lines.append({"times_ns": points.times_ns[kept]} | {name: line[kept] for name, line in lines.items()})
        self._samples.append((times_ns[seen], samples[seen]))

    def _near(self, points: ErrorPoints) -> tuple[int, int]:
        """Return the instants [ns] around the first considerable force of the run; (0, 0) when it is elsewhere."""
        force = np.abs(points.ideal)
        self._greatest = max(self._greatest, float(force.max(initial=0.0)))
        considerable = np.flatnonzero((force > 0.0) & (force >= CONSIDERABLE * self._greatest))
        # The force at which the first one began may have become small beside a later, far greater one.
        if not len(considerable) or (self._began and self._began >= CONSIDERABLE * self._greatest):
            return 0, 0
        first = int(considerable[0])
        self._began = float(force[first])
        at_ns = int(points.times_ns[first])
        return at_ns - BEFORE * self._period_ns, at_ns + AFTER * self._period_ns

    def trace(self, axis: AxisPlan) -> Trace:
        """Return the trace of all parts; there must be one at least."""
        start_ns = self._samples[0][0][0]
        lines = {name: np.concatenate([part[name] for part in self._lines]) for name in self._lines[-1]}
        times_ns, samples = (np.concatenate(part) for part in zip(*self._samples, strict=True))
        return Trace(
            axis.name,
            axis.workspace,
            (lines["times_ns"] - start_ns) * 1e-9,
            lines["position"],
            lines["force"],
            ideal=lines["ideal"],
            sample_times=(times_ns - start_ns) * 1e-9,
            samples=samples,
            virtual={name.removeprefix(VIRTUAL): line for name, line in lines.items() if name.startswith(VIRTUAL)},
            sensor="tachometer" if axis.integrates else "encoder",
            period=self._period_ns * 1e-9,
        )


def extremes(lines: Sequence[Array], times_ns: Times, size: int, near_ns: tuple[int, int]) -> NDArray[np.int64]:
    """Return the indices of both ends, of the least and the greatest value of each line in each bin, and of all near.

    `lines` and `times_ns` have the shape `(n,)`; a bin has `size` points; near is all between the instants `near_ns`.
    """
    whole = len(times_ns) // size * size
    starts = np.arange(0, whole, size)
    kept = [np.array([0, len(times_ns) - 1]) if len(times_ns) else np.array([], dtype=np.int64)]
    kept.append(np.flatnonzero((times_ns >= near_ns[0]) & (times_ns <= near_ns[1])))
    for values in lines:
        blocks = values[:whole].reshape(-1, size)
        rest = values[whole:]
        kept += [starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1)] if whole else []
        kept += [np.array([whole + rest.argmin(), whole + rest.argmax()])] if len(rest) else []
    return np.unique(np.concatenate(kept)).astype(np.int64)
