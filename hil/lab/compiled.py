"""Compile numerical functions with numba, store the machine code, and show compilation as progress.

    @compiled
    def kernel(...): ...

compiles a function of the laboratory; `kernel.py_func` is the plain function. It may call other such functions and
those of the firmware's numeric core (hil/lab/numeric_core.py, which describes the arithmetic).

Machine code is stored by the content of the sources: each module has a folder that is named after a digest of its file
and of the files that it imports, directly and indirectly. Only what a change can affect is compiled again.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, flock
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, TextIO, TypeVar

import llvmlite
import numba
from numba.core import caching, event

from hil.lab.numeric_core import ERROR_MODEL


class DeferredSignals(event.Listener):
    """Defers signals while the main thread is in the compiler, because exceptions in LLVM's callbacks are lost.

    A deferred signal is handled when the compiler, or one of its parts, ends.
    """

    def __init__(self) -> None:
        """Start without a deferred signal."""
        self._depth = 0
        self._deferred: int | None = None
        self._handlers: dict[int, Any] = {}

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Defer signals from now on."""
        if threading.current_thread() is not threading.main_thread():
            return
        if not self._depth:
            self._handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
            self._set(lambda number, _frame: setattr(self, "_deferred", number))
        self._depth += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Handle the deferred signal, if any."""
        if threading.current_thread() is not threading.main_thread():
            return
        self._depth -= 1
        if not self._depth:
            self._set(None)
        deferred, self._deferred = self._deferred, None
        if deferred is not None:
            self._handlers[deferred](deferred, None)

    def _set(self, handler: Callable[[int, object], None] | None) -> None:
        for number, handler_before in self._handlers.items():
            if callable(handler_before):  # otherwise the default handler, which ends the program
                signal.signal(number, handler_before if handler is None else handler)


Function = TypeVar("Function", bound=Callable[..., Any])

PROGRESS_DELAY_S = 0.4  # loading from the cache is faster and shows no progress
PROGRESS_INTERVAL_S = 0.5
# Folders that are not deleted: the newest of each module, and all younger than MIN_AGE_S, which may be in use.
MIN_FOLDERS, MIN_AGE_S = 4, 86400.0
ROOT = Path(__file__).parents[2]
# Only at the start of a line: numba compiles no imports within functions, and those below TYPE_CHECKING do not run.
IMPORTS = re.compile(
    r"^(?:from ((?:hil|firmware_py)[\w.]*) import (\([^)]*\)|.*)|import ((?:hil|firmware_py)[\w.]*))", re.MULTILINE
)


class _Compilations(event.Listener):
    """Counts the running compilations and their seconds; loading from the cache is not a compilation."""

    def __init__(self) -> None:
        self.running, self.began_s, self.seconds = 0, 0.0, 0.0

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Count the start of a compilation."""
        if self.running == 0:
            self.began_s = time.monotonic()
        self.running += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Count the end of a compilation."""
        self.running -= 1
        if self.running == 0:
            self.seconds += time.monotonic() - self.began_s


_compilations: Final = _Compilations()
_warning_printed: Final = threading.Event()  # set when the warning about missing storage has been printed
_progress_lock: Final = threading.Lock()
event.register("numba:compile", _compilations)  # type: ignore[no-untyped-call]
event.register("numba:compiler_lock", DeferredSignals())  # type: ignore[no-untyped-call]


def being_compiled() -> bool:
    """Return whether code is being compiled now."""
    return _compilations.running > 0


def compiled(function: Function) -> Function:
    """Compile a function at its first call, and store the machine code for later processes.

    Without a writable cache directory each process compiles it.
    """
    dispatcher: Any = compiled_here(function)
    with suppress(RuntimeError):  # no cache directory
        # Private names of numba, whose versions pyproject.toml limits for this. The public cache=True depends on path
        # and time of one file: a fresh checkout would compile again, and a changed import would not.
        dispatcher._cache = _Cache(function)  # type: ignore[no-untyped-call] # noqa: SLF001
    return dispatcher  # type: ignore[no-any-return]


def compiled_here(function: Function) -> Function:
    """Compile a function for this process only; necessary if its arguments are functions."""
    # nogil: several threads can run it at a time, also the thread that shows progress.
    # no_cfunc_wrapper: no C code calls these functions, and the wrapper takes time to compile.
    options: dict[str, Any] = {"error_model": ERROR_MODEL, "nogil": True, "no_cfunc_wrapper": True}
    return numba.njit(function, **options)  # type: ignore[no-any-return]


class _CacheFolder(caching._CacheLocator):  # noqa: SLF001 - numba has no public one
    """Locates the cache folder of a function, which is named after the content of its sources."""

    def __init__(self, folder: Path, file: str, line: int) -> None:
        self._folder, self._py_file, self._line = folder, file, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _CacheFolder | None:
        """Return the locator, or None without a cache directory."""
        folder = cache_folder(Path(py_file))
        return None if folder is None else cls(folder, py_file, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return a text that changes with the sources."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes functions of the same name."""
        return str(self._line)


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes: Any = (_CacheFolder,)


