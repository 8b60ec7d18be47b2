"""Conditions that must last before they count: windows and time-outs of CiA 402-2 (6066h, 6068h, 606Eh, 6070h)."""

_MS = 1_000_000


class Lasting:
    """Whether a condition has held without interruption for a time."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def restart(self) -> None:
        """As if the condition had just failed."""
        self._since_ns = None

    def __call__(self, condition: bool, t_ns: int, time_ms: int) -> bool:
        """Look at the condition now; whether it has held for `time_ms`."""
        if not condition:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        return t_ns - self._since_ns >= time_ms * _MS
