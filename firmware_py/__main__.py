"""The command line `rambler`."""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import importlib.util
import io
import os
import resource
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from firmware_py import ROOT, commit_of, version_text
from firmware_py.common.system_errors import system_error_text
from firmware_py.files.standard_streams import keep_standard_streams

# command -> (module, one line of help). A module is imported only when it is asked for, so
# that the autopilot carries nothing of the bench tools.
COMMANDS = {
    "run": ("firmware_py.cli.run", "run the autopilot on the ports that a vehicle file names"),
    "status": ("firmware_py.cli.status", "what the autopilot that runs on this computer says of itself"),
    "view": ("firmware_py.cli.view", "a page of the boat under way, for a browser"),
    "energy": ("firmware_py.cli.energy", "watt-hours by day and by consumer, from the thin log"),
    "listen": ("firmware_py.cli.listen", "open each device and show what it says"),
    "decode": ("firmware_py.cli.decode", "decode a capture with the drivers themselves"),
    "replay": ("firmware_py.cli.replay", "recompute a log and compare every rudder command"),
    "calibrate": (
        "firmware_py.cli.calibrate",
        "the compass's deviation, the rudder's centre and limits: proposed, never set",
    ),
    "plan": ("firmware_py.cli.plan", "check plan files; take plans into and out of a stopped autopilot's state"),
    "key": ("firmware_py.cli.key", "the key of signed frames in a state directory: show its state, set it, remove it"),
    "state": ("firmware_py.cli.state", "take the state of an autopilot to another computer: one file out, one in"),
    "params": ("firmware_py.cli.params", "the parameter table; check a parameter file"),
    "check": ("firmware_py.cli.check", "a preflight of devices, storage, clock and parameters"),
    "example": ("firmware_py.cli.example", "write a commented vehicle file to begin with"),
    "service": ("firmware_py.cli.service", "the autopilot as a service: print its files, install, status, remove"),
    "report": ("firmware_py.cli.report", "a page with the pictures and figures of logs, or of a state directory"),
    "export": ("firmware_py.cli.export", "a log as a file for other tools: csv, parquet, mcap (Foxglove), gpx, kml"),
    "update": ("firmware_py.cli.update", "put another version in force, on trial, from a bundle; or the one before"),
}


# Each hash that hashlib knows has a module of Python's own; without one of them OpenSSL's are needed.
_OWN_HASHES = (
    "_md5",
    "_sha1",
    "_sha3",
    "_blake2",
    *(("_sha2",) if sys.version_info >= (3, 12) else ("_sha256", "_sha512")),
)

_ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGHUP)
_M_MMAP_THRESHOLD, _LARGE_BYTES = -3, 1 << 16  # mallopt(3)
_LIBRARY_BYTES = 80 << 20  # what numpy's library and its buffer take of the addresses


class UsageError(Exception):
    """Bad usage, told in one line."""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line that names the remedy."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{self.prog}: {message}; see {self.prog} -h")


def _be_small() -> None:
    """Keep the autopilot out of 5 MiB that it has no use for; before anything else of it is imported.

    hashlib takes Python's own hashes: OpenSSL is 4 MiB, and 30 ms of the start, for one SHA-256. And the C library
    gives large pieces of memory back: it would keep more of them the larger those are that imports have used.
    """
    import ctypes  # noqa: PLC0415 - libffi keeps a file open from then on, which must not become a standard stream

    if "_hashlib" not in sys.modules and all(map(importlib.util.find_spec, _OWN_HASHES)):
        sys.modules["_hashlib"] = None  # type: ignore[assignment] # what is None there counts as missing
    with contextlib.suppress(AttributeError):  # another C library than glibc
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def _want_memory() -> None:
    """Raise MemoryError where a limit leaves too little for numpy's library, which would end the process with 1."""
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return
    import mmap  # noqa: PLC0415 - hardly anybody sets a limit

    try:
        mmap.mmap(-1, _LIBRARY_BYTES, flags=mmap.MAP_PRIVATE).close()
    except OSError:
        raise MemoryError from None


def _take_dialect() -> None:
    """Import pymavlink before all that is large, and forget what of it is not used.

    What is imported afterwards lies where that was; forgotten last it left 1.5 MiB of holes.
    """
    if "pymavlink" in sys.modules:  # of somebody else, who may want all of it
        return
    from firmware_py.link.wire.dialect import forget_what_is_not_used  # noqa: PLC0415 - no other command wants it

    forget_what_is_not_used()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; 0 success, 1 a finding, 2 bad usage or configuration."""
    keep_standard_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    wanted = next((word for word in words if word in COMMANDS), None)
    if wanted != "run":
        return _run(words, wanted)
    # Until `run` takes them: the run before may have left the rudder over, and this one is to make it safe.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        return _run(words, wanted)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _run(words: list[str], wanted: str | None) -> int:
    """Import the module of the command that is wanted, and run it."""
    for stream in (sys.stdout, sys.stderr):  # a path may hold what the terminal's alphabet has not
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's library would start threads that nobody needs
    gc.disable()  # imports make no garbage, and looking for it takes a tenth of the start
    if wanted == "run":
        _be_small()
    parser = _Parser(prog="rambler", description="Autopilot for wave gliders and other very slow boats.")
    commit = commit_of(ROOT) if "--version" in words else ""  # git is asked only then
    parser.add_argument("--version", action="version", version=version_text("rambler", commit))
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    try:
        if wanted == "run":
            _take_dialect()
            _want_memory()
        for name, (module_name, text) in COMMANDS.items():
            command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
            if name == wanted:
                module = importlib.import_module(module_name)
                module.add_arguments(command)
                command.set_defaults(run=module.run)
        gc.enable()
        if any("\0" in word for word in words):
            parser.error("a word of the command line holds a NUL, which no path and no name does")
        parsed = parser.parse_args(words)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
    except UsageError as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader (head, less) has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        text = system_error_text(error)
        if not text:
            raise
        print(f"rambler: {text}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return code


if __name__ == "__main__":
    sys.exit(main())
