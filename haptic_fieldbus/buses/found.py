"""What a look at a bus finds before a drive is used: its nodes, what they say of themselves, and checks of the adapter.

Nothing here has been written to a drive. Protocols that lack a quantity leave it None.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class FoundNode:
    """A device that answered, or that was heard."""

    node: int
    vendor_id: int | None = None
    product_code: int | None = None
    revision: int | None = None
    serial: int | None = None
    name: str | None = None
    """Name that the device gives itself."""
    profile: str | None = None
    """Name of the profile that fits best; None: none does."""
    sure: str | None = None
    """Words for how sure the profile is, and what speaks for it."""
    nmt_state: str | None = None
    power_state: str | None = None
    """State of the drive by its statusword; None for a device that is no drive."""

    def to_json(self) -> Json:
        return asdict(self)


@dataclass(frozen=True)
class Scan:
    """The nodes of one bus."""

    bus: str
    nodes: tuple[FoundNode, ...]
    listened: str
    """Sentence about what was heard before anything was sent."""
    masters: str = ""
    """Sentence about somebody else who commands; then nothing was asked, and the nodes are those that were heard."""

    def to_json(self) -> dict[str, Json]:
        nodes: list[Json] = [node.to_json() for node in self.nodes]
        return {"bus": self.bus, "nodes": nodes, "listened": self.listened, "masters": self.masters or None}


@dataclass(frozen=True)
class Check:
    """One check of bus, adapter or computer; `ok` is None where nothing could be told or nothing applies."""

    name: str
    ok: bool | None
    measured: str
    advice: str = ""
    """What to do about it; empty when it is well."""

    def to_json(self) -> Json:
        return {"name": self.name, "ok": self.ok, "measured": self.measured, "advice": self.advice or None}


@dataclass(frozen=True)
class Glimpse:
    """What one drive said when it was looked at, in its own steps."""

    t_ns: int
    """Instant at which its position came, or else of the look [ns]."""
    values: Mapping[Signal, int] = field(default_factory=dict)
    age: float | None = None
    """Age of the oldest of the values [s]; None without values."""
    life_age: float | None = None
    """Time since the last sign of life that comes by itself, such as a heartbeat [s]; None: there was none."""
    nmt_state: str | None = None
    error_code: int | None = None
    """Code of the last fault; None: the drive tells none."""
    note: str = ""
    """Sentence about why values are missing."""
