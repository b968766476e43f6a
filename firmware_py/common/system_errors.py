"""One-line texts for errors of the operating system: exhausted resources and unusable paths."""

from __future__ import annotations

import errno
from collections.abc import Iterator

_MEMORY = "out of memory; raise the limit (ulimit -v, MemoryMax)"
_FILES = "too many open files; raise the limit (ulimit -n, LimitNOFILE)"
_THREADS = "cannot start a thread or process; raise the limits (ulimit -u and -v, TasksMax)"
_DISK_FULL = "a disk is full (see df); free some space, or use paths on another disk"
_BY_NUMBER = {
    errno.EMFILE: _FILES,
    errno.ENFILE: _FILES,
    errno.ENOMEM: _MEMORY,
    errno.EAGAIN: _THREADS,
}
_NO_TEMPORARY = "No usable temporary directory"  # text of tempfile
_BY_LOADER_TEXT = {
    "Too many open files": _FILES,
    "Cannot allocate memory": _MEMORY,
    "cannot allocate memory": _MEMORY,
    "failed to map segment": _MEMORY,
    "cannot map zero-fill pages": _MEMORY,
    "cannot create shared object descriptor": _MEMORY,
}


def system_error_text(error: BaseException) -> str:
    """Return a line with cause and remedy of an error of the system, empty for other errors."""
    for cause in _causes(error):
        if isinstance(cause, MemoryError):
            return _MEMORY
        if isinstance(cause, RuntimeError) and "start new thread" in str(cause):
            return _THREADS
        if isinstance(cause, OSError) and cause.errno in _BY_NUMBER:
            return _BY_NUMBER[cause.errno]
        if isinstance(cause, FileNotFoundError) and _NO_TEMPORARY in str(cause):
            return f"{cause.strerror}; free some space, or set TMPDIR to a directory with space"
        if isinstance(cause, ImportError):
            for loader_text, text in _BY_LOADER_TEXT.items():
                if loader_text in str(cause):
                    return text
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        name = error.object[max(error.start - 30, 0) : error.end]
        return f"name {name!a}: not representable in this locale; use another name, or LC_ALL=C.UTF-8"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; use another path"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return _DISK_FULL
    # Without a file name and apart from tempfile, only the working directory can be missing.
    if isinstance(error, FileNotFoundError) and error.errno == errno.ENOENT:
        return "the working directory no longer exists; change to another one"
    return ""


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and its causes."""
    cause: BaseException | None = error
    while cause is not None:
        yield cause
        cause = cause.__cause__
