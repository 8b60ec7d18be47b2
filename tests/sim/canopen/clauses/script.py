"""A clause of a standard and the conversation that shows it; how a conversation is carried out.

One step a line:

    > 605 40 00 10 00 00 00 00 00   the master sends this frame; `?` two digits of which it does not matter
    ? 705                           the master sends a remote frame
    wait 50                         [ms] pass
    w 1017:00 u16 10 = ok           SDO download, expedited; or = the abort code
    r 1017:00 = u16 10              SDO upload, expedited; or = the abort code
    error 2310                      the drive detects an error
    < 705 7f                        the drive has sent this frame

After each step the drive must have sent exactly the frames of the `<` lines that follow it, no more and no others.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from haptic_fieldbus.sim.canopen.link import Frame
from tests.sim.bench import MS, NODE, DriveBench

FORMATS = {"u8": "<B", "i8": "<b", "u16": "<H", "i16": "<h", "u32": "<I", "i32": "<i"}


@dataclass(frozen=True)
class Clause:
    """Where it stands, what it says, the conversation."""

    place: str
    says: str
    script: str

    def __str__(self) -> str:
        return f"{self.place}: {self.says}"


def steps(script: str) -> Iterator[tuple[str, list[str]]]:
    """Each step and the frames that must follow it."""
    lines = [line.partition("#")[0].strip() for line in script.splitlines()]
    step, expected = "", list[str]()
    for line in filter(None, lines):
        if line.startswith("<"):
            expected.append(line[1:].strip())
        else:
            if step:
                yield step, expected
            step, expected = line, []
    yield step, expected


def play(clause: Clause, bench: DriveBench) -> None:
    """Carry the conversation out; AssertionError with the step that went another way."""
    for step, expected in steps(clause.script):
        bench.sent.clear()
        expected = [*take(bench, step), *expected]
        sent = [f"{frame.can_id:03x} {frame.data.hex(' ')}".strip() for _, frame in bench.sent]
        assert len(sent) == len(expected), f"{step}\n  sent {sent}\n  expected {expected}"
        for actual, wanted in zip(sent, expected, strict=True):
            assert matches(actual, wanted), f"{step}\n  sent {sent}\n  expected {expected}"


def matches(actual: str, wanted: str) -> bool:
    return len(actual) == len(wanted) and all(w in ("?", a) for a, w in zip(actual, wanted, strict=True))


def take(bench: DriveBench, step: str) -> list[str]:
    """Do one step; the frames that it says itself must follow."""
    word, *rest = step.split()
    if word == ">":
        bench.slave.receive(Frame(int(rest[0], 16), bytes.fromhex("".join(rest[1:]))), bench.t_ns)
    elif word == "?":
        bench.slave.receive(Frame(int(rest[0], 16), bytes(int(rest[1]) if rest[1:] else 0), remote=True), bench.t_ns)
    elif word == "wait":
        bench.run(round(float(rest[0]) * MS))
    elif word == "error":
        bench.slave.error(int(rest[0], 16), bench.t_ns)
    elif word in ("w", "r"):
        return sdo(bench, word, rest)
    else:
        raise ValueError(step)
    return []


def sdo(bench: DriveBench, word: str, rest: list[str]) -> list[str]:
    """An expedited transfer; returns its response."""
    index, subindex = (int(part, 16) for part in rest[0].split(":"))
    where = struct.pack("<HB", index, subindex)
    after = rest[rest.index("=") + 1 :]
    if word == "w":
        value = struct.pack(FORMATS[rest[1]], int(rest[2], 0))
        request = bytes((0x23 | (4 - len(value)) << 2,)) + where + value
        response = bytes((0x60,)) + where
    else:
        request = bytes((0x40,)) + where
        value = struct.pack(FORMATS[after[0]], int(after[1], 0)) if after[1:] else b""
        response = bytes((0x43 | (4 - len(value)) << 2,)) + where + value
    if after[0] != "ok" and not after[1:]:
        response = bytes((0x80,)) + where + struct.pack("<I", int(after[0], 16))
    bench.give(0x600 + NODE, request.ljust(8, b"\0"))
    return [f"{0x580 + NODE:03x} {response.ljust(8, bytes(1)).hex(' ')}"]
