"""An Iridium 9602 or 9603 modem by its AT commands, without blocking: bytes in, bytes out, time as an argument.

Source: Iridium ISU AT Command Reference, the commands of Short Burst Data.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeAlias

import msgspec
from msgspec.structs import replace

LONGEST_OUT = 340  # bytes of a message that a 9602 sends
LONGEST_IN = 270  # and receives
BAUD = 19200
_ANSWER_S = 10.0
_SIGNAL_S = 50.0  # a new measurement may take this long
_SESSION_S = 120.0
_PAUSE_S = 10.0  # before the next attempt after a failed dialogue
_LINE_BYTES = 256  # a longer line is noise
_RING = b"SBDRING"
_HANDED_OVER, _NOT_HANDED_OVER = 1, 2  # the third number of +SBDIX; 0: there is no message
_ENDINGS = (b"OK", b"ERROR", b"READY")


class ModemCommand(msgspec.Struct, frozen=True):
    """A command, or bytes, and the timeout of the reply; `content`: the reply starts with a binary message."""

    data: bytes
    timeout_s: float = _ANSWER_S
    content: bool = False


class ModemReply(msgspec.Struct, frozen=True):
    """The lines of a reply, its ending (empty after a timeout), and its binary message, None for a damaged one."""

    ending: bytes
    lines: tuple[bytes, ...] = ()
    content: bytes | None = None


class Session(msgspec.Struct, frozen=True):
    """The result of a session.

    `status` is that of the sent message: 0 to 4 for success, None if the modem gave none. `tried`: the satellite was
    called. `number` is the network's number of the received message, `content` that message, None without one.
    `damaged`: it could not be read; `length` is its length by the modem. `queued` messages remain ashore; `unread`: the
    network failed to deliver one.
    """

    tried: bool
    status: int | None = None
    number: int = 0
    length: int = 0
    content: bytes | None = None
    damaged: bool = False
    queued: int = 0
    unread: bool = False

    @property
    def sent(self) -> bool:
        """Whether the message was sent successfully."""
        return self.status is not None and 0 <= self.status <= 4


Dialogue: TypeAlias = Generator[ModemCommand, ModemReply, bool]  # returns whether the modem replied as specified


def checksum(content: bytes) -> bytes:
    """Return the sum of the bytes in two bytes, high one first."""
    return (sum(content) & 0xFFFF).to_bytes(2, "big")


class Modem:
    """The dialogue with the modem; one command at a time.

    `signal` is the latest measured, 0 to 5; `idle_since_s` is the end of the latest dialogue.
    `failing_since_s`: start of a period without valid replies, None outside one.
    """

    def __init__(self) -> None:
        """Start with an unknown modem."""
        self.imei = ""
        self.signal: int | None = None
        self.idle_since_s = 0.0
        self._rings = 0
        self.failing_since_s: float | None = None
        self._sessions: list[Session] = []
        self._dialogue: Dialogue | None = None
        self._command: ModemCommand | None = None
        self._command_s = 0.0
        self._out = b""
        self._held = b""
        self._lines: list[bytes] = []
        self._content: bytes | None = None
        self._content_read = False
        self._pause_end_s: float | None = 0.0  # when it is set up; None when that has been done

    @property
    def ready(self) -> bool:
        """Whether it is set up and idle."""
        return self._dialogue is None and self._pause_end_s is None

    @property
    def ringing(self) -> bool:
        """Whether the modem has announced a message ashore."""
        return self._rings > 0

    def restart(self) -> None:
        """Set the modem up again after the line was lost."""
        if self._dialogue is not None:
            self._dialogue.close()
        self._dialogue = self._command = None
        self._held = self._out = b""
        self._pause_end_s = 0.0

    def take_session(self) -> Session | None:
        """Return the result of the last session, once; also a message found in the modem at the start."""
        return self._sessions.pop(0) if self._sessions else None

    def measure_signal(self, now_s: float) -> None:
        """Start a signal measurement; only when ready."""
        self._begin(self._measure(), now_s)

    def begin(self, content: bytes, now_s: float) -> None:
        """Start a session that sends a message, or checks the mailbox with an empty one; only when ready."""
        self._begin(self._session(content), now_s)

    # ------------------------------------------------------------------ bytes

    def update(self, now_s: float) -> bytes:
        """Return the bytes to be written now."""
        if self._command is not None and now_s - self._command_s > self._command.timeout_s:
            self._go_on(ModemReply(b""), now_s)
        if self._dialogue is None and self._pause_end_s is not None and now_s >= self._pause_end_s:
            self._begin(self._set_up(), now_s)
        out, self._out = self._out, b""
        return out

    def feed(self, data: bytes, now_s: float) -> None:
        """Take bytes from the modem."""
        self._held += data
        while self._held:
            if self._command is not None and self._command.content and not self._content_read:
                # A modem after a reset echoes the command, and the message follows. Anything else in its place is
                # text: no message is so long that its length starts with a letter.
                self._held = self._held.removeprefix(self._command.data)
                if self._held[:1] <= bytes((LONGEST_OUT >> 8,)):
                    if not self._read_content():
                        return
                    continue
            line, end, rest = self._held.partition(b"\n")
            if not end:
                self._held = self._held[-_LINE_BYTES:]
                return
            self._held = rest
            self._take_line(line.strip(b"\r\x00 "), now_s)

    def _read_content(self) -> bool:
        """Take length, message and checksum from the received bytes; False if they are incomplete."""
        size = int.from_bytes(self._held[:2], "big")
        if len(self._held) >= 2 and size > LONGEST_OUT:
            self._content, self._content_read, self._held = None, True, b""  # not a message: out of step
            return True
        if len(self._held) < size + 4:
            return False
        content, received_sum = self._held[2 : size + 2], self._held[size + 2 : size + 4]
        self._content = content if received_sum == checksum(content) else None
        self._content_read, self._held = True, self._held[size + 4 :]
        return True

    def _take_line(self, line: bytes, now_s: float) -> None:
        if line.endswith(_RING):
            self._rings += 1
        elif self._command is None or not line:
            return
        elif line in _ENDINGS:
            self._go_on(ModemReply(line, tuple(self._lines), self._content), now_s)
        elif len(self._lines) < 8:
            self._lines.append(line)

    # ------------------------------------------------------------------ dialogues

    def _begin(self, dialogue: Dialogue, now_s: float) -> None:
        self._dialogue = dialogue
        self._next(lambda: next(dialogue), now_s)

    def _go_on(self, answer: ModemReply, now_s: float) -> None:
        dialogue = self._dialogue
        if dialogue is not None:
            self._next(lambda: dialogue.send(answer), now_s)

    def _next(self, step: Callable[[], ModemCommand], now_s: float) -> None:
        self._lines, self._content, self._content_read = [], None, False
        try:
            self._command = step()
        except StopIteration as end:
            self._dialogue = self._command = None
            self.idle_since_s = now_s
            kept = bool(end.value)
            self._pause_end_s = None if kept else now_s + _PAUSE_S
            if kept:
                self.failing_since_s = None
            elif self.failing_since_s is None:
                self.failing_since_s = now_s
        else:
            self._out += self._command.data
            self._command_s = now_s

    def _set_up(self) -> Dialogue:
        # Echo and flow control off, ring alerts on; AT twice, since the first may end a partial line. A modem without
        # flow control or alerts refuses the two last commands, and works without them.
        for command in (b"AT", b"AT", b"ATE0", b"AT&K0", b"AT+SBDMTA=1"):
            answer = yield ModemCommand(command + b"\r")
            if command != b"AT" and (not answer.ending or (command == b"ATE0" and answer.ending != b"OK")):
                return False
        answer = yield ModemCommand(b"AT+CGSN\r")
        numbers = [line for line in answer.lines if len(line) == 15 and line.isdigit()]
        if answer.ending != b"OK" or not numbers:
            return False
        self.imei = numbers[0].decode()
        answer = yield ModemCommand(b"AT+SBDSX\r")
        fields = _numbers(answer, b"+SBDSX:", 6)
        if fields is None:
            return False
        self._rings = max(self._rings, int(fields[4] == 1 or fields[5] > 0))
        if fields[2] == 1:  # received before a restart
            found = yield from self._read(Session(tried=False, number=fields[3]))
            self._sessions.append(found)
        answer = yield ModemCommand(b"AT+SBDD0\r")
        return answer.ending == b"OK"

    def _measure(self) -> Dialogue:
        answer = yield ModemCommand(b"AT+CSQ\r", _SIGNAL_S)
        fields = _numbers(answer, b"+CSQ:", 1)
        self.signal = fields[0] if fields is not None and fields[0] <= 5 else None
        return fields is not None

    def _session(self, content: bytes) -> Dialogue:
        failed = Session(tried=False)
        if content:
            answer = yield ModemCommand(b"AT+SBDWB=%d\r" % len(content))
            if answer.ending == b"READY":
                answer = yield ModemCommand(content + checksum(content))
            written = answer.ending == b"OK" and answer.lines[:1] == (b"0",)
        else:
            answer = yield ModemCommand(b"AT+SBDD0\r")
            written = answer.ending == b"OK"
        if not written:
            self._sessions.append(failed)
            return False
        rings = self._rings  # a later one is for another message
        answer = yield ModemCommand(b"AT+SBDIXA\r" if rings else b"AT+SBDIX\r", _SESSION_S)
        fields = _numbers(answer, b"+SBDIX:", 6)
        if fields is None:
            self._sessions.append(Session(tried=True))
            return False
        status, _sequence, received, number, length, queued = fields
        session = Session(tried=True, status=status, number=number, unread=received == _NOT_HANDED_OVER)
        if session.sent:
            self._rings -= rings
        if received == _HANDED_OVER:
            # Without a received message the queue length is ignored: a message too long for the modem stays in it.
            session = yield from self._read(replace(session, length=length, queued=queued))
        self._sessions.append(session)
        answer = yield ModemCommand(b"AT+SBDD0\r")
        return answer.ending == b"OK" and not session.damaged  # the next setup finds it again

    def _read(self, session: Session) -> Generator[ModemCommand, ModemReply, Session]:
        """Read the message in the modem, and delete it there."""
        answer = yield ModemCommand(b"AT+SBDRB\r", content=True)
        if answer.content is None:
            return replace(session, damaged=True)
        yield ModemCommand(b"AT+SBDD1\r")
        return replace(session, content=answer.content)


def _numbers(answer: ModemReply, name: bytes, count: int) -> tuple[int, ...] | None:
    """Return the numbers behind a name in an answer that ended well; None for anything else."""
    lines = [line for line in answer.lines if line.startswith(name)]
    if answer.ending != b"OK" or len(lines) != 1:
        return None
    words = [word.strip() for word in lines[0][len(name) :].split(b",")]
    if len(words) != count or not all(word.removeprefix(b"-").isdigit() and len(word) <= 6 for word in words):
        return None
    return tuple(int(word) for word in words)
