"""What turns at the motor shaft, seen from the drive and from the hand; `plant` and `loaded_plant` move it.

Everything at the motor shaft, SI; `t_ns` is the body's own time.
"""

from abc import ABC, abstractmethod
from collections import deque

from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics.motion import ANGLE, FORCE, SPEED, STRETCH, TARGET, TORQUE, State
from haptic_fieldbus.sim.mechanics.trajectory import Recorder


class Body(ABC):
    """A shaft, perhaps held by a hand; moves when told to."""

    t_ns: int
    state: State
    """Begins with the nine of `motion`."""
    recorder: Recorder
    _grip: Grip | None

    def __init__(self, t_ns: int, state: State, recorded: int) -> None:
        """`recorded`: how many states are kept of each segment."""
        self.t_ns = t_ns
        self.state = state
        self.recorder = Recorder(recorded)
        self._agenda: deque[tuple[int, Piece | None]] = deque()

    @property
    def position(self) -> float:
        """Shaft angle [rad]."""
        return self.state[ANGLE]

    @property
    def velocity(self) -> float:
        """[rad/s]"""
        return self.state[SPEED]

    @property
    def torque(self) -> float:
        """Motor torque after the torque loop [N·m]."""
        return self.state[TORQUE]

    def set_target(self, torque: float) -> None:
        """What the torque loop follows from now on [N·m]."""
        self.recorder.target(self.t_ns, torque)
        if torque != self.state[TARGET]:
            self._continue((*self.state[:TARGET], torque, *self.state[TARGET + 1 :]))

    def start_hand(self) -> None:
        """The hand's clock starts now."""
        if self._grip is not None:
            self._agenda.extend((self.t_ns + round(piece.start * 1e9), piece) for piece in self._grip.pieces)
            if self._grip.release is not None:
                self._agenda.append((self.t_ns + round(self._grip.release * 1e9), None))
            self.advance(self.t_ns)

    def advance(self, t_ns: int) -> None:
        """Move to `t_ns`, which is not before the body's own time."""
        while self._agenda and self._agenda[0][0] <= t_ns:
            at_ns, piece = self._agenda.popleft()
            self._move(at_ns)
            self._begin(piece)
        self._move(t_ns)

    def _begin(self, piece: Piece | None) -> None:
        """A new piece of the hand's force, or (None) the hand lets go."""
        if piece is not None:
            self._continue((*self.state[:FORCE], piece.force, piece.slope, *self.state[TARGET:]))
        else:
            self.state = (*self.state[:STRETCH], 0.0, 0.0, 0.0, 0.0, *self.state[TARGET:])
            self._hold(None)

    @abstractmethod
    def _hold(self, grip: Grip | None) -> None:
        """The modes of motion with this hand, or with none."""

    @abstractmethod
    def _continue(self, state: State) -> None:
        """Go on from here in the same mode, with another target or another force of the hand."""

    @abstractmethod
    def _move(self, t_ns: int) -> None:
        """Move to `t_ns`; nothing changes from outside until then."""
