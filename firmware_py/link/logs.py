"""Log download and erasure: LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END, LOG_ERASE.

Log numbers form a ring, because ground stations expect different first numbers. N logs are listed as 0 to N - 1, as
MAVSDK expects; number N is the same log as 0, the newest one. So 1 to N are all logs from the oldest on, as
QGroundControl expects of ArduPilot. A log that is compressed on disk is listed and sent uncompressed.
"""

from __future__ import annotations

import contextlib
import struct
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from firmware_py.common.records import Severity
from firmware_py.files.packed import PackedFile, PlainFile, open_log, packed_path
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.frames import Packed
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.worker import Worker

_LOG_DATA, _LOG_ENTRY = 120, 118
_BLOCK_BYTES = 90
_DATA = struct.Struct("<IHB")  # offset, log number, bytes in the block; the block follows
_ENTRY = struct.Struct("<IIHHH")  # UTC [s], size in bytes, log number, number of logs, last log number
_FRAME_BYTES = 12 + _DATA.size + _BLOCK_BYTES  # header and checksum have 12 bytes
_MAX_PEERS = 4  # served at the same time; each has a file open
_SILENT_S = 10.0  # silence after which another peer may replace a download
_MAX_RANGES = 64  # queued for one peer; MAVProxy requests up to twenty gaps together
_CHUNK_BYTES = 512 * _BLOCK_BYTES  # of one request of MAVSDK and QGroundControl
_MAX_TICK_BYTES = 256 * _BLOCK_BYTES  # for requests of a whole log; a receive buffer of 208 KiB stores four ticks
_MAX_LOGS = 0xFFFE  # numbers have 16 bits, and one more than the number of logs is used


class LogFile(NamedTuple):
    """Log at the time of the listing."""

    path: Path
    size: int  # uncompressed, in bytes
    modified_s: int  # since 1970


class _Range(NamedTuple):
    """Requested bytes of a log; `end` may exceed the log. The list may change before they are sent."""

    number: int
    log: LogFile
    start: int
    end: int


class _Download:
    """Download of one peer: entries of the list, then ranges of one log."""

    def __init__(self) -> None:
        self.entries: Iterator[Packed] | None = None
        self.ranges: deque[_Range] = deque()
        self.logs: tuple[LogFile, ...] = ()  # the list that was sent to this peer, to which its numbers refer
        self.open_log: LogFile | None = None
        self.file: PlainFile | PackedFile | None = None
        self.granted_bytes = _MAX_TICK_BYTES  # of ranges that are longer than a chunk, in this tick

    def read(self, log: LogFile, offset: int, count: int) -> bytes:
        """Read bytes of a log; raise OSError if that fails."""
        if self.file is None or self.open_log != log:
            self.close()
            self.file = open_log(log.path)
            self.open_log = log
        return self.file.read(offset, count)

    def close(self) -> None:
        """Close the file."""
        if self.file is not None:
            self.file.close()
        self.file = self.open_log = None


