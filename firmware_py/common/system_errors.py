"""Errors of the computer itself in one line: it has no more of something, or a path that leads nowhere."""

from __future__ import annotations

import errno
from collections.abc import Iterator

_MEMORY = "too little memory; give it more (ulimit -v, MemoryMax)"
_FILES = "too many open files; allow more (ulimit -n, LimitNOFILE)"
_THREADS = "no new thread or process is to be had; allow more, or more memory (ulimit -u and -v, TasksMax)"
_ROOM = "no room is left on a disk; make room there (df tells which), or give paths on another"
_BY_NUMBER = {
    errno.EMFILE: _FILES,
    errno.ENFILE: _FILES,
    errno.ENOMEM: _MEMORY,
    errno.EAGAIN: _THREADS,
}
_NO_TEMPORARY = "No usable temporary directory"  # as tempfile says it
# What the dynamic loader says of a library that it could not load for want of something.
_BY_LOADERS_WORDS = {
    "Too many open files": _FILES,
    "Cannot allocate memory": _MEMORY,
    "cannot allocate memory": _MEMORY,
    "failed to map segment": _MEMORY,
    "cannot map zero-fill pages": _MEMORY,
    "cannot create shared object descriptor": _MEMORY,
}


def system_error_text(error: BaseException) -> str:
    """Say in one line what there is too little of, or which path cannot be used; empty when the error is another."""
    for cause in _causes(error):
        if isinstance(cause, MemoryError):
            return _MEMORY
        if isinstance(cause, RuntimeError) and "start new thread" in str(cause):
            return _THREADS
        if isinstance(cause, OSError) and cause.errno in _BY_NUMBER:
            return _BY_NUMBER[cause.errno]
        if isinstance(cause, FileNotFoundError) and _NO_TEMPORARY in str(cause):
            return f"{cause.strerror}; make room there, or set TMPDIR to a directory with room"
        if isinstance(cause, ImportError):
            for words, text in _BY_LOADERS_WORDS.items():
                if words in str(cause):
                    return text
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        name = error.object[max(error.start - 30, 0) : error.end]
        return f"a name in {name!a} is no text in this locale; give another, or LC_ALL=C.UTF-8"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; give another path"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return _ROOM
    # All that is looked for without a name, but for tempfile's, is the directory from which paths count.
    if isinstance(error, FileNotFoundError) and error.errno == errno.ENOENT:
        return "the directory that this was called in is there no more; call it in another"
    return ""


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and those that it was raised for."""
    cause: BaseException | None = error
    while cause is not None:
        yield cause
        cause = cause.__cause__
