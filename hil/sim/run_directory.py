"""The output directory of a run: locked, cleared of the earlier run, prepared with a copy of a state."""

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
# Files of an earlier run, which must not be mistaken for those of this one.
FILES = (TRUTH_FILE, FIRMWARE_LOG, VEHICLE_NAME, run_file.NAME, SUMMARY, PAGE, PICTURE)
_EARLIER = ".earlier"  # the files of an earlier run, until this one has begun
_PARTLY = ".earlier-moving"  # some of them, while they are moved


@contextmanager
def locked_directory(out: Path) -> Iterator[None]:
    """Lock the directory of a run; UsageError while another run or report has locked it.

    The lock is a kernel lock on the directory itself: no file is left behind, however this process ends.
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
    """Raise UsageError for a directory that holds one of the named files of a run or a campaign."""
    for name in names:
        if (out / name).exists():
            what = "a campaign" if name == CAMPAIGN else "a run"
            raise UsageError(f"output directory {out} holds {what}, which would be overwritten; give another --out")


def prepare_directory(out: Path, begin_with: Path | None = None) -> None:
    """Prepare the output directory: copy a state into it and set an earlier run aside; or raise UsageError.

    `remove_earlier` deletes the earlier run when this one has begun; `restore_earlier` restores it if this one fails.
    The copy comes first: its source may be the earlier run's state, and if it fails the earlier run stays intact.
    """
    check_free(out, (CAMPAIGN,))
    state = out / STATE
    try:
        out.mkdir(parents=True, exist_ok=True)
        restore_earlier(out)  # left by a process that was killed before its run had begun
        with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
            copied = Path(directory) / STATE
            if begin_with is not None:
                copy_state(begin_with, copied)
            # An old state would change the run. But never remove a directory that was not created by a run.
            if state.exists() and not (out / FIRMWARE_LOG).exists():
                raise UsageError(f"{state} exists and is not of an earlier run; give another --out")
            if earlier := [name for name in (STATE, *FILES) if (out / name).exists()]:
                (out / _PARTLY).mkdir()
                for name in earlier:
                    (out / name).rename(out / _PARTLY / name)
                (out / _PARTLY).rename(out / _EARLIER)
            if begin_with is not None:
                (out / FIRMWARE_LOG).touch()
                copied.rename(state)
    except OSError as error:
        raise UsageError(f"output directory {out}: {error.strerror}; give another --out") from None


def restore_earlier(out: Path) -> None:
    """Restore the earlier run that was set aside, if any, in place of the files of a failed run."""
    if (out / _EARLIER).exists():
        shutil.rmtree(out / STATE, ignore_errors=True)
        for name in FILES:
            (out / name).unlink(missing_ok=True)
        (out / _EARLIER).rename(out / _PARTLY)
    if (out / _PARTLY).exists():
        for path in (out / _PARTLY).iterdir():
            path.rename(out / path.name)
        (out / _PARTLY).rmdir()


def remove_earlier(out: Path) -> None:
    """Print which earlier run is replaced, if one was set aside, and delete it."""
    earlier = out / _EARLIER
    if not earlier.exists():
        return
    if any((earlier / name).exists() for name in (run_file.NAME, VEHICLE_NAME)):
        try:
            before = f"the run of {run_file.read(earlier).begun}"
        except UsageError:  # from another version
            before = "an earlier run"
        print(f"rambler-hil: {out}: {before} is replaced; use another --out to keep both", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
        earlier.rename(Path(directory) / STATE)


def copy_state(state: Path, target: Path) -> None:
    """Copy the initial state directory of the autopilot without its logs; UsageError when that fails."""
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
        content = read_regular(Path(source), MAX_STATE_FILE_BYTES, follow=False)
        mode = stat.S_IMODE(os.lstat(source).st_mode) | stat.S_IWUSR
        Path(target).touch(mode=mode)  # a key keeps its permissions
        Path(target).write_bytes(content)
    except OSError as error:
        raise OSError(error.errno, error.strerror, source) from None
