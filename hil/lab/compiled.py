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


class HeldSignals(event.Listener):
    """Defers signals while the main thread is in the compiler; exceptions raised in LLVM's callbacks would be lost.

    A deferred signal is handled when the compiler, or one of its parts, ends.
    """

    def __init__(self) -> None:
        """Start without a deferred signal."""
        self._depth = 0
        self._due: int | None = None
        self._before: dict[int, Any] = {}

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Defer signals from now on."""
        if threading.current_thread() is not threading.main_thread():
            return
        if not self._depth:
            self._before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
            self._set(lambda number, _frame: setattr(self, "_due", number))
        self._depth += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Handle the deferred signal, if any."""
        if threading.current_thread() is not threading.main_thread():
            return
        self._depth -= 1
        if not self._depth:
            self._set(None)
        due, self._due = self._due, None
        if due is not None:
            self._before[due](due, None)

    def _set(self, handler: Callable[[int, object], None] | None) -> None:
        for number, before in self._before.items():
            if callable(before):  # otherwise the default handler, which ends the program
                signal.signal(number, before if handler is None else handler)


Function = TypeVar("Function", bound=Callable[..., Any])

PROGRESS_DELAY_S = 0.4  # loading from the cache is faster and shows no progress
PROGRESS_INTERVAL_S = 0.5
# Folders that are not deleted: this number for each module, and all of the last day, which may be in use.
MIN_FOLDERS, MIN_AGE_S = 4, 86400.0
ROOT = Path(__file__).parents[2]
# Only at the start of a line: numba compiles no import within a function, and those below TYPE_CHECKING never run.
IMPORTS = re.compile(
    r"^(?:from ((?:hil|firmware_py)[\w.]*) import (\([^)]*\)|.*)|import ((?:hil|firmware_py)[\w.]*))", re.MULTILINE
)


class _Compilations(event.Listener):
    """Count the compilations under way and their seconds; loading from the cache is not a compilation."""

    def __init__(self) -> None:
        self.under_way, self.began_s, self.seconds = 0, 0.0, 0.0

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Count the start of a compilation."""
        if self.under_way == 0:
            self.began_s = time.monotonic()
        self.under_way += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Count the end of a compilation."""
        self.under_way -= 1
        if self.under_way == 0:
            self.seconds += time.monotonic() - self.began_s


_compilations: Final = _Compilations()
_warned: Final = threading.Event()  # set when the warning about missing storage has been printed
_progress_line: Final = threading.Lock()
event.register("numba:compile", _compilations)  # type: ignore[no-untyped-call]
event.register("numba:compiler_lock", HeldSignals())  # type: ignore[no-untyped-call]


def being_compiled() -> bool:
    """Return whether code is being compiled now."""
    return _compilations.under_way > 0


def compiled(function: Function) -> Function:
    """Compile a function at its first call, and store the machine code for later processes.

    Without a writable cache directory each process compiles it.
    """
    dispatcher: Any = compiled_here(function)
    with suppress(RuntimeError):  # no cache directory
        # Private names of numba, whose range pyproject.toml limits for this: the public cache=True goes by path and
        # time of one file, so that a fresh checkout compiles again and a changed import does not.
        dispatcher._cache = _Cache(function)  # type: ignore[no-untyped-call] # noqa: SLF001
    return dispatcher  # type: ignore[no-any-return]


def compiled_here(function: Function) -> Function:
    """Compile a function for this process alone; necessary for one that takes other functions as arguments."""
    # nogil: several threads may share the work, and the one that shows progress gets its turn.
    # no_cfunc_wrapper: nothing calls these functions from C, and the wrapper takes time to compile.
    options: dict[str, Any] = {"error_model": ERROR_MODEL, "nogil": True, "no_cfunc_wrapper": True}
    return numba.njit(function, **options)  # type: ignore[no-any-return]


