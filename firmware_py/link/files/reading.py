"""File transfer: listing, reading, checksums."""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from firmware_py.files.packed import PackedFile, PlainFile
from firmware_py.link.files.answers import Answers, FileAction, FileCall
from firmware_py.link.files.area import mavlink_crc32
from firmware_py.link.files.payload import DATA_BYTES, Error, Opcode, Refusal
from firmware_py.link.files.sessions import Burst, FileSessions, OpenFile, listing_data
from firmware_py.link.files.tree import Tree, parse_path
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Correspondent

_LISTINGS = 8
_LISTING_S = 30.0  # a listing is read on, page by page, for so long


class ReadingRequests:
    """The requests that change nothing."""

    def __init__(self, tree: Tree, sessions: FileSessions, answers: Answers) -> None:
        """Take the files there are, those that are open, what answers."""
        self._tree = tree
        self._sessions = sessions
        self._answers = answers
        self._listings: OrderedDict[tuple[Correspondent, bytes], tuple[Any, float]] = OrderedDict()

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
                reading.close()  # others were quicker
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
