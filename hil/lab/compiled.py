"""Compiles numerical functions with numba, once per machine, and shows the first time as progress.

    @compiled
    def kernel(...): ...

compiles a function of the laboratory, which runs plain as `kernel.py_func`. It may call other such functions and those
of the firmware's numeric core (hil/lab/numeric_core.py, where the arithmetic is described).

Machine code is kept by the content of the sources: for each module in a folder that is named after a digest of its file
and of the files that it imports, directly and indirectly. Only what a change can affect is compiled again.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, TextIO, TypeVar

import llvmlite
import numba
from numba.core import caching, event

from hil.lab.held_signals import HeldSignals
from hil.lab.numeric_core import ERROR_MODEL

Function = TypeVar("Function", bound=Callable[..., Any])

PATIENCE_S = 0.4  # what is loaded from the cache takes less, and says nothing
TICK_S = 0.5
KEPT_CACHES, KEPT_S = 4, 86400.0  # of a module so many, and all of the last day: another program may be using them
_HOW_OFTEN: Final = {False: "the first time only", True: "as each time"}

ROOT = Path(__file__).parents[2]
IMPORTS = re.compile(
    r"^(?:from ((?:hil|firmware_py)[\w.]*) import (\([^)]*\)|.*)|import ((?:hil|firmware_py)[\w.]*))", re.MULTILINE
)
# nogil: several threads may share the work, and the one that shows progress gets its turn.
OPTIONS: Final = {"error_model": ERROR_MODEL, "nogil": True}


class _Compilations(event.Listener):
    """Counts the compilations under way and their seconds; what comes from the cache is none."""

    def __init__(self) -> None:
        self.under_way, self.began_s, self.seconds = 0, 0.0, 0.0

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Note one more."""
        if self.under_way == 0:
            self.began_s = time.monotonic()
        self.under_way += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Note one less."""
        self.under_way -= 1
        if self.under_way == 0:
            self.seconds += time.monotonic() - self.began_s


_compilations: Final = _Compilations()
_told: Final[list[bool]] = []  # that nothing can be kept
_line: Final = threading.Lock()  # who holds it writes the line of progress
event.register("numba:compile", _compilations)  # type: ignore[no-untyped-call]
event.register("numba:compiler_lock", HeldSignals())  # type: ignore[no-untyped-call]


def being_compiled() -> bool:
    """Whether code is being compiled just now."""
    return _compilations.under_way > 0


def compiled(function: Function) -> Function:
    """Compile a function at its first call, and keep the machine code for later processes.

    Without a place to keep it (no home, a read-only disk) it is compiled each time.
    """
    made: Any = compiled_here(function)
    with suppress(RuntimeError):  # there is no place
        # As numba's own cache=True does, which goes by the time of a file and not by its content.
        made._cache = _Cache(function)  # type: ignore[no-untyped-call] # noqa: SLF001
    return made  # type: ignore[no-any-return]


def compiled_here(function: Function) -> Function:
    """Compile a function for this process alone, as one must that takes other functions as arguments."""
    # nogil: several threads may share the work, and the one that shows progress gets its turn.
    return numba.njit(function, error_model=ERROR_MODEL, nogil=True)  # type: ignore[no-any-return]


class _Place(caching._CacheLocator):  # noqa: SLF001 - numba has no public one
    """Where numba finds the machine code of a function: in a folder that the content of its sources names."""

    def __init__(self, folder: Path, file: str, line: int) -> None:
        self._folder, self._py_file, self._line = folder, file, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Place | None:
        """Return the place, None without one."""
        folder = cache_folder(Path(py_file))
        return None if folder is None else cls(folder, py_file, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what changes with the sources."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Return what distinguishes functions of the same name."""
        return str(self._line)


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes: Any = (_Place,)


class _Cache(caching.FunctionCache):
    _impl_class = _Implementation


@cache
def cache_folder(file: Path) -> Path | None:
    """Return where the machine code of a module is kept, or None where nothing can be."""
    home = _caches()
    if home.parts[0] == "~":  # of a user without a home; it would be made wherever one is
        return None
    module = f"{file.parent.name}.{file.stem}"
    folder = home / f"{module}-{sources_digest(file)}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(folder)
        TemporaryFile(dir=folder).close()
    except OSError:
        return None
    with suppress(OSError):  # another process drops the same
        _drop_old(home, module)
    return folder


