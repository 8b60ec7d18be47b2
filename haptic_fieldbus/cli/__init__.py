"""The command line: a thin caller of the Python API.

Modules of the package are imported inside the commands, so that each command loads only what it needs.
"""

import os
import sys
from collections.abc import Sequence

from haptic_fieldbus.cli.app import app
from haptic_fieldbus.cli.failures import tell
from haptic_fieldbus.errors import HapticFieldbusError


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its status."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are tiny; a pool of threads only disturbs the loop
    try:
        app(args=arguments, prog_name="haptic-fieldbus")
    except HapticFieldbusError as error:
        sys.exit(tell(error))
