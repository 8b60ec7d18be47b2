"""The stiff and extreme cases by name: each a function of `quick` that measures and is judged by an oracle of its own.

One file a theme, and in each a table `CASES`; a name stands in one file only.
"""

from collections.abc import Callable

from haptic_fieldbus.report.case import CaseResult
from haptic_fieldbus.report.cases import closed_loop, drive, elements, integrators, sensing, sharing

Case = Callable[[bool], CaseResult]

CASES: dict[str, Case] = {
    **integrators.CASES,
    **closed_loop.CASES,
    **sharing.CASES,
    **sensing.CASES,
    **elements.CASES,
    **drive.CASES,
}
