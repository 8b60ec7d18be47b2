"""What a run in real time asked of its computer, and what it got."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from haptic_fieldbus.protocols.traffic import Json


@dataclass(frozen=True)
class Right:
    """One wish, and its outcome in words."""

    name: str
    """`scheduling`, `memory`, `processor`, `timer_slack` or `idle_states`."""
    wished: str
    got: str
    granted: bool
    advice: str = ""
    """What a person can do to get what was refused; empty when it was granted."""

    def to_json(self) -> Json:
        return {
            "name": self.name,
            "wished": self.wished,
            "got": self.got,
            "granted": self.granted,
            "advice": self.advice or None,
        }


def rights_texts(rights: Iterable[Right]) -> Iterator[str]:
    """Yield a line of what was granted, a line of what was refused, and what to do about it."""
    granted = [right.got for right in rights if right.granted]
    refused = [right for right in rights if not right.granted]
    if granted:
        yield ", ".join(granted)
    if refused:
        yield f"refused: {', '.join(f'{right.wished} (got {right.got})' for right in refused)}"
    yield from dict.fromkeys(right.advice for right in refused if right.advice)
