"""Updates: a bundle is unpacked into a new environment, checked, and installed on trial by one rename.

After an interruption at any step (kill, full disk, power cut) the service can start a program: the previous one before
the rename, the new one after it, and the previous one again after a failed trial (program_link.py).
"""

from __future__ import annotations

import fcntl
import os
import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from firmware_py import ROOT, __version__, commit_of, commit_utc_s_of
from firmware_py.files.reading import read_regular
from firmware_py.install import environment as environments
from firmware_py.install.bundle import Bundle, UpdateError, check_computer, format_title, is_older, unpack
from firmware_py.install.environment import Environment, read_environment
from firmware_py.install.program_link import STARTS, TRIAL_S, UPDATE_FILE, ProgramLink, passed_line
from firmware_py.install.self_check import Candidate, read_printed_unit, self_check
from firmware_py.install.unit import Installation
from firmware_py.system.clock import machine_s
from firmware_py.system.state_directory import StateFiles
from firmware_py.system.status_file import Freshness, StatusReading, find_status

SIGNERS = Path("/etc/rambler/allowed_signers")
_POLL_INTERVAL_S, _MAX_START_S = 1.0, 90.0
_MAX_SLOT_BYTES = 1 << 18
_UMASK = 0o022  # so that the user of the service can read and run the files
Report = Callable[[str], None]


class Permissions(msgspec.Struct, frozen=True):
    """Exceptions that the operator permits: update while armed, update to an older version."""

    armed: bool
    older: bool


def update(
    installation: Installation, bundle_file: Path, signers: Path | None, permissions: Permissions, report: Report
) -> None:
    """Install a bundle on trial; raise UpdateError on failure, after which the installation is unchanged."""
    with _lock_installation(installation.link, installation.state) as (link, current, lock):
        _check_unarmed(installation.state, permissions)
        work = environments.create_work_directory(current)
        try:
            bundle = unpack(bundle_file, work / "wheels", signers)
            trust = "signed" if signers is not None else "hashes correct, signature not required"
            report(f"{bundle_file.name}: {bundle.title}, {trust}")
            check_computer(bundle)
            for package in environments.check_driver_packages(current, bundle):
                report(f"driver package {package}: the bundle contains it")
            _check_age(bundle, current, permissions, report)
            new = environments.new_environment(current, bundle)
            if new == current:
                raise UpdateError(f"{bundle.title} is already installed")
            previous = link.previous()
            kept = [current, *([Environment(previous.parents[1])] if previous is not None else []), new]
            for name in environments.remove_other_environments(kept):
                report(f"removed {name} of an earlier update")
            try:
                if new.bundle() != bundle:
                    environments.check_free_space(new, work / "wheels")
                    report(f"creating {new.path}: takes some minutes on a slow board")
                    environments.create(new, work / "wheels", bundle, lock)
                for line in self_check(Candidate(new, bundle, installation.vehicle, installation.state, work)):
                    report(line)
            except BaseException:
                if new not in kept[:-1]:
                    environments.remove_other_environments(kept[:-1])  # to free the space
                raise
        finally:
            shutil.rmtree(work, ignore_errors=True)
        _switch(installation, link, new, permissions, report)
        _compare_units(installation, new, report)


def roll_back(installation: Installation, permissions: Permissions, report: Report) -> None:
    """Install the previous version on trial; raise UpdateError without one."""
    with _lock_installation(installation.link) as (link, current, _lock):
        previous = link.previous()
        if previous is None or previous == current.program:
            raise UpdateError("there is no previous version")
        if not os.access(previous, os.X_OK):
            raise UpdateError(f"{previous} no longer exists; update with a bundle of that version (--older)")
        _switch(installation, link, Environment(previous.parents[1]), permissions, report)
        _compare_units(installation, Environment(previous.parents[1]), report)


def await_trial(installation: Installation, report: Report) -> bool:
    """Wait for the end of the trial; return whether it was passed."""
    link = installation.link
    program, starts = link.target(), 0
    end_s = time.monotonic() + STARTS * (TRIAL_S + _MAX_START_S)
    while time.monotonic() < end_s:
        if (failed := link.failed()) is not None:
            report(f"rolled back: {failed.name} has not passed its trial in {failed.starts} starts")
            return False
        if program is not None and StateFiles(installation.state).load(UPDATE_FILE) == passed_line(program).encode():
            link.end_trial()
            report("trial passed: the new version stays")
            return True
        trial = link.trial()
        if trial is None:
            report("trial passed before: the version stays")
            return True
        if trial.starts != starts:
            starts = trial.starts
            report(f"start {starts} of {STARTS}; passes after {TRIAL_S:.0f} s")
        time.sleep(_POLL_INTERVAL_S)
    report("trial not finished; the next starts decide, see rambler status")
    return False


