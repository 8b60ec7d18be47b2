"""Context that every section is given: bench, tools, choices, and the rows of the report."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

from haptic_fieldbus.study.measure.bench import Bench, Tools
from haptic_fieldbus.study.measure.timing import Cost

Item = TypeVar("Item")
Progress = Callable[[str, float], None]
"""Function called with a label of the present measurement, and the share that is done (0 to 1)."""


@dataclass(frozen=True)
class Context:
    """Arguments of a section; `quick` asks for shorter and coarser measurements."""

    tools: Tools
    bench: Bench
    quick: bool
    names: frozenset[str] | None = None
    """Names of the problems or cases to measure; None for all."""
    progress: Progress = lambda label, share: None
    rows: dict[str, list[dict[str, object]]] = field(default_factory=dict)
    """Rows of `report.json` by their key; sections add to them, and all share the same dictionary."""

    costs: list[Cost] = field(default_factory=list)
    """All costs that were taken, from which it shows how quiet the machine was; shared by all sections too."""

    def is_chosen(self, name: str) -> bool:
        """Return whether a problem or case is to be measured."""
        return self.names is None or name in self.names

    def add(self, key: str, row: dict[str, object]) -> None:
        """Add a row to `report.json`."""
        self.rows.setdefault(key, []).append(row)

    def with_progress(self, items: Collection[Item], label: Callable[[Item], str]) -> Iterator[Item]:
        """Yield the items one after another, and report progress before each."""
        for place, item in enumerate(items):
            self.progress(label(item), place / len(items))
            yield item