class _Cache(caching.FunctionCache):
    """Machine code of a function on disk; a process waits while another one compiles the same function."""

    _impl_class = _Implementation
    _lock: Any = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for a signature; None if this process has the lock and has to compile it."""
        code = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        if code is None and self._lock is None:
            with suppress(OSError):  # the folder was deleted or is read-only
                self._lock = (Path(self._cache_path) / f"{self._impl.filename_base}.lock").open("w")
                _compilations.on_start(None)  # a terminal shows the wait as a compilation
                try:
                    flock(self._lock, LOCK_EX)
                finally:
                    _compilations.on_end(None)
                code = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        if code is not None:
            self._unlock()
        return code

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the machine code for a signature."""
        super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        self._unlock()

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


@cache
def cache_folder(file: Path) -> Path | None:
    """Return the folder of a module's machine code, or None if it cannot be written."""
    home = _cache_home()
    if home.parts[0] == "~":  # a user without a home directory
        return None
    module = f"{file.parent.name}.{file.stem}"
    folder = home / f"{module}-{sources_digest(file)}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(folder)
        TemporaryFile(dir=folder).close()
    except OSError:
        return None
    with suppress(OSError):  # another process deletes the same folder
        _delete_old_folders(home, module)
    return folder


def _cache_home() -> Path:
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - Path.expanduser raises without a home
    return Path(base) / "rambler-hil"


def sources_digest(file: Path) -> str:
    """Return a digest of a module's file, of the files that it imports, and of the versions of the compiler.

    numba itself distinguishes processors.
    """
    versions = (numba.__version__, llvmlite.__version__, *platform.libc_ver(), ERROR_MODEL)
    digest, files, pending = hashlib.sha256(" ".join(versions).encode()), set(), [file]
    while pending:
        if (path := pending.pop()) not in files:
            files.add(path)
            pending += _source(path)[1]
    for path in sorted(files, key=str):
        digest.update(f"{path.name} {_source(path)[0]}\0".encode())
    return digest.hexdigest()[:16]


@cache
def _source(file: Path) -> tuple[str, tuple[Path, ...]]:
    """Return the digest of a file, and the files of firmware_py and hil that it imports.

    This module is excluded: its text does not change the machine code.
    """
    text = file.read_bytes()
    names = {
        part for module, name in _imports(text.decode()) for part in (module, f"{module}.__init__", f"{module}.{name}")
    }
    paths = {ROOT / f"{name.replace('.', '/')}.py" for name in names} - {ROOT / "hil/lab/compiled.py"}
    return hashlib.sha256(text).hexdigest(), tuple(path for path in sorted(paths) if path.is_file())


def _imports(text: str) -> Iterator[tuple[str, str]]:
    """Yield each imported module of firmware_py and hil with each name that is imported from it."""
    for source, names, module in IMPORTS.findall(text):
        for name in re.findall(r"\w+", names) or ("",):
            yield source or module, name


def _delete_old_folders(home: Path, module: str) -> None:
    """Delete the machine code of a module except for its newest versions and those of the last day."""
    times_s = {path: path.stat().st_mtime for path in home.glob(f"{module}-*") if path.is_dir()}
    oldest_s = time.time() - MIN_AGE_S
    for folder in sorted(times_s, key=times_s.__getitem__)[:-MIN_FOLDERS]:
        if times_s[folder] > oldest_s:
            continue
        for path in sorted(folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
        folder.rmdir()


@contextmanager
def compiling(subject: str, stream: TextIO | None = None) -> Iterator[None]:
    """Show progress on a terminal while code is compiled in the block; print nothing in a pipe or in a nested block.

    A missing cache directory is reported once, also in a pipe.
    """
    stream = sys.stderr if stream is None else stream
    _warn_without_storage(stream)
    if not stream.isatty() or not _progress_lock.acquire(blocking=False):
        yield
        return
    is_done = threading.Event()
    thread = threading.Thread(target=_show_progress, args=(subject, stream, is_done), daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_done.set()
        thread.join()
        _progress_lock.release()


def _has_storage() -> bool:
    return cache_folder(Path(__file__)) is not None


def _warn_without_storage(stream: TextIO) -> None:
    if not _has_storage() and not _warning_printed.is_set() and parent_process() is None:
        _warning_printed.set()
        stream.write(
            f"rambler-hil: machine code cannot be stored in {_cache_home()}, so each process compiles it again; "
            "set NUMBA_CACHE_DIR to another directory\n"
        )
        stream.flush()


def _show_progress(subject: str, stream: TextIO, is_done: threading.Event) -> None:
    began_s, before_s, is_visible, was_visible = time.monotonic(), _compilations.seconds, False, False
    while not is_done.wait(PROGRESS_INTERVAL_S if is_visible else PROGRESS_DELAY_S):
        if being_compiled():
            elapsed_s = time.monotonic() - began_s
            frequency = "first time only" if _has_storage() else "every time"
            stream.write(f"\r\x1b[Kcompiling {subject} for this machine, {frequency} ... {elapsed_s:.0f} s")
        elif is_visible:
            stream.write("\r\x1b[K")
        is_visible = being_compiled()
        was_visible = was_visible or is_visible
        stream.flush()
    if was_visible:
        seconds = _compilations.seconds - before_s
        stream.write(f"\r\x1b[Kcompiled {subject} for this machine in {seconds:.0f} s\n")
        stream.flush()
