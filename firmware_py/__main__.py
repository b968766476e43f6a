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
from firmware_py.files.standard_streams import open_closed_streams

# command -> (module, one line of help). Only the module of the command is imported: the autopilot does not load the
# bench tools.
COMMANDS = {
    "run": ("firmware_py.cli.run", "run the autopilot with the devices of a vehicle file"),
    "status": ("firmware_py.cli.status", "show the state of the autopilot on this computer"),
    "view": ("firmware_py.cli.view", "serve a live page of the boat for a browser"),
    "energy": ("firmware_py.cli.energy", "print watt-hours per day and consumer, from the thin log"),
    "listen": ("firmware_py.cli.listen", "open each device and show its decoded output"),
    "decode": ("firmware_py.cli.decode", "decode a capture with the decoders of the drivers"),
    "replay": ("firmware_py.cli.replay", "recompute a log and compare every rudder command"),
    "calibrate": (
        "firmware_py.cli.calibrate",
        "propose compass deviation, or rudder centre and limits; sets nothing",
    ),
    "plan": ("firmware_py.cli.plan", "check plan files; load them into a state directory, or save them from it"),
    "key": ("firmware_py.cli.key", "show, set or remove the signing key of a state directory"),
    "state": ("firmware_py.cli.state", "export or import the state of an autopilot, to move it to another computer"),
    "params": ("firmware_py.cli.params", "print the parameter table; check a parameter file"),
    "check": ("firmware_py.cli.check", "preflight check of devices, storage, clock, links and parameters"),
    "example": ("firmware_py.cli.example", "write a commented example of a vehicle file"),
    "service": ("firmware_py.cli.service", "install the autopilot as a service, show its status, or remove it"),
    "report": ("firmware_py.cli.report", "write a page with plots and figures of logs, or of a state directory"),
    "export": ("firmware_py.cli.export", "convert a log for other tools: csv, parquet, mcap (Foxglove), gpx, kml"),
    "update": (
        "firmware_py.cli.update",
        "install another version on trial from a bundle, or return to the previous one",
    ),
}

# Python's own modules for all hashes of hashlib. If one is missing, hashlib needs OpenSSL.
_PYTHON_HASHES = (
    "_md5",
    "_sha1",
    "_sha3",
    "_blake2",
    *(("_sha2",) if sys.version_info >= (3, 12) else ("_sha256", "_sha512")),
)

_END_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGHUP)
_M_MMAP_THRESHOLD, _MMAP_THRESHOLD_BYTES = -3, 1 << 16  # mallopt(3)
_NUMPY_BYTES = 80 << 20  # address space of the library of numpy and its buffer


class UsageError(Exception):
    """Wrong usage; the text is one line."""


class _Parser(argparse.ArgumentParser):
    """Parser that reports an error as one line with the remedy."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{self.prog}: {message}; see {self.prog} -h")


def _reduce_memory() -> None:
    """Save 5 MiB of memory; call before other imports.

    hashlib uses Python's own hashes: OpenSSL takes 4 MiB and 30 ms for one SHA-256. A fixed threshold makes the C
    library return large blocks to the system; by default the threshold grows with the blocks that imports use.
    """
    import ctypes  # noqa: PLC0415 - libffi opens a file, which must not become a standard stream

    if "_hashlib" not in sys.modules and all(map(importlib.util.find_spec, _PYTHON_HASHES)):
        sys.modules["_hashlib"] = None  # type: ignore[assignment] # None: cannot be imported
    with contextlib.suppress(AttributeError):  # another C library than glibc
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _MMAP_THRESHOLD_BYTES)


def _check_memory_limit() -> None:
    """Raise MemoryError if the memory limit is too low for the library of numpy, which would exit with code 1."""
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return
    import mmap  # noqa: PLC0415 - a limit is rare

    try:
        mmap.mmap(-1, _NUMPY_BYTES, flags=mmap.MAP_PRIVATE).close()
    except OSError:
        raise MemoryError from None


def _import_dialect() -> None:
    """Import pymavlink before other large modules, and delete its unused parts.

    Later imports then reuse that memory. Deletion after them would leave 1.5 MiB of unusable gaps.
    """
    if "pymavlink" in sys.modules:  # the importer may use all of it
        return
    from firmware_py.link.wire.dialect import release_unused_attributes  # noqa: PLC0415 - only used by `run`

    release_unused_attributes()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; return 0 for success, 1 for a finding, 2 for wrong usage or configuration."""
    open_closed_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    command_name = next((word for word in words if word in COMMANDS), None)
    if command_name != "run":
        return _run_command(words, command_name)
    # The signals wait until `run` handles them, which makes the rudder safe: an earlier run may have left it deflected.
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, _END_SIGNALS)
    try:
        return _run_command(words, command_name)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


def _run_command(words: list[str], command_name: str | None) -> int:
    """Import the module of the command and run it."""
    for stream in (sys.stdout, sys.stderr):  # a path may contain characters that the terminal lacks
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # no threads in the library of numpy
    gc.disable()  # imports create no garbage; collection takes a tenth of the start time
    if command_name == "run":
        _reduce_memory()
    parser = _Parser(prog="rambler", description="Autopilot for wave gliders and other very slow boats.")
    commit = commit_of(ROOT) if "--version" in words else ""  # runs git
    parser.add_argument("--version", action="version", version=version_text("rambler", commit))
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    try:
        if command_name == "run":
            _import_dialect()
            _check_memory_limit()
        for name, (module_name, text) in COMMANDS.items():
            command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
            if name == command_name:
                module = importlib.import_module(module_name)
                module.add_arguments(command)
                command.set_defaults(run=module.run)
        gc.enable()
        if any("\0" in word for word in words):
            parser.error("an argument contains a NUL character; remove it")
        parsed = parser.parse_args(words)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
    except UsageError as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader (head, less) has closed the pipe.
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
