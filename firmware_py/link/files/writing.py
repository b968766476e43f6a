"""File transfer: uploads and what else changes the disk, inside the areas that may be written to."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import partial

from firmware_py.link.context import LinkContext
from firmware_py.link.files.answers import Answers, FileAction, FileCall
from firmware_py.link.files.area import Area, Parts
from firmware_py.link.files.payload import Error, Opcode, Refusal
from firmware_py.link.files.sessions import IDLE_S, FileSessions, FileUpload
from firmware_py.link.files.tree import Origin, Tree, parse_path
from firmware_py.link.wire.timeouts import timeouts_of
from firmware_py.link.wire.worker import Worker

_MOST_UPLOADS = 4


class WritingRequests:
    """The requests that change something, and those that end sessions: an upload takes its place then."""

    def __init__(
        self, tree: Tree, sessions: FileSessions, answers: Answers, context: LinkContext, worker: Worker
    ) -> None:
        """Take the files there are, those that are open, what answers, and who waits for the disk."""
        self._tree = tree
        self._sessions = sessions
        self._answers = answers
        self._context = context
        self._worker = worker
        self._storing = 0  # uploads on their way to the disk

    def actions(self) -> Mapping[int, FileAction]:
        """Return the opcodes carried out here."""
        return {
            Opcode.TERMINATE: self._terminate,
            Opcode.RESET: self._reset,
            Opcode.CREATE: self._create,
            Opcode.OPEN_WRITE: self._open_write,
            Opcode.WRITE: self._write,
            Opcode.REMOVE: self._remove,
            Opcode.CREATE_DIRECTORY: self._make_directory,
            Opcode.REMOVE_DIRECTORY: self._remove_directory,
            Opcode.TRUNCATE: self._truncate,
            Opcode.RENAME: self._rename,
        }

    def _create(self, call: FileCall) -> bytes:
        parts, _ = parse_path(call.request.data)
        self._check_room(call)
        if parts not in self._tree.sinks:
            _, within = self._tree.area(parts, write=True)
            if not within:
                raise Refusal(Error.FILE_PROTECTED)
        self._sessions.open(call.client, call.request.session, FileUpload(parts), call.now_s)
        return b""

    def _check_room(self, call: FileCall) -> None:
        """Generate sure that an upload may begin: each takes memory until it is on disk."""
        sessions, own = self._sessions, (call.client, call.request.session)
        sessions.check_room(*own, call.now_s)
        uploads = [key for key, session in sessions.items() if isinstance(session.handle, FileUpload) and key != own]
        if len(uploads) + self._storing < _MOST_UPLOADS:
            return
        if not uploads or call.now_s - sessions.used_s(*uploads[0]) < IDLE_S:
            raise Refusal(Error.NO_SESSIONS_AVAILABLE)
        sessions.discard(*uploads[0])

    def _open_write(self, call: FileCall) -> bytes | None:
        """Open a file as it is, or a new one: older clients never create one before."""
        parts, _ = parse_path(call.request.data)
        if parts in self._tree.sinks:
            self._create(call)
            return struct.pack("<I", 0)
        self._check_room(call)
        area, within = self._tree.area(parts, write=True)

        def opened(content: bytes) -> bytes:
            self._check_room(call)  # again: others may have been quicker
            self._sessions.open(call.client, call.request.session, FileUpload(parts, content), call.now_s)
            return struct.pack("<I", len(content))

        self._answers.finish_later(call, partial(_content, area, within), opened)
        return None

    def _write(self, call: FileCall) -> bytes:
        handle = self._sessions.use(call.client, call.request.session, call.now_s).handle
        if not isinstance(handle, FileUpload):
            raise Refusal(Error.INVALID_SESSION)
        handle.write(call.request.offset, call.request.data)
        # As ArduPilot and PX4 do: how much was written.
        return struct.pack("<I", len(call.request.data))

    def _terminate(self, call: FileCall) -> bytes | None:
        handle = self._sessions.end(call.client, call.request.session)
        if isinstance(handle, FileUpload):
            self._store(call, handle)
            return None
        if handle is not None:
            handle.close()
        return b""

    def _reset(self, call: FileCall) -> bytes | None:
        """End all sessions of a client; QGroundControl ends its uploads in this way, at once.

        One that comes long after the last part is another program's, which begins: the upload was broken off.
        """
        uploads, late = [], False
        for number in self._sessions.numbers(call.client):
            silent_s = call.now_s - self._sessions.used_s(call.client, number)
            handle = self._sessions.end(call.client, number)
            if isinstance(handle, FileUpload) and silent_s <= timeouts_of(call.client.peer.transport).give_up_s:
                uploads.append(handle)
            elif handle is not None:
                late = late or isinstance(handle, FileUpload)
                handle.close()
        if late:
            raise Refusal(Error.FAIL, text="An upload was broken off and is not kept: the file is as it was")
        if not uploads:
            return b""
        for upload in uploads[:-1]:
            self._store(call, upload, silent=True)
        self._store(call, uploads[-1])
        return None

    def _store(self, call: FileCall, upload: FileUpload, *, silent: bool = False) -> None:
        """Let an upload take its place, and answer when it has."""
        if upload.gaps:
            if not silent:
                name = "/".join(upload.path)
                self._answers.finish(call, Refusal(Error.FAIL, text=f"{name}: a part never came: send the file again"))
            return
        content = bytes(upload.content)

        def stored(result: object) -> None:
            self._storing -= 1
            if not silent:
                self._answers.finish(call, result if isinstance(result, Exception) else b"")
                call.peer.outbox.flush(self._context.now_s)

        def put_in_force(reason: str) -> None:
            name = "/".join(upload.path)
            stored(Refusal(Error.FAIL, text=f"{name}: {reason}") if reason else None)

        sink = self._tree.sinks.get(upload.path)
        if sink is not None:
            self._storing += 1
            sink(content, Origin(*call.client.sender, call.now_s), put_in_force)
            return
        area, within = self._tree.area(upload.path, write=True)
        self._storing += 1
        if not self._worker.submit(partial(area.store, within, content), stored):
            stored(Refusal(Error.FAIL, text="The disk has too much to do: send the file again"))

    def _remove(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, within = self._tree.area(parts, write=True)
        self._answers.finish_later(call, partial(area.remove, within))

    def _make_directory(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        if parts and len(parts) == 1 and parts[0] in self._tree.directories():
            raise Refusal(Error.FILE_EXISTS)
        area, within = self._tree.area(parts, write=True)
        self._answers.finish_later(call, partial(area.make_directory, within))

    def _remove_directory(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, within = self._tree.area(parts, write=True)
        self._answers.finish_later(call, partial(area.remove_directory, within))

    def _truncate(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, within = self._tree.area(parts, write=True)
        self._answers.finish_later(call, partial(area.truncate, within, call.request.offset))

    def _rename(self, call: FileCall) -> None:
        old, _, new = call.request.data.partition(b"\0")
        area, source = self._tree.area(parse_path(old)[0], write=True)
        other, target = self._tree.area(parse_path(new)[0], write=True)
        if area is not other:
            raise Refusal(Error.FILE_PROTECTED)
        self._answers.finish_later(call, partial(area.rename, source, target))


def _content(area: Area, within: Parts) -> bytes:
    """Return what is in a file, nothing for one that is not there yet."""
    try:
        return area.read_whole(within)
    except FileNotFoundError:
        return b""
