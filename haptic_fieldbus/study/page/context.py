"""What every section is given."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

from haptic_fieldbus.study.measure.bench import Bench, Tools

Item = TypeVar("Item")
Progress = Callable[[str, float], None]
"""(what is being measured, share of the section that is done)."""


@dataclass(frozen=True)
class Context:
    """`quick` trades length and resolution for time; `names` chooses among problems and cases, None: all."""

    tools: Tools
    bench: Bench
    quick: bool
    names: frozenset[str] | None = None
    progress: Progress = lambda label, share: None
    rows: dict[str, list[dict[str, object]]] = field(default_factory=dict)
    """What `report.json` keeps, by its key; sections add to it."""

    def is_chosen(self, name: str) -> bool:
        return self.names is None or name in self.names

    def add(self, key: str, row: dict[str, object]) -> None:
        self.rows.setdefault(key, []).append(row)

    def with_progress(self, items: Collection[Item], label: Callable[[Item], str]) -> Iterator[Item]:
        """The items one after another; progress is told before each."""
        for place, item in enumerate(items):
            self.progress(label(item), place / len(items))
            yield item
