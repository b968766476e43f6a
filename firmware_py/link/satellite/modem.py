"""An Iridium 9602 or 9603 by its AT commands: never waits, bytes in and bytes out, time passed in.

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
_PAUSE_S = 10.0  # before a modem that does not answer is tried again
_LINE_BYTES = 256  # of a line; what is longer is noise
_RING = b"SBDRING"
_HANDED_OVER, _NOT_HANDED_OVER = 1, 2  # the third number of +SBDIX; 0: there is no message
_ENDINGS = (b"OK", b"ERROR", b"READY")


class ModemCommand(msgspec.Struct, frozen=True):
    """A command, or bytes, and how long the answer may take; `content`: it begins with a message in binary."""

    data: bytes
    timeout_s: float = _ANSWER_S
    content: bool = False


class ModemReply(msgspec.Struct, frozen=True):
    """The lines of an answer, how it ended (empty: not at all), and the message in it, None for a damaged one."""

    ending: bytes
    lines: tuple[bytes, ...] = ()
    content: bytes | None = None


class Session(msgspec.Struct, frozen=True):
    """How a session has ended.

    `status` is that of the message sent: 0 to 4 for sent, None when the modem did not say. `tried`: the satellite was
    called. `number` is the network's of the message received, `content` that message, None without one.
    `damaged`: there was one that could not be read; `length` is what the modem says of it. `queued` more wait ashore;
    `unread`: the network failed to hand one over.
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
        """Whether what was to be sent has arrived."""
        return self.status is not None and 0 <= self.status <= 4


Dialogue: TypeAlias = Generator[ModemCommand, ModemReply, bool]  # returns whether the modem kept to it


def checksum(content: bytes) -> bytes:
    """Return the sum of the bytes in two bytes, high one first."""
    return (sum(content) & 0xFFFF).to_bytes(2, "big")


class Modem:
    """The dialogue with the modem; one thing at a time.

    `signal` is the last measured, 0 to 5; `idle_since_s` is when the last dialogue has ended, so that of measuring.
    `failing_since_s`: since when it has not answered as it should, None while it does.
    """

    def __init__(self) -> None:
        """Begin with a modem of which nothing is known."""
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
        """Whether it is set up and has nothing to do."""
        return self._dialogue is None and self._pause_end_s is None

    @property
    def ringing(self) -> bool:
        """Whether a message waits for her ashore, as the modem says."""
        return self._rings > 0

    def restart(self) -> None:
        """Set it up anew: the line was away."""
        if self._dialogue is not None:
            self._dialogue.close()
        self._dialogue = self._command = None
        self._held = self._out = b""
        self._pause_end_s = 0.0

    def take_session(self) -> Session | None:
        """Return how the last session ended, once; also a message that was found in the modem at the start."""
        return self._sessions.pop(0) if self._sessions else None

    def measure_signal(self, now_s: float) -> None:
        """Ask how strong the satellite is; only when ready."""
        self._begin(self._measure(), now_s)

    def begin(self, content: bytes, now_s: float) -> None:
        """Send a message, or look whether there is one with an empty one; only when ready."""
        self._begin(self._session(content), now_s)

    # ------------------------------------------------------------------ bytes

    def update(self, now_s: float) -> bytes:
        """Return what is to be written now."""
        if self._command is not None and now_s - self._command_s > self._command.timeout_s:
            self._go_on(ModemReply(b""), now_s)
        if self._dialogue is None and self._pause_end_s is not None and now_s >= self._pause_end_s:
            self._begin(self._set_up(), now_s)
        out, self._out = self._out, b""
        return out

    def feed(self, data: bytes, now_s: float) -> None:
        """Take what the modem has said."""
        self._held += data
        while self._held:
            if self._command is not None and self._command.content and not self._content_read:
                # One that was reset echoes, and a message follows at once; what else may come before a message, or
                # instead, is text: no message is so long that it begins with a letter.
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
        """Take length, message and checksum off what was read; False when they are not whole yet."""
        size = int.from_bytes(self._held[:2], "big")
        if len(self._held) >= 2 and size > LONGEST_OUT:
            self._content, self._content_read, self._held = None, True, b""  # no message: the line is out of step
            return True
        if len(self._held) < size + 4:
            return False
        content, told = self._held[2 : size + 2], self._held[size + 2 : size + 4]
        self._content = content if told == checksum(content) else None
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
        # Echo and flow control off, ring alerts on; twice AT, since the first may end what the line has left over. A
        # modem that knows no flow control or no alerts of its own refuses the two last: she calls without them.
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
        if fields[2] == 1:  # received before an end that came between
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
        rings = self._rings  # one that comes meanwhile is of another message
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
            # Where none was, none is to be had: a message that is too long for her is counted for ever.
            session = yield from self._read(replace(session, length=length, queued=queued))
        self._sessions.append(session)
        answer = yield ModemCommand(b"AT+SBDD0\r")
        return answer.ending == b"OK" and not session.damaged  # the setting up finds it again

    def _read(self, session: Session) -> Generator[ModemCommand, ModemReply, Session]:
        """Read the message that the modem holds, and have it forgotten."""
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
