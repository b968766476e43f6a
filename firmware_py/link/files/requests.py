"""Execution of file transfer requests: those that read, and those that write."""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from firmware_py.files.packed import PackedFile, PlainFile
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import Area, PathParts, mavlink_crc32
from firmware_py.link.files.payload import DATA_BYTES, Error, Opcode, Refusal
from firmware_py.link.files.sessions import (
    MIN_IDLE_S,
    BurstRead,
    FileAction,
    FileCall,
    FileSessions,
    FileUpload,
    OpenFile,
    ReplySender,
    encode_listing,
)
from firmware_py.link.files.tree import Origin, Tree, parse_path
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Station
from firmware_py.link.wire.timeouts import timeouts_of
from firmware_py.link.wire.worker import Worker

_MAX_LISTINGS = 8
_MAX_LISTING_AGE_S = 30.0  # pages of a listing come from one snapshot of the directory during this time
_MAX_UPLOADS = 4


class ReadingRequests:
    """Requests that do not change files."""

    def __init__(self, tree: Tree, sessions: FileSessions, replies: ReplySender) -> None:
        """Store the files, the open sessions and the sender of replies."""
        self._tree = tree
        self._sessions = sessions
        self._replies = replies
        self._listings: OrderedDict[tuple[Station, bytes], tuple[Any, float]] = OrderedDict()

    def actions(self) -> Mapping[int, FileAction]:
        """Return the functions that execute the requests, by opcode."""
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

        def page_data(entries: Any) -> bytes:
            return encode_listing(entries, start, with_time=with_time, max_bytes=DATA_BYTES)

        listing = self._listings.get(key)
        if start and listing is not None and call.now_s - listing[1] < _MAX_LISTING_AGE_S:
            return page_data(listing[0])
        parts, _ = parse_path(call.request.data)

        def store_listing(entries: Any) -> bytes:
            keep_latest(self._listings, key, (entries, call.now_s), _MAX_LISTINGS)
            return page_data(entries)

        self._replies.finish_later(call, partial(self._tree.list_directory, parts), store_listing)
        return None

    def _open_read(self, call: FileCall) -> None:
        parts, query = parse_path(call.request.data)
        generate = self._tree.generated.get(parts)
        if generate is None:
            area, area_parts = self._tree.find_area(parts)
            open_source: Callable[[], PlainFile | PackedFile | bytes] = partial(area.open_read, area_parts)
        else:
            open_source = partial(generate, query)
        self._sessions.close_idle_if_full(call.client, call.request.session, call.now_s)

        def open_session(source: PlainFile | PackedFile | bytes) -> bytes:
            file = OpenFile(source)
            try:
                self._sessions.close_idle_if_full(call.client, call.request.session, call.now_s)
            except Refusal:
                file.close()  # other clients have opened sessions in the meantime
                raise
            self._sessions.open(call.client, call.request.session, file, call.now_s)
            return struct.pack("<I", min(file.size, 0xFFFFFFFF))

        self._replies.finish_later(call, open_source, open_session)

    def _find_open_file(self, call: FileCall) -> OpenFile:
        handle = self._sessions.use(call.client, call.request.session, call.now_s).handle
        if not isinstance(handle, OpenFile):
            raise Refusal(Error.INVALID_SESSION)
        return handle

    def _read(self, call: FileCall) -> bytes:
        return self._find_open_file(call).read(call.request.offset, call.request.size or DATA_BYTES)

    def _burst_read(self, call: FileCall) -> None:
        file = self._find_open_file(call)
        if call.request.offset >= file.size:
            raise Refusal(Error.END_OF_FILE)
        session = self._sessions.use(call.client, call.request.session, call.now_s)
        if session.burst is None or session.burst.request != call.request:
            session.burst = BurstRead(call.request, call.client, file)
        session.burst.client = call.client

    def _checksum(self, call: FileCall) -> None:
        parts, query = parse_path(call.request.data)
        generate = self._tree.generated.get(parts)
        if generate is None:
            area, area_parts = self._tree.find_area(parts)
            self._replies.finish_later(call, partial(area.checksum, area_parts), _checksum_data)
        else:
            self._replies.finish_later(call, lambda: mavlink_crc32(generate(query)), _checksum_data)


def _checksum_data(checksum: int) -> bytes:
    return struct.pack("<I", checksum)


