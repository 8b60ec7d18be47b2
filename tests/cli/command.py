"""The command line as a test calls it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class FinalState:
    """How a command ended: exit status, standard output, standard error."""

    status: int
    out: str
    err: str


Command = Callable[..., FinalState]
