"""Result of a scan before a drive is used: the nodes, their identity, and checks of the adapter.

Nothing here has been written to a drive. Protocols that lack a quantity leave it None.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from haptic_fieldbus.numerals import OutputRow, rounded
from haptic_fieldbus.signals import Signal

COLUMNS = {
    "node": "node", "vendor_id": "vendor", "product_code": "product", "revision": "revision", "serial": "serial",
    "name": "name", "nmt_state": "NMT", "power_state": "state", "profile": "profile",
}  # fmt: skip
"""Key of a node → heading of its column, in the order of the columns."""
HEXADECIMAL = ("vendor_id", "product_code", "revision", "serial")
PASSED = {True: "ok", False: "not ok", None: "-"}


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

    def rows(self) -> Iterator[OutputRow]:
        """Yield a row for each column of its line, and one about its profile, which is told below the table."""
        for key, heading in COLUMNS.items():
            value = getattr(self, key)
            shown = "" if value is None else f"{value:08X}h" if key in HEXADECIMAL else str(value)
            yield OutputRow(heading, [shown], key, value)
        yield OutputRow(f"node {self.node}", [] if self.sure is None else [self.sure], "sure", self.sure)


@dataclass(frozen=True)
class Scan:
    """The nodes of one bus."""

    bus: str
    nodes: tuple[FoundNode, ...]
    listened: str
    """Sentence about what was heard before anything was sent."""
    masters: str = ""
    """Sentence about another master. Nothing was asked then, and `nodes` are those that were heard."""
    silent: str = ""
    """Sentence for no answer at all: what to check on such a bus."""

    def rows(self) -> Iterator[OutputRow]:
        """Yield what was heard on the bus; the nodes have rows of their own."""
        yield OutputRow(key="bus", value=self.bus)
        yield OutputRow("bus", [self.listened], "listened", self.listened)
        yield OutputRow("listened", filter(None, [self.masters]), "masters", self.masters or None)
        yield OutputRow("none", [] if self.nodes or not self.silent else [self.silent])


@dataclass(frozen=True)
class Check:
    """One check of bus, adapter or computer; `ok` is None where nothing could be told or nothing applies."""

    name: str
    ok: bool | None
    measured: str
    advice: str = ""
    """Remedy for a failed check; empty when the check passed."""

    @property
    def row(self) -> OutputRow:
        """The check in words, and as an object of JSON."""
        told = {"name": self.name, "ok": self.ok, "measured": self.measured, "advice": self.advice or None}
        words = f"{self.name.replace('_', ' ')}: {self.measured}"
        return OutputRow(PASSED[self.ok], filter(None, [words, self.advice]), self.name, told)


@dataclass(frozen=True)
class DriveReading:
    """Values read from one drive, in the drive's own steps."""

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


def another_master(sentence: str) -> tuple[Check, Check]:
    """Return the checks of a bus with another master, on which nothing is measured."""
    advice = "end the other master; until then nothing is requested, and the round trip is not measured"
    return Check("other_masters", False, sentence, advice), Check("round_trip", None, "not measured")


# The way to a device and back: is it short enough for a loop, and does it take equally long each time?

QUESTIONS = 200
ANSWER_NS = 100_000_000
"""Time for which an answer is waited for [ns]."""
LONGEST_ROUND_TRIP = 5e-3
"""[s]; adapters that hold octets back, as USB serial ports do, take longer."""
JITTER_SHARE = 0.5
"""Share of a period by which a round trip may be longer than the usual one."""


def timing_checks(
    subject: str, times: Sequence[float], asked: int, rate: float, *, silent: str, slow: str
) -> tuple[Check, Check]:
    """Return the checks of the usual round trip and of its jitter, for a loop of this rate [Hz].

    `times` are those of the answers [s]; `silent` and `slow` are the advice for no answer and for slow ones.
    """
    if len(times) < 2:
        silence = Check("round_trip", False, f"{subject} does not answer", silent)
        return silence, Check("round_trip_jitter", None, "not measured")
    from statistics import quantiles  # imported here, because a run has no use for it

    cuts = quantiles(times, n=100, method="inclusive")
    usual, jitter = cuts[49], cuts[98] - cuts[49]
    fitting_rate = rounded(JITTER_SHARE / max(jitter, 1e-9), 2)
    lost = f", {asked - len(times)} of {asked} without answer" if len(times) < asked else ""
    quick = usual <= LONGEST_ROUND_TRIP and not lost
    steady = jitter <= JITTER_SHARE / rate
    unsteady = (
        f"at {rounded(rate)} Hz feedback would be late in some periods: give this program real-time rights "
        f"(scheduling, memory), reduce the load of this computer, or use --rate {fitting_rate}"
    )
    told = f"{_ms(min(times))} ms (min), {_ms(usual)} ms (median), {_ms(max(times))} ms (max), {subject}{lost}"
    spread = f"p99 is {_ms(jitter)} ms longer than the median"
    round_trip = Check("round_trip", quick, told, "" if quick else slow)
    return round_trip, Check("round_trip_jitter", steady, spread, "" if steady else unsteady)


def _ms(seconds: float) -> str:
    return rounded(1e3 * seconds)