class WritingRequests:
    """Requests that change files or end sessions; the end of a session stores its upload."""

    def __init__(
        self, tree: Tree, sessions: FileSessions, replies: ReplySender, context: LinkContext, worker: Worker
    ) -> None:
        """Store the files, the open sessions, the sender of replies, the context and the worker for the disk."""
        self._tree = tree
        self._sessions = sessions
        self._replies = replies
        self._context = context
        self._worker = worker
        self._pending_stores = 0  # complete uploads that are being written to the disk

    def actions(self) -> Mapping[int, FileAction]:
        """Return the functions that execute the requests, by opcode."""
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
        self._close_idle_if_full(call)
        if parts not in self._tree.sinks:
            _, area_parts = self._tree.find_area(parts, write=True)
            if not area_parts:
                raise Refusal(Error.FILE_PROTECTED)
        self._sessions.open(call.client, call.request.session, FileUpload(parts), call.now_s)
        return b""

    def _close_idle_if_full(self, call: FileCall) -> None:
        """Discard the least recently used upload if the limit is reached; raise Refusal if it is not idle.

        An upload is in memory until it is stored.
        """
        sessions, own_key = self._sessions, (call.client, call.request.session)
        sessions.close_idle_if_full(*own_key, call.now_s)
        uploads = [
            key for key, session in sessions.items() if isinstance(session.handle, FileUpload) and key != own_key
        ]
        if len(uploads) + self._pending_stores < _MAX_UPLOADS:
            return
        if not uploads or call.now_s - sessions.last_use_s(*uploads[0]) < MIN_IDLE_S:
            raise Refusal(Error.NO_SESSIONS_AVAILABLE)
        sessions.discard(*uploads[0])

    def _open_write(self, call: FileCall) -> bytes | None:
        """Open a file with its present content, or a new file: older clients do not send CREATE first."""
        parts, _ = parse_path(call.request.data)
        if parts in self._tree.sinks:
            self._create(call)
            return struct.pack("<I", 0)
        self._close_idle_if_full(call)
        area, area_parts = self._tree.find_area(parts, write=True)

        def open_session(content: bytes) -> bytes:
            self._close_idle_if_full(call)  # again: other clients may have begun uploads in the meantime
            self._sessions.open(call.client, call.request.session, FileUpload(parts, content), call.now_s)
            return struct.pack("<I", len(content))

        self._replies.finish_later(call, partial(_read_existing, area, area_parts), open_session)
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
        _close(handle)
        return b""

    def _reset(self, call: FileCall) -> bytes | None:
        """End all sessions of a client and store its uploads: QGroundControl ends an upload by RESET.

        A reset long after the last part comes from a restarted client: the upload is incomplete and discarded.
        """
        uploads, has_stale_upload = [], False
        for number in self._sessions.numbers(call.client):
            idle_s = call.now_s - self._sessions.last_use_s(call.client, number)
            handle = self._sessions.end(call.client, number)
            if not isinstance(handle, FileUpload):
                _close(handle)
            elif idle_s <= timeouts_of(call.client.peer.transport).give_up_s:
                uploads.append(handle)
            else:
                has_stale_upload = True
        if has_stale_upload:
            raise Refusal(Error.FAIL, text="Upload aborted: file unchanged")
        if not uploads:
            return b""
        for upload in uploads[:-1]:
            self._store(call, upload, with_reply=False)
        self._store(call, uploads[-1])
        return None

    def _store(self, call: FileCall, upload: FileUpload, *, with_reply: bool = True) -> None:
        """Store an upload, or refuse it if it is incomplete, and reply afterwards."""
        if upload.gaps:
            if with_reply:
                name = "/".join(upload.path)
                self._replies.finish(call, Refusal(Error.FAIL, text=f"{name}: upload incomplete, send the file again"))
            return
        content = bytes(upload.content)

        def finish_store(result: object) -> None:
            self._pending_stores -= 1
            if with_reply:
                self._replies.finish(call, result if isinstance(result, Exception) else b"")
                call.peer.outbox.flush(self._context.now_s)

        def finish_sink(reason: str) -> None:
            name = "/".join(upload.path)
            finish_store(Refusal(Error.FAIL, text=f"{name}: {reason}") if reason else None)

        sink = self._tree.sinks.get(upload.path)
        if sink is not None:
            self._pending_stores += 1
            sink(content, Origin(*call.client.sender, call.now_s), finish_sink)
            return
        area, area_parts = self._tree.find_area(upload.path, write=True)
        self._pending_stores += 1
        if not self._worker.submit(partial(area.store, area_parts, content), finish_store):
            finish_store(Refusal(Error.FAIL, text="Disk busy: send the file again"))

    def _remove(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, area_parts = self._tree.find_area(parts, write=True)
        self._replies.finish_later(call, partial(area.remove, area_parts))

    def _make_directory(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        if len(parts) == 1 and parts[0] in self._tree.directory_names():
            raise Refusal(Error.FILE_EXISTS)
        area, area_parts = self._tree.find_area(parts, write=True)
        self._replies.finish_later(call, partial(area.make_directory, area_parts))

    def _remove_directory(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, area_parts = self._tree.find_area(parts, write=True)
        self._replies.finish_later(call, partial(area.remove_directory, area_parts))

    def _truncate(self, call: FileCall) -> None:
        parts, _ = parse_path(call.request.data)
        area, area_parts = self._tree.find_area(parts, write=True)
        self._replies.finish_later(call, partial(area.truncate, area_parts, call.request.offset))

    def _rename(self, call: FileCall) -> None:
        old, _, new = call.request.data.partition(b"\0")
        area, source = self._tree.find_area(parse_path(old)[0], write=True)
        target_area, target = self._tree.find_area(parse_path(new)[0], write=True)
        if area is not target_area:
            raise Refusal(Error.FILE_PROTECTED)
        self._replies.finish_later(call, partial(area.rename, source, target))


def _close(file: OpenFile | None) -> None:
    if file is not None:
        file.close()


def _read_existing(area: Area, parts: PathParts) -> bytes:
    """Return the content of a file, empty if it does not exist."""
    try:
        return area.read_whole(parts)
    except FileNotFoundError:
        return b""
