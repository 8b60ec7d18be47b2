"""Files that nobody writes by mistake, and a process of bounded memory in which they are read."""

import json
import os
import resource
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

MEMORY = 1 << 30
"""Memory of the process [octet]; the interpreter with numpy takes a tenth."""
PATIENCE = 120.0
"""Time after which a test is given up [s]; every file takes less than a second."""

READERS = {
    "scene": "from haptic_fieldbus.scenes.catalogue import load_scene; load_scene(path('x.toml'))",
    "rig": "from haptic_fieldbus.protocols.catalogue import load_rig; load_rig(path('x.toml'))",
    "profile": "from haptic_fieldbus.protocols.catalogue import load_profile; load_profile(path('x.toml'))",
    "faults": "from haptic_fieldbus.sim.faults import load_faults; load_faults(path('x.toml'))",
    "eds": "from haptic_fieldbus.protocols.catalogue import load_profile; load_profile(path('x.eds'))",
    "dcf": "from haptic_fieldbus.eds import load_eds; load_eds(path('x.dcf'))",
    "motion": "import haptic_fieldbus as h; h.response('wall', input=path('x.csv'), duration=0.1)",
    "signal": "from haptic_fieldbus.documents.samples import *; read_samples(path('x.csv'), ('position', 'velocity'))",
}
"""All that reads a file from outside; a file of the same content stands there by each suffix."""

_CODE = """
import json, sys
from pathlib import Path
from haptic_fieldbus.errors import HapticFieldbusError

def path(name):
    return Path(sys.argv[1]) / name

said = {}
for name, code in json.loads(sys.argv[2]).items():
    try:
        exec(code)
        said[name] = None
    except HapticFieldbusError as error:
        said[name] = str(error)
print(json.dumps(said))
"""


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def said_of(folder: Path, readers: dict[str, str]) -> dict[str, str | None]:
    """The message of every reader about its file in the folder, None where the file was taken."""
    done = subprocess.run(
        [sys.executable, "-c", _CODE, str(folder), json.dumps(readers)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        preexec_fn=_bounded,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # each of its threads would reserve memory
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found: dict[str, str | None] = json.loads(done.stdout)
    return found


def _socket(path: Path) -> None:
    # Of a short relative name: the path of a socket has about 100 octets at most.
    before = Path.cwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.chdir(before)


def _text(text: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(text, encoding="utf-8")

    return write


DEVICES: dict[str, tuple[Callable[[Path], None], str]] = {
    "folder": (Path.mkdir, "it is a folder; expected a regular file"),
    "fifo": (lambda path: os.mkfifo(path), "it is a FIFO; expected a regular file"),
    "socket": (_socket, "it is a socket; expected a regular file"),
    "zero": (lambda path: path.symlink_to("/dev/zero"), "it is a device; expected a regular file"),
    "terminal": (lambda path: path.symlink_to("/dev/tty"), "cannot be read: "),
    "dangling": (lambda path: path.symlink_to("nowhere"), "o such file"),
    "circle": (lambda path: path.symlink_to(path.name), "cannot be read: Too many levels of symbolic links"),
    "long string": (_text(f'description = "{"x" * 50_000_000}"\n'), "it is too large; expected at most "),
}
"""Files that are none of a sane size: how it is made, and what every reader says of it."""

KEY = "a" + ".a" * 50_000
TOML = {
    "dotted key": (f"{KEY} = 1\n", "a key has too many parts; expected at most 32"),
    "dotted header": (f"[{KEY}]\n", "a key has too many parts; expected at most 32"),
    "quoted key": ('"a"' + '."a"' * 30_000 + " = 1\n", "a key has too many parts; expected at most 32"),
    "spaced key": ("a" + " . a" * 30_000 + " = 1\n", "a key has too many parts; expected at most 32"),
    "many long keys": (
        "".join(f"a{number}" + ".a" * 2_000 + " = 1\n" for number in range(50)),
        "a key has too many parts; expected at most 32",
    ),
    "lists": ("a = " + "[" * 100_000 + "]" * 100_000 + "\n", "nested too deeply"),
    "tables": ("a = " + "{a = " * 30_000 + "1" + "}" * 30_000 + "\n", "nested too deeply"),
    "open lists": ("a = " + "[" * 200_000, "nested too deeply"),
    "many keys": ("".join(f"k{number} = 1\n" for number in range(20_000)), "a table of 20000 members"),
    "many tables": ("[[fault]]\n" * 20_000, "a list of 20000 members"),
    "many elements": ("[[element]]\n" * 1_000, "element"),
    "long name": (f"{'k' * 200_000} = 1\n", "unknown key"),
    "digits": (f"a = 0x{'f' * 200_000}\n", "a number has too many digits"),
    "open string": ('a = "' + "\\" * 200_001, "not TOML"),
    "quotes": ('a = """' + '"" ' * 60_000, "not TOML"),
    "escaped quotes": ('a = "' + '\\"' * 100_000, "not TOML"),
    "escaped long quotes": ('a = """' + '\\"""' * 50_000, "not TOML"),
    "wrong values": ("".join(f"k{number} = {{ x = 1 }}\n" for number in range(1_000)), "the first 100 errors"),
}
"""TOML texts of a size that is read, and a part of what is said of them."""
