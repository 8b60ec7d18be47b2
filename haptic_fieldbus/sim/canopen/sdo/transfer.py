"""What all SDO transfers that take more than one request have in common."""

from typing import Protocol

from haptic_fieldbus.sim.canopen.dictionary import Entry

Response = list[bytes]
"""Frames that the server sends, eight octets each."""


class Transfer(Protocol):
    """A transfer under way."""

    @property
    def entry(self) -> Entry:
        """Whose content it carries."""
        ...

    @property
    def finished(self) -> bool:
        """Nothing more is expected of the client."""
        ...

    def takes(self, command: int) -> bool:
        """Whether a request with this first octet continues the transfer."""
        ...

    def request(self, data: bytes) -> Response:
        """One request of it; SdoAbort ends it."""
        ...
