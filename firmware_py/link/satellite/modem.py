"""AT commands of an Iridium 9602 or 9603 modem, without input and output: bytes and time are arguments.

Source: Iridium ISU AT Command Reference, Short Burst Data commands.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeAlias

import msgspec
from msgspec.structs import replace

MAX_SENT_BYTES = 340  # of a message, by a 9602
_REPLY_TIMEOUT_S = 10.0
_SIGNAL_TIMEOUT_S = 50.0
_SESSION_TIMEOUT_S = 120.0
_PAUSE_S = 10.0  # after a failed dialogue
_MAX_LINE_BYTES = 256  # a longer line is noise
_MAX_LINES = 8
_RING = b"SBDRING"
_RECEIVED, _NOT_DELIVERED = 1, 2  # MT status, third number of +SBDIX; 0: no message for the boat
_ENDINGS = (b"OK", b"ERROR", b"READY")


class ModemCommand(msgspec.Struct, frozen=True):
    """Command or binary message to the modem, and the timeout of the reply."""

    data: bytes
    timeout_s: float = _REPLY_TIMEOUT_S
    expects_content: bool = False  # the reply starts with a binary message


class ModemReply(msgspec.Struct, frozen=True):
    """Reply of the modem."""

    ending: bytes  # empty after a timeout
    lines: tuple[bytes, ...] = ()
    content: bytes | None = None  # binary message; None if it is missing or damaged


class Session(msgspec.Struct, frozen=True):
    """Result of a session."""

    tried: bool  # whether the modem called the satellite
    status: int | None = None  # MO status of the sent message, 0 to 4 for success; None if the modem did not report it
    number: int = 0  # of the received message, assigned by the network
    length: int = 0  # of the received message in bytes, reported by the modem
    content: bytes | None = None  # the received message
    damaged: bool = False  # whether reading the received message from the modem failed
    queued: int = 0  # number of messages for the boat that remain in the network
    unread: bool = False  # whether the network failed to deliver a message

    @property
    def sent(self) -> bool:
        """Whether the message was sent successfully."""
        return self.status is not None and 0 <= self.status <= 4


Dialogue: TypeAlias = Generator[ModemCommand, ModemReply, bool]  # returns whether the replies were as specified


def checksum(content: bytes) -> bytes:
    """Return the sum of the bytes modulo 65536 in two bytes, big-endian."""
    return (sum(content) & 0xFFFF).to_bytes(2, "big")


class Modem:
    """State of the modem and of the dialogue with it, one command at a time."""

    def __init__(self) -> None:
        """Start before the setup of the modem."""
        self.imei = ""
        self.signal: int | None = None  # latest measurement, 0 to 5
        self.idle_since_s = 0.0  # end of the latest dialogue
        self._rings = 0
        self.failing_since_s: float | None = None  # start of a period without valid replies
        self._sessions: list[Session] = []
        self._dialogue: Dialogue | None = None
        self._command: ModemCommand | None = None
        self._command_s = 0.0
        self._output = b""
        self._buffer = b""  # received bytes
        self._lines: list[bytes] = []
        self._content: bytes | None = None
        self._is_content_read = False
        self._setup_s: float | None = 0.0  # time of the next setup; None after a successful one

    @property
    def is_ready(self) -> bool:
        """Whether the modem is set up and idle."""
        return self._dialogue is None and self._setup_s is None

    @property
    def is_ringing(self) -> bool:
        """Whether the modem has announced a message for the boat."""
        return self._rings > 0

    def restart(self) -> None:
        """Discard the present dialogue and set the modem up again, after the line was lost."""
        self._dialogue = self._command = None
        self._buffer = self._output = b""
        self._setup_s = 0.0

    def take_session(self) -> Session | None:
        """Return and remove the oldest result of a session, or a message that was in the modem at the setup."""
        return self._sessions.pop(0) if self._sessions else None

    def measure_signal(self, now_s: float) -> None:
        """Start a signal measurement; the modem must be ready."""
        self._start(self._measure_signal(), now_s)

    def start_session(self, content: bytes, now_s: float) -> None:
        """Start a session with a message; an empty one checks the mailbox. The modem must be ready."""
        self._start(self._run_session(content), now_s)

    # ------------------------------------------------------------------ bytes

    def update(self, now_s: float) -> bytes:
        """Handle timeouts and start a setup that is due; return the bytes for the modem."""
        if self._command is not None and now_s - self._command_s > self._command.timeout_s:
            self._continue(ModemReply(b""), now_s)
        if self._dialogue is None and self._setup_s is not None and now_s >= self._setup_s:
            self._start(self._set_up(), now_s)
        output, self._output = self._output, b""
        return output

    def feed(self, data: bytes, now_s: float) -> None:
        """Evaluate bytes received from the modem."""
        self._buffer += data
        while self._buffer:
            if self._command is not None and self._command.expects_content and not self._is_content_read:
                # After a reset the modem echoes the command before the message. A first byte that is not the high byte
                # of a valid length belongs to a text line.
                self._buffer = self._buffer.removeprefix(self._command.data)
                if self._buffer[:1] <= bytes((MAX_SENT_BYTES >> 8,)):
                    if not self._read_content():
                        return
                    continue
            line, end, rest = self._buffer.partition(b"\n")
            if not end:
                self._buffer = self._buffer[-_MAX_LINE_BYTES:]
                return
            self._buffer = rest
            self._read_line(line.strip(b"\r\x00 "), now_s)

    def _read_content(self) -> bool:
        """Read length, message and checksum from the buffer; return False if they are incomplete."""
        size = int.from_bytes(self._buffer[:2], "big")
        if len(self._buffer) >= 2 and size > MAX_SENT_BYTES:
            self._content, self._is_content_read, self._buffer = None, True, b""  # not a message
            return True
        if len(self._buffer) < size + 4:
            return False
        content, received_sum = self._buffer[2 : size + 2], self._buffer[size + 2 : size + 4]
        self._content = content if received_sum == checksum(content) else None
        self._is_content_read, self._buffer = True, self._buffer[size + 4 :]
        return True

    def _read_line(self, line: bytes, now_s: float) -> None:
        if line.endswith(_RING):
            self._rings += 1
        elif self._command is None or not line:
            return
        elif line in _ENDINGS:
            self._continue(ModemReply(line, tuple(self._lines), self._content), now_s)
        elif len(self._lines) < _MAX_LINES:
            self._lines.append(line)

    # ------------------------------------------------------------------ dialogues

    def _start(self, dialogue: Dialogue, now_s: float) -> None:
        self._dialogue = dialogue
        self._advance(lambda: next(dialogue), now_s)

    def _continue(self, reply: ModemReply, now_s: float) -> None:
        dialogue = self._dialogue
        if dialogue is not None:
            self._advance(lambda: dialogue.send(reply), now_s)

    def _advance(self, next_command: Callable[[], ModemCommand], now_s: float) -> None:
        self._lines, self._content, self._is_content_read = [], None, False
        try:
            self._command = next_command()
        except StopIteration as end:
            self._dialogue = self._command = None
            self.idle_since_s = now_s
            is_valid = bool(end.value)
            self._setup_s = None if is_valid else now_s + _PAUSE_S
            if is_valid:
                self.failing_since_s = None
            elif self.failing_since_s is None:
                self.failing_since_s = now_s
        else:
            self._output += self._command.data
            self._command_s = now_s

    def _set_up(self) -> Dialogue:
        # Echo and flow control off, ring alerts on. AT is sent twice, since the first may end a partial line. A modem
        # without flow control or alerts rejects the last two commands, and works without them.
        for command in (b"AT", b"AT", b"ATE0", b"AT&K0", b"AT+SBDMTA=1"):
            reply = yield ModemCommand(command + b"\r")
            if command != b"AT" and (not reply.ending or (command == b"ATE0" and reply.ending != b"OK")):
                return False
        reply = yield ModemCommand(b"AT+CGSN\r")
        imeis = [line for line in reply.lines if len(line) == 15 and line.isdigit()]
        if reply.ending != b"OK" or not imeis:
            return False
        self.imei = imeis[0].decode()
        reply = yield ModemCommand(b"AT+SBDSX\r")
        fields = _parse_numbers(reply, b"+SBDSX:", 6)
        if fields is None:
            return False
        _has_message_to_send, _sent_number, is_received, number, is_ringing, queued = fields
        self._rings = max(self._rings, int(is_ringing == 1 or queued > 0))
        if is_received == 1:  # before the setup
            session = yield from self._read_received(Session(tried=False, number=number))
            self._sessions.append(session)
        reply = yield ModemCommand(b"AT+SBDD0\r")  # delete the message to send
        return reply.ending == b"OK"

    def _measure_signal(self) -> Dialogue:
        reply = yield ModemCommand(b"AT+CSQ\r", _SIGNAL_TIMEOUT_S)
        fields = _parse_numbers(reply, b"+CSQ:", 1)
        self.signal = fields[0] if fields is not None and fields[0] <= 5 else None
        return fields is not None

    def _run_session(self, content: bytes) -> Dialogue:
        if content:
            reply = yield ModemCommand(b"AT+SBDWB=%d\r" % len(content))
            if reply.ending == b"READY":
                reply = yield ModemCommand(content + checksum(content))
            is_written = reply.ending == b"OK" and reply.lines[:1] == (b"0",)  # 0: written
        else:
            reply = yield ModemCommand(b"AT+SBDD0\r")
            is_written = reply.ending == b"OK"
        if not is_written:
            self._sessions.append(Session(tried=False))
            return False
        # SBDIXA: session after a ring alert. Later rings announce another message.
        rings = self._rings
        reply = yield ModemCommand(b"AT+SBDIXA\r" if rings else b"AT+SBDIX\r", _SESSION_TIMEOUT_S)
        fields = _parse_numbers(reply, b"+SBDIX:", 6)
        if fields is None:
            self._sessions.append(Session(tried=True))
            return False
        status, _sequence, received, number, length, queued = fields
        session = Session(tried=True, status=status, number=number, unread=received == _NOT_DELIVERED)
        if session.sent:
            self._rings -= rings
        if received == _RECEIVED:
            # Otherwise the queue length is ignored, since a message too long for the modem remains in the queue.
            session = yield from self._read_received(replace(session, length=length, queued=queued))
        self._sessions.append(session)
        reply = yield ModemCommand(b"AT+SBDD0\r")
        return reply.ending == b"OK" and not session.damaged  # the next setup reads a damaged message again

    def _read_received(self, session: Session) -> Generator[ModemCommand, ModemReply, Session]:
        """Read the received message from the modem, and delete it there."""
        reply = yield ModemCommand(b"AT+SBDRB\r", expects_content=True)
        if reply.content is None:
            return replace(session, damaged=True)
        yield ModemCommand(b"AT+SBDD1\r")
        return replace(session, content=reply.content)


def _parse_numbers(reply: ModemReply, name: bytes, count: int) -> tuple[int, ...] | None:
    """Return the `count` numbers after a name in a reply with the ending OK; None if the reply is different."""
    lines = [line for line in reply.lines if line.startswith(name)]
    if reply.ending != b"OK" or len(lines) != 1:
        return None
    words = [word.strip() for word in lines[0][len(name) :].split(b",")]
    if len(words) != count or not all(word.removeprefix(b"-").isdigit() and len(word) <= 6 for word in words):
        return None
    return tuple(int(word) for word in words)
