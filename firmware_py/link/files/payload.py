"""Payload of FILE_TRANSFER_PROTOCOL: encoding of requests and replies (MAVLink guide, services/ftp)."""

from __future__ import annotations

import errno
import struct
from enum import IntEnum
from typing import NamedTuple

# Sequence, session, opcode, size, opcode of the request (in replies), 1 at the end of a burst, padding, offset, data.
PAYLOAD = struct.Struct("<HBBBBBBI239s")
DATA_BYTES = 239


class Opcode(IntEnum):
    """Requests and replies."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN_READ = 4
    READ = 5
    CREATE = 6
    WRITE = 7
    REMOVE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_WRITE = 11
    TRUNCATE = 12
    RENAME = 13
    CHECKSUM = 14
    BURST_READ = 15
    LIST_WITH_TIME = 16
    ACK = 128
    NAK = 129


class Error(IntEnum):
    """Reasons for a refusal."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class Refusal(Exception):  # noqa: N818 - a reply, not a fault of the program
    """Refusal of a request: `number` is the errno for FAIL_ERRNO, `text` a STATUSTEXT for the operator."""

    def __init__(self, error: Error, number: int = 0, text: str = "") -> None:
        """Store the error code, the errno and the text."""
        self.error = error
        self.number = number
        self.text = text


_ERROR_OF_ERRNO = {
    errno.ENOENT: Error.FILE_NOT_FOUND,
    errno.ENOTDIR: Error.FILE_NOT_FOUND,
    errno.EEXIST: Error.FILE_EXISTS,
    errno.EACCES: Error.FILE_PROTECTED,
    errno.EPERM: Error.FILE_PROTECTED,
    errno.EROFS: Error.FILE_PROTECTED,
    errno.ELOOP: Error.FILE_PROTECTED,  # a symbolic link, which is never followed
}


def refusal_of(failure: Exception) -> Refusal:
    """Return the refusal for an exception."""
    if isinstance(failure, Refusal):
        return failure
    if isinstance(failure, OSError) and failure.errno is not None:
        error = _ERROR_OF_ERRNO.get(failure.errno)
        if error is not None:
            return Refusal(error)
        return Refusal(Error.FAIL_ERRNO, failure.errno & 0xFF)
    return Refusal(Error.FAIL)


class FileRequest(NamedTuple):
    """One request as received; only `size` is checked."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes  # has `size` bytes


def parse_request(payload: bytes) -> FileRequest:
    """Decode a payload of 251 bytes; raise Refusal if its size field exceeds DATA_BYTES."""
    sequence, session, opcode, size, _, _, _, offset, data = PAYLOAD.unpack(payload)
    if size > DATA_BYTES:
        raise Refusal(Error.INVALID_DATA_SIZE)
    return FileRequest(sequence, session, opcode, size, offset, data[:size])


def ack_payload(request: FileRequest, data: bytes = b"", *, offset: int | None = None) -> bytes:
    """Return the ACK of a request as a payload."""
    reply_offset = request.offset if offset is None else offset
    sequence = (request.sequence + 1) & 0xFFFF
    return PAYLOAD.pack(sequence, request.session, Opcode.ACK, len(data), request.opcode, 0, 0, reply_offset, data)


def nak_payload(request: FileRequest, refusal: Refusal) -> bytes:
    """Return the NAK of a request as a payload."""
    data = bytes((refusal.error,))
    if refusal.error is Error.FAIL_ERRNO:
        data += bytes((refusal.number,))
    sequence = (request.sequence + 1) & 0xFFFF
    return PAYLOAD.pack(sequence, request.session, Opcode.NAK, len(data), request.opcode, 0, 0, request.offset, data)


def burst_payload(request: FileRequest, index: int, data: bytes, offset: int, *, is_last: bool) -> bytes:
    """Return part `index` of the reply to a burst read as a payload; each part has the next sequence number."""
    sequence = (request.sequence + 1 + index) & 0xFFFF
    return PAYLOAD.pack(sequence, request.session, Opcode.ACK, len(data), request.opcode, is_last, 0, offset, data)
