"""Damaged files for every reader: each gives a value or a list of faults, soon and in little memory."""

import resource
from collections.abc import Callable, Mapping
from functools import cache
from math import sin
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import process_time

from haptic_fieldbus.documents.samples import read_samples
from haptic_fieldbus.eds import eds_text, load_eds
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig, profile_folder, profile_names
from haptic_fieldbus.scenes import library
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.sim.canopen.simulated_eds import sheet
from haptic_fieldbus.sim.faults import load_faults, toml_of
from haptic_fieldbus.sim.faults.drawing import drawn
from tests.builders import shipped

LONGEST = 10.0
"""[s] that any file may take."""
MEMORY = 3 << 30
"""[octets] of a process that reads."""
VENDOR_SIZE = 200_000
"""[octets]; files of vendors have 50 to 500 KB."""
MOST_CHANGES = 8
TOKENS = (
    "0", "-1", "1e308", "-1e-308", "nan", "inf", "0xFFFFFFFF", "99999999999999999999", '""', "[]", "{}", "true", "=",
    "[[", "]]", "[", "]", '"', "'''", "#", "\\", "\0", "\ufeff", "é", "$NODEID+0x600", "../../etc/passwd", "/dev/zero",
    "\r",
)  # fmt: skip
RIG = """[bus.bench]
interface = "socketcan"
channel = "can0"
bitrate = 1000000

[axis.handle]
bus = "bench"
node = 5
profile = "maxon_epos4"
mechanism = { kind = "linear", metres_per_revolution = 0.05 }
encoder_counts_per_revolution = 4096
rated_torque = 0.4
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3

[axis.handle.limits]
effort = 20.0
speed = 2.0
"""

Read = Callable[[Path], object]


@cache
def _scene_texts() -> tuple[str, ...]:
    return tuple(path.read_text() for path in sorted(Path(library.__path__[0]).glob("*.toml")))


@cache
def _profile_texts() -> tuple[str, ...]:
    return tuple((profile_folder() / f"{name}.toml").read_text() for name in profile_names())


@cache
def _eds_texts() -> tuple[str, ...]:
    return tuple(eds_text(sheet(canopen_profile(load_profile(name)))) for name in shipped())


def _eds(path: Path) -> object:
    return (load_eds(path), load_profile(path))


@cache
def _recordings() -> tuple[str, ...]:
    """Record of a run about an axis, as `estimate` and `response` read it, and with the columns of a whole row."""
    rows = [(0.001 * number, 0.03 * sin(0.02 * number)) for number in range(200)]
    narrow = "".join(f"{time:.3f},{position:.9f}\n" for time, position in rows)
    wide = "".join(f"{time:.3f},39,{position:.9f},-{position:.6f}\n" for time, position in rows)
    return ("time,position\n" + narrow, "time,velocity\n" + narrow, "time,statusword,position,force\n" + wide)


def _samples(path: Path) -> object:
    return read_samples(path, ("position", "velocity"))


READERS: Mapping[str, tuple[str, Callable[[], tuple[str, ...]], Read]] = {
    "scene": (".toml", _scene_texts, load_scene),
    "rig": (".toml", lambda: (RIG,), load_rig),
    "profile": (".toml", _profile_texts, load_profile),
    "faults": (".toml", lambda: tuple(toml_of(drawn(seed, 10.0)) for seed in range(40)), load_faults),
    "eds": (".eds", _eds_texts, _eds),
    "recording": (".csv", _recordings, _samples),
}
"""Suffix, sound texts and function of each reader."""


def damaged(random: Random, text: str) -> bytes:
    """A text with a few changes: octets, lines or values otherwise, gone, or twice."""
    data = text.encode()
    for _ in range(random.randint(1, MOST_CHANGES)):
        data = random.choice((_octet, _cut, _lines, _token, _value, _value))(random, data)
    return data


def enlarged(random: Random, text: str) -> bytes:
    """A damaged text that is repeated until it has the size of a vendor's file."""
    data = damaged(random, text)
    while len(data) < VENDOR_SIZE:
        data += b"\n" + (damaged(random, text) if random.random() < 0.2 else text.encode())
    return data


def _octet(random: Random, data: bytes) -> bytes:
    place = random.randrange(len(data) + 1)
    return data[:place] + random.randbytes(1) + data[place + 1 :]


def _cut(random: Random, data: bytes) -> bytes:
    first, last = sorted(random.randrange(len(data) + 1) for _ in range(2))
    return data[:first] + data[last if random.random() < 0.5 else min(last, first + 20) :]


def _lines(random: Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    place, other = random.randrange(len(lines)), random.randrange(len(lines))
    if random.random() < 0.5:
        lines[place], lines[other] = lines[other], lines[place]
    else:
        lines.insert(place, lines[other])
    return b"\n".join(lines)


def _token(random: Random, data: bytes) -> bytes:
    place = random.randrange(len(data) + 1)
    return data[:place] + random.choice(TOKENS).encode() * random.choice((1, 1, 1, 50)) + data[place:]


def _value(random: Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    place = random.randrange(len(lines))
    key, equals, _ = lines[place].partition(b"=")
    if equals:
        lines[place] = key + b"= " + random.choice(TOKENS).encode()
    return b"\n".join(lines)


def bounded() -> None:
    """Let this process take no more memory than a reader may."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


def into_reader(name: str, seed: int, count: int, *, large: bool) -> list[str]:
    """Give damaged files to a reader; return what is wrong."""
    suffix, texts, read = READERS[name]
    random, wrong = Random(f"{name}/{seed}/{large}"), list[str]()
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"x{suffix}"
        for number in range(count):
            text = random.choice(texts())
            data = enlarged(random, text) if large else damaged(random, text)
            path.write_bytes(data)
            begun = process_time()
            try:
                read(path)
            except HapticFieldbusError:
                pass
            except BaseException as crash:
                if isinstance(crash, KeyboardInterrupt):
                    raise
                wrong.append(f"{name}, seed {seed}, file {number}: {type(crash).__name__}: {str(crash)[:200]}")
            if process_time() - begun > LONGEST:
                wrong.append(f"{name}, seed {seed}, file {number}: {process_time() - begun:.1f} s")
    return wrong