def _caches() -> Path:
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - Path.expanduser raises without a home
    return Path(base) / "rambler-hil"


def sources_digest(file: Path) -> str:
    """Return a digest of a module's file and of those that it imports, and of the versions that compile them.

    numba itself tells processors apart.
    """
    versions = (numba.__version__, llvmlite.__version__, *platform.libc_ver(), ERROR_MODEL)
    digest, files, left = hashlib.sha256(" ".join(versions).encode()), set(), [file]
    while left:
        if (one := left.pop()) not in files:
            files.add(one)
            left += _source(one)[1]
    for one in sorted(files, key=str):
        digest.update(f"{one.name} {_source(one)[0]}\0".encode())
    return digest.hexdigest()[:16]


@cache
def _source(file: Path) -> tuple[str, tuple[Path, ...]]:
    """Return the digest of a file, and the files of both programs that it imports.

    What this module itself is made of does not change what it compiles.
    """
    text = file.read_bytes()
    names = [f"{module}.{name}" for module, name in _imports(text.decode())]
    names += [module for module, _ in _imports(text.decode())]
    paths = {ROOT / f"{name.replace('.', '/')}.py" for name in names} - {ROOT / "hil/lab/compiled.py"}
    return hashlib.sha256(text).hexdigest(), tuple(path for path in sorted(paths) if path.is_file())


def _imports(text: str) -> Iterator[tuple[str, str]]:
    """Yield the modules of both programs that a text imports, each with a name that is imported from it."""
    for source, names, module in IMPORTS.findall(text):
        for name in re.findall(r"\w+", names) or ("",):
            yield source or module, name


def _drop_old(home: Path, module: str) -> None:
    """Forget the machine code of a module but for its latest few versions, and those of the last day."""
    used_s = {path: path.stat().st_mtime for path in home.glob(f"{module}-*") if path.is_dir()}
    oldest_s = time.time() - KEPT_S
    for folder in sorted(used_s, key=used_s.__getitem__)[:-KEPT_CACHES]:
        if used_s[folder] > oldest_s:
            continue
        for path in sorted(folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
        folder.rmdir()


@contextmanager
def compiling(what: str, stream: TextIO | None = None) -> Iterator[None]:
    """Show on a terminal that code is being compiled in the block, and how long it took; silent in a pipe.

    A block within another is silent, too. Where machine code cannot be kept, a pipe gets that once.
    """
    stream = sys.stderr if stream is None else stream
    _tell_if_not_kept(stream)
    if not stream.isatty() or not _line.acquire(blocking=False):
        yield
        return
    done = threading.Event()
    teller = threading.Thread(target=_tell, args=(what, stream, done), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()
        _line.release()


def _is_kept() -> bool:
    return cache_folder(Path(__file__)) is not None


def _tell_if_not_kept(stream: TextIO) -> None:
    if not _is_kept() and not _told and parent_process() is None:
        _told.append(True)
        stream.write(
            f"rambler-hil: machine code cannot be kept in {_caches()} and is compiled anew each time, by each process; "
            "NUMBA_CACHE_DIR can name another directory\n"
        )
        stream.flush()


def _tell(what: str, stream: TextIO, done: threading.Event) -> None:
    began_s, before_s, shown, ever = time.monotonic(), _compilations.seconds, False, False
    while not done.wait(TICK_S if shown else PATIENCE_S):
        if being_compiled():
            elapsed_s = time.monotonic() - began_s
            often = _HOW_OFTEN[not _is_kept()]
            stream.write(f"\r\x1b[Kcompiling {what} for this machine, {often} ... {elapsed_s:.0f} s")
        elif shown:
            stream.write("\r\x1b[K")
        shown = being_compiled()
        ever = ever or shown
        stream.flush()
    if ever:
        seconds = _compilations.seconds - before_s
        stream.write(f"\r\x1b[Kcompiled {what} for this machine in {seconds:.0f} s\n")
        stream.flush()
