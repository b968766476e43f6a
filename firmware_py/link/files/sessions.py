"""Sessions of file transfer, and replies that are remembered for repeated requests."""

from __future__ import annotations

import errno
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from firmware_py.common.records import Severity
from firmware_py.files.packed import PackedFile, PlainFile
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import MAX_FILE_BYTES, Entry, Parts
from firmware_py.link.files.payload import Error, FileRequest, Opcode, Refusal, ack_payload, nak_payload, refusal_of
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer, Station
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.worker import Worker

MAX_SESSIONS = 16
MAX_CLIENT_SESSIONS = 6  # sessions of one client; MAVProxy uses five at once
IDLE_S = 10.0  # a session unused for this long makes room for another
FORGET_S = 120.0  # and unused for this long it is closed in any case
_MAX_GAPS = 64  # in an upload
_BURST_PARTS = 160  # in a reply: a receive buffer of 208 KiB holds them; then the client continues with a new request

FILE_TRANSFER = 110
_REMEMBERED = 64  # answers
_REMEMBERED_S = 5.0  # maximum age of a repeated request
PENDING = b""  # in place of a reply while a request is being executed

# Requests that may be executed twice.
_HARMLESS = frozenset(
    (Opcode.NONE, Opcode.LIST, Opcode.LIST_WITH_TIME, Opcode.READ, Opcode.BURST_READ, Opcode.CHECKSUM)
)


class OpenFile:
    """A file with the size at its opening; bytes that are appended later are not part of it."""

    __slots__ = ("_content", "_file", "path", "size")

    def __init__(self, path: Parts, source: PlainFile | PackedFile | bytes) -> None:
        """Take a file of the disk, or the content of one in memory."""
        self.path = path
        self._file = None if isinstance(source, bytes) else source
        self._content = source if isinstance(source, bytes) else b""
        self.size = len(source) if isinstance(source, bytes) else source.size

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes at an offset; Refusal at the end."""
        if offset >= self.size:
            raise Refusal(Error.END_OF_FILE)
        count = min(count, self.size - offset)
        if self._file is None:
            return self._content[offset : offset + count]
        return self._file.read(offset, count)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


class FileUpload:
    """An upload; it is stored whole when the session ends, or not at all."""

    __slots__ = ("content", "gaps", "path")

    def __init__(self, path: Parts, content: bytes = b"") -> None:
        """Start empty, or with the present content of the file."""
        self.path = path
        self.content = bytearray(content)
        self.gaps: list[tuple[int, int]] = []  # parts that are missing, from and to

    def write(self, offset: int, data: bytes) -> None:
        """Write a part at its offset; parts may come in any order."""
        end, size = offset + len(data), len(self.content)
        if end > MAX_FILE_BYTES:
            raise Refusal(Error.FAIL_ERRNO, errno.EFBIG)
        gaps = [*self.gaps, (size, offset)] if offset > size else self.gaps
        left = [piece for low, high in gaps for piece in ((low, min(high, offset)), (max(low, end), high))]
        gaps = [(low, high) for low, high in left if low < high]
        if len(gaps) > _MAX_GAPS:
            raise Refusal(Error.FAIL)
        self.gaps = gaps
        if end > size:
            self.content.extend(bytes(end - size))
        self.content[offset:end] = data

    def close(self) -> None:
        """Drop the content."""
        self.content.clear()


class Burst:
    """The state of a reply to a burst read."""

    __slots__ = ("_part_bytes", "client", "index", "offset", "request")

    def __init__(self, request: FileRequest, client: Station) -> None:
        """Start at the requested offset; the requested size is that of each part."""
        self.request = request
        self.client = client
        self.offset = request.offset
        self.index = 0
        self._part_bytes = request.size or 239

    def next_parts(self, reading: OpenFile, count: int) -> tuple[list[tuple[int, int, bytes]], bool]:
        """Return up to count parts as (index, offset, data), and whether they end the burst."""
        count = min(count, _BURST_PARTS - self.index)
        data = reading.read(self.offset, count * self._part_bytes)
        parts = []
        for start in range(0, len(data), self._part_bytes):
            piece = data[start : start + self._part_bytes]
            parts.append((self.index, self.offset, piece))
            self.index += 1
            self.offset += len(piece)
        # Also the end of a file that has become shorter.
        ended = self.index >= _BURST_PARTS or self.offset >= reading.size or not data
        return parts, ended


class FileSession:
    """One session."""

    __slots__ = ("burst", "handle", "used_s")

    def __init__(self, handle: OpenFile | FileUpload, now_s: float) -> None:
        """Begin to be used."""
        self.handle = handle
        self.burst: Burst | None = None
        self.used_s = now_s


class FileSessions:
    """The open sessions of all clients, bounded; a client chooses the numbers of its sessions."""

    def __init__(self) -> None:
        """Start with none."""
        self._open: OrderedDict[tuple[Station, int], FileSession] = OrderedDict()  # the least used first

    def __len__(self) -> int:
        """Return the number of sessions."""
        return len(self._open)

    def items(self) -> tuple[tuple[tuple[Station, int], FileSession], ...]:
        """Return the sessions as they are now."""
        return tuple(self._open.items())

    def use(self, client: Station, number: int, now_s: float) -> FileSession:
        """Return a session and note its use; Refusal when there is none."""
        session = self._open.get((client, number))
        if session is None:
            raise Refusal(Error.INVALID_SESSION)
        session.used_s = now_s
        self._open.move_to_end((client, number))
        return session

    def get(self, client: Station, number: int) -> FileSession | None:
        """Return a session without using it."""
        return self._open.get((client, number))

    def used_s(self, client: Station, number: int) -> float:
        """Return when a session was used last."""
        return self._open[(client, number)].used_s

    def check_room(self, client: Station, number: int, now_s: float) -> None:
        """Make room for a session by closing an idle one; Refusal if none is idle."""
        if (client, number) in self._open:
            return
        own = [key for key in self._open if key[0] == client]
        crowd = own if len(own) >= MAX_CLIENT_SESSIONS else list(self._open) if len(self._open) >= MAX_SESSIONS else []
        if not crowd:
            return
        if now_s - self._open[crowd[0]].used_s < IDLE_S:
            raise Refusal(Error.NO_SESSIONS_AVAILABLE)
        self.discard(*crowd[0])

    def open(self, client: Station, number: int, handle: OpenFile | FileUpload, now_s: float) -> None:
        """Open a session, in place of one of the same number."""
        self.discard(client, number)
        self._open[(client, number)] = FileSession(handle, now_s)

    def end(self, client: Station, number: int) -> OpenFile | FileUpload | None:
        """End a session and return its file or upload."""
        session = self._open.pop((client, number), None)
        return None if session is None else session.handle

    def discard(self, client: Station, number: int) -> None:
        """End a session; an upload is dropped."""
        handle = self.end(client, number)
        if handle is not None:
            handle.close()

    def numbers(self, client: Station) -> tuple[int, ...]:
        """Return the numbers of a client's sessions."""
        return tuple(number for owner, number in self._open if owner == client)

    def expire(self, now_s: float) -> None:
        """Close sessions that are unused for long."""
        for key, session in self.items():
            if now_s - session.used_s > FORGET_S:
                self.discard(*key)


