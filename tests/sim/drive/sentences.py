"""A small language for the clauses of CiA 402-2: a row is a sentence of the standard and the steps that show it.

Steps are SDO accesses, time and what happens to the hardware; nothing looks inside the drive. The bench has a shaft
without friction, so that ramps are those of the closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import pytest

from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import MS, DriveBench, Refusal, axis

Step = Callable[[DriveBench], None]
SIGNS = {"b": 8, "h": 16, "i": 32}
CODES = {
    0x6007: "h", 0x605A: "h", 0x605B: "h", 0x605C: "h", 0x605D: "h", 0x605E: "h", 0x6040: "H", 0x6060: "b",
    0x6065: "I", 0x6066: "H", 0x6067: "I", 0x6068: "H", 0x606D: "H", 0x606E: "H", 0x606F: "H", 0x6070: "H",
    0x6071: "h", 0x6072: "H", 0x6073: "H", 0x607A: "i", 0x607C: "i", 0x607E: "B", 0x607F: "I", 0x6080: "I",
    0x6081: "I", 0x6083: "I", 0x6084: "I", 0x6085: "I", 0x6086: "h", 0x6087: "I", 0x6088: "h", 0x608F: "I",
    0x6091: "I", 0x6092: "I", 0x6098: "b", 0x6099: "I", 0x60B0: "i", 0x60B1: "i", 0x60B2: "h", 0x60C2: "B",
    0x60E0: "H", 0x60E1: "H", 0x60FF: "i", 0x6061: "b", 0x6062: "i", 0x6064: "i", 0x606B: "i", 0x606C: "i",
    0x6074: "h", 0x6077: "h", 0x6078: "h", 0x60F4: "i", 0x60FD: "I", 0x603F: "H", 0x6041: "H", 0x6075: "I",
    0x6502: "I",
}  # fmt: skip
"""Data types of the objects, by their characters in `struct`."""
SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, RESET, HALT = 0x06, 0x07, 0x0F, 0x00, 0x02, 0x80, 0x10F

INERTIA, COUNTS, RATED = 4e-5, 4096, 0.4
SPEED = 60.0
"""[rad/s]; what a turning shaft turns at."""
SPEED_COUNTS = SPEED * COUNTS / 6.283185307179586


@dataclass(frozen=True)
class Clause:
    """A sentence, and the steps that show it."""

    sentence: str
    steps: tuple[Step, ...]
    settings: DriveSettings = DriveSettings()  # noqa: RUF009 - frozen
    hand: str = "none"

    def show(self) -> None:
        run_clause(self)


def clause(sentence: str, *steps: Step, **settings: object) -> Clause:
    return Clause(sentence, steps, DriveSettings(**settings))  # type: ignore[arg-type]


def turning(sentence: str, *steps: Step, **settings: object) -> Clause:
    """The shaft turns at `SPEED` from power-on."""
    return clause(sentence, *steps, velocity=SPEED, **settings)


def run_clause(row: Clause) -> None:
    bench = DriveBench(
        drive_axis=axis(coulomb_friction=0.0, viscous_damping=0.0, inertia=INERTIA), settings=row.settings
    )
    for number, step in enumerate(row.steps):
        try:
            step(bench)
        except AssertionError as error:
            raise AssertionError(f"step {number}: {error}") from error


Row = TypeVar("Row")


def table(rows: list[Clause]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("row", rows, ids=[row.sentence for row in rows])


def read(bench: DriveBench, index: int, subindex: int = 0) -> int:
    value = bench.read(index, subindex)
    assert isinstance(value, int), f"{index:04X}h: {value}"
    bits = SIGNS.get(CODES[index])
    return value - (1 << bits) if bits is not None and value >> bits - 1 else value


# Steps.


def write(index: int, value: int, subindex: int = 0, code: str | None = None) -> Step:
    def step(bench: DriveBench) -> None:
        answer = bench.write(index, subindex, value, code or CODES[index])
        assert answer is None, f"{index:04X}h := {value} is refused: {answer}"

    return step


def refused(index: int, value: int, abort: int, subindex: int = 0, code: str | None = None) -> Step:
    def step(bench: DriveBench) -> None:
        assert bench.write(index, subindex, value, code or CODES[index]) == Refusal(abort)

    return step


def absent(*indices: int) -> Step:
    def step(bench: DriveBench) -> None:
        for index in indices:
            assert bench.read(index) == Refusal(0x0602_0000), f"{index:04X}h"

    return step


def control(*words: int) -> Step:
    def step(bench: DriveBench) -> None:
        for word in words:
            assert bench.write(0x6040, 0, word, "H") is None

    return step


def mode(number: int) -> Step:
    return write(0x6060, number)


def enabled(number: int) -> Step:
    """Operation enabled in a mode."""

    def step(bench: DriveBench) -> None:
        mode(number)(bench)
        control(SHUTDOWN, SWITCH_ON, ENABLE)(bench)

    return step


def run(milliseconds: float) -> Step:
    return lambda bench: bench.run(round(milliseconds * MS))


def fault(code: int = 0x2310) -> Step:
    return lambda bench: bench.drive.fault(code, bench.t_ns)


def sto(open_: bool) -> Step:
    return lambda bench: bench.drive.sto(open_, bench.t_ns)


def nmt(command: int) -> Step:
    return lambda bench: bench.nmt(command)


def inputs(bits: int) -> Step:
    return lambda bench: bench.drive.inputs(bits)


# What is seen.

STATES = {
    "not ready to switch on": (0x4F, 0x00),
    "switch on disabled": (0x4F, 0x40),
    "ready to switch on": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault reaction active": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}
"""CiA 402-2, state coding of the statusword: mask, value."""


def state(name: str) -> Step:
    mask, value = STATES[name]

    def step(bench: DriveBench) -> None:
        word = bench.drive.objects.statusword.value  # stopped nodes answer no SDO
        found = [other for other, (m, v) in STATES.items() if word & m == v]
        assert word & mask == value, f"expected {name}, is {found}"

    return step


def bits(mask: int, value: int) -> Step:
    """Bits of the statusword."""

    def step(bench: DriveBench) -> None:
        word = read(bench, 0x6041)
        assert word & mask == value, f"statusword {word:04X}h, bits {mask:04X}h: expected {value:04X}h"

    return step


def shows(index: int, value: float, tolerance: float = 0.0, subindex: int = 0) -> Step:
    def step(bench: DriveBench) -> None:
        found = read(bench, index, subindex)
        assert abs(found - value) <= tolerance, f"{index:04X}h is {found}, not {value} ± {tolerance}"

    return step


def emergency(code: int) -> Step:
    """An emergency message with this code has been sent since the last SDO."""

    def step(bench: DriveBench) -> None:
        codes = [int.from_bytes(frame.data[:2], "little") for _, frame in bench.sent if frame.can_id == 0x85]
        assert code in codes, f"{[f'{seen:04X}h' for seen in codes]}"

    return step
