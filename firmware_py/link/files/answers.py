"""How the answers of file transfer go out, and are remembered for those who ask again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.files.payload import FileRequest, Opcode, Refusal, ack_payload, nak_payload, refusal_of
from firmware_py.link.files.sessions import FileSessions, OpenFile
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Correspondent, Peer
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.worker import Worker

FILE_TRANSFER = 110
_REMEMBERED = 64  # answers
_REMEMBERED_S = 5.0  # retries and stray copies come within this
PENDING = b""  # remembered while a request is being carried out

# What may be done twice: the answer to each is found again when it is asked for again.
_HARMLESS = frozenset(
    (Opcode.NONE, Opcode.LIST, Opcode.LIST_WITH_TIME, Opcode.READ, Opcode.BURST_READ, Opcode.CHECKSUM)
)


class FileCall(NamedTuple):
    """A request, who made it and when."""

    request: FileRequest
    raw: bytes
    client: Correspondent
    now_s: float

    @property
    def peer(self) -> Peer:
        """Return whom the answer goes to."""
        return self.client.peer


# Returns the data of the acknowledgement, or None when the answer comes later; raises Refusal or OSError.
FileAction = Callable[[FileCall], bytes | None]


class Answers:
    """Answers requests, at once or when the disk has answered, and remembers what it answered."""

    def __init__(self, context: LinkContext, sessions: FileSessions, worker: Worker) -> None:
        """Take the context to answer through, what is open, and who waits for the disk."""
        self._context = context
        self._sessions = sessions
        self._worker = worker
        self._remembered: OrderedDict[tuple[Correspondent, bytes], tuple[bytes, float]] = OrderedDict()

    def find(self, call: FileCall) -> bytes | None:
        """Return the remembered answer to a request that has come before."""
        payload, answered_s = self._remembered.get((call.client, call.raw), (None, 0.0))
        if payload is None or call.now_s - answered_s > _REMEMBERED_S:
            return None
        if call.request.opcode == Opcode.OPEN_READ and payload is not PENDING:
            # A client that was started again may count from the same number: only an open session stays open.
            return payload if self._sessions.get(call.client, call.request.session) is not None else None
        if call.request.opcode == Opcode.TERMINATE:
            # MAVProxy counts from the same number for each file: a session opened since then is to be ended too, or the
            # next one would read the old content. Not an upload, which a stray copy must not cut short.
            opened = self._sessions.get(call.client, call.request.session)
            if opened is not None and isinstance(opened.handle, OpenFile):
                return None
        return payload

    def begin(self, call: FileCall) -> None:
        """Remember that a request is being carried out, so that a copy of it is not."""
        if call.request.opcode not in _HARMLESS:
            self._remember(call, PENDING)

    def finish(self, call: FileCall, result: bytes | Exception) -> None:
        """Answer a request with the data asked for, or with what stood in the way."""
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
        """Keep an answer for those who ask again."""
        key = (call.client, call.raw)
        keep_latest(self._remembered, key, (payload, call.now_s), _REMEMBERED)

    def send(self, call: FileCall, payload: bytes) -> None:
        """Queue a payload to whoever has asked."""
        address = bytes((0, *call.client.sender))
        packed = self._context.codec.pack_payload(FILE_TRANSFER, address + payload)
        call.peer.outbox.push(packed, Priority.REPLY)

    def finish_later(
        self, call: FileCall, job: Callable[[], Any], then: Callable[[Any], bytes] = lambda _: b""
    ) -> None:
        """Have a job done that waits for the disk, and answer when it is done."""

        def done(result: Any) -> None:
            if not isinstance(result, Exception):
                try:
                    result = then(result)
                except Refusal as refusal:
                    result = refusal
            self.finish(call, result)
            call.peer.outbox.flush(self._context.now_s)

        if not self._worker.submit(job, done):
            # The client asks again: by then there may be room.
            self._remembered.pop((call.client, call.raw), None)
