"""Common part of `profiles check` and `scenes check`."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import typer

from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.errors import DocumentError, Fault, UsageError

FAULTY = 2
"""Exit status when any file has a fault."""
Told = tuple[str | None, Fault]
"""The file, or what was given as its name, or None where there is neither; and a fault of it."""


def check_files(names: Sequence[str], load: Callable[[str], object], as_json: bool) -> None:
    """Load each file and print the faults of all of them, as lines or as one JSON object.

    Raises `typer.Exit` with status 2 when any file has a fault.
    """
    found = {name: list(_faults(name, load)) for name in names}
    if as_json:
        print_json({"errors": plain(faults_to_json(told for faults in found.values() for told in faults))})
    else:
        for name, faults in found.items():
            show((None, f"{source}: {fault}") for source, fault in faults)
            if not faults:
                show([(None, f"{name}: no fault")])
    if any(found.values()):
        raise typer.Exit(FAULTY)


def _faults(name: str, load: Callable[[str], object]) -> Iterator[Told]:
    """Yield each fault of a file with the path of that file, or with `name` when no file was found."""
    try:
        load(name)
    except (DocumentError, UsageError) as error:
        yield from faults_told(name, error)


def faults_told(name: str, error: DocumentError | UsageError) -> Iterator[Told]:
    """Yield each fault of a file with its path, or the fault of a name with that name."""
    if isinstance(error, DocumentError):
        yield from ((error.source, fault) for fault in error.faults)
    else:
        yield name, Fault("", str(error))


def faults_to_json(told: Iterable[Told]) -> list[dict[str, str | int | None]]:
    """Return the faults as `--json` lists them."""
    return [
        {"source": source, "key": fault.key or None, "line": fault.line, "message": fault.message}
        for source, fault in told
    ]
