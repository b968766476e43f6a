"""Compiles numerical functions with numba, once per machine, and shows the first time as progress.

    @compiled
    def kernel(...): ...

compiles a function of the laboratory, which runs plain as `kernel.py_func`. It may call other such functions and those
of the firmware's numeric core (hil/lab/numeric_core.py, where the arithmetic is described).
"""

from __future__ import annotations

import ctypes
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
from typing import Any, Final, TextIO, TypeVar

import llvmlite.binding
import numba
import numba.core.registry
from numba.core import codegen, event
from numba.core import config as numba_config

from firmware_py.model import kt
from hil.lab.held_signals import HeldSignals
from hil.lab.numeric_core import ERROR_MODEL

Function = TypeVar("Function", bound=Callable[..., Any])

PATIENCE_S = 0.4  # what is loaded from the cache takes less, and says nothing
TICK_S = 0.5
KEPT_CACHES, KEPT_S = 4, 86400.0  # so many, and all of the last day: another program may be using them
_HOW_OFTEN: Final = {False: "the first time only", True: "as each time"}

PACKAGE = Path(__file__).parents[1]
COMPILES = re.compile(rb"hil\.lab\.compiled")
IMPORTED = re.compile(rb"^from ((?:hil|firmware_py)[\w.]*) import", re.MULTILINE)
config: Any = numba_config  # numba makes its settings at run time, unseen by type checkers


def use_whole_registers() -> None:
    """Let loops use vector registers of 512 bits where there are some, also where they are not the compiler's choice.

    A processor clocks slower with them, but the simulations run half as fast again. Which lane computes
    a value does not change it. Asked for by NUMBA_CPU_FEATURES, other features stay as they were asked for.
    """
    if config.CPU_FEATURES is not None:
        return
    features = str(codegen.get_host_cpu_features())  # type: ignore[no-untyped-call]
    if "+avx512f" in features.split(","):
        config.CPU_FEATURES = f"{features},-prefer-256-bit"


use_whole_registers()


def ask_the_c_library() -> None:
    """Let compiled code call the functions that Python's math calls, not the older ones that numba was linked with.

    They compute the same, but the older ones look at each argument first.
    """
    context: Any = numba.core.registry.cpu_target.target_context  # made here, for it names its own
    library = ctypes.CDLL(None)
    for name in ("exp", "log", "pow"):
        if context is not None and hasattr(library, name):
            llvmlite.binding.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)


ask_the_c_library()


class _Compilations(event.Listener):
    """Counts the compilations under way; what comes from the cache is none."""

    def __init__(self) -> None:
        self.under_way = 0

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Note one more."""
        self.under_way += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Note one less."""
        self.under_way -= 1


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

    Without any place to keep it (no home, a read-only disk) it is compiled anew each time.
    """
    return _compile(function, keep=True)


def compiled_here(function: Function) -> Function:
    """Compile a function for this process alone, as one must that takes other functions as arguments."""
    return _compile(function, keep=False)


def _compile(function: Function, *, keep: bool) -> Function:
    folder = cache_folder() if keep else None
    if folder is None:
        return _njit(function, keep=False)
    usual = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        return _njit(function, keep=True)
    except RuntimeError:
        # numba found the folder unusable after all.
        return _njit(function, keep=False)
    finally:
        config.CACHE_DIR = usual


def _njit(function: Function, *, keep: bool) -> Function:
    # nogil: several threads may share the work, and the one that tells of progress gets its turn.
    return numba.njit(function, cache=keep, error_model=ERROR_MODEL, nogil=True)  # type: ignore[no-any-return]


@cache
def cache_folder() -> Path | None:
    """Return where machine code is kept, or None where nothing can be.

    numba renews a function's machine code when its own file changes, but not when a function
    that it calls does: a changed K-T equation would live on in old kernels. So the folder
    is named after the text of all files that hold compiled functions.
    """
    home = _caches()
    if home.parts[0] == "~":  # of a user without a home; it would be made wherever one is
        return None
    folder = home / sources_digest()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            return None
    except OSError:
        return None
    with suppress(OSError):  # another process drops the same
        _drop_old(home)
    return folder


def _caches() -> Path:
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - Path.expanduser raises without a home
    return Path(base) / "rambler-hil"


def sources_digest() -> str:
    """Return a digest of the model, and of every file of this package that imports this module.

    So of the files from which these import, and of the C library's version: a constant is compiled into what uses it.
    """
    digest = hashlib.sha256(" ".join((numba.__version__, *platform.libc_ver())).encode())
    files = set(Path(kt.__file__).parent.glob("*.py"))
    for path in PACKAGE.rglob("*.py"):
        text = path.read_bytes()
        if COMPILES.search(text) or path == Path(__file__):
            files |= {path, *_imported(text)}
    for path in sorted(files):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _imported(text: bytes) -> Iterator[Path]:
    """Yield the files of both programs from which a file imports names."""
    for name in IMPORTED.findall(text):
        path = PACKAGE.parent / f"{name.decode().replace('.', '/')}.py"
        if path.is_file():
            yield path


def _drop_old(home: Path) -> None:
    """Forget the machine code of all but the latest few versions of the sources, and those of the last day."""
    used_s = {path: path.stat().st_mtime for path in home.iterdir() if path.is_dir()}
    oldest_s = time.time() - KEPT_S
    for folder in sorted(used_s, key=used_s.__getitem__)[:-KEPT_CACHES]:
        if used_s[folder] > oldest_s:
            continue
        for path in sorted(folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
        folder.rmdir()


@contextmanager
def compiling(what: str, stream: TextIO | None = None) -> Iterator[None]:
    """Say on a terminal when code is being compiled in the block; silent in a pipe, and within another such block.

    Where machine code cannot be kept, that is told in a pipe, too, once.
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


def _tell_if_not_kept(stream: TextIO) -> None:
    if cache_folder() is None and not _told and parent_process() is None:
        _told.append(True)
        stream.write(
            f"rambler-hil: machine code cannot be kept in {_caches()} and is compiled anew each time, by each process; "
            "NUMBA_CACHE_DIR can name another directory\n"
        )
        stream.flush()


def _tell(what: str, stream: TextIO, done: threading.Event) -> None:
    began_s, shown = time.monotonic(), False
    while not done.wait(TICK_S if shown else PATIENCE_S):
        if being_compiled():
            elapsed_s = time.monotonic() - began_s
            often = _HOW_OFTEN[cache_folder() is None]
            stream.write(f"\r\x1b[Kcompiling {what} for this machine, {often} ... {elapsed_s:.0f} s")
        elif shown:
            stream.write("\r\x1b[K")
        shown = being_compiled()
        stream.flush()
    if shown:
        stream.write("\r\x1b[K")
        stream.flush()