@contextmanager
def _lock_installation(link: ProgramLink, state: Path | None = None) -> Iterator[tuple[ProgramLink, Environment, int]]:
    """Lock the installation against other updates; return link, environment and descriptor of the lock.

    Raises UpdateError if an update is impossible, and with a state directory also during a trial.
    """
    folder = link.path.parent
    previous_umask = os.umask(_UMASK)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        program = link.target()
        if program is None:
            raise UpdateError(
                f"{link.path} is not a link; replace it by a link to the program (ln -s), and repeat "
                "rambler service install VEHICLE.toml by that name"
            )
        current = read_environment(program)
        for directory in (folder, current.path.parent):
            if not os.access(directory, os.W_OK):
                raise UpdateError(f"{directory} is not writable; run this as root (sudo), and mount it for writing")
        if state is not None and (trial := link.trial()) is not None and not _has_passed(state, trial.program):
            raise UpdateError(
                f"{trial.name} is on trial ({trial.starts} starts so far); wait until it has passed, "
                "or use rambler update --back"
            )
        yield link, current, descriptor
    except BlockingIOError:
        raise UpdateError("another update is running; wait for its end") from None
    finally:
        os.close(descriptor)
        os.umask(previous_umask)


def _check_age(bundle: Bundle, current: Environment, permissions: Permissions, report: Report) -> None:
    installed = current.bundle()
    if not is_older(bundle, __version__, commit_utc_s_of(ROOT) if installed is None else installed.commit_utc_s):
        return
    title = format_title(__version__, commit_of(ROOT)) if installed is None else installed.title
    text = f"{bundle.title} is older than the installed {title}"
    if not permissions.older:
        raise UpdateError(f"{text}; to allow a downgrade, use --older")
    report(text)


def _check_unarmed(state: Path, permissions: Permissions) -> StatusReading:
    """Return the status; raise UpdateError if the boat is armed or this is unknown, unless permitted."""
    status = find_status(state, machine_s())
    if permissions.armed or (status.freshness is Freshness.ABSENT and not status.is_refused):
        return status
    if status.freshness is not Freshness.RUNNING or "armed" not in status.content:
        raise UpdateError(f"arming state unknown ({status.reason}); to update anyway, use --armed")
    if status.content["armed"]:
        raise UpdateError("the boat is armed; disarm it, or use --armed (the rudder is centred during the restart)")
    return status


def _switch(
    installation: Installation, link: ProgramLink, new: Environment, permissions: Permissions, report: Report
) -> None:
    """Install a program and end the running autopilot, so that the service starts the new program."""
    status = _check_unarmed(installation.state, permissions)
    link.switch(new.program)
    has_passed = _has_passed(installation.state, new.program)
    report(f"{link.path} points to {new.program}{'' if has_passed else f', on trial for {STARTS} starts'}")
    pid = int(status.content.get("pid", 0))
    if status.freshness is Freshness.ABSENT or not _is_autopilot(pid, link.path):
        report("no autopilot runs; the next start of the service uses it (sudo systemctl start rambler); waiting")
        return
    os.kill(pid, signal.SIGTERM)
    report(f"process {pid} ended; the service starts the new one")


def _has_passed(state: Path, program: Path) -> bool:
    """Return whether a program has passed a trial, from the record that the start script reads."""
    line = passed_line(program).encode().rstrip(b"\n")
    for slot in state.glob(f"{UPDATE_FILE}.[01]"):
        with suppress(OSError, ValueError):
            if line in read_regular(slot, _MAX_SLOT_BYTES, follow_symlinks=False).split(b"\n"):
                return True
    return False


def _compare_units(installation: Installation, new: Environment, report: Report) -> None:
    """Report if the unit of the new version differs from the installed unit, which remains usable."""
    unit = read_printed_unit(new.program, [*installation.service_arguments, "--program", str(installation.link.path)])
    if unit is not None and unit != installation.unit:
        command = shlex.join(["rambler", "service", "install", *installation.service_arguments])
        report(f"the new version has another service unit; after the trial: sudo {command}")


def _is_autopilot(pid: int, program: Path) -> bool:
    """Return whether a process is an autopilot started by the link, because the pid in a status may be forged."""
    try:
        arguments = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return os.fsencode(program) in arguments and b"run" in arguments
