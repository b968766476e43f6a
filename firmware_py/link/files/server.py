"""MAVLink FTP server.

A session belongs to one station on all of its links. The client chooses its number: MAVSDK always uses 0, MAVProxy
several at once. A request that changes something is executed once; its reply is stored and sent again for repeated
requests.
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
    FILE_TRANSFER_MESSAGE,
    PENDING,
    BurstRead,
    FileAction,
    FileCall,
    FileSession,
    FileSessions,
    ReplySender,
)
from firmware_py.link.files.tree import Tree
from firmware_py.link.peers import Peer, station_of
from firmware_py.link.wire.dialect import Message
from firmware_py.link.wire.worker import Worker

_FRAME_BYTES = 12 + 3 + PAYLOAD.size  # header and checksum of MAVLink 2; network, system and component of the target


class FileServer:
    """Executes the requests in FILE_TRANSFER_PROTOCOL messages and replies to them."""

    def __init__(self, context: LinkContext, tree: Tree, worker: Worker) -> None:
        """Store the context, the files, and the worker for the disk."""
        self._sessions = FileSessions()
        self._replies = ReplySender(context, self._sessions, worker)
        self._actions: Mapping[int, FileAction] = {
            **ReadingRequests(tree, self._sessions, self._replies).actions(),
            **WritingRequests(tree, self._sessions, self._replies, context, worker).actions(),
        }

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {FILE_TRANSFER_MESSAGE: self._handle_message}

    def _handle_message(self, peer: Peer, message: Message, now_s: float) -> None:
        raw = bytes(message.payload)
        if raw[3] in (Opcode.ACK, Opcode.NAK):
            return
        client = station_of(peer, message)
        try:
            request = parse_request(raw)
        except Refusal as refusal:
            sequence, session, opcode = PAYLOAD.unpack(raw)[:3]
            call = FileCall(FileRequest(sequence, session, opcode, 0, 0, b""), raw, client, now_s)
            self._replies.send(call, nak_payload(call.request, refusal))
            return
        call = FileCall(request, raw, client, now_s)
        self._sessions.expire(now_s)
        stored_reply = self._replies.find_stored(call)
        if stored_reply is None:
            self._execute(call)
        elif stored_reply is not PENDING:
            self._replies.send(call, stored_reply)

    def _execute(self, call: FileCall) -> None:
        action = self._actions.get(call.request.opcode)
        if action is None:
            self._replies.finish(call, Refusal(Error.UNKNOWN_COMMAND))
            return
        self._replies.begin(call)
        try:
            data = action(call)
        except (Refusal, OSError) as failure:
            self._replies.finish(call, failure)
        else:
            if data is not None:
                self._replies.finish(call, data)

    def pump(self, peer: Peer, now_s: float) -> None:
        """Continue the burst reads of a peer within the free capacity of its link."""
        if not self._sessions:
            return
        bursts = [
            (session, burst)
            for _, session in self._sessions.items()
            if (burst := session.burst) is not None and burst.client.peer is peer
        ]
        for session, burst in bursts:
            max_parts = peer.bulk_frames(_FRAME_BYTES, now_s)
            if max_parts <= 0:
                break
            session.last_use_s = now_s
            self._send_parts(session, burst, max_parts, now_s)
        if any(session.burst is not None for session, _ in bursts):
            peer.bulk.mark_unfinished()

    def _send_parts(self, session: FileSession, burst: BurstRead, max_parts: int, now_s: float) -> None:
        """Send the next parts of one burst read."""
        call = FileCall(burst.request, b"", burst.client, now_s)
        try:
            parts, is_end = burst.next_parts(max_parts)
        except (Refusal, OSError) as failure:
            session.burst = None
            self._replies.send(call, nak_payload(call.request, refusal_of(failure)))
            return
        for position, (index, offset, data) in enumerate(parts, 1):
            is_last = is_end and position == len(parts)
            self._replies.send(call, burst_payload(call.request, index, data, offset, is_last=is_last))
        call.peer.bulk.spend(len(parts) * _FRAME_BYTES)
        if is_end:
            session.burst = None
