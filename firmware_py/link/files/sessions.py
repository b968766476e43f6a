"""Sessions of file transfer, and replies that are stored for repeated requests."""

from __future__ import annotations

import errno
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from firmware_py.common.records import Severity
from firmware_py.files.packed import PackedFile, PlainFile
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import MAX_FILE_BYTES, Entry, PathParts
from firmware_py.link.files.payload import (
    DATA_BYTES,
    Error,
    FileRequest,
    Opcode,
    Refusal,
    ack_payload,
    nak_payload,
    refusal_of,
)
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer, Station
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.worker import Worker

MAX_SESSIONS = 16
MAX_CLIENT_SESSIONS = 6  # sessions of one client; MAVProxy uses five at once
MIN_IDLE_S = 10.0  # a session that is idle for this time may be closed for a new one
_MAX_IDLE_S = 120.0  # a session that is idle for this time is closed in any case
_MAX_GAPS = 64  # in an upload
_MAX_BURST_PARTS = 160  # they fit in a receive buffer of 208 KiB; the client requests the next burst

FILE_TRANSFER_MESSAGE = 110  # message id of FILE_TRANSFER_PROTOCOL
_MAX_STORED_REPLIES = 64
_MAX_REPLY_AGE_S = 5.0  # an older stored reply is not sent again
PENDING = b""  # stored instead of a reply while a request is being executed

# Requests that may be executed twice.
_REPEATABLE_OPCODES = frozenset(
    (Opcode.NONE, Opcode.LIST, Opcode.LIST_WITH_TIME, Opcode.READ, Opcode.BURST_READ, Opcode.CHECKSUM)
)


