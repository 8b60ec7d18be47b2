"""The option `--plot`: checked before anything is done, drawn after it."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from haptic_fieldbus.cli.options import OUTPUT, option
from haptic_fieldbus.errors import UsageError

PlotOption = Annotated[Path | None, option("PATH", "A picture: .png, .svg or .pdf.", OUTPUT)]


def check_plot(path: Path | None) -> None:
    """Before anything moves: where the picture goes, and that it can be drawn."""
    from haptic_fieldbus.planning.request import PLOT_SUFFIXES, file_faults

    wrong = file_faults("plot", path, PLOT_SUFFIXES)
    if path is not None and find_spec("matplotlib") is None:
        wrong.append("--plot needs matplotlib: pip install matplotlib")
    if wrong:
        raise UsageError("\n".join(wrong))


def draw(path: Path, plot: Callable[[Path], None]) -> None:
    """Raises UsageError when the file cannot be written."""
    try:
        plot(path)
    except OSError as error:
        raise UsageError(f'plot "{path}": {error.strerror}') from error
