"""All that the torque error takes along from one part of a run to the next."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.assessing.spans import Kind, Span

if TYPE_CHECKING:  # imported for its type alone: only virtual states need it
    from haptic_fieldbus.assessing.virtual_states import ResponseToError

Key = tuple[Hashable, ...]


@dataclass
class Carried:
    """Laws with their memory, virtual states, and the forces of the part before."""

    laws: dict[Key, Any] = field(default_factory=dict)
    exact: dict[Key, Array] = field(default_factory=dict)
    """Ideal virtual states at the last node, each `(order,)`."""
    to_error: dict[Key, "ResponseToError"] = field(default_factory=dict)
    stages: dict[str, Array] = field(default_factory=dict)
    """Force of each stage in all periods of the part before."""

    def law(self, key: Key, begin: Callable[[], Any]) -> Any:
        """Return the law of a key; it begins when it is asked for first."""
        if key not in self.laws:
            self.laws[key] = begin()
        return self.laws[key]

    def tail(self, name: str, overlap: int) -> Array | float:
        """Return the force of a stage in the last periods of the part before, `(overlap,)`; 0 if it was not there."""
        before = self.stages.get(name)
        return 0.0 if before is None else before[len(before) - overlap :]


def begins(span: Span[Kind], overlap: int) -> bool:
    """Return whether the element begins to act in the part that the span is of."""
    return span.first >= overlap


def new_rows(span: Span[Kind], overlap: int) -> slice:
    """Return the slice of periods of a span that earlier parts did not have."""
    return slice(max(span.rows.start, overlap), span.rows.stop)


def new_nodes(span: Span[Kind], overlap: int, nodes_ns: Times, times_ns: Times) -> slice:
    """Return the slice of nodes after the period in which the span's ramp begins, up to its last period.

    Of a span that goes on, it begins after the first node, which the part before had too.
    """
    begin_ns = times_ns[span.before] if begins(span, overlap) else nodes_ns[0]
    first, last = nodes_ns.searchsorted([begin_ns, times_ns[span.rows.stop - 1]], side="right")
    return slice(int(first), int(last))
