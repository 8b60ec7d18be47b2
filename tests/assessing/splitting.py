"""Splits the error of one axis over a whole run at once, as the parts of a run together."""

from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.assessing.coupling_error import Tie
from haptic_fieldbus.assessing.element_forces import Handover, spans
from haptic_fieldbus.assessing.recording import Conversion, Recording, TrueMotion
from haptic_fieldbus.assessing.torque_error import ErrorFigures, ErrorPoints, Splitter
from haptic_fieldbus.scenes.element import Element


@dataclass(frozen=True, eq=False)
class ErrorSplit(ErrorPoints, ErrorFigures):
    """Error of a whole run: its figures, and all its points."""


def split(
    elements: Sequence[Element],
    recording: Recording,
    trajectory: TrueMotion,
    conversion: Conversion,
    *,
    period: float,
    begin_ns: int,
    method: str | None = None,
    unit: str = "N",
    step: float = 0.0,
    late: tuple[float, float] = (0.0, 0.0),
    exchanges: Sequence[Handover[Element]] = (),
    ties: Sequence[Tie] = (),
) -> ErrorSplit:
    """Return the error of a completely recorded run; the arguments are those of `Splitter`.

    Raises ValueError when nothing was recorded after `begin_ns`, or when the drive took over no recorded command.
    """
    splitter = Splitter(period=period, begin_ns=begin_ns, method=method, unit=unit, step=step, late=late)
    acted = spans(elements, exchanges, recording.times_ns)
    points = splitter.take(recording, trajectory, conversion, acted=acted, ties=ties)
    if splitter.figures is None:
        raise ValueError(f"nothing was recorded after {begin_ns} ns")
    return ErrorSplit(**vars(splitter.figures), **vars(points))
