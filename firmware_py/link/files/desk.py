"""The desk of file transfer: who asks, what is open, how answers go out and are remembered."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.files.payload import FileRequest, Opcode, Refusal, ack_payload, nak_payload, refusal_of
from firmware_py.link.files.sessions import Client, FileSessions, OpenFile
from firmware_py.link.files.tree import Tree
from firmware_py.link.peer import Peer
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
    client: Client
    now_s: float

    @property
    def peer(self) -> Peer:
        """Return whom the answer goes to."""
        return self.client.peer


# Returns the data of the acknowledgement, or None when the answer comes later; raises Refusal or OSError.
FileAction = Callable[[FileCall], bytes | None]


class Desk:
    """What all requests share."""

    def __init__(self, session: LinkContext, tree: Tree, worker: Worker) -> None:
        """Take the session to answer through, what is to be seen, and who waits for the disk."""
        self.session = session
        self.tree = tree
        self.sessions = FileSessions()
        self.worker = worker
        self._answers: OrderedDict[tuple[Client, bytes], tuple[bytes, float]] = OrderedDict()

    def earlier(self, call: FileCall) -> bytes | None:
        """Return the remembered answer to a request that has come before."""
        found = self._answers.get((call.client, call.raw))
        if found is None or call.now_s - found[1] > _REMEMBERED_S:
            return None
        if call.request.opcode == Opcode.OPEN_READ and found[0] is not PENDING:
            # A client that was started again may count from the same number: only an open session stays open.
            return found[0] if self.sessions.get(call.client, call.request.session) is not None else None
        if call.request.opcode == Opcode.TERMINATE:
            # MAVProxy counts from the same number for each file: a session opened since then is to be ended too, or the
            # next one would read the old content. Not an upload, which a stray copy must not cut short.
            opened = self.sessions.get(call.client, call.request.session)
            if opened is not None and isinstance(opened.handle, OpenFile):
                return None
        return found[0]

    def begin(self, call: FileCall) -> None:
        """Note that a request is being carried out, so that a copy of it is not."""
        if call.request.opcode not in _HARMLESS:
            self.remember(call, PENDING)

    def finish(self, call: FileCall, result: bytes | Exception) -> None:
        """Answer a request with the data asked for, or with what stood in the way."""
        if isinstance(result, Exception):
            refusal = refusal_of(result)
            if refusal.text:
                self.session.send_text_limited(call.peer, Severity.WARNING, refusal.text, call.now_s)
            payload = nak_payload(call.request, refusal)
        else:
            payload = ack_payload(call.request, result)
        if call.request.opcode not in _HARMLESS:
            self.remember(call, payload)
        self.send(call, payload)

    def remember(self, call: FileCall, payload: bytes) -> None:
        """Keep an answer for those who ask again."""
        key = (call.client, call.raw)
        self._answers[key] = (payload, call.now_s)
        self._answers.move_to_end(key)
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)

    def send(self, call: FileCall, payload: bytes) -> None:
        """Queue a payload to whoever has asked."""
        address = bytes((0, call.client.system, call.client.component))
        packed = self.session.codec.pack_payload(FILE_TRANSFER, address + payload)
        call.peer.outbox.push(packed, Priority.REPLY)

    def later(self, call: FileCall, job: Callable[[], Any], then: Callable[[Any], bytes] = lambda _: b"") -> None:
        """Have a job done that waits for the disk, and answer when it is done."""

        def done(result: Any) -> None:
            if not isinstance(result, Exception):
                try:
                    result = then(result)
                except Refusal as refusal:
                    result = refusal
            self.finish(call, result)
            call.peer.outbox.flush(self.session.now_s)

        if not self.worker.submit(job, done):
            # The client asks again: by then there may be room.
            self._answers.pop((call.client, call.raw), None)
