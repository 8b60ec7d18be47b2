"""Common part of `profiles check` and `scenes check`."""

from collections.abc import Callable, Iterator, Sequence

import typer

from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.errors import DocumentError, Fault, UsageError

FAULTY = 2
"""Exit status when any file has a fault."""


def check_files(names: Sequence[str], load: Callable[[str], object], as_json: bool) -> None:
    """Load each file and print the faults of all of them, as lines or as one JSON object.

    Raises `typer.Exit` with status 2 when any file has a fault.
    """
    found = {name: list(_faults(name, load)) for name in names}
    if as_json:
        errors = [
            {"source": source, "key": fault.key or None, "line": fault.line, "message": fault.message}
            for faults in found.values()
            for source, fault in faults
        ]
        print_json({"errors": plain(errors)})
    else:
        for name, faults in found.items():
            show((None, f"{source}: {fault}") for source, fault in faults)
            if not faults:
                show([(None, f"{name}: no fault")])
    if any(found.values()):
        raise typer.Exit(FAULTY)


def _faults(name: str, load: Callable[[str], object]) -> Iterator[tuple[str, Fault]]:
    """Yield each fault of a file with the path of that file, or with `name` when no file was found."""
    try:
        load(name)
    except DocumentError as error:
        yield from ((error.source, fault) for fault in error.faults)
    except UsageError as error:
        yield name, Fault("", str(error))
