"""The directory of a run: kept to oneself, cleared of the run before, begun with a state that was given."""

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

MOST_STATE_BYTES = 8 << 20  # of one file; an upload has 1 MiB at most
TRUTH_FILE, FIRMWARE_LOG, VEHICLE_NAME, STATE = "truth.csv", "firmware.log", "vehicle.toml", "state"
SUMMARY, PAGE, PICTURE = "summary.json", "report.html", "run.png"
CAMPAIGN = "campaign.json"  # of a directory that is not a run's
# What an earlier run has left: nobody shall take it for what this one came to.
FILES = (TRUTH_FILE, FIRMWARE_LOG, VEHICLE_NAME, run_file.NAME, SUMMARY, PAGE, PICTURE)
_EARLIER = ".earlier"  # the files of an earlier run, until this one has begun
_PARTLY = ".earlier-moving"  # some of them, while they are moved


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep a directory of a run to oneself; UsageError while another run or report has it.

    The lock is the kernel's and of the directory itself: nothing is left behind, however this process ends.
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
                f"output directory {out}: another run is under way in it; give another, or wait for its end"
            ) from None
        yield
    finally:
        os.close(descriptor)


def check_name(directory: Path) -> None:
    """UsageError for a directory whose path cannot stand in the files that are written there."""
    try:
        str(directory.absolute()).encode()
    except UnicodeEncodeError:
        raise UsageError(
            f"directory {directory.absolute()}: not representable in this locale; use another name, or LC_ALL=C.UTF-8"
        ) from None


def check_free(out: Path, names: tuple[str, ...]) -> None:
    """UsageError for a directory that belongs to a run or a campaign, by what such a one has in it."""
    for name in names:
        if (out / name).exists():
            what = "a campaign" if name == CAMPAIGN else "a run"
            raise UsageError(f"output directory {out} holds {what}, whose results would be lost; give another")


def prepare_directory(out: Path, begin_with: Path | None = None) -> None:
    """Make the output directory, with a copy of a state in it, and set an earlier run aside; or raise UsageError.

    `remove_earlier` deletes the earlier run when this one has begun, `restore_earlier` restores it when it is refused.
    The copy is made first: it may be of the earlier run's state, and one that cannot be made leaves that run whole.
    """
    check_free(out, (CAMPAIGN,))
    state = out / STATE
    try:
        out.mkdir(parents=True, exist_ok=True)
        restore_earlier(out)  # of a process that was killed before its run had begun
        with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
            copied = Path(directory) / STATE
            if begin_with is not None:
                copy_state(begin_with, copied)
            # What the autopilot remembers would change the run. But never remove what no run's autopilot has made.
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
    """Replace what a run that was refused has left by the earlier run that was set aside, if any."""
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
    """Report which run is replaced, if one was set aside, and delete it."""
    earlier = out / _EARLIER
    if not earlier.exists():
        return
    if any((earlier / name).exists() for name in (run_file.NAME, VEHICLE_NAME)):
        try:
            before = f"the run of {run_file.read(earlier).begun}"
        except UsageError:  # of another version
            before = "an earlier run"
        print(f"rambler-hil: {out}: {before} is replaced; another --out keeps both", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix=".state-", dir=out) as directory:
        earlier.rename(Path(directory) / STATE)


def copy_state(state: Path, target: Path) -> None:
    """Copy the state directory that the autopilot is to begin with, the logs left out; UsageError when it cannot be."""
    try:
        ignored = shutil.ignore_patterns("logs", "lock")
        shutil.copytree(state, target, ignore=ignored, copy_function=_copy_file)
    except FileNotFoundError:
        remedy = f"make it: rambler plan load FILE --state {shlex.quote(str(state))}"
        raise UsageError(f"state directory {state} is not there; name another, or {remedy}") from None
    except OSError as error:
        reasons = [str(reason) for *_, reason in error.args[0]] if isinstance(error, shutil.Error) else [str(error)]
        text = re.sub(r"\[Errno \d+\] ", "", "; ".join(reasons))
        raise UsageError(f"state directory {state} cannot be copied: {text}") from None


def _copy_file(source: str, target: str) -> None:
    """Copy a file of a state directory, and nothing that is no file or has no end."""
    try:
        content = read_regular(Path(source), MOST_STATE_BYTES, follow=False)
        mode = stat.S_IMODE(os.lstat(source).st_mode) | stat.S_IWUSR
        Path(target).touch(mode=mode)  # a key stays as secret as it was
        Path(target).write_bytes(content)
    except OSError as error:
        raise OSError(error.errno, error.strerror, source) from None
