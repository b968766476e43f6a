"""File transfer: the actions of reading and writing requests."""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from firmware_py.files.packed import PackedFile, PlainFile
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import Area, Parts, mavlink_crc32
from firmware_py.link.files.payload import DATA_BYTES, Error, Opcode, Refusal
from firmware_py.link.files.sessions import (
    IDLE_S,
    Answers,
    Burst,
    FileAction,
    FileCall,
    FileSessions,
    FileUpload,
    OpenFile,
    listing_data,
)
from firmware_py.link.files.tree import Origin, Tree, parse_path
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Station
from firmware_py.link.wire.timeouts import timeouts_of
from firmware_py.link.wire.worker import Worker

_LISTINGS = 8
_LISTING_S = 30.0  # a listing is read on, page by page, for so long

_MAX_UPLOADS = 4


class ReadingRequests:
    """Requests that change nothing."""

    def __init__(self, tree: Tree, sessions: FileSessions, answers: Answers) -> None:
        """Take the files, the open sessions and the sender of replies."""
        self._tree = tree
        self._sessions = sessions
        self._answers = answers
        self._listings: OrderedDict[tuple[Station, bytes], tuple[Any, float]] = OrderedDict()

    def actions(self) -> Mapping[int, FileAction]:
        """Return the opcodes carried out here."""
        return {
            Opcode.NONE: lambda _: b"",
            Opcode.LIST: self._list,
            Opcode.LIST_WITH_TIME: self._list,
            Opcode.OPEN_READ: self._open_read,
            Opcode.READ: self._read,
            Opcode.BURST_READ: self._burst_read,
            Opcode.CHECKSUM: self._checksum,
        }

    def _list(self, call: FileCall) -> bytes | None:
        key = (call.client, call.request.data)
        start, with_time = call.request.offset, call.request.opcode == Opcode.LIST_WITH_TIME

        def page(entries: Any) -> bytes:
            return listing_data(entries, start, with_time=with_time, room=DATA_BYTES)

        listing, listed_s = self._listings.get(key, (None, 0.0))
        if start and listing is not None and call.now_s - listed_s < _LISTING_S:
            return page(listing)
        parts, _ = parse_path(call.request.data)

        def keep(entries: Any) -> bytes:
            keep_latest(self._listings, key, (entries, call.now_s), _LISTINGS)
            return page(entries)

        self._answers.finish_later(call, partial(self._tree.listing, parts), keep)
        return None

    def _open_read(self, call: FileCall) -> None:
        parts, query = parse_path(call.request.data)
        make = self._tree.generated.get(parts)
        if make is None:
            area, within = self._tree.area(parts)
            source: Callable[[], PlainFile | PackedFile | bytes] = partial(area.open_read, within)
        else:
            source = partial(make, query)
        self._sessions.check_room(call.client, call.request.session, call.now_s)

        def opened(content: PlainFile | PackedFile | bytes) -> bytes:
            reading = OpenFile(parts, content)
            try:
                self._sessions.check_room(call.client, call.request.session, call.now_s)
            except Refusal:
                reading.close()  # other clients have taken the room meanwhile
                raise
            self._sessions.open(call.client, call.request.session, reading, call.now_s)
            return struct.pack("<I", min(reading.size, 0xFFFFFFFF))

        self._answers.finish_later(call, source, opened)

    def _reading(self, call: FileCall) -> OpenFile:
        handle = self._sessions.use(call.client, call.request.session, call.now_s).handle
        if not isinstance(handle, OpenFile):
            raise Refusal(Error.INVALID_SESSION)
        return handle

    def _read(self, call: FileCall) -> bytes:
        return self._reading(call).read(call.request.offset, call.request.size or DATA_BYTES)

    def _burst_read(self, call: FileCall) -> None:
        reading = self._reading(call)
        if call.request.offset >= reading.size:
            raise Refusal(Error.END_OF_FILE)
        session = self._sessions.use(call.client, call.request.session, call.now_s)
        if session.burst is None or session.burst.request != call.request:
            session.burst = Burst(call.request, call.client)
        session.burst.client = call.client

    def _checksum(self, call: FileCall) -> None:
        parts, query = parse_path(call.request.data)
        make = self._tree.generated.get(parts)
        if make is None:
            area, within = self._tree.area(parts)
            self._answers.finish_later(call, partial(area.checksum, within), _checksum_data)
        else:
            self._answers.finish_later(call, lambda: mavlink_crc32(make(query)), _checksum_data)


def _checksum_data(checksum: int) -> bytes:
    return struct.pack("<I", checksum)


class WritingRequests:
    """Requests that change files, and those that end sessions, which stores uploads."""

    def __init__(
        self, tree: Tree, sessions: FileSessions, answers: Answers, context: LinkContext, worker: Worker
    ) -> None:
        """Take the files, the open sessions, the sender of replies, the context and the worker for the disk."""
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
        """Make room for an upload, since each takes memory until it is stored; Refusal if that is not possible."""
        sessions, own = self._sessions, (call.client, call.request.session)
        sessions.check_room(*own, call.now_s)
        uploads = [key for key, session in sessions.items() if isinstance(session.handle, FileUpload) and key != own]
        if len(uploads) + self._storing < _MAX_UPLOADS:
            return
        if not uploads or call.now_s - sessions.used_s(*uploads[0]) < IDLE_S:
            raise Refusal(Error.NO_SESSIONS_AVAILABLE)
        sessions.discard(*uploads[0])

    def _open_write(self, call: FileCall) -> bytes | None:
        """Open a file as it is, or a new one, since older clients do not create it first."""
        parts, _ = parse_path(call.request.data)
        if parts in self._tree.sinks:
            self._create(call)
            return struct.pack("<I", 0)
        self._check_room(call)
        area, within = self._tree.area(parts, write=True)

        def opened(content: bytes) -> bytes:
            self._check_room(call)  # again: other clients may have taken the room meanwhile
            self._sessions.open(call.client, call.request.session, FileUpload(parts, content), call.now_s)
            return struct.pack("<I", len(content))

        self._answers.finish_later(call, partial(_content, area, within), opened)
        return None

    def _write(self, call: FileCall) -> bytes:
        handle = self._sessions.use(call.client, call.request.session, call.now_s).handle
        if not isinstance(handle, FileUpload):
            raise Refusal(Error.INVALID_SESSION)
        handle.write(call.request.offset, call.request.data)
        # The number of written bytes, as ArduPilot and PX4 reply.
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
        """End all sessions of a client; QGroundControl ends its uploads by it.

        A reset long after the last part comes from a program that starts: the upload is incomplete and dropped.
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
            raise Refusal(Error.FAIL, text="Upload aborted: file unchanged")
        if not uploads:
            return b""
        for upload in uploads[:-1]:
            self._store(call, upload, silent=True)
        self._store(call, uploads[-1])
        return None

    def _store(self, call: FileCall, upload: FileUpload, *, silent: bool = False) -> None:
        """Store an upload, and reply when that is done."""
        if upload.gaps:
            if not silent:
                name = "/".join(upload.path)
                self._answers.finish(call, Refusal(Error.FAIL, text=f"{name}: upload incomplete, send the file again"))
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
            stored(Refusal(Error.FAIL, text="Disk busy: send the file again"))

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
    """Return the content of a file, empty if it does not exist."""
    try:
        return area.read_whole(within)
    except FileNotFoundError:
        return b""