def listing_data(entries: tuple[Entry, ...], start: int, *, with_time: bool, room: int) -> bytes:
    """Return as many lines of a listing as fit, from one on; Refusal at the end."""
    if start >= len(entries):
        raise Refusal(Error.END_OF_FILE)
    data = b""
    for entry in entries[start:]:
        text = f"D{entry.name}" if entry.is_directory else f"F{entry.name}\t{entry.size}"
        if with_time and not entry.is_directory:
            text += f"\t{entry.modified_s}"
        line = text.encode("ascii", "replace") + b"\0"
        if len(data) + len(line) > room:
            break
        data += line
    return data


class FileCall(NamedTuple):
    """A request, its client and time."""

    request: FileRequest
    raw: bytes
    client: Station
    now_s: float

    @property
    def peer(self) -> Peer:
        """The peer that gets the reply."""
        return self.client.peer


# Returns the data of the acknowledgement, or None when the answer comes later; raises Refusal or OSError.
FileAction = Callable[[FileCall], bytes | None]


class Answers:
    """Sends replies, at once or after disk work, and stores them for repeated requests."""

    def __init__(self, context: LinkContext, sessions: FileSessions, worker: Worker) -> None:
        """Take the context, the open sessions, and the worker for the disk."""
        self._context = context
        self._sessions = sessions
        self._worker = worker
        self._remembered: OrderedDict[tuple[Station, bytes], tuple[bytes, float]] = OrderedDict()

    def find(self, call: FileCall) -> bytes | None:
        """Return the stored reply to a repeated request; None for a new one."""
        payload, answered_s = self._remembered.get((call.client, call.raw), (None, 0.0))
        if payload is None or call.now_s - answered_s > _REMEMBERED_S:
            return None
        if call.request.opcode == Opcode.OPEN_READ and payload is not PENDING:
            # A client that was restarted may count from the same number: valid only while the session is open.
            return payload if self._sessions.get(call.client, call.request.session) is not None else None
        if call.request.opcode == Opcode.TERMINATE:
            # MAVProxy counts from the same number for each file: a session that was opened since must be ended, too, or
            # the next one would read the old content. Not an upload: a late duplicate must not end it.
            opened = self._sessions.get(call.client, call.request.session)
            if opened is not None and isinstance(opened.handle, OpenFile):
                return None
        return payload

    def begin(self, call: FileCall) -> None:
        """Mark a request as being executed, so that a duplicate is ignored."""
        if call.request.opcode not in _HARMLESS:
            self._remember(call, PENDING)

    def finish(self, call: FileCall, result: bytes | Exception) -> None:
        """Reply to a request with its data or its failure."""
        if isinstance(result, Exception):
            refusal = refusal_of(result)
            if refusal.text:
                self._context.send_text_limited(call.peer, Severity.WARNING, refusal.text, call.now_s)
            payload = nak_payload(call.request, refusal)
        else:
            payload = ack_payload(call.request, result)
        if call.request.opcode not in _HARMLESS:
            self._remember(call, payload)
        self.send(call, payload)

    def _remember(self, call: FileCall, payload: bytes) -> None:
        """Store a reply for repeated requests."""
        key = (call.client, call.raw)
        keep_latest(self._remembered, key, (payload, call.now_s), _REMEMBERED)

    def send(self, call: FileCall, payload: bytes) -> None:
        """Queue a payload to the client."""
        address = bytes((0, *call.client.sender))
        packed = self._context.codec.pack_payload(FILE_TRANSFER, address + payload)
        call.peer.outbox.push(packed, Priority.REPLY)

    def finish_later(
        self, call: FileCall, job: Callable[[], Any], then: Callable[[Any], bytes] = lambda _: b""
    ) -> None:
        """Start a job on the worker, and reply when it is done."""

        def done(result: Any) -> None:
            if not isinstance(result, Exception):
                try:
                    result = then(result)
                except Refusal as refusal:
                    result = refusal
            self.finish(call, result)
            call.peer.outbox.flush(self._context.now_s)

        if not self._worker.submit(job, done):
            # The client repeats its request; by then there may be room.
            self._remembered.pop((call.client, call.raw), None)
