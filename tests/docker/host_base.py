"""Base image made from this machine's own files, for machines that reach no registry of images.

It holds this Python, the programs that the Dockerfile and compose.yaml call, and the libraries that these load: no more
than python:3.13-slim promises to them.
"""

import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

PROGRAMS = (
    "sh", "cat", "env", "find", "grep", "install", "ls", "mkfifo", "mkdir", "rm", "sleep", "tee", "test", "useradd",
)  # fmt: skip
PROMISED = ("libdl.so.2", "libgcc_s.so.1", "libpthread.so.0", "librt.so.1", "libstdc++.so.6", "libutil.so.1")
"""Libraries that wheels of Linux expect everywhere (PEP 600)."""
OMITTED = ("site-packages", "dist-packages", "test", "idlelib", "tkinter", "config-*", "__pycache__")
"""Of the standard library."""
ACCOUNTS = {
    "etc/passwd": "root:x:0:0:root:/root:/bin/sh\n",
    "etc/group": "root:x:0:\n",
    "etc/shadow": "root:*:19000:0:99999:7:::\n",
    "etc/gshadow": "root:*::\n",
    "etc/login.defs": "UID_MIN 1000\nUID_MAX 60000\nGID_MIN 1000\nGID_MAX 60000\n",
}


def lay_out(root: Path) -> None:
    """Write the file system of the image."""
    for folder in ("bin", "tmp", "root", "home", "usr/local/bin", "usr/local/lib", "proc", "sys", "dev"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    (root / "tmp").chmod(0o1777)
    for name, text in ACCOUNTS.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(text)
    programs = [Path(found) for name in PROGRAMS if (found := shutil.which(name)) is not None]
    for program in programs:
        shutil.copy2(program, root / "bin" / program.name)
    python = _copy_python(root)
    promised = [path for path in _known_to_the_loader() if path.name in PROMISED]
    for library in {*promised, *_libraries([*programs, *python, *promised])}:
        target = root / library.relative_to("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(library, target)


def _copy_python(root: Path) -> list[Path]:
    """Copy interpreter, standard library and pip below /usr/local; the files that may load libraries."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    interpreter = Path(sys.executable).resolve()
    library = Path(sysconfig.get_path("stdlib"))
    target = root / "usr/local/lib" / version
    shutil.copytree(library, target, ignore=shutil.ignore_patterns(*OMITTED))
    shutil.copy2(interpreter, root / "usr/local/bin" / version)
    for alias in ("python", "python3"):
        (root / "usr/local/bin" / alias).symlink_to(version)
    import pip

    shutil.copytree(Path(pip.__file__).parent, target / "site-packages" / "pip")
    return [interpreter, *library.glob("lib-dynload/*.so")]


def _known_to_the_loader() -> list[Path]:
    """Libraries in its cache; ldconfig is where root finds it."""
    shown = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=True).stdout
    return [Path(path) for path in re.findall(r"x86-64.*=> (\S+)", shown)]


def _libraries(files: Iterable[Path]) -> set[Path]:
    """Libraries that they load, as the loader names them, itself included."""
    shown = subprocess.run(["ldd", *map(str, files)], capture_output=True, text=True, check=False).stdout
    return {Path(path) for path in re.findall(r"(?:=> |^\t)(/\S+) \(0x", shown, re.MULTILINE)}
