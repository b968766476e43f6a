"""Export of the state as one file: a line with format, length and SHA-256, then JSON with the content of each name.

Texts are stored as UTF-8, in which invalid bytes are replaced, and records (`NAME.record`) as base64. In a state
directory, an export named PENDING_IMPORT is an import that has priority over the slots until it is written into them.
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

from firmware_py.files.reading import UNUSABLE, read_regular
from firmware_py.files.writing import PRIVATE_MODE, set_aside, sync_directory, write_atomically

RECORD_SUFFIX: Final = ".record"  # of binary records; other contents are texts
FORMAT: Final = 2  # in format 1 the records were texts
MAX_EXPORT_BYTES: Final = 64 << 20  # more than the escaped content of all slots
KEY_SUFFIX: Final = ".key"
_MAX_SLOT_BYTES: Final = {".plan": 4 << 20, KEY_SUFFIX: 64 << 10}
_DEFAULT_MAX_SLOT_BYTES: Final = 1 << 20
MAX_HEAD_BYTES: Final = 64  # of a slot
MAX_ABOUT_ENTRIES, MAX_ABOUT_CHARACTERS = 8, 200
PENDING_IMPORT: Final = "import.awaited"
_FINISHED_IMPORT: Final = ".import.done"
_HEAD = re.compile(rb"# rambler exported state (\d{1,9}) (\d{1,12}) ([0-9a-f]{64})\n")
_NAME = re.compile(r"[a-z]{1,32}\.[a-z]{1,8}")  # of a state file; no path separators
_ANY_HEAD = b"# rambler exported state "


class BrokenExportError(ValueError):
    """The file is not an exported state or not readable by this version; the text names the remedy."""


def max_slot_bytes(name: str) -> int:
    """Return the maximum slot size of a name."""
    return _MAX_SLOT_BYTES.get(Path(name).suffix, _DEFAULT_MAX_SLOT_BYTES)


class Export(msgspec.Struct, frozen=True):
    """The content of each name, None if it is empty; `about` describes the origin of the export."""

    files: Mapping[str, bytes | None]
    about: Mapping[str, str] = msgspec.field(default_factory=dict)

    def content(self, name: str) -> bytes | None:
        """Return the content of a name."""
        return self.files.get(name)


def pack(export: Export) -> bytes:
    """Encode an export as the content of a file."""
    files = {name: None if content is None else _to_text(name, content) for name, content in export.files.items()}
    body = json.dumps({"about": dict(export.about), "files": files}, indent=1).encode() + b"\n"
    return b"# rambler exported state %d %d %s\n" % (FORMAT, len(body), _sha256(body)) + body


def unpack(data: bytes) -> Export:
    """Decode the content of an export file; raises BrokenExportError."""
    head = _HEAD.match(data)
    if head is None:
        is_export = data.startswith(_ANY_HEAD)
        raise BrokenExportError(f"is {'damaged' if is_export else 'not an exported state of rambler'}")
    if int(head[1]) != FORMAT:
        remedy = "use a newer version" if int(head[1]) > FORMAT else "export that state with this version"
        raise BrokenExportError(f"has format {int(head[1])}, this version reads {FORMAT}; {remedy}")
    body = data[head.end() :]
    if len(body) != int(head[2]) or _sha256(body) != head[3]:
        raise BrokenExportError("is damaged")
    try:
        content = json.loads(body)
        texts = content["files"].items()
        files = {_check_name(name): None if text is None else _from_text(name, text) for name, text in texts}
        about = list(content["about"].items())[:MAX_ABOUT_ENTRIES]
        limit = MAX_ABOUT_CHARACTERS
        return Export(files, {str(key)[:limit]: str(value)[:limit] for key, value in about})
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        text = ascii(str(error))[1:-1][:MAX_ABOUT_CHARACTERS]
        raise BrokenExportError(f"is not an exported state of rambler: {text}") from None


def begin_import(directory: Path, export: Export) -> None:
    """Write an import into a directory that this process has locked; from then on it has priority over the slots.

    On OSError nothing has changed, unless strerror says that the next start may find the import nevertheless.
    """
    path = directory / PENDING_IMPORT
    try:
        write_atomically(path, pack(export), PRIVATE_MODE)
    except OSError as error:
        try:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(path)  # noqa: PTH108 - tests inject errors into calls of os
            sync_directory(directory)
        except OSError:
            raise OSError(error.errno, f"{error.strerror}; the next start may find it nevertheless") from None
        raise


def pending_import(directory: Path) -> Export | None:
    """Return the import that is not yet in the slots, None without one.

    Raises OSError, and BrokenExportError for an invalid file or one that does not belong to the owner of the directory.
    """
    path = directory / PENDING_IMPORT
    try:
        if path.lstat().st_uid != directory.stat().st_uid:
            raise BrokenExportError("belongs to another user")  # noqa: TRY301 - reported with the name like the others
        return unpack(read_regular(path, MAX_EXPORT_BYTES, follow_symlinks=False))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except BrokenExportError as error:
        raise BrokenExportError(f"{PENDING_IMPORT} {error}") from None
    except OSError as error:
        if error.errno not in UNUSABLE:
            raise
        raise BrokenExportError(f"{PENDING_IMPORT} {error.strerror}") from None


def end_import(directory: Path) -> None:
    """Overwrite and remove an import that is in the slots. Raises OSError."""
    finished_import = directory / _FINISHED_IMPORT
    os.replace(directory / PENDING_IMPORT, finished_import)  # noqa: PTH105
    sync_directory(directory)
    remove_leftovers(directory)


def remove_leftovers(directory: Path) -> None:
    """Overwrite and remove unused files of interrupted imports. Raises OSError."""
    for name in (_FINISHED_IMPORT, f".{PENDING_IMPORT}.new"):
        _overwrite_and_remove(directory / name)


def _overwrite_and_remove(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_EXPORT_BYTES:
            set_aside(path)  # not a file of this program
            return
        descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.pwrite(descriptor, bytes(os.fstat(descriptor).st_size), 0)
            os.fdatasync(descriptor)
        finally:
            os.close(descriptor)
        os.unlink(path)  # noqa: PTH108


def _sha256(body: bytes) -> bytes:
    return hashlib.sha256(body).hexdigest().encode()


def _to_text(name: str, content: bytes) -> str:
    if name.endswith(RECORD_SUFFIX):
        return base64.b64encode(content).decode()
    return content.decode("utf-8", "replace")


def _from_text(name: str, value: object) -> bytes:
    if not isinstance(value, str):
        raise TypeError("a content is not a text")
    content = base64.b64decode(value, validate=True) if name.endswith(RECORD_SUFFIX) else value.encode()
    if len(content) > max_slot_bytes(name) - MAX_HEAD_BYTES:
        raise ValueError(f"{name} is larger than {max_slot_bytes(name) >> 10} KiB")
    return content


def _check_name(value: str) -> str:
    if not _NAME.fullmatch(value):
        raise ValueError(f"{value[:40]!r} is not a valid name")
    return value
