"""The motor shaft as the drive and the hand see it; `plant` and `loaded_plant` implement its motion.

All quantities are at the motor shaft, SI; `t_ns` is the body's own time.
"""

from abc import ABC, abstractmethod
from collections import deque

from haptic_fieldbus.sim.hand import LEADING_NS, Grip, Piece
from haptic_fieldbus.sim.mechanics.motion import ANGLE, FORCE, HAND_SPEED, SPEED, STRETCH, TARGET, TORQUE, State
from haptic_fieldbus.sim.mechanics.trajectory import Recorder


class Body(ABC):
    """A shaft, with or without a hand; it moves when `advance` is called."""

    t_ns: int
    state: State
    """The nine states of `motion`, in their order, then any further states."""
    recorder: Recorder
    _grip: Grip | None

    def __init__(self, t_ns: int, state: State, recorded: int) -> None:
        """Start at `t_ns`; `recorded` is the number of states kept of each segment."""
        self.t_ns = t_ns
        self.state = state
        self.recorder = Recorder(recorded)
        self._pieces: deque[tuple[int, Piece | None]] = deque()
        self._hand: Grip | None = None
        """The hand that has released the handle, or waits for *operation enabled*; None without such a hand."""
        self._leader: Grip | None = None
        """The hand that moves the handle while the drive is off; None: no hand."""
        self._guest: Grip | None = None
        """The hand that has taken the handle while it moves; None: no hand."""

    @property
    def position(self) -> float:
        """Return the shaft angle [rad]."""
        return self.state[ANGLE]

    @property
    def velocity(self) -> float:
        """Return the shaft speed [rad/s]."""
        return self.state[SPEED]

    @property
    def torque(self) -> float:
        """Return the motor torque after the torque loop [N·m]."""
        return self.state[TORQUE]

    def set_target(self, torque: float) -> None:
        """Set the target of the torque loop [N·m] from now on."""
        self.recorder.target(self.t_ns, torque)
        # A repeated target is recorded, but starts no new segment of motion.
        if torque != self.state[TARGET]:
            self._continue((*self.state[:TARGET], torque, *self.state[TARGET + 1 :]))

    def start_hand(self) -> None:
        """Start the hand's clock now, at 0; a hand that has released the handle, or has waited, grips it again."""
        self._pieces.clear()
        if self._hand is not None and self._grip is not self._hand:
            self._take(self._hand, self.velocity)
        if self._grip is not None:
            self.plan_pieces(self._grip)
            # A piece at 0 s begins at once.
            self.advance(self.t_ns)

    def rest_hand(self) -> None:
        """Stop the hand until it is started again: it still holds the handle, without a force of its own.

        The mass of a leading hand is so large that it would continue to move by itself. If another hand leads while the
        drive is off, it takes the handle and starts again.
        """
        self._pieces.clear()
        if self._leader is not None:
            if self._grip is not None and self._grip is not self._leader:
                self._hand = self._grip
            self._take(self._leader, 0.0)
            self._pieces.extend((self.t_ns + round(piece.start * 1e9), piece) for piece in self._leader.pieces)
        elif self._grip is not None and any(self.state[HAND_SPEED:TARGET]):
            self.state = (*self.state[:HAND_SPEED], 0.0, 0.0, 0.0, *self.state[TARGET:])
            self._hold(self._grip)

    def lead_when_off(self, leader: Grip) -> None:
        """Let this hand move the handle from now on while the drive is off."""
        self._leader = leader
        self.rest_hand()

    # A hand that takes the handle while it moves, led by a pointer.

    def is_held_by(self, grip: Grip) -> bool:
        """Return whether this very hand holds the handle."""
        return self._grip is grip

    def lead(self, grip: Grip, force: float) -> None:
        """Let this hand hold the handle from now on, with a force on its mass [N·m]; the one before is gone."""
        self._pieces.clear()
        if self._grip is not grip:
            self._guest = grip
            self._take(grip, self.velocity)
        self._begin(Piece(0.0, force))

    def let_go(self) -> None:
        """Let the hand go that holds the handle, if one does."""
        self._pieces.clear()
        if self._grip is not None:
            self._begin(None)

    def plan_pieces(self, grip: Grip) -> None:
        """Let the force of the hand that holds the handle follow the pieces of `grip`, its release included."""
        # A hand that has let go is gone: the pieces after that never begin.
        begins = ((piece.start, piece) for piece in grip.pieces if grip.release is None or piece.start < grip.release)
        ends = [] if grip.release is None else [(grip.release, None)]
        self._pieces.extend((self.t_ns + round(start * 1e9), piece) for start, piece in (*begins, *ends))

    @property
    def led(self) -> bool:
        """Return whether the leading hand moves the handle, as it does while the drive is off."""
        return self._leader is not None and self._grip is self._leader

    def _holder(self, grip: Grip | None) -> int:
        """Return the holder: 0 no hand, 1 the hand, 2 the hand that leads while the drive is off, 3 a guest."""
        return 0 if grip is None else 2 if grip is self._leader else 3 if grip is self._guest else 1

    @abstractmethod
    def prepare(self) -> None:
        """Prepare later steps now, for a body that is read at non-repeating intervals."""

    def advance(self, t_ns: int) -> None:
        """Move to `t_ns`, which must not be before the body's own time."""
        if t_ns - self.t_ns >= 2 * LEADING_NS and self.led:
            self._leave_out((t_ns - self.t_ns) // LEADING_NS - 1)
        pieces = self._pieces
        while pieces and pieces[0][0] <= t_ns:
            at_ns, piece = pieces.popleft()
            self._move(at_ns)
            self._begin(piece)
            if self.led:
                self._pieces.append((at_ns + LEADING_NS, piece))
        self._move(t_ns)

    def _leave_out(self, cycles: int) -> None:
        """Skip equal cycles of the leading hand after a long time without access."""
        skipped_ns = cycles * LEADING_NS
        self.t_ns += skipped_ns
        self._pieces = deque((at_ns + skipped_ns, piece) for at_ns, piece in self._pieces)
        self._continue(self.state)

    def _begin(self, piece: Piece | None) -> None:
        """Begin a new piece of the hand's force; None: the hand lets go."""
        if piece is not None:
            self._continue((*self.state[:FORCE], piece.force, piece.slope, *self.state[TARGET:]))
        else:
            self._hand = self._grip
            self._take(None, 0.0)

    def _take(self, grip: Grip | None, speed: float) -> None:
        """Let this hand hold the handle from now on, at its place and at this speed; None: no hand."""
        self.state = (*self.state[:STRETCH], 0.0, speed, 0.0, 0.0, *self.state[TARGET:])
        self._hold(grip)

    @abstractmethod
    def _hold(self, grip: Grip | None) -> None:
        """Set the modes of motion for this hand; None: no hand."""

    @abstractmethod
    def _continue(self, state: State) -> None:
        """Continue from this state in the same mode, with another target or another force of the hand."""

    @abstractmethod
    def _move(self, t_ns: int) -> None:
        """Move to `t_ns` without any change from outside."""