class OpenFile:
    """A file that is open for reading, with the size that it had when it was opened.

    Bytes that are appended later are not read.
    """

    __slots__ = ("_content", "_file", "size")

    def __init__(self, source: PlainFile | PackedFile | bytes) -> None:
        """Begin with an open file of the disk, or with the bytes of a generated file."""
        self._file = None if isinstance(source, bytes) else source
        self._content = source if isinstance(source, bytes) else b""
        self.size = len(source) if isinstance(source, bytes) else source.size

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes at an offset; raise Refusal with END_OF_FILE at the end."""
        if offset >= self.size:
            raise Refusal(Error.END_OF_FILE)
        count = min(count, self.size - offset)
        if self._file is None:
            return self._content[offset : offset + count]
        return self._file.read(offset, count)

    def close(self) -> None:
        """Close the file of the disk; a generated file needs no closing."""
        if self._file is not None:
            self._file.close()


class FileUpload:
    """An upload in memory; it is stored when the session ends, if it is complete."""

    __slots__ = ("content", "gaps", "path")

    def __init__(self, path: PathParts, content: bytes = b"") -> None:
        """Begin with the present content of the file, which is empty for a new file."""
        self.path = path
        self.content = bytearray(content)
        self.gaps: list[tuple[int, int]] = []  # (start, end) of missing bytes; the end is not included

    def write(self, offset: int, data: bytes) -> None:
        """Write a part at its offset, in any order; raise Refusal if the file is too large or has too many gaps."""
        end, size = offset + len(data), len(self.content)
        if end > MAX_FILE_BYTES:
            raise Refusal(Error.FAIL_ERRNO, errno.EFBIG)
        gaps = (*self.gaps, (size, offset))  # the last one is empty, and removed, unless the part is beyond the end
        split_gaps = [gap for low, high in gaps for gap in ((low, min(high, offset)), (max(low, end), high))]
        remaining_gaps = [(low, high) for low, high in split_gaps if low < high]
        if len(remaining_gaps) > _MAX_GAPS:
            raise Refusal(Error.FAIL)
        self.gaps = remaining_gaps
        if end > size:
            self.content.extend(bytes(end - size))
        self.content[offset:end] = data

    def close(self) -> None:
        """Do nothing: the content is discarded with the upload."""


class BurstRead:
    """State of the reply to a burst read."""

    __slots__ = ("_file", "_part_bytes", "client", "index", "offset", "request")

    def __init__(self, request: FileRequest, client: Station, file: OpenFile) -> None:
        """Start at the requested offset of a file; each part has the requested size."""
        self.request = request
        self.client = client
        self._file = file
        self.offset = request.offset
        self.index = 0
        self._part_bytes = request.size or DATA_BYTES

    def next_parts(self, max_parts: int) -> tuple[list[tuple[int, int, bytes]], bool]:
        """Return at most `max_parts` parts as (index, offset, data), and whether they end the burst."""
        count = min(max_parts, _MAX_BURST_PARTS - self.index)
        data = self._file.read(self.offset, count * self._part_bytes)
        parts = []
        for start in range(0, len(data), self._part_bytes):
            part = data[start : start + self._part_bytes]
            parts.append((self.index, self.offset, part))
            self.index += 1
            self.offset += len(part)
        # Without data, the file has become shorter since its opening.
        is_end = self.index >= _MAX_BURST_PARTS or self.offset >= self._file.size or not data
        return parts, is_end


class FileSession:
    """One session: an open file or an upload, the burst read that it sends, and the time of its last use."""

    __slots__ = ("burst", "handle", "last_use_s")

    def __init__(self, handle: OpenFile | FileUpload, now_s: float) -> None:
        """Begin with a file or an upload, which is first used at `now_s`."""
        self.handle = handle
        self.burst: BurstRead | None = None
        self.last_use_s = now_s


class FileSessions:
    """The open sessions of all clients, at most MAX_SESSIONS. Each client numbers its own sessions."""

    def __init__(self) -> None:
        """Start without sessions."""
        self._sessions: OrderedDict[tuple[Station, int], FileSession] = OrderedDict()  # least recently used first

    def __len__(self) -> int:
        """Return the number of sessions."""
        return len(self._sessions)

    def items(self) -> tuple[tuple[tuple[Station, int], FileSession], ...]:
        """Return a copy of the sessions by client and number."""
        return tuple(self._sessions.items())

    def use(self, client: Station, number: int, now_s: float) -> FileSession:
        """Return a session and update its time of use; raise Refusal if it is not open."""
        session = self._sessions.get((client, number))
        if session is None:
            raise Refusal(Error.INVALID_SESSION)
        session.last_use_s = now_s
        self._sessions.move_to_end((client, number))
        return session

    def get(self, client: Station, number: int) -> FileSession | None:
        """Return a session without updating its time of use; None if it is not open."""
        return self._sessions.get((client, number))

    def last_use_s(self, client: Station, number: int) -> float:
        """Return the time of the last use of a session."""
        return self._sessions[(client, number)].last_use_s

    def close_idle_if_full(self, client: Station, number: int, now_s: float) -> None:
        """Close the least recently used session if the limit of the client or that of all clients is reached.

        Raises Refusal if that session is not idle. Does nothing if the session `number` is open already.
        """
        if (client, number) in self._sessions:
            return
        keys = [key for key in self._sessions if key[0] == client]
        if len(keys) < MAX_CLIENT_SESSIONS:
            if len(self._sessions) < MAX_SESSIONS:
                return
            keys = list(self._sessions)
        if now_s - self._sessions[keys[0]].last_use_s < MIN_IDLE_S:
            raise Refusal(Error.NO_SESSIONS_AVAILABLE)
        self.discard(*keys[0])

    def open(self, client: Station, number: int, handle: OpenFile | FileUpload, now_s: float) -> None:
        """Open a session; a session with the same number is discarded."""
        self.discard(client, number)
        self._sessions[(client, number)] = FileSession(handle, now_s)

    def end(self, client: Station, number: int) -> OpenFile | FileUpload | None:
        """Remove a session and return its file or upload, or None if it is not open."""
        session = self._sessions.pop((client, number), None)
        return None if session is None else session.handle

    def discard(self, client: Station, number: int) -> None:
        """Remove a session and close its file or upload; an upload is not stored."""
        handle = self.end(client, number)
        if handle is not None:
            handle.close()

    def numbers(self, client: Station) -> tuple[int, ...]:
        """Return the numbers of a client's sessions."""
        return tuple(number for owner, number in self._sessions if owner == client)

    def expire(self, now_s: float) -> None:
        """Discard sessions that were not used for _MAX_IDLE_S."""
        for key, session in self.items():
            if now_s - session.last_use_s > _MAX_IDLE_S:
                self.discard(*key)


