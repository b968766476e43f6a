"""The state as one file: a line with format, length and SHA-256, then JSON with the content of each name.

Texts stand as they are, records (`NAME.record`) as base64.

In a state directory, such a file named PENDING_IMPORT is an import that is in force and not yet in the slots.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.files.reading import UNFIT, read_regular
from firmware_py.files.writing import PRIVATE_MODE, set_aside, sync_directory, write_atomically

RECORD_ENDING: Final = ".record"  # of what this program alone writes and reads; everything else is text
FORMAT: Final = 2  # 1: the records were texts, too
MAX_EXPORT_BYTES: Final = 64 << 20  # more than all slots can hold, escaped
# The largest slot that is read or written, by the ending of its name: no plan comes near it.
KEY_ENDING: Final = ".key"
_LARGEST_BYTES: Final = {".plan": 4 << 20, KEY_ENDING: 64 << 10}
_LARGEST_BYTES_ELSE: Final = 1 << 20
MAX_HEAD_BYTES: Final = 64  # of a slot
MAX_ABOUT_ENTRIES, MAX_ABOUT_CHARACTERS = 8, 200
PENDING_IMPORT: Final = "import.awaited"
_DONE: Final = ".import.done"
_HEAD = re.compile(rb"# rambler exported state (\d{1,9}) (\d{1,12}) ([0-9a-f]{64})\n")
_NAME = re.compile(r"[a-z]{1,32}\.[a-z]{1,8}")  # of a file of the state: it leads nowhere else
_ANY_HEAD = b"# rambler exported state "


class BrokenExportError(ValueError):
    """What was read is no exported state, or none that this version can read; the text names the remedy."""


def largest_bytes(name: str) -> int:
    """Return the size of the largest slot of a name."""
    return _LARGEST_BYTES.get(Path(name).suffix, _LARGEST_BYTES_ELSE)


class Export(msgspec.Struct, frozen=True):
    """The content of each name, None for one that holds nothing; `about` says where it comes from."""

    files: Mapping[str, bytes | None]
    about: Mapping[str, str] = msgspec.field(default_factory=dict)

    def content(self, name: str) -> bytes | None:
        """Return what a name holds."""
        return self.files.get(name)


def pack(export: Export) -> bytes:
    """Return the file."""
    files = {name: None if content is None else _to_text(name, content) for name, content in export.files.items()}
    body = json.dumps({"about": dict(export.about), "files": files}, indent=1).encode() + b"\n"
    return b"# rambler exported state %d %d %s\n" % (FORMAT, len(body), _digest(body)) + body


def unpack(data: bytes) -> Export:
    """Read what `pack` has written; BrokenExportError."""
    head = _HEAD.match(data)
    if head is None:
        known = data.startswith(_ANY_HEAD)
        raise BrokenExportError(f"is {'damaged' if known else 'no state that rambler has exported'}")
    if int(head[1]) != FORMAT:
        remedy = "take a newer version" if int(head[1]) > FORMAT else "export that state with this version"
        raise BrokenExportError(f"is of format {int(head[1])}, this version reads {FORMAT}; {remedy}")
    body = data[head.end() :]
    if len(body) != int(head[2]) or _digest(body) != head[3]:
        raise BrokenExportError("is damaged")
    try:
        content = json.loads(body)
        texts = content["files"].items()
        files = {_name(name): None if text is None else _from_text(name, text) for name, text in texts}
        about = list(content["about"].items())[:MAX_ABOUT_ENTRIES]
        limit = MAX_ABOUT_CHARACTERS
        return Export(files, {str(key)[:limit]: str(value)[:limit] for key, value in about})
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        text = ascii(str(error))[1:-1][:MAX_ABOUT_CHARACTERS]
        raise BrokenExportError(f"is no state that rambler has exported: {text}") from None


def begin_import(directory: Path, export: Export) -> None:
    """Let a directory that this process holds count for what is imported from now on.

    OSError: nothing has changed, unless its strerror says that the next start may find it all the same.
    """
    path = directory / PENDING_IMPORT
    try:
        write_atomically(path, pack(export), PRIVATE_MODE)
    except OSError as error:
        try:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(path)  # noqa: PTH108 - the tests' disk stands before the calls of os
            sync_directory(directory)
        except OSError:
            raise OSError(error.errno, f"{error.strerror}; the next start may find it all the same") from None
        raise


def pending_import(directory: Path) -> Export | None:
    """Return the import that counts and is not in the slots, None when there is none.

    BrokenExportError for what lies there and is none, OSError for a disk that does not give it. Only the owner of the
    directory may have begun one.
    """
    path = directory / PENDING_IMPORT
    try:
        if path.lstat().st_uid != directory.stat().st_uid:
            raise BrokenExportError("belongs to another user")  # noqa: TRY301 - reported with the name like the others
        return unpack(read_regular(path, MAX_EXPORT_BYTES, follow=False))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except BrokenExportError as error:
        raise BrokenExportError(f"{PENDING_IMPORT} {error}") from None
    except OSError as error:
        if error.errno not in UNFIT:
            raise
        raise BrokenExportError(f"{PENDING_IMPORT} {error.strerror}") from None


def end_import(directory: Path) -> None:
    """Forget an import that is in the slots; what it held of a secret is overwritten. OSError."""
    done = directory / _DONE
    os.replace(directory / PENDING_IMPORT, done)  # noqa: PTH105
    sync_directory(directory)
    remove_leftovers(directory)


def remove_leftovers(directory: Path) -> None:
    """Remove what imports that were cut off have left and does not count, overwritten. OSError."""
    for name in (_DONE, f".{PENDING_IMPORT}.new"):
        _wipe(directory / name)


def _wipe(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_EXPORT_BYTES:
            set_aside(path)  # it is none of ours
            return
        descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.pwrite(descriptor, bytes(os.fstat(descriptor).st_size), 0)
            os.fdatasync(descriptor)
        finally:
            os.close(descriptor)
        os.unlink(path)  # noqa: PTH108


def _digest(body: bytes) -> bytes:
    return hashlib.sha256(body).hexdigest().encode()


def _to_text(name: str, content: bytes) -> str:
    if name.endswith(RECORD_ENDING):
        return base64.b64encode(content).decode()
    return content.decode("utf-8", "replace")


def _from_text(name: str, value: object) -> bytes:
    if not isinstance(value, str):
        raise TypeError("a content is no text")
    content = base64.b64decode(value, validate=True) if name.endswith(RECORD_ENDING) else value.encode()
    if len(content) > largest_bytes(name) - MAX_HEAD_BYTES:
        raise ValueError(f"{name} is larger than it may be, {largest_bytes(name) >> 10} KiB")
    return content


def _name(value: str) -> str:
    if not _NAME.fullmatch(value):
        raise ValueError(f"{value[:40]!r} is no name of a state")
    return value
