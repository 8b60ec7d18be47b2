"""Command line: a thin layer over the Python API.

Modules of the package are imported inside the commands, so that each command loads only the modules that it needs.
"""

import gc
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from haptic_fieldbus.cli.output import free_output
from haptic_fieldbus.running.ending import EndSignals, ended_by_signals

SIGNALLED, INTERRUPTED = 128, 130
"""Exit statuses: base to which the number of a signal is added, and the status after Ctrl-C."""
NEW_OBJECTS = 250_000
"""New objects that wait for a garbage collection: what a start imports stays. Looking for garbage in it would take a
third of a short command, most of it at the end of the process."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, or those of the process, and exit with its status.

    Raises SystemExit always; errors of the package are printed and become exit statuses, other errors pass.
    """
    # Before numpy is imported, which reads it once: matrices are tiny, and a pool of threads only disturbs the loop.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Before pydantic is imported, which else looks for plugins in all that is installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    thresholds = gc.get_threshold()
    gc.set_threshold(NEW_OBJECTS)
    with ended_by_signals() as ending, free_output(lambda: ending.leaving) as output:
        ending.last = arguments is None
        status = _status(arguments, ending)
    if output.fault is not None:
        with suppress(OSError):
            print(f"the output is not complete: {output.fault.strerror}", file=sys.stderr, flush=True)
        status = status or 1
    if arguments is None:
        gc.freeze()  # the process ends, so nothing needs to be looked through
    else:
        gc.set_threshold(*thresholds)
    # CPython remembers a KeyboardInterrupt that left any `exec` of a text, such as that of a dataclass in an import. It
    # would end by SIGINT although the interrupt was caught; the next text makes it forget.
    exec("")
    sys.exit(status)


def _status(arguments: Sequence[str] | None, ending: EndSignals) -> int:
    """Return the exit status of a command; the first signal decides it for a command without fault."""
    try:
        status = _ended(arguments, ending)
        ending.hold()  # here, so that a signal before it is caught below
    except KeyboardInterrupt:
        status = INTERRUPTED
        ending.hold()
    if ending.signal is None or status not in (0, INTERRUPTED):
        return status
    print(ending.sentence, file=sys.stderr)
    return SIGNALLED + ending.signal


def _ended(arguments: Sequence[str] | None, ending: EndSignals) -> int:
    """Run a command until it and its output have ended, and return its exit status."""
    # Imported here, so that a signal meets our handlers while the command is loaded.
    from haptic_fieldbus.cli.app import application
    from haptic_fieldbus.cli.failures import TYPER_ERROR, print_object, tell
    from haptic_fieldbus.errors import HapticFieldbusError

    given = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in (given[: given.index("--")] if "--" in given else given)
    try:
        application(given)(args=arguments, prog_name="haptic-fieldbus")
        status = 0
    except HapticFieldbusError as error:
        if as_json and error.result is None:  # else `run` has printed the object of its result
            print_object(error)
        status = tell(error)
    except SystemExit as ended:
        wrong = ended.__context__  # Typer exits while it handles an error of its own
        if as_json and isinstance(wrong, TYPER_ERROR):
            print_object(wrong)
        gone = isinstance(wrong, BrokenPipeError)  # the reader of the output, who wanted no more
        status = ended.code if isinstance(ended.code, int) and not gone else 0
    with suppress(BrokenPipeError):
        sys.stdout.flush()
    return status
