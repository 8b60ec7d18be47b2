"""The common interface of SDO transfers that take more than one request."""

from abc import ABC, abstractmethod

from haptic_fieldbus.sim.drive.dictionary import Entry

Response = list[bytes]
"""Frames that the server sends, eight octets each."""


class Transfer(ABC):
    """A transfer of the content of an entry; `finished` is True when no further request is expected."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry
        self.finished = False

    @abstractmethod
    def takes(self, command: int) -> bool:
        """Return whether a request with this first octet continues the transfer."""

    @abstractmethod
    def request(self, data: bytes) -> Response:
        """Handle one request of the transfer and return the responses; raises Refused to abort the transfer."""
