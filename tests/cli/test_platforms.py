"""The package on a system that is no POSIX: simulation, judging and Modbus TCP work, the rest is refused in a sentence.

A process of its own is made to look like Windows. What the standard library and other packages need of POSIX they have
imported before; a module of our package that imports what Windows lacks, or takes such a name of `os`, `signal`,
`socket` or `select`, fails.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.peers.hosts import STARTS_WITHIN, line_of

AS_ON_WINDOWS = """
import asyncio, builtins, ctypes, multiprocessing, os, platform, selectors, shutil, signal, select, socket
import subprocess, sys, tempfile, can, can.interfaces.socketcan, canopen, serial, pymodbus.server, pymodbus.client
import matplotlib.pyplot, nicegui.ui, numpy, pytest, rich.console, typer, uvicorn

REFUSED = {"termios", "fcntl", "resource", "grp", "pwd", "pty", "tty", "syslog", "posix", "crypt", "curses"}
real_import = builtins.__import__

def windows_import(name, globals=None, *rest, **named):
    importer = (globals or {}).get("__name__", "")
    if name.partition(".")[0] in REFUSED and importer.startswith("haptic_fieldbus"):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return real_import(name, globals, *rest, **named)

builtins.__import__ = windows_import
platform.system, sys.platform = lambda: "Windows", "win32"
GONE = {
    os: "fork forkpty openpty ttyname getuid geteuid getgid getegid mkfifo mknod fchmod fchown chown lchown killpg "
        "setsid getpgid setpgid pidfd_open statvfs getloadavg nice major minor uname ctermid sync O_CLOEXEC O_NONBLOCK "
        "O_NOCTTY O_DIRECTORY O_SYNC sched_yield set_blocking",
    signal: "SIGHUP SIGALRM SIGKILL SIGQUIT SIGUSR1 SIGUSR2 SIGTSTP SIGCONT SIGPIPE setitimer alarm pthread_sigmask",
    socket: "AF_CAN PF_CAN MSG_DONTWAIT SO_REUSEPORT",
    select: "poll POLLIN POLLOUT POLLERR POLLHUP",
}
for module, names in GONE.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
for module, start in ((os, "sched_"), (os, "SCHED_"), (socket, "CAN_"), (socket, "SOL_CAN")):
    for name in [name for name in dir(module) if name.startswith(start)]:
        delattr(module, name)
"""
EVERY_MODULE = """
import importlib, pkgutil, haptic_fieldbus
failed = {}
for found in pkgutil.walk_packages(haptic_fieldbus.__path__, "haptic_fieldbus."):
    try:
        importlib.import_module(found.name)
    except Exception as error:
        failed[found.name] = repr(error)
print(failed)
"""
COMMANDS = """
import contextlib, io, json
from haptic_fieldbus.cli import main
told = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words)
        except SystemExit as ended:
            told.append([words, ended.code, out.getvalue(), err.getvalue()])
print(json.dumps(told))
"""


def on_windows(program: str, *arguments: str) -> str:
    words = [sys.executable, "-c", AS_ON_WINDOWS + program, *arguments]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def commands(*lines: Sequence[str]) -> list[tuple[list[str], int, str, str]]:
    told: list[Any] = json.loads(on_windows(COMMANDS, json.dumps(lines)))
    return [(words, status, out, err) for words, status, out, err in told]


def test_every_module_can_be_imported() -> None:
    assert on_windows(EVERY_MODULE) == "{}\n"


@pytest.mark.thorough("commands one after another")
def test_simulation_and_planning_work() -> None:
    lines = ("run wall --duration 0.2", "run wall --bus sim-modbus-tcp --duration 0.2", "plan damped_wall", "scan")
    for words, status, out, err in commands(*map(str.split, lines)):
        assert status == 0, (words, out, err)


@pytest.mark.thorough("a dozen commands one after another")
def test_recording_judging_and_the_report_work(tmp_path: Path) -> None:
    lines = (
        f"run wall --duration 0.2 --record {tmp_path / 'run.csv'} --json",
        "run wall --bus sim-modbus-rtu@115200 --set wall.stiffness=max/2 --duration 0.2",
        "stability wall",
        "response sprung_mass",
        f"report --quick --only wall-in-hand --out {tmp_path / 'report'}",
        "profiles check maxon_epos4",
        "scenes list",
    )
    for words, status, out, err in commands(*map(str.split, lines)):
        assert status == 0, (words, out, err)


REFUSALS = {
    "run wall --bus socketcan:can0 --yes --force": (1, "cannot open socketcan:can0"),
    "scan --bus socketcan:can0": (1, "cannot open socketcan:can0"),
    "run wall --bus modbus-rtu:COM3@115200 --yes --force": (2, "serial lines work under Linux and macOS only"),
    "simulate --bus modbus-rtu:pty --drive simplex_motion": (2, "serial lines work under Linux and macOS only"),
    "simulate --bus socketcan:vcan0": (1, "cannot open socketcan:vcan0"),
    f"vcan --guest -- {sys.executable} --version": (125, "User-Mode Linux needs Linux on x86"),
}


@pytest.mark.thorough("commands one after another")
def test_what_does_not_work_is_refused_in_a_sentence() -> None:
    for words, status, _, err in commands(*map(str.split, REFUSALS)):
        expected, sentence = REFUSALS[" ".join(words)]
        assert (status, sentence in err) == (expected, True), (words, err)


ONE_COMMAND = """
from haptic_fieldbus.cli import main
main()
"""


def started(*words: str) -> "subprocess.Popen[str]":
    program = [sys.executable, "-c", AS_ON_WINDOWS + ONE_COMMAND, *words]
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.thorough("two processes in real time")
def test_a_run_over_real_modbus_tcp_works(tmp_path: Path) -> None:
    """A busy machine may end it by a trip; what it must not do is to miss a part of the system."""
    rig, rows = tmp_path / "rig.toml", tmp_path / "run.csv"
    hosting = started("simulate", "--bus", "modbus-tcp:127.0.0.1:0", "--write-rig", str(rig))
    try:
        line_of(hosting)
        words = ("--set", "wall.stiffness=max/2", "--rate", "100", "--duration", "1", "--yes", "--record", str(rows))
        run = started("run", "wall", "--rig", str(rig), *words)
        out, err = run.communicate(timeout=STARTS_WITHIN)
        assert run.returncode in (0, 1, 3), err
        assert "Traceback" not in err
        assert "result" in out
        assert rows.read_text().startswith("t_ns,")
        hosting.send_signal(signal.SIGINT)
        assert hosting.wait(STARTS_WITHIN) == 0
    finally:
        hosting.kill()
        hosting.communicate()
