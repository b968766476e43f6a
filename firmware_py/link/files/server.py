"""MAVLink FTP.

Sessions belong to a station, on all of its paths, and have the number that the client chooses: MAVSDK always uses 0,
MAVProxy several at once. A request that changes something is executed once; its reply is stored and sent again for
repeated requests.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.files.payload import (
    PAYLOAD,
    Error,
    FileRequest,
    Opcode,
    Refusal,
    burst_payload,
    nak_payload,
    parse_request,
    refusal_of,
)
from firmware_py.link.files.requests import ReadingRequests, WritingRequests
from firmware_py.link.files.sessions import (
    FILE_TRANSFER,
    PENDING,
    Answers,
    FileAction,
    FileCall,
    FileSession,
    FileSessions,
    OpenFile,
)
from firmware_py.link.files.tree import Tree
from firmware_py.link.peers import Peer, station_of
from firmware_py.link.wire.dialect import Message
from firmware_py.link.wire.worker import Worker

_FRAME_BYTES = 12 + 3 + PAYLOAD.size


class FileServer:
    """Answers FILE_TRANSFER_PROTOCOL."""

    def __init__(self, context: LinkContext, tree: Tree, worker: Worker) -> None:
        """Take the context, the files, and the worker for the disk."""
        self._sessions = FileSessions()
        self._answers = Answers(context, self._sessions, worker)
        self._actions: Mapping[int, FileAction] = {
            **ReadingRequests(tree, self._sessions, self._answers).actions(),
            **WritingRequests(tree, self._sessions, self._answers, context, worker).actions(),
        }

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {FILE_TRANSFER: self._answer}

    def _answer(self, peer: Peer, message: Message, now_s: float) -> None:
        raw = bytes(message.payload)
        if raw[3] in (Opcode.ACK, Opcode.NAK):
            return
        client = station_of(peer, message)
        try:
            request = parse_request(raw)
        except Refusal as refusal:
            sequence, number, opcode = PAYLOAD.unpack(raw)[:3]
            call = FileCall(FileRequest(sequence, number, opcode, 0, 0, b""), raw, client, now_s)
            self._answers.send(call, nak_payload(call.request, refusal))
            return
        call = FileCall(request, raw, client, now_s)
        self._sessions.expire(now_s)
        earlier = self._answers.find(call)
        if earlier is None:
            self._execute(call)
        elif earlier is not PENDING:
            self._answers.send(call, earlier)

    def _execute(self, call: FileCall) -> None:
        action = self._actions.get(call.request.opcode)
        if action is None:
            self._answers.finish(call, Refusal(Error.UNKNOWN_COMMAND))
            return
        self._answers.begin(call)
        try:
            data = action(call)
        except (Refusal, OSError) as failure:
            self._answers.finish(call, failure)
        else:
            if data is not None:
                self._answers.finish(call, data)

    def pump(self, peer: Peer, now_s: float) -> None:
        """Continue the burst reads of a peer, as far as its line has room."""
        if not self._sessions:
            return
        waiting = [
            session
            for _, session in self._sessions.items()
            if session.burst is not None and session.burst.client.peer is peer
        ]
        for session in waiting:
            count = peer.bulk_frames(_FRAME_BYTES, now_s)
            if count <= 0:
                break
            session.used_s = now_s
            self._send_parts(session, count, now_s)
        if any(session.burst is not None for session in waiting):
            peer.bulk.mark_unfinished()

    def _send_parts(self, session: FileSession, count: int, now_s: float) -> None:
        """Send the next parts of one burst read."""
        if session.burst is None or not isinstance(session.handle, OpenFile):
            return
        call = FileCall(session.burst.request, b"", session.burst.client, now_s)
        try:
            parts, ended = session.burst.next_parts(session.handle, count)
        except (Refusal, OSError) as failure:
            session.burst = None
            self._answers.send(call, nak_payload(call.request, refusal_of(failure)))
            return
        for place, (index, offset, data) in enumerate(parts):
            last = ended and place == len(parts) - 1
            self._answers.send(call, burst_payload(call.request, index, data, offset, last=last))
        call.peer.bulk.spend(len(parts) * _FRAME_BYTES)
        if ended:
            session.burst = None
