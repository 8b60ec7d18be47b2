"""The LSS slave: setting of node-ID and bit timing over the bus.

Theory (CiA 305): an LSS slave *waits* until it is switched to *configuration*, either together with all others or alone
by its address: vendor-ID, product code, revision number and serial number of 1018h. Only in *configuration* does it
accept a new node-ID or bit timing. These are *pending* until communication is reset; *store* keeps them for the next
power-on. Node-ID FFh means that the node has none: its NMT state machine waits in *initialising*, and fastscan finds
its address bit by bit. Requests and responses have eight octets.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

REQUEST_ID = 0x7E5
RESPONSE_ID = 0x7E4
UNCONFIGURED = 0xFF
_OCTETS = 8
_LAST_NODE = 127

# CiA 305, standard bit timing table 0 [bit/s]; 5 is reserved, 9 (automatic) is not offered.
BIT_RATES = {0: 1_000_000, 1: 800_000, 2: 500_000, 3: 250_000, 4: 125_000, 6: 50_000, 7: 20_000, 8: 10_000}

_SWITCH_GLOBAL = 0x04
_SELECTED, _IDENTIFIED, _NOT_CONFIGURED = 0x44, 0x4F, 0x50
_SELECT, _IDENTIFY, _INQUIRE = range(0x40, 0x44), range(0x46, 0x4C), range(0x5A, 0x5E)
_IDENTIFY_NOT_CONFIGURED, _FASTSCAN = 0x4C, 0x51
_FASTSCAN_START = 0x80
_OUT_OF_RANGE = 1

Answer = tuple[int, ...] | None
"""Octets of a response before padding; None for no response."""


class LssState(Enum):
    """LSS states; the value is the mode octet of *switch state global*."""

    WAITING = 0
    CONFIGURATION = 1


@dataclass(eq=False)
class LssSlave:
    """One LSS slave; `identity` returns the four parts of its address.

    `configured` is called when a node without node-ID has received one, `activate` with the switch delay [ms].
    """

    _identity: Callable[[], list[int]]
    node: int
    bitrate: int
    """`node` and `bitrate` are pending, `active_node` is in use, `_stored_node` and `_stored_bitrate` are kept."""
    _configured: Callable[[], None]
    _activate: Callable[[int], None]
    state: LssState = LssState.WAITING
    _position: int = 0

    def __post_init__(self) -> None:
        self.active_node = self._stored_node = self.node
        self._stored_bitrate = self.bitrate
        self._heard: dict[range, list[int]] = {_SELECT: [], _IDENTIFY: []}
        """Parts of an address received so far, in the order in which a selective service sends them."""
        self._waiting: dict[int, Callable[[bytes], Answer]] = {
            **dict.fromkeys(_SELECT, self._select),
            **dict.fromkeys(_IDENTIFY, self._identify),
            _IDENTIFY_NOT_CONFIGURED: lambda _data: (_NOT_CONFIGURED,) if self._is_unconfigured else None,
            _FASTSCAN: self._fastscan,
        }

    def request(self, data: bytes) -> bytes | None:
        """Return the response to a request of eight octets; None when there is none."""
        if len(data) != _OCTETS:
            return None
        if data[0] == _SWITCH_GLOBAL:
            self._switch(data[1])
            return None
        service = self._waiting.get(data[0]) if self.state is LssState.WAITING else self._configure
        answer = service(data) if service is not None else None
        return None if answer is None else bytes(answer).ljust(_OCTETS, b"\0")

    def reset(self, *, power_on: bool) -> None:
        """Make the pending values active; at power-on the stored ones become pending first."""
        if power_on:
            self.node, self.bitrate = self._stored_node, self._stored_bitrate
        self.active_node = self.node
        self.state = LssState.WAITING
        self._forget()
        self._position = 0

    def commission(self, bitrate: int) -> None:
        """Set and store the bit rate [bit/s], as when a bench is commissioned."""
        self.bitrate = self._stored_bitrate = bitrate

    # Waiting.

    def _switch(self, mode: int) -> None:
        before = self.state
        if mode in (state.value for state in LssState):
            self.state = LssState(mode)
            self._forget()
        # CiA 305: a node without node-ID goes on to boot when it leaves *configuration* with a pending one.
        gets_one = self.active_node == UNCONFIGURED and self.node != UNCONFIGURED
        if before is LssState.CONFIGURATION and self.state is LssState.WAITING and gets_one:
            self._configured()

    def _part(self, services: range, data: bytes) -> list[int] | None:
        """Return the address received so far; None while it is incomplete or out of order."""
        heard, position = self._heard[services], data[0] - services.start
        if position == 0:
            heard.clear()
        if len(heard) != position:
            return None
        # The part must come in its turn: a repeated or skipped one breaks the address until the next first part.
        heard.append(int.from_bytes(data[1:5], "little"))
        return heard if len(heard) == len(services) else None

    def _forget(self) -> None:
        self._heard = {services: [] for services in self._heard}

    def _select(self, data: bytes) -> Answer:
        if self._part(_SELECT, data) != self._identity():
            return None
        self.state = LssState.CONFIGURATION
        return (_SELECTED,)

    def _identify(self, data: bytes) -> Answer:
        if (heard := self._part(_IDENTIFY, data)) is None:
            return None
        vendor, product, low_revision, high_revision, low_serial, high_serial = heard
        own = self._identity()
        hit = own[:2] == [vendor, product] and low_revision <= own[2] <= high_revision
        return (_IDENTIFIED,) if hit and low_serial <= own[3] <= high_serial else None

    def _fastscan(self, data: bytes) -> Answer:
        number, (bit, part, following) = int.from_bytes(data[1:5], "little"), data[5:8]
        if not self._is_unconfigured or part > 3 or following > 3:
            return None
        if bit == _FASTSCAN_START:
            self._position = 0
            return (_IDENTIFIED,)
        # Only the bits from `bit` up are compared; the lower ones are not scanned yet.
        if bit > 31 or part != self._position or (self._identity()[part] ^ number) >> bit:
            return None
        self._position = following
        # The whole address is confirmed when the master goes back to an earlier part.
        if bit == 0 and following < part:
            self.state = LssState.CONFIGURATION
        return (_IDENTIFIED,)

    @property
    def _is_unconfigured(self) -> bool:
        return self.active_node == self.node == UNCONFIGURED

    # Configuration.

    def _configure(self, data: bytes) -> Answer:
        """Serve a request in *configuration*; the answer of a setting has the error code, 0 when it is taken."""
        command = data[0]
        match command:
            case 0x11 if 1 <= data[1] <= _LAST_NODE or data[1] == UNCONFIGURED:
                self.node = data[1]
            # Table selector 0 is the standard table; no other one is offered.
            case 0x13 if data[1] == 0 and data[2] in BIT_RATES:
                self.bitrate = BIT_RATES[data[2]]
            case 0x11 | 0x13:
                return command, _OUT_OF_RANGE
            case 0x15:
                self._activate(int.from_bytes(data[1:3], "little"))
                return None
            case 0x17:
                self._stored_node, self._stored_bitrate = self.node, self.bitrate
            case 0x5E:
                return command, self.active_node
            case _:
                inquires = command in _INQUIRE
                return (
                    (command, *self._identity()[command - _INQUIRE.start].to_bytes(4, "little")) if inquires else None
                )
        return command, 0
