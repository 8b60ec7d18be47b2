"""One request at a time on a line: sent, waited for until a deadline, and forgotten.

A request whose answer stays away is *outstanding*: its answer may still come. What that means differs:

- On TCP the answer carries a transaction id, and nothing else gets through before it. Set-points would only queue up,
  to be obeyed one after another when they are old; and a server with Nagle's algorithm would hold the answer to a
  second request back until we acknowledge the first (`transport`). So nothing is sent meanwhile, except on the way to
  zero torque. After some periods the question counts as lost.
- On RTU the late answer to a request looks like the answer to the next one of the same function. The next request is
  therefore one of another function, or none: see `master`.

With a half-duplex adapter that gives back what one sends, our own octets come first, and are taken off.
"""

from collections import Counter

from haptic_fieldbus.buses.modbus.framing import Answer, DroppedOctets, FrameForm, Framing, Question
from haptic_fieldbus.buses.modbus.transport import Transport
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError

LONGEST_FRAME = 256
"""Octets of a frame of RTU."""
MOST_LATE = 16
"""Largest number of receptions after a deadline, because octets may have waited: a peer may go on sending."""
ECHO_ADVICE = "the adapter echoes sent octets: set echo = true in its table of the rig"


class Requester:
    """The requests of one line; `echo` says that the adapter returns what is sent."""

    def __init__(self, transport: Transport, clock: Clock, *, echo: bool = False) -> None:
        self.transport, self.name = transport, transport.name
        self.clock, self.echo = clock, echo
        self.silence_ns = 0
        """Silence that must separate two frames [ns]."""
        self.surprises: Counter[DroppedOctets] = Counter()
        """How often octets were dropped, and why."""
        self.unasked = self.garbled = b""
        """The latest octets that came when nothing was asked, and those that came in the place of an answer."""
        self.outstanding: FrameForm | None = None
        """The question whose answer has not come; None when the line is free."""
        self.sent_ns = self.arrived_ns = 0
        """Instants [ns] of the last request and of the last answer."""
        self.echoes = False
        """Whether octets came back as they were sent, although `echo` does not say so."""
        self._serial, self._now_ns = transport.serial, clock.now_ns
        self._framing = Framing(serial=transport.serial)
        self._gathered = b""
        self._echo = b""
        self._replaced = 0
        """Questions that were replaced by another one before they were answered."""
        self._free_ns = clock.now_ns()

    def form(self, question: Question) -> FrameForm:
        """Return the form of a question, so that it need not be encoded each time."""
        return self._framing.form(question)

    def ask(self, question: Question) -> None:
        """Send a question; raises BusError when the line is dead."""
        self.send(self.form(question))

    def send(self, form: FrameForm, values: bytes | bytearray = b"") -> None:
        """Send the request of `form`; `values` replaces the octets of its written values.

        On a serial line, octets that were received before are dropped first. TCP has transaction ids that identify late
        answers, so nothing is dropped there. Raises BusError when the line is dead.
        """
        if self._serial:
            self.keep_silence()
            dropped = self.transport.discard()
            if dropped and self.outstanding is None:  # they came when nothing was asked, or too late
                self.unasked = dropped[-LONGEST_FRAME:]
                self.surprises[DroppedOctets.EARLIER] += 1
        frame = self._framing.fill(form, values)
        self._gathered, self._echo = b"", bytes(frame) if self._serial else b""
        self._replaced += self.outstanding is not None
        self.outstanding = form
        self.sent_ns = self._now_ns()
        self.transport.send(frame)

    def answer(self, deadline_ns: int) -> Answer | None:
        """Return the answer to the outstanding question; None when it did not come by the deadline [ns].

        Raises BusError when the line is dead.
        """
        late = 0
        while self.outstanding is not None and late <= MOST_LATE:
            octets = self.transport.receive(deadline_ns)
            if not octets:
                return None
            if not (self._gathered or self._echo):
                data = self._framing.data_of(octets)
                if data is not None:  # the usual case: all of the answer at once, and nothing else
                    self.outstanding, self.arrived_ns = None, self._now_ns()
                    self._free_ns = self.arrived_ns + self.silence_ns
                    return Answer(data)
            self._gathered += octets
            answer = self._taken()
            if answer is not None:
                return answer
            late += self._now_ns() >= deadline_ns
        return None

    def _arrived(self, answer: Answer) -> Answer:
        """Free the line, and note when its answer came."""
        self.outstanding, self.arrived_ns = None, self._now_ns()
        self._free_ns = self.arrived_ns + self.silence_ns
        return answer

    def waiting(self) -> Answer | None:
        """Return an answer that has already arrived, and wait for the silence after it."""
        answer = self.answer(self.clock.now_ns())
        if answer is not None:
            self._free_ns = self.clock.now_ns()
        return answer

    def keep_silence(self) -> None:
        """Wait until the silence after the last answer is over."""
        self.clock.sleep_until(self._free_ns)

    def quiet(self, duration_ns: int) -> None:
        """Send nothing for this time [ns], and drop what comes; raises BusError when the line is dead."""
        self.forget()
        if self.listen(self.clock.now_ns() + duration_ns):
            self.surprises[DroppedOctets.EARLIER] += 1

    def listen(self, deadline_ns: int) -> bytes:
        """Return what comes until the deadline [ns] although nothing was asked; raises BusError when dead."""
        heard, late = b"", 0
        while late <= MOST_LATE and (octets := self.transport.receive(deadline_ns)):
            heard += octets
            late += self._now_ns() >= deadline_ns
        return heard

    def forget(self) -> None:
        """Give up the outstanding question."""
        self.outstanding, self._gathered = None, b""

    def _taken(self) -> Answer | None:
        """Take frames from the octets that were gathered, until one is the answer."""
        if self._echo and not self._echo_taken():
            return None
        while self._gathered:
            octets = self._gathered
            used, found = self._framing.take(octets)
            if not used:
                return None
            self._gathered = octets[used:]
            if isinstance(found, Answer):
                return self._arrived(found)
            if found is DroppedOctets.EARLIER and self._replaced:
                self._replaced -= 1  # we did not wait for it
            elif found is not None:
                self.surprises[found] += 1
                if found is DroppedOctets.GARBAGE:
                    self.garbled = octets[:used]
        return None

    def _echo_taken(self) -> bool:
        """Remove our own octets, which the adapter returned; False while they are not complete."""
        frame, gathered = self._echo, self._gathered
        if not self.echo:
            # The answer to FC6 repeats its request in full, so for that function nothing can be told.
            self.echoes = self.echoes or (gathered.startswith(frame) and frame[1] != 6)
            self._echo = b""
            return True
        if len(gathered) < len(frame) and frame.startswith(gathered):
            return False
        self._echo = b""
        if gathered.startswith(frame):
            self._gathered = gathered[len(frame) :]
        return True


def no_echo(requester: Requester) -> None:
    """Raise BusError when the adapter returns what is sent, and the rig does not say so."""
    if requester.echoes:
        raise BusError(f"{requester.name}: {ECHO_ADVICE}")
