"""Write the tables of methods, estimators and drives from the code and the profiles: `python docs/make_tables.py`.

A table stands between two marks in a page that people write.
"""

import math
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from haptic_fieldbus.numerals import LIMIT_DIGITS, exactly, rounded
from haptic_fieldbus.numerics.estimators import ESTIMATORS, bind, chosen
from haptic_fieldbus.numerics.estimators.estimator import Parameter
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.integrators.method import Integrator
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names

CHECKOUT = Path(__file__).resolve().parent.parent
FOLDER = CHECKOUT / "docs" / "reference"
MARKED = re.compile(r"(<!-- written by make docs -->\n).*?(<!-- end -->\n)", re.DOTALL)
PERIOD = 1e-3
SETTLED = 4000
"""Periods after which an impulse response is over."""


def pages() -> dict[Path, str]:
    """The text of each page by its file, its table as the code says."""
    tables = {
        FOLDER / "methods.md": _methods(),
        FOLDER / "estimators.md": _estimators(),
        CHECKOUT / "profiles" / "README.md": _drives(),
    }
    return {file: _page(file, table) for file, table in tables.items()}


def _page(file: Path, table: Iterable[Sequence[str]]) -> str:
    rows = "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in table)
    written, count = MARKED.subn(lambda marks: f"{marks[1]}{rows}{marks[2]}", file.read_text(encoding="utf-8"))
    if count != 1:
        raise ValueError(f"{file.name}: expected one table between <!-- written by make docs --> and <!-- end -->")
    return written


def _methods() -> Iterable[Sequence[str]]:
    yield ("method", "order", "free motion", "input samples", "step", "stable oscillator: h", "stable decay: T·λ")
    yield ("---",) * 7
    yield from (_method(method) for method in METHODS.values())


def _method(method: Integrator) -> Sequence[str]:
    free = "exact" if math.isinf(method.free_order) else exactly(method.free_order)
    limits = (method.oscillator_limit, method.lag_limit)
    return (f"`{method.name}`", f"{method.order}", free, f"`{method.inputs}`", method.update, *map(_limit, limits))


def _limit(limit: float) -> str:
    return "none" if limit == 0.0 else "any" if math.isinf(limit) else rounded(limit, LIMIT_DIGITS)


def _estimators() -> Iterable[Sequence[str]]:
    yield ("name", "method", "parameters (default)", "noise gain · T", "delay / T")
    yield ("---",) * 5
    for name in ESTIMATORS:
        estimator = chosen(name).estimator
        parameters = ", ".join(map(_parameter, estimator.parameters))
        yield (f"`{name}`", estimator.summary, parameters or "–", _noise_gain(name), _delay(name))


def _parameter(parameter: Parameter) -> str:
    return f"`{parameter.key}` {parameter.meaning} ({_default(parameter)})"


def _default(parameter: Parameter) -> str:
    if parameter.default is None:
        return "one count"
    if isinstance(parameter.default, str):
        return f"`{parameter.default}`"
    return f"{exactly(parameter.default)} {parameter.unit}".rstrip()


def _noise_gain(name: str) -> str:
    """Return the norm of the impulse response of a linear estimator."""
    if chosen(name).estimator.system is None:
        return "see below"
    step = bind(name, PERIOD)
    step(0.0)
    return rounded(PERIOD * math.hypot(*(step(float(sample == 0)) for sample in range(SETTLED))))


def _delay(name: str) -> str:
    choice = chosen(name)
    delay = choice.estimator.delay
    return "see below" if delay is None else rounded(delay(choice.setup(PERIOD)) / PERIOD)


def _drives() -> Iterable[Sequence[str]]:
    """Of CANopen; the example stands for no drive."""
    yield ("profile", "drive", "mode of operation", "set-point", "drive watchdog", "echo", "evidence")
    yield ("---",) * 7
    for name in profile_names():
        profile = load_profile(name)
        if isinstance(profile, CanopenProfile) and profile.drive.vendor != "example":
            yield _drive(profile)


def _drive(profile: CanopenProfile) -> Sequence[str]:
    loss, target = profile.link_loss, profile.torque.target
    options = [f"{each.object:04X}h" for each in (loss.abort_connection_option, loss.fault_reaction_option) if each]
    guard = ["life guarding" if loss.life_guarding else "1016h", " and ".join(options) or "no option object"]
    return (
        f"`{profile.name}`",
        profile.title,
        _mode(profile.torque.mode_of_operation) if profile.drive.usable else "not usable for force",
        f"{target.object:04X}h, `{target.unit}`" if profile.drive.usable else "none",
        ", ".join(guard),
        "none" if profile.echo is None else f"{profile.entries()[profile.echo].object:04X}h",
        profile.drive.evidence,
    )


def _mode(mode: int) -> str:
    names = {4: "profile torque", 10: "cyclic synchronous torque"}
    return f"{names[mode]} ({mode})" if mode in names else f"the manufacturer's ({mode})"


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
        print(path, file=sys.stderr)
