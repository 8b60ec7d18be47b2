"""What all SDO transfers that take more than one request have in common."""

from abc import ABC, abstractmethod

from haptic_fieldbus.sim.drive.dictionary import Entry

Response = list[bytes]
"""Frames that the server sends, eight octets each."""


class Transfer(ABC):
    """A transfer under way, of the content of an entry; `finished`: nothing more is expected of the client."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry
        self.finished = False

    @abstractmethod
    def takes(self, command: int) -> bool:
        """Whether a request with this first octet continues the transfer."""

    @abstractmethod
    def request(self, data: bytes) -> Response:
        """One request of it; Refused ends it."""