class LogServer:
    """Lists, sends and erases logs. `catalogue` returns their paths by number; the newest has the highest number."""

    def __init__(
        self, context: LinkContext, catalogue: Callable[[], Mapping[int, Path]], worker: Worker, *, logging: bool
    ) -> None:
        """Store the arguments; with `logging` the newest log is being written and is not erased."""
        self._context = context
        self._catalogue = catalogue
        self._worker = worker
        self._logging = logging
        self._downloads: OrderedDict[Peer, _Download] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handlers by message number."""
        return {
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST: self._list,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA: self._data,
            mavlink.MAVLINK_MSG_ID_LOG_ERASE: self._erase,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END: self._end,
        }

    # ------------------------------------------------------------------ requests

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        start, end = message.start, message.end

        def send_list(logs: tuple[LogFile, ...] | Exception) -> None:
            download = self._download(peer)
            if download is None:
                return
            download.logs = logs if isinstance(logs, tuple) else ()
            download.entries = self._entries(download.logs, start, end)

        self._worker.submit(self._find_logs, send_list)

    def _data(self, peer: Peer, message: Message, now_s: float) -> None:
        download = self._download(peer)
        if download is None:
            self._context.send_text_limited(
                peer, Severity.WARNING, "Log download refused: server busy, try again", now_s
            )
        elif download.logs:
            self._queue_range(peer, download, message, now_s)
        else:
            # The station uses the list of an earlier connection.
            def queue(logs: tuple[LogFile, ...] | Exception) -> None:
                download.logs = logs if isinstance(logs, tuple) else ()
                self._queue_range(peer, download, message, self._context.now_s)

            self._worker.submit(self._find_logs, queue)

    def _queue_range(self, peer: Peer, download: _Download, message: Message, now_s: float) -> None:
        count = len(download.logs)
        if not count or message.id > count:
            self._context.send_text_limited(peer, Severity.WARNING, f"Log {message.id} does not exist", now_s)
            return
        log = download.logs[message.id % count]
        span = _Range(message.id, log, message.ofs, message.ofs + message.count)
        if download.ranges and download.ranges[0][:2] != span[:2]:
            download.ranges.clear()
        if any(queued.start <= span.start and span.end <= queued.end for queued in download.ranges):
            return  # already queued
        if len(download.ranges) < _MAX_RANGES:
            download.ranges.append(span)

    def _end(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        download = self._downloads.get(peer)
        if download is not None:
            download.ranges.clear()
            download.close()

    def _erase(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        snapshot = self._context.snapshot
        if snapshot is None or snapshot.armed:
            self._context.send_text_limited(peer, Severity.WARNING, "Log erase refused: armed, disarm first", now_s)
            return
        for download in self._downloads.values():
            download.ranges.clear()
            download.entries = None
            download.logs = ()
            download.close()

        def report(erased: int | Exception) -> None:
            if isinstance(erased, Exception):
                self._context.send_text_all(Severity.ERROR, f"Logs could not be erased: {erased}"[:200])
            else:
                self._context.send_text_all(Severity.NOTICE, f"{erased} logs erased")

        self._worker.submit(self._erase_all, report)

    # ------------------------------------------------------------------ on the worker's thread

    def _find_logs(self) -> tuple[LogFile, ...]:
        """Return the logs in the order of the ring: the newest, then the others from the oldest on."""
        logs = []
        for _, path in deque(sorted(self._catalogue().items()), _MAX_LOGS):
            try:
                size, modified_s = _size_and_time(path)
            except OSError:
                continue  # removed or damaged since the listing
            logs.append(LogFile(path, min(size, 0xFFFFFFFF), max(0, int(modified_s)) & 0xFFFFFFFF))
        return (*logs[-1:], *logs[:-1])

    def _erase_all(self) -> int:
        logs = sorted(self._catalogue().items())
        erased = logs[:-1] if self._logging else logs
        for _, path in erased:
            for name in {path, packed_path(path)}:  # it may have been compressed since the listing
                name.unlink(missing_ok=True)
        return len(erased)

    # ------------------------------------------------------------------ replies

    def _download(self, peer: Peer) -> _Download | None:
        """Return the download of a peer, a new one if it has none; None if the maximum number is active."""
        download = self._downloads.get(peer)
        if download is None:
            self._remove_old_downloads(self._context.now_s)
            if len(self._downloads) >= _MAX_PEERS:
                return None
            download = self._downloads[peer] = _Download()
        return download

    def _remove_old_downloads(self, now_s: float) -> None:
        """Remove downloads of disconnected peers; at the maximum number also idle ones and those of silent peers."""
        present = set(self._context.all_peers())
        for peer, download in tuple(self._downloads.items()):
            is_idle = not download.ranges and download.entries is None
            is_idle = is_idle or now_s - peer.last_frame_s > _SILENT_S
            if peer not in present or (is_idle and len(self._downloads) >= _MAX_PEERS):
                download.close()
                del self._downloads[peer]

    def _entries(self, logs: tuple[LogFile, ...], start: int, end: int) -> Iterator[Packed]:
        count = len(logs)
        if not count:
            yield self._context.codec.pack_payload(_LOG_ENTRY, bytes(_ENTRY.size))
            return
        # Numbers 0 and `count` are the same log: a request for all numbers from 0 on gets it once.
        last = min(end, count if start > 0 or end <= count else count - 1)
        for number in range(start, last + 1):
            log = logs[number % count]
            payload = _ENTRY.pack(log.modified_s, log.size, number, count, max(last, count - 1))
            yield self._context.codec.pack_payload(_LOG_ENTRY, payload)

    def update(self, now_s: float) -> None:  # noqa: ARG002 - a service like the others
        """Reset the bytes that downloads of whole logs may send in this tick."""
        for download in self._downloads.values():
            download.granted_bytes = _MAX_TICK_BYTES

    def pump(self, peer: Peer, now_s: float) -> None:
        """Continue the download of a peer within the free capacity of its line."""
        download = self._downloads.get(peer)
        if download is None or not (download.ranges or download.entries):
            return
        frames = peer.bulk_frames(_FRAME_BYTES, now_s)
        if frames > 0 and download.entries is not None:
            sent = 0
            for packed in download.entries:
                peer.outbox.push(packed, Priority.REPLY)
                sent += 1
                if sent >= frames:
                    break
            else:
                download.entries = None
            peer.bulk.spend(sent * _FRAME_BYTES)
            frames -= sent
        while frames > 0 and download.ranges:
            sent = self._send_range(peer, download, frames)
            if not sent:
                break
            frames -= sent
            peer.bulk.spend(sent * _FRAME_BYTES)
        if download.entries is not None or (download.ranges and frames <= 0):
            peer.bulk.mark_unfinished()

    def _send_range(self, peer: Peer, download: _Download, frames: int) -> int:
        """Queue blocks of the first range; return their number."""
        number, log, start, end = download.ranges[0]
        if end - start > _CHUNK_BYTES and peer.transport.is_datagram:
            # The station does not acknowledge such a stream, and a slow reader would lose more.
            frames = min(frames, download.granted_bytes // _BLOCK_BYTES)
            download.granted_bytes -= frames * _BLOCK_BYTES
            if frames <= 0:
                return 0
        try:
            data = download.read(log, start, min(frames * _BLOCK_BYTES, max(0, min(end, log.size) - start)))
        except OSError:
            download.ranges.clear()
            download.close()
            return 0
        pack, push = self._context.codec.pack_payload, peer.outbox.push
        blocks = [data[begin : begin + _BLOCK_BYTES] for begin in range(0, len(data), _BLOCK_BYTES)]
        for index, block in enumerate(blocks):
            header = _DATA.pack(start + index * _BLOCK_BYTES, number, len(block))
            push(pack(_LOG_DATA, header + block), Priority.REPLY)
        sent, start = len(blocks), start + len(data)
        if start < min(end, log.size) and data:
            download.ranges[0] = _Range(number, log, start, end)
            return sent
        if not sent:
            # Only for a request beyond the end: MAVProxy stops at an empty block even if earlier blocks were lost.
            push(pack(_LOG_DATA, _DATA.pack(start, number, 0)), Priority.REPLY)
            sent = 1
        download.ranges.popleft()
        return sent


def _size_and_time(path: Path) -> tuple[int, float]:
    """Return uncompressed size and modification time of a log; raise OSError if it cannot be read."""
    with contextlib.closing(open_log(path)) as file:
        return file.size, file.modified_s
