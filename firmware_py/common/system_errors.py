"""Errors of the computer itself in one line: it has no more of something, or a path that leads nowhere."""

from __future__ import annotations

import errno
from collections.abc import Iterator

_MEMORY = "too little memory; give it more (ulimit -v, MemoryMax)"
_FILES = "too many open files; allow more (ulimit -n, LimitNOFILE)"
_THREADS = "no new thread or process is to be had; allow more, or more memory (ulimit -u and -v, TasksMax)"
_BY_NUMBER = {
    errno.EMFILE: _FILES,
    errno.ENFILE: _FILES,
    errno.ENOMEM: _MEMORY,
    errno.EAGAIN: _THREADS,
}
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
        if isinstance(cause, ImportError):
            for words, text in _BY_LOADERS_WORDS.items():
                if words in str(cause):
                    return text
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; give another path"
    return ""


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and those that it was raised for."""
    cause: BaseException | None = error
    while cause is not None:
        yield cause
        cause = cause.__cause__
