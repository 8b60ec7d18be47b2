"""Description of the machine on which the report is made."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import get_clock_info

import numpy as np

from haptic_fieldbus.numerals import exactly

PACKAGES = ("haptic-fieldbus", "numpy", "matplotlib", "python-can", "canopen")


def host_facts() -> dict[str, str]:
    """Return processor, system, clock and versions as texts by stable keys."""
    clock = get_clock_info("perf_counter")
    return {
        "processor": processor(),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        **{name: _version(name) for name in PACKAGES},
        "linear_algebra": _blas(),
        "clock": f"{clock.implementation}, resolution {exactly(clock.resolution * 1e9)} ns",
    }


def processor() -> str:
    """Return the name of the processor that the system gives, or of its architecture when there is none."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _blas() -> str:
    """Return name and version of numpy's linear algebra library."""
    known = np.show_config(mode="dicts")
    blas = known.get("Build Dependencies", {}).get("blas", {}) if isinstance(known, dict) else {}
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
