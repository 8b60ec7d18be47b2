"""Option `--plot`: checked before a command does anything, drawn when it is done."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from haptic_fieldbus.cli.options import OUTPUT, option
from haptic_fieldbus.errors import UsageError

PlotOption = Annotated[Path | None, option("PATH", "A picture: .png, .svg or .pdf.", OUTPUT)]


def check_plot(path: Path | None) -> None:
    """Check that the picture can be drawn and its file written; call it before anything moves.

    Raises UsageError that lists all faults.
    """
    from haptic_fieldbus.planning.request import PLOT_SUFFIXES, file_faults

    wrong = file_faults("plot", path, PLOT_SUFFIXES)
    if path is not None and find_spec("matplotlib") is None:
        wrong.append("--plot needs matplotlib: pip install matplotlib")
    if wrong:
        raise UsageError("\n".join(wrong))


def draw(path: Path, plot: Callable[[Path], None]) -> None:
    """Draw a picture into a file by calling `plot`; raises UsageError when the file cannot be written."""
    try:
        plot(path)
    except OSError as error:
        raise UsageError(f'plot "{path}": {error.strerror}') from error