class _Place(caching._CacheLocator):  # noqa: SLF001 - numba has no public one
    """Locates the cache folder of a function, which is named after the content of its sources."""

    def __init__(self, folder: Path, file: str, line: int) -> None:
        self._folder, self._py_file, self._line = folder, file, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Place | None:
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
    _locator_classes: Any = (_Place,)


class _Cache(caching.FunctionCache):
    """Machine code of a function on disk; a process waits while another one compiles the same function."""

    _impl_class = _Implementation
    _lock: Any = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for a signature; None: this process holds the lock and compiles it."""
        found = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        if found is None and self._lock is None:
            with suppress(OSError):  # the folder was deleted or is read-only
                self._lock = (Path(self._cache_path) / f"{self._impl.filename_base}.lock").open("w")
                _compilations.on_start(None)  # a terminal shows the wait as a compilation
                try:
                    flock(self._lock, LOCK_EX)
                finally:
                    _compilations.on_end(None)
                found = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        if found is not None:
            self._unlock()
        return found

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
    """Return the folder of a module's machine code, or None where nothing can be stored."""
    home = _caches()
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
        _drop_old(home, module)
    return folder


def _caches() -> Path:
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - Path.expanduser raises without a home
    return Path(base) / "rambler-hil"


def sources_digest(file: Path) -> str:
    """Return a digest of a module's file and of those that it imports, and of the versions that compile them.

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
    """Return the digest of a file, and the files of both programs that it imports.

    This module is excluded: its text does not change the machine code.
    """
    text = file.read_bytes()
    names = {
        part for module, name in _imports(text.decode()) for part in (module, f"{module}.__init__", f"{module}.{name}")
    }
    paths = {ROOT / f"{name.replace('.', '/')}.py" for name in names} - {ROOT / "hil/lab/compiled.py"}
    return hashlib.sha256(text).hexdigest(), tuple(path for path in sorted(paths) if path.is_file())


def _imports(text: str) -> Iterator[tuple[str, str]]:
    """Yield the modules of both programs that a text imports, each with a name that it imports from them."""
    for source, names, module in IMPORTS.findall(text):
        for name in re.findall(r"\w+", names) or ("",):
            yield source or module, name


def _drop_old(home: Path, module: str) -> None:
    """Delete the machine code of a module except for its latest versions and those of the last day."""
    used_s = {path: path.stat().st_mtime for path in home.glob(f"{module}-*") if path.is_dir()}
    oldest_s = time.time() - MIN_AGE_S
    for folder in sorted(used_s, key=used_s.__getitem__)[:-MIN_FOLDERS]:
        if used_s[folder] > oldest_s:
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
    if not stream.isatty() or not _progress_line.acquire(blocking=False):
        yield
        return
    done = threading.Event()
    thread = threading.Thread(target=_show_progress, args=(subject, stream, done), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        _progress_line.release()


def _has_storage() -> bool:
    return cache_folder(Path(__file__)) is not None


def _warn_without_storage(stream: TextIO) -> None:
    if not _has_storage() and not _warned.is_set() and parent_process() is None:
        _warned.set()
        stream.write(
            f"rambler-hil: machine code cannot be stored in {_caches()}, so each process compiles it again; "
            "set NUMBA_CACHE_DIR to another directory\n"
        )
        stream.flush()


def _show_progress(subject: str, stream: TextIO, done: threading.Event) -> None:
    began_s, before_s, visible, was_visible = time.monotonic(), _compilations.seconds, False, False
    while not done.wait(PROGRESS_INTERVAL_S if visible else PROGRESS_DELAY_S):
        if being_compiled():
            elapsed_s = time.monotonic() - began_s
            frequency = "first time only" if _has_storage() else "every time"
            stream.write(f"\r\x1b[Kcompiling {subject} for this machine, {frequency} ... {elapsed_s:.0f} s")
        elif visible:
            stream.write("\r\x1b[K")
        visible = being_compiled()
        was_visible = was_visible or visible
        stream.flush()
    if was_visible:
        seconds = _compilations.seconds - before_s
        stream.write(f"\r\x1b[Kcompiled {subject} for this machine in {seconds:.0f} s\n")
        stream.flush()