def encode_listing(entries: tuple[Entry, ...], start: int, *, with_time: bool, max_bytes: int) -> bytes:
    """Return the lines of a listing from index `start`, at most `max_bytes` bytes; raise Refusal after the last."""
    if start >= len(entries):
        raise Refusal(Error.END_OF_FILE)
    data = b""
    for entry in entries[start:]:
        text = f"D{entry.name}" if entry.is_directory else f"F{entry.name}\t{entry.size}"
        if with_time and not entry.is_directory:
            text += f"\t{entry.modified_s}"
        line = text.encode("ascii", "replace") + b"\0"
        if len(data) + len(line) > max_bytes:
            break
        data += line
    return data


class FileCall(NamedTuple):
    """A request, its undecoded payload, its client and the time of its arrival."""

    request: FileRequest
    raw_payload: bytes
    client: Station
    now_s: float

    @property
    def peer(self) -> Peer:
        """The peer that gets the reply."""
        return self.client.peer


# Returns the data of the acknowledgement, or None if the reply is sent later; raises Refusal or OSError.
FileAction = Callable[[FileCall], bytes | None]


class ReplySender:
    """Sends replies, at once or after disk work, and stores them for repeated requests."""

    def __init__(self, context: LinkContext, sessions: FileSessions, worker: Worker) -> None:
        """Store the context, the open sessions, and the worker for the disk."""
        self._context = context
        self._sessions = sessions
        self._worker = worker
        self._stored_replies: OrderedDict[tuple[Station, bytes], tuple[bytes, float]] = OrderedDict()

    def find_stored(self, call: FileCall) -> bytes | None:
        """Return the stored reply to a repeated request; None for a new one."""
        stored = self._stored_replies.get((call.client, call.raw_payload))
        if stored is None or call.now_s - stored[1] > _MAX_REPLY_AGE_S:
            return None
        payload = stored[0]
        if call.request.opcode == Opcode.OPEN_READ and payload is not PENDING:
            # A restarted client may repeat sequence numbers: the reply is valid only while the session is open.
            return payload if self._sessions.get(call.client, call.request.session) is not None else None
        if call.request.opcode == Opcode.TERMINATE:
            # MAVProxy repeats sequence numbers for each file: an open file must be closed, or the next read would get
            # the old content. An upload stays open: a late duplicate must not end it.
            session = self._sessions.get(call.client, call.request.session)
            if session is not None and isinstance(session.handle, OpenFile):
                return None
        return payload

    def begin(self, call: FileCall) -> None:
        """Mark a request as being executed, so that its duplicates are ignored."""
        if call.request.opcode not in _REPEATABLE_OPCODES:
            self._store(call, PENDING)

    def finish(self, call: FileCall, result: bytes | Exception) -> None:
        """Reply to a request with its data or its failure."""
        if isinstance(result, Exception):
            refusal = refusal_of(result)
            if refusal.text:
                self._context.send_text_limited(call.peer, Severity.WARNING, refusal.text, call.now_s)
            payload = nak_payload(call.request, refusal)
        else:
            payload = ack_payload(call.request, result)
        if call.request.opcode not in _REPEATABLE_OPCODES:
            self._store(call, payload)
        self.send(call, payload)

    def _store(self, call: FileCall, payload: bytes) -> None:
        """Store a reply for repeated requests."""
        key = (call.client, call.raw_payload)
        keep_latest(self._stored_replies, key, (payload, call.now_s), _MAX_STORED_REPLIES)

    def send(self, call: FileCall, payload: bytes) -> None:
        """Queue a payload to the client."""
        address = bytes((0, *call.client.sender))
        frame = self._context.codec.pack_payload(FILE_TRANSFER_MESSAGE, address + payload)
        call.peer.outbox.push(frame, Priority.REPLY)

    def finish_later(
        self, call: FileCall, job: Callable[[], Any], make_data: Callable[[Any], bytes] = lambda _: b""
    ) -> None:
        """Start a job on the worker, and reply with `make_data(result)` when it is done."""

        def reply(result: Any) -> None:
            if not isinstance(result, Exception):
                try:
                    result = make_data(result)
                except Refusal as refusal:
                    result = refusal
            self.finish(call, result)
            call.peer.outbox.flush(self._context.now_s)

        if not self._worker.submit(job, reply):
            # The queue of the worker is full: the client repeats its request.
            self._stored_replies.pop((call.client, call.raw_payload), None)
