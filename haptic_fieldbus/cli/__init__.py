"""Command line: a thin layer over the Python API.

Modules of the package are imported inside the commands, so that each command loads only the modules that it needs.
"""

import os
import sys
from collections.abc import Sequence

from haptic_fieldbus.cli.app import app
from haptic_fieldbus.cli.failures import tell
from haptic_fieldbus.errors import HapticFieldbusError


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, or those of the process, and exit with its status.

    Raises SystemExit always; errors of the package are printed and become exit statuses, other errors pass.
    """
    # Before numpy is imported, which reads it once: matrices are tiny, and a pool of threads only disturbs the loop.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app(args=arguments, prog_name="haptic-fieldbus")
    except HapticFieldbusError as error:
        sys.exit(tell(error))
