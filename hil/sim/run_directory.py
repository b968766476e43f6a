"""The output directory of a run: lock, replacement of an earlier run, copy of an initial state."""

from __future__ import annotations

import fcntl
import os
import re
import shlex
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firmware_py.files.reading import read_regular
from hil.errors import UsageError
from hil.sim import run_file

MAX_STATE_FILE_BYTES = 8 << 20  # an upload has 1 MiB at most
TRUTH_FILE, FIRMWARE_LOG, VEHICLE_NAME, STATE = "truth.csv", "firmware.log", "vehicle.toml", "state"
SUMMARY, PAGE, PICTURE = "summary.json", "report.html", "run.png"
CAMPAIGN = "campaign.json"  # marks the directory of a campaign
# Files of a run; those of an earlier run must not be mistaken for those of this one.
FILES = (TRUTH_FILE, FIRMWARE_LOG, VEHICLE_NAME, run_file.NAME, SUMMARY, PAGE, PICTURE)
_EARLIER = ".earlier"  # the files of an earlier run, until this one has begun
_PARTIAL_EARLIER = ".earlier-moving"  # some of them, while they are moved


@contextmanager
def locked_directory(out: Path) -> Iterator[None]:
    """Lock the directory of a run; raise UsageError if another run or report has locked it.

    The kernel releases the lock on the directory when this process ends; there is no lock file.
    """
    check_name(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(out, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise UsageError(f"output directory {out}: {error.strerror}; give another --out") from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(
                f"output directory {out}: another run is under way in it; give another --out, or wait for its end"
            ) from None
        yield
    finally:
        os.close(descriptor)


def check_name(directory: Path) -> None:
    """Raise UsageError for a path that cannot be written in the files of a run."""
    try:
        str(directory.absolute()).encode()
    except UnicodeEncodeError:
        raise UsageError(
            f"directory {directory.absolute()}: not representable in this locale; use another name, or LC_ALL=C.UTF-8"
        ) from None


def check_free(out: Path, names: tuple[str, ...]) -> None:
    """Raise UsageError if the directory contains one of these files of a run or a campaign."""
    for name in names:
        if (out / name).exists():
            kind = "a campaign" if name == CAMPAIGN else "a run"
            raise UsageError(f"output directory {out} holds {kind}, which would be overwritten; give another --out")


def prepare_directory(out: Path, initial_state: Path | None = None) -> None:
    """Copy the initial state into the output directory and set an earlier run aside; raise UsageError if that fails.

    `remove_earlier` deletes the earlier run when this one has begun; `restore_earlier` restores it if this one fails.
    The copy is made first: its source may be the state of the earlier run, and if it fails that run is unchanged.
    """
    check_free(out, (CAMPAIGN,))
    state = out / STATE
    try:
        out.mkdir(parents=True, exist_ok=True)
        restore_earlier(out)  # set aside by a process that was killed before its run had begun
        with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
            copy = Path(directory) / STATE
            if initial_state is not None:
                copy_state(initial_state, copy)
            # An old state would change the run, but a directory that no run has created must not be removed.
            if state.exists() and not (out / FIRMWARE_LOG).exists():
                raise UsageError(f"{state} exists and is not of an earlier run; give another --out")
            if earlier := [name for name in (STATE, *FILES) if (out / name).exists()]:
                (out / _PARTIAL_EARLIER).mkdir()
                for name in earlier:
                    (out / name).rename(out / _PARTIAL_EARLIER / name)
                (out / _PARTIAL_EARLIER).rename(out / _EARLIER)
            if initial_state is not None:
                (out / FIRMWARE_LOG).touch()
                copy.rename(state)
    except OSError as error:
        raise UsageError(f"output directory {out}: {error.strerror}; give another --out") from None


def restore_earlier(out: Path) -> None:
    """Replace the files of a failed run by the earlier run, if one was set aside."""
    if (out / _EARLIER).exists():
        shutil.rmtree(out / STATE, ignore_errors=True)
        for name in FILES:
            (out / name).unlink(missing_ok=True)
        (out / _EARLIER).rename(out / _PARTIAL_EARLIER)
    if (out / _PARTIAL_EARLIER).exists():
        for path in (out / _PARTIAL_EARLIER).iterdir():
            path.rename(out / path.name)
        (out / _PARTIAL_EARLIER).rmdir()


def remove_earlier(out: Path) -> None:
    """Delete the earlier run, if one was set aside, and print its date."""
    earlier = out / _EARLIER
    if not earlier.exists():
        return
    if any((earlier / name).exists() for name in (run_file.NAME, VEHICLE_NAME)):
        try:
            description = f"the run of {run_file.read(earlier).begun}"
        except UsageError:  # from another version
            description = "an earlier run"
        print(f"rambler-hil: {out}: {description} is replaced; use another --out to keep both", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
        earlier.rename(Path(directory) / STATE)


def copy_state(state: Path, target: Path) -> None:
    """Copy the initial state directory of the autopilot without its logs; raise UsageError if that fails."""
    try:
        ignored = shutil.ignore_patterns("logs", "lock")
        shutil.copytree(state, target, ignore=ignored, copy_function=_copy_file)
    except FileNotFoundError:
        remedy = f"create it with rambler plan load FILE --state {shlex.quote(str(state))}"
        raise UsageError(f"state directory {state} does not exist; name another, or {remedy}") from None
    except OSError as error:
        reasons = [str(reason) for *_, reason in error.args[0]] if isinstance(error, shutil.Error) else [str(error)]
        text = re.sub(r"\[Errno \d+\] ", "", "; ".join(reasons))
        raise UsageError(f"state directory {state} cannot be copied: {text}") from None


def _copy_file(source: str, target: str) -> None:
    """Copy a regular file of limited size from a state directory."""
    try:
        content = read_regular(Path(source), MAX_STATE_FILE_BYTES, follow_symlinks=False)
        mode = stat.S_IMODE(os.lstat(source).st_mode) | stat.S_IWUSR
        Path(target).touch(mode=mode)  # keys need restricted permissions before they are written
        Path(target).write_bytes(content)
    except OSError as error:
        raise OSError(error.errno, error.strerror, source) from None
